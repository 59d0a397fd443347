"""The choice of sleeping nodes to wake and of awake nodes to keep awake, as in RTAB-Map 0.23.8."""

from __future__ import annotations

import heapq
import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from waychair.slam.memory.anchor_poses import AnchorPoses
from waychair.slam.memory.nodes import IN_TIME, NodeStatus
from waychair.slam.memory.skeleton import ANY, Skeleton
from waychair.types import IntArray, Pose2

# RTAB-Map's parameters
MAX_RETRIEVED = 2  # nodes woken round the hypothesis in one iteration (Rtabmap/MaxRetrieved)
MAX_LOCAL_RETRIEVED = 2  # nodes woken round the chair in one iteration (RGBD/MaxLocalRetrieved)
LOCAL_RADIUS = 10.0  # [m] round the chair (RGBD/LocalRadius)
LOCAL_IMMUNIZATION_RATIO = 0.25  # share of the WM kept awake round the chair (RGBD/LocalImmunizationRatio)
PREDICTION_LEVELS = 17  # links from the hypothesis, as in Bayes/PredictionLC

_ASLEEP = int(NodeStatus.LTM)  # looked up often
_LATEST = 32  # newest nodes of an anchor that are considered


@dataclass(frozen=True, slots=True)
class NearbyNodes:
    """The nodes round the chair: `near` in the WM, nearest first; `path` of the planned path; `here`, the newest node.

    `sleepers` are sleeping nodes within reach at places where no node is awake, nearest first.
    """

    here: int
    near: Sequence[int] = ()
    path: Sequence[int] = ()
    sleepers: Sequence[int] = field(default=())


def nearby_nodes(
    skeleton: Skeleton,
    anchors: AnchorPoses,
    here: Pose2,
    newest: int,
    wm: Collection[int],
    path: Sequence[int],
) -> NearbyNodes:
    """Return the nodes within `LOCAL_RADIUS` of the chair at `here`.

    Sleeping nodes are included by place, unlike in RTAB-Map, which finds a sleeping node only through an awake one: a
    chair that returns to a place whose nodes are all asleep would recognise nothing.
    """
    near = _nearest(np.array(sorted(wm), np.int64), skeleton, anchors, here, LOCAL_RADIUS)
    return NearbyNodes(newest, near, path, _sleepers(skeleton, anchors, here, newest, wm))


def nodes_to_wake(skeleton: Skeleton, hypothesis: int | None, around: NearbyNodes) -> list[int]:
    """Return the sleeping nodes to wake in this iteration, the most urgent first.

    First come nodes round the chair: those of the planned path, neighbours of near nodes, and their neighbours. Then
    come nodes round the best hypothesis, of any probability, level by level: over neighbours in time, the newest id of
    a level first, then over loops.
    """
    local = _local(skeleton, around, MAX_LOCAL_RETRIEVED)
    most = MAX_RETRIEVED + len(local)
    queue = dict.fromkeys(local)
    if hypothesis is not None:
        for node in _round_hypothesis(skeleton, hypothesis, PREDICTION_LEVELS):
            if len(queue) >= most:
                break
            queue[node] = None
    return list(queue)


def immunised_nodes(
    skeleton: Skeleton,
    hypothesis: int | None,
    around: NearbyNodes,
    awake: Collection[int],
    wm_size: int,
) -> set[int]:
    """Return the awake nodes that must not be put to sleep in this iteration, besides those just woken.

    These are always the nodes round the hypothesis in time. Within a budget (`LOCAL_IMMUNIZATION_RATIO` of the WM),
    they are also nodes of the planned path near the chair, the shortest way from the nearest node of the WM to the
    newest one, and the nearest nodes.
    """
    kept: set[int] = set()
    if hypothesis is not None:
        for level in skeleton.levels(hypothesis, PREDICTION_LEVELS, IN_TIME):
            kept.update(node for node in level if node in awake)
    budget = int(LOCAL_IMMUNIZATION_RATIO * wm_size)
    near = frozenset(around.near)
    on_path = [node for node in around.path if node in near]
    way = _shortest_way(skeleton, around.near[0], around.here, awake) if around.near else []
    used = 0
    for node in (*on_path, *way):
        used += node not in kept
        kept.add(node)
    for node in around.near:
        if used >= budget:
            break
        used += node not in kept
        kept.add(node)
    return kept


def _local(skeleton: Skeleton, around: NearbyNodes, most: int) -> list[int]:
    queue: dict[int, None] = {}
    kept = skeleton.rows["kept"]

    def candidates() -> Iterator[int]:
        yield from around.path
        for node in around.near:
            yield from skeleton.neighbours(node)
        for node in list(queue):
            yield from skeleton.neighbours(node)
        yield from around.sleepers

    for node in candidates():
        if len(queue) >= most:
            break
        if kept[node] == _ASLEEP:
            queue[node] = None
    return list(queue)


def _round_hypothesis(skeleton: Skeleton, hypothesis: int, most: int) -> Iterator[int]:
    kept = skeleton.rows["kept"]
    for ways in (IN_TIME, ANY):
        for level in skeleton.levels(hypothesis, most, ways):
            yield from (node for node in reversed(level) if kept[node] == _ASLEEP)


def _nearest(nodes: IntArray, skeleton: Skeleton, anchors: AnchorPoses, here: Pose2, radius: float) -> list[int]:
    """Return the nodes (given in ascending order) within the radius [m], nearest first."""
    if not len(nodes) or not len(anchors):
        return []
    away = np.hypot(*(skeleton.poses(nodes, anchors.poses)[:, :2] - (here.x, here.y)).T)
    order = np.argsort(away, kind="stable")
    near: list[int] = nodes[order[away[order] <= radius]].tolist()
    return near


def _sleepers(skeleton: Skeleton, anchors: AnchorPoses, here: Pose2, newest: int, wm: Collection[int]) -> list[int]:
    """Return a sleeping node for each anchor in reach without an awake node.

    Of the anchor's latest nodes it is the one of greatest weight, among equals the newest.
    """
    rows = skeleton.rows
    taken = {int(rows["anchor"][newest]), *rows["anchor"][np.fromiter(wm, np.int64)].tolist()}
    found: list[int] = []
    for anchor in anchors.near(here, LOCAL_RADIUS).tolist():
        if len(found) >= MAX_LOCAL_RETRIEVED:
            break
        asleep = (
            []
            if anchor in taken
            else [n for n in skeleton.attached_to(anchor)[-_LATEST:] if rows["kept"][n] == _ASLEEP]
        )
        if asleep:
            found.append(max(asleep, key=lambda node: (int(rows["weight"][node]), node)))
    return found


def _shortest_way(skeleton: Skeleton, start: int, goal: int, awake: Collection[int]) -> list[int]:
    """Return the nodes of the shortest way [m] over links between awake nodes, with both ends; empty if none."""
    before, length, queue = {start: start}, {start: 0.0}, [(0.0, start)]
    while queue:
        so_far, node = heapq.heappop(queue)
        if node == goal:
            break
        if so_far > length[node]:
            continue
        for there, far in skeleton.steps(node):
            longer = so_far + far
            if there in awake and longer < length.get(there, math.inf):
                before[there], length[there] = node, longer
                heapq.heappush(queue, (longer, there))
    if goal not in before:
        return []
    way = [goal]
    while way[-1] != start:
        way.append(before[way[-1]])
    return way
