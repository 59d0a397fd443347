"""Loop closure by proximity: where the chair may be back, and the matches that prove it.

A candidate is a run of earlier key scans near the present one whose way round the graph is long. Its uncertainty,
and with it the search window, grows with that way. A loop is accepted by geometry (enough of the query lies on the
reference's surfaces, no second place in the window fits nearly as well), never by the likelihood alone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from waychair.config import Settings, setting
from waychair.slam.graph import Edge
from waychair.types import FloatArray, IntArray


@dataclass(frozen=True, slots=True)
class LoopSettings(Settings):
    """Where loops are looked for and when one is believed."""

    radius: float = setting(4.0, "m", "a candidate lies within this distance, beyond the uncertainty", low=0.5, high=50)
    min_way: float = setting(5.0, "m", "shortest way round the graph that counts as a loop", low=1.0, high=1000.0)
    drift: float = setting(0.03, "m/m", "growth of the position's uncertainty per metre of the way", low=0.0, high=1.0)
    turn_drift: float = setting(0.01, "rad/m", "growth of the heading's uncertainty", low=0.0, high=1.0)
    min_window: float = setting(0.3, "m", "smallest half window of the search", low=0.05, high=10.0)
    max_window: float = setting(4.0, "m", "largest half window of the search", low=0.05, high=50.0)
    max_angle: float = setting(0.7, "rad", "largest half window of the heading", low=0.05, high=math.pi)
    spacing: float = setting(0.5, "m", "distance driven between two searches", low=0.0, high=100.0)
    chains: int = setting(2, "", "candidates tried at each search", low=1, high=20)
    chain_reach: float = setting(
        4.0, "m", "key scans of a chain this near to its nearest one are matched against", low=0.5, high=20.0
    )
    query_scans: int = setting(6, "", "latest key scans that are matched together", low=1, high=50)
    min_response: float = setting(0.5, "", "least mean likelihood", low=0.0, high=1.0)
    min_inliers: float = setting(0.7, "", "least share of points on the reference's surfaces", low=0.0, high=1.0)
    max_ambiguity: float = setting(0.9, "", "largest runner-up response over the winner's", low=0.0, high=1.0)


@dataclass(frozen=True, slots=True)
class Candidate:
    """A run of earlier key scans: its nearest node, its members, and the half window of the search [m], [rad]."""

    nearest: int
    members: IntArray
    window: float
    angle: float


def graph_distances(poses: FloatArray, edges: Sequence[Edge], node: int) -> FloatArray:
    """(N,) length [m] of the shortest way over the edges from a node to every node."""
    i = np.array([edge.i for edge in edges], np.int64)
    j = np.array([edge.j for edge in edges], np.int64)
    lengths = np.hypot(*(poses[i, :2] - poses[j, :2]).T) + 1e-3
    graph = csr_matrix((lengths, (i, j)), shape=(len(poses), len(poses)))
    distances: FloatArray = dijkstra(graph, directed=False, indices=node)
    return distances


def candidates(poses: FloatArray, edges: Sequence[Edge], recent: int, settings: LoopSettings) -> tuple[Candidate, ...]:
    """Chains of nodes before `recent` that the last node may have come back to, nearest first."""
    node = len(poses) - 1
    if recent < 1:
        return ()
    away = np.hypot(*(poses[:recent, :2] - poses[node, :2]).T)
    ways = graph_distances(poses, edges, node)[:recent]
    windows = np.clip(settings.drift * ways, settings.min_window, settings.max_window)
    near = np.flatnonzero((away < settings.radius + windows) & (ways > settings.min_way))
    if len(near) == 0:
        return ()
    found = []
    for chain in np.split(near, np.flatnonzero(np.diff(near) > 3) + 1):
        nearest = int(chain[np.argmin(away[chain])])
        low = max(0, chain[0] - 5)
        members = np.arange(low, min(recent, chain[-1] + 6))
        reach = np.hypot(*(poses[members, :2] - poses[nearest, :2]).T)
        angle = min(settings.max_angle, 0.15 + settings.turn_drift * ways[nearest])
        found.append(Candidate(nearest, members[reach < settings.chain_reach], float(windows[nearest]), float(angle)))
    found.sort(key=lambda candidate: float(away[candidate.nearest]))
    return tuple(found[: settings.chains])
