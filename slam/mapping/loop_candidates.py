"""Where a chair may have returned to: key scans near it on the map, and submaps where drift makes its position useless."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from waychair.config import Settings, setting
from waychair.slam.graph.edges import Edge, EdgeArrays, edge_arrays
from waychair.slam.graph.shortest_paths import shortest_paths
from waychair.slam.mapping.loop_searches import LoopCandidate
from waychair.types import FloatArray, IntArray

MIN_LOOP_PATH = 5.0
"""Shortest path [m] through the graph that counts as a loop."""

CHAIN_REACH = 4.0
"""Key scans of a chain this near [m] to its nearest one are matched against."""

MIN_WINDOW, MAX_WINDOW = 0.3, 4.0
"""Smallest and largest half window [m] of a search near the chair."""

MAX_ANGLE, TURN_DRIFT = 0.7, 0.01
"""Largest half window of the heading [rad], and growth of its uncertainty with the path [rad/m]."""

_UNKNOWN_LENGTH = 1e4  # m; of an edge of unknown motion; longer than any path
_LEAST_LENGTH = 1e-3  # m; of an edge
_RADIUS = 4.0  # m; a candidate lies within this distance, beyond the uncertainty
_CHAINS = 2  # candidates tried at each search
_SUBMAP_SCANS = 40  # key scans of a submap that is searched as a whole
_LEAST_SUBMAP = 5  # key scans; fewer before a tear show too little of a place
_FAR_DRIFT = 3.0  # times the assumed drift; the chair is hardly ever farther from where the map says


@dataclass(frozen=True, slots=True)
class LoopSettings(Settings):
    """Where and how often loops are searched."""

    drift: float = setting(
        0.03, "m/m", "assumed odometry drift per metre; larger: wider searches, which close loops after longer drives",
        low=0.0, high=1.0,
    )  # fmt: skip
    spacing: float = setting(
        0.5, "m", "distance driven between two loop searches; larger: they take less time and may miss loops",
        low=0.0, high=100.0,
    )  # fmt: skip
    submap_spacing: float = setting(
        2.0, "m",
        "distance driven between two searches of whole submaps; larger: less time, but kidnappings are found later",
        low=0.0, high=100.0,
    )  # fmt: skip


def graph_distances(poses: FloatArray, edges: Sequence[Edge] | EdgeArrays, node: int) -> FloatArray:
    """Return the length (N,) [m] of the shortest path along the edges from a node to every node."""
    own = edges if isinstance(edges, EdgeArrays) else edge_arrays(edges)
    lengths = np.hypot(*(poses[own.i, :2] - poses[own.j, :2]).T) + _LEAST_LENGTH + _UNKNOWN_LENGTH * own.torn
    return shortest_paths(own.i, own.j, lengths, len(poses), node)


def candidates(poses: FloatArray, path_lengths: FloatArray, settings: LoopSettings) -> tuple[LoopCandidate, ...]:
    """Return the chains of nodes to which the last node may have returned, nearest first.

    `path_lengths` (R,) [m] are the path lengths along the edges from the last of `poses` (N, 3) to the first R nodes, R < N.
    """
    recent = len(path_lengths)
    if recent < 1:
        return ()
    away = np.hypot(*(poses[:recent, :2] - poses[-1, :2]).T)
    windows = np.clip(settings.drift * path_lengths, MIN_WINDOW, MAX_WINDOW)
    reached = settings.drift * path_lengths <= MAX_WINDOW
    near = np.flatnonzero((away < _RADIUS + windows) & (path_lengths > MIN_LOOP_PATH) & reached)
    if len(near) == 0:
        return ()
    found = []
    for chain in np.split(near, np.flatnonzero(np.diff(near) > 3) + 1):
        nearest = int(chain[np.argmin(away[chain])])
        low = max(0, chain[0] - 5)
        members = np.arange(low, min(recent, chain[-1] + 6))
        reach = np.hypot(*(poses[members, :2] - poses[nearest, :2]).T)
        angle = min(MAX_ANGLE, 0.15 + TURN_DRIFT * path_lengths[nearest])
        found.append(LoopCandidate(nearest, members[reach < CHAIN_REACH], float(windows[nearest]), float(angle)))
    found.sort(key=lambda candidate: float(away[candidate.nearest]))
    return tuple(found[:_CHAINS])


def uncertain_submaps(
    poses: FloatArray, path_lengths: FloatArray, settings: LoopSettings, part_starts: Sequence[int] = ()
) -> dict[int, IntArray]:
    """Return the finished submaps that are too uncertain for a window and where the chair can be, nearest first.

    Arguments as of `candidates`; `part_starts` are the key scans at which the chair may have been carried. No submap spans
    two parts, and the rest before such a key scan is a smaller one. The members by the first of them. The chair can be at
    a key scan if three times the drift of the path from there explains the distance on the map.
    """
    size, recent = _SUBMAP_SCANS, len(path_lengths)
    drift = settings.drift * path_lengths
    away = np.hypot(*(poses[:recent, :2] - poses[-1, :2]).T)
    uncertain, reachable = drift > MAX_WINDOW, away < _RADIUS + _FAR_DRIFT * drift
    starts = sorted({start for start in part_starts if 0 < start <= recent})
    runs: list[tuple[int, int]] = []
    for first, end in pairwise([0, *starts, recent]):
        finished = end if end in starts else end - (end - first) % size
        runs += [(k, min(k + size, finished)) for k in range(first, finished, size)]
    firsts, ends = np.array(runs, np.int64).reshape(-1, 2).T
    certain_before, reachable_before = (np.concatenate([[0], np.cumsum(each)]) for each in (~uncertain, reachable))
    possible = (ends - firsts >= _LEAST_SUBMAP) & (certain_before[ends] == certain_before[firsts])
    possible &= reachable_before[ends] > reachable_before[firsts]
    found = [(float(away[k:end].min()), k, end) for k, end in np.array(runs)[possible].tolist()]
    return {k: np.arange(k, end) for _, k, end in sorted(found)}
