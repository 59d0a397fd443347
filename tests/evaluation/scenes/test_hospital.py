"""Seeded hospitals."""

from __future__ import annotations

import numpy as np
from evaluation.scenes.buildings.hospital import Hospital, Size, hospital
from evaluation.scenes.buildings.hospital_text import hgraph_of
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from waychair.maps.building.graph_arrays import NO_HEADING
from waychair.maps.building.indexed import indexed


def small() -> Hospital:
    """Return a hospital of four storeys."""
    return hospital(Size(4, 6, 10, 6), seed=3)


def test_every_goal_reaches_every_other_and_no_node_has_more_than_four_arcs() -> None:
    made = small()
    graph, count = made.graph, len(made.graph.xy)
    matrix = csr_array((np.ones(len(graph.tail)), (graph.tail, graph.head)), shape=(count, count))
    component = connected_components(matrix, connection="strong")[1]
    assert len(set(component[made.goals].tolist())) == 1
    assert np.bincount(graph.tail[graph.heading != NO_HEADING]).max() <= 4


def test_the_same_seed_gives_the_same_hospital_and_its_model_the_same_costs() -> None:
    made = small()
    assert np.array_equal(made.graph.cost, small().graph.cost)
    assert not np.array_equal(made.graph.xy, hospital(Size(4, 6, 10, 6), seed=4).graph.xy[: len(made.graph.xy)])
    built = indexed(hgraph_of(made))
    assert len(built.graph.xy) == len(made.graph.xy)
    assert np.array_equal(np.sort(built.graph.cost), np.sort(made.graph.cost))
