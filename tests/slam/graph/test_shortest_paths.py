"""Lengths of shortest paths: those of scipy, also where nodes are unreachable and edges lie side by side."""

from __future__ import annotations

import math

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from waychair.slam.graph.shortest_paths import shortest_paths


def test_paths_through_random_graphs_are_the_shortest() -> None:
    rng = np.random.default_rng(3)
    for edges in (30, 60, 200):
        pairs = np.unique(rng.integers(0, 50, (edges, 2)), axis=0)
        pairs = pairs[pairs[:, 0] < pairs[:, 1]]
        lengths = rng.uniform(0.1, 4.0, len(pairs))
        graph = csr_matrix((lengths, pairs.T), shape=(50, 50))
        np.testing.assert_allclose(
            shortest_paths(*pairs.T, lengths, 50, 7), dijkstra(graph, directed=False, indices=7), rtol=1e-12
        )


def test_of_two_edges_between_the_same_nodes_the_shorter_counts() -> None:
    i, j = np.array([0, 0, 1]), np.array([1, 1, 2])
    assert shortest_paths(i, j, np.array([5.0, 2.0, 1.0]), 4, 2).tolist() == [3.0, 1.0, 0.0, math.inf]
