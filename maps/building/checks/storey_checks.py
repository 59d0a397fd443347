"""The checks between the sub-maps of a storey: nodes that almost touch, arcs that cross, detours, size (E12, E14, E17, W1).

An `Outline` holds a sub-map's nodes and arcs as arrays in the building's frame; a check after an edit makes anew only the
outlines that changed.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from waychair.maps.building.checks.graph_findings import GraphFinding, GraphSurroundings, error, warning
from waychair.maps.building.hgraph import HGraph, NodeRef, SubMap, SubmapFrame, inner_end
from waychair.types import BoolArray, FloatArray, IntArray

SAME_M = 0.3
"""Ends closer than this [m] look joined; so do the two sides of a doorway."""

FAR, NEIGHBOURS_M, APART_M = 3.0, 6.0, 1.0
"""Doors of two rooms that are between 1 and 6 m [m] from each other should not be more than 3 times as far by driving."""

_TABLE = 4_000_000
"""Most entries of a table of distances that is held at a time."""

Suspect: TypeAlias = tuple[NodeRef, NodeRef, float]
"""Two doors of different rooms, and the metres between them."""

LARGEST_M = 2000.0
"""A sub-map or storey as large [m] has a wrong unit or scale."""


@dataclass(frozen=True, slots=True)
class CheckedDoorway:
    """A doorway: its node in the parent, its node in the child, and the place [m] of the latter."""

    outer: NodeRef
    inner: NodeRef
    x: float
    y: float


@dataclass(frozen=True, slots=True)
class Outline:
    """One sub-map in the building's frame: nodes' points (N, 2) [m], arcs' ends by index (A, 2), which arcs are open (A,),
    and the box round the arcs (4,): least x, y, largest x, y [m]."""

    submap: SubMap
    frame: SubmapFrame
    points: FloatArray
    arcs: IntArray
    is_open: BoolArray
    box: FloatArray


def outline_of(submap: SubMap, frame: SubmapFrame) -> Outline:
    """Return the outline of a sub-map whose frame in the building's is given."""
    index = {key: at for at, key in enumerate(submap.nodes)}
    points = np.array([frame.point(node.x, node.y) for node in submap.nodes.values()]).reshape(-1, 2)
    arcs = np.array([(index[arc.start], index[arc.end]) for arc in submap.arcs], np.int64).reshape(-1, 2)
    is_open = np.array([arc.way.closure is None for arc in submap.arcs], np.bool_)
    used = points[arcs].reshape(-1, 2)
    box = np.concatenate([used.min(axis=0), used.max(axis=0)]) if len(used) else np.full(4, np.nan)
    return Outline(submap, frame, points, arcs, is_open, box)


class Crossings:
    """Finds arcs of different sub-maps that cross; pairs of sub-maps that have not changed are not searched again."""

    def __init__(self) -> None:
        self._kept: dict[tuple[str, str], tuple[Outline, Outline, tuple[GraphFinding, ...]]] = {}

    def findings(self, storeys: list[list[Outline]]) -> Iterator[GraphFinding]:
        """Yield the crossings between the sub-maps of each storey."""
        before, self._kept = self._kept, {}
        for here in storeys:
            for one, other in _overlapping([each for each in here if len(each.arcs)]):
                key = one.submap.path, other.submap.path
                kept = before.get(key)
                if kept is None or kept[0] is not one or kept[1] is not other:
                    kept = one, other, tuple(_crossed(one, other))
                self._kept[key] = kept
                yield from kept[2]


def _overlapping(here: list[Outline]) -> Iterator[tuple[Outline, Outline]]:
    """Yield the pairs of outlines whose boxes overlap."""
    boxes = np.array([each.box for each in here]).reshape(-1, 4)
    order = np.argsort(boxes[:, 0], kind="stable")
    ends = np.searchsorted(boxes[order, 0], boxes[order, 2], side="right")
    for rank, i in enumerate(order.tolist()):
        near = order[rank + 1 : ends[rank]]
        near = near[(boxes[near, 1] <= boxes[i, 3]) & (boxes[i, 1] <= boxes[near, 3])]
        for j in near.tolist():
            yield here[min(i, j)], here[max(i, j)]


def storey_findings(
    hgraph: HGraph,
    outlines: Mapping[str, Outline],
    suspects: Iterable[Suspect],
    around: GraphSurroundings,
    crossings: Crossings,
) -> Iterator[GraphFinding]:
    """Yield the faults between the sub-maps of each storey; `suspects` are the detours within each sub-map."""
    by_storey: dict[str, list[Outline]] = {}
    for path, outline in outlines.items():
        by_storey.setdefault(hgraph.storey_of(path), []).append(outline)
    by_suspects: dict[str, list[Suspect]] = {}
    for pair in suspects:
        by_suspects.setdefault(hgraph.storey_of(pair[0].submap), []).append(pair)
    yield from crossings.findings([here for storey, here in by_storey.items() if storey])
    for storey, here in by_storey.items():
        if storey:
            yield from _almost_joined(here)
            yield from _size(storey, here)
            yield from _places(storey, here, around)
            yield from _detours(hgraph, here, outlines, by_suspects.get(storey, []))


def crossing_pairs(starts: FloatArray, stops: FloatArray, others: tuple[FloatArray, FloatArray]) -> IntArray:
    """Return the pairs (P, 2) of segments (N, 2), (N, 2) and others (M, 2), (M, 2) that cross in their inside."""
    here, there = (stops - starts)[:, None], (others[1] - others[0])[None]
    one, other = starts[:, None], others[0][None]
    sides = _cross(here, other - one) * _cross(here, others[1][None] - one)
    across = _cross(there, one - other) * _cross(there, stops[:, None] - other)
    return np.argwhere((sides < 0) & (across < 0))


def _cross(one: FloatArray, other: FloatArray) -> FloatArray:
    product: FloatArray = one[..., 0] * other[..., 1] - one[..., 1] * other[..., 0]
    return product


def _ref(outline: Outline, index: int) -> NodeRef:
    return NodeRef(outline.submap.path, list(outline.submap.nodes)[index])


def _almost_joined(here: list[Outline]) -> Iterator[GraphFinding]:
    """Yield nodes of different sub-maps that almost touch, though no doorway joins them."""
    owners = np.repeat(np.arange(len(here)), [len(each.points) for each in here])
    if len(here) < 2 or not len(owners):
        return
    first = np.cumsum([0, *(len(each.points) for each in here)])
    pairs = cKDTree(np.concatenate([each.points for each in here])).query_pairs(SAME_M, output_type="ndarray")
    pairs = pairs[owners[pairs[:, 0]] != owners[pairs[:, 1]]]
    if not len(pairs):
        return
    outer: dict[NodeRef, set[NodeRef]] = {}
    for each in here:
        for door in each.submap.doorways:
            outer.setdefault(inner_end(each.submap, door), set()).add(NodeRef(each.submap.path, door.start))
    none: set[NodeRef] = set()
    for i, j in sorted(map(tuple, pairs.tolist())):
        one, other = here[owners[i]], here[owners[j]]
        ends = _ref(one, int(i - first[owners[i]])), _ref(other, int(j - first[owners[j]]))
        sides = outer.get(ends[0], none), outer.get(ends[1], none)
        if ends[1] in sides[0] or ends[0] in sides[1] or sides[0] & sides[1]:
            continue  # a doorway joins them, or two rooms meet in one door
        distance = math.dist(one.points[i - first[owners[i]]], other.points[j - first[owners[j]]])
        sentence = f"nodes {ends[0]} and {ends[1]} are {distance:.2f} m apart and not joined"
        yield warning("E12", ends[0], sentence, "join them by a doorway, or move one")


def _crossed(one: Outline, other: Outline) -> Iterator[GraphFinding]:
    parts = []
    for each, box in ((one, other.box), (other, one.box)):
        starts, stops = each.points[each.arcs[:, 0]], each.points[each.arcs[:, 1]]
        low, high = np.minimum(starts, stops), np.maximum(starts, stops)
        near = np.flatnonzero(((low <= box[2:]) & (high >= box[:2])).all(axis=1))
        parts.append((near, starts[near], stops[near]))
    (own, starts, stops), (others, other_starts, other_stops) = parts
    for i, j in crossing_pairs(starts, stops, (other_starts, other_stops)).tolist():
        arc, crossed = one.submap.arcs[own[i]], other.submap.arcs[others[j]]
        ref = f"{one.submap.path}:{arc.start}>{arc.end}"
        sentence = f"arcs {ref} and {other.submap.path}:{crossed.start}>{crossed.end} cross without a node"
        yield warning("E12", ref, sentence, "put a doorway where they meet, or move one")


def _size(storey: str, here: list[Outline]) -> Iterator[GraphFinding]:
    points = [each.points for each in here if len(each.points)]
    if not points:
        return
    table = np.concatenate(points)
    extent = float(np.ptp(table, axis=0).max())
    if extent > LARGEST_M and all(np.ptp(each, axis=0).max() <= LARGEST_M for each in points):
        sentence = f"storey '{storey}' is {extent / 1000.0:.1f} km across"
        yield error("E17", f"storey {storey}", sentence, "correct the frames of its sub-maps: they are metres")


def _places(storey: str, here: list[Outline], around: GraphSurroundings) -> Iterator[GraphFinding]:
    """Yield places of a storey's map that are no goal of the graph."""
    goals = {node.name for each in here for node in each.submap.nodes.values() if node.name}
    for name in around.places.get(storey, {}):
        if name not in goals:
            sentence = f"the place '{name}' of storey '{storey}' is no goal"
            yield warning(
                "E14", f"storey {storey}", sentence, "add an End node of this name, or generate the graph again"
            )


def detours_within(hgraph: HGraph, outline: Outline) -> tuple[Suspect, ...]:
    """Return the pairs of doors of one sub-map that are close to each other, but far by driving within it, and how close [m].

    There may be a shorter way outside it: `storey_findings` looks for one.
    """
    doors = _doors(hgraph, outline.submap)
    pairs = _near_rooms(doors, same_parent=True)
    if not pairs:
        return ()
    index = {key: at for at, key in enumerate(outline.submap.nodes)}
    arcs = outline.arcs[outline.is_open]
    lengths = np.hypot(*(outline.points[arcs[:, 0]] - outline.points[arcs[:, 1]]).T) + 1e-3
    matrix = csr_array((lengths, (arcs[:, 0], arcs[:, 1])), shape=(len(index), len(index)))
    outer = np.array([index[door.outer.node] for door in doors])
    starts = np.unique(outer[[i for i, _, _ in pairs]])
    driven = dijkstra(matrix, directed=False, indices=starts, limit=FAR * NEIGHBOURS_M)
    row = {start: at for at, start in enumerate(starts.tolist())}
    return tuple(
        (doors[i].inner, doors[j].inner, line) for i, j, line in pairs if driven[row[outer[i]], outer[j]] > FAR * line
    )


def _detours(
    hgraph: HGraph, here: list[Outline], outlines: Mapping[str, Outline], suspects: list[Suspect]
) -> Iterator[GraphFinding]:
    """Yield doors of two rooms of a storey that are close to each other, but far by driving, whichever way on the storey."""
    doors = [door for each in here for door in _doors(hgraph, each.submap, outlines)]
    pairs = suspects + [(doors[i].inner, doors[j].inner, line) for i, j, line in _near_rooms(doors, same_parent=False)]
    number: dict[NodeRef, int] = {}
    for each in here if pairs else ():
        number.update((NodeRef(each.submap.path, key), at) for at, key in enumerate(each.submap.nodes, len(number)))
    pairs = [pair for pair in pairs if pair[0] in number and pair[1] in number]
    if not pairs:
        return
    lengths = _lengths(here, doors, number)
    ends = np.array([(number[one], number[other]) for one, other, _ in pairs], np.int64)
    between = np.empty(len(pairs))
    rows = max(1, _TABLE // len(number))
    starts = np.unique(ends[:, 0])
    for first in range(0, len(starts), rows):  # a whole table of a large storey would not fit into memory
        some = starts[first : first + rows]
        driven = dijkstra(lengths, directed=False, indices=some, limit=FAR * NEIGHBOURS_M + SAME_M)
        mine = np.flatnonzero(np.isin(ends[:, 0], some))
        between[mine] = driven[np.searchsorted(some, ends[mine, 0]), ends[mine, 1]]
    for (one, other, line), metres in zip(pairs, between.tolist(), strict=True):
        if metres > FAR * line:
            sentence = f"from {one} to {other}, {line:.1f} m away, the way is more than {FAR:g} times as long"
            yield warning("W1", one, sentence, "look whether a doorway between them is missing")


def _doors(hgraph: HGraph, submap: SubMap, outlines: Mapping[str, Outline] | None = None) -> list[CheckedDoorway]:
    """Return the open doorways of a sub-map that have both sides."""
    found = []
    for doorway in submap.doorways:
        end = inner_end(submap, doorway)
        node = hgraph.node(end)
        if node is not None and doorway.way.closure is None:
            frame = hgraph.frame_of(end.submap) if outlines is None else outlines[end.submap].frame
            found.append(CheckedDoorway(NodeRef(submap.path, doorway.start), end, *frame.point(node.x, node.y)))
    return found


def _near_rooms(doors: list[CheckedDoorway], same_parent: bool) -> list[tuple[int, int, float]]:
    """Return the pairs of doors of different rooms, of one parent or of two, that are near each other: indices, metres."""
    if len(doors) < 2:
        return []
    places = np.array([(door.x, door.y) for door in doors])
    near = cKDTree(places).query_pairs(NEIGHBOURS_M, output_type="ndarray")
    apart = np.hypot(*(places[near[:, 0]] - places[near[:, 1]]).T)
    parents, rooms = (
        np.unique([getattr(door, side).submap for door in doors], return_inverse=True)[1] for side in ("outer", "inner")
    )
    one, other = near.T
    wanted = (apart > APART_M) & (rooms[one] != rooms[other]) & ((parents[one] == parents[other]) == same_parent)
    rows = zip(near[wanted].tolist(), apart[wanted].tolist(), strict=True)
    return sorted((i, j, line) for (i, j), line in rows)


def _lengths(here: list[Outline], doors: list[CheckedDoorway], number: Mapping[NodeRef, int]) -> csr_array:
    """Return the lengths [m] of the open arcs and doorways of a storey, by the numbers of their nodes."""
    rows, lengths, first = [], [], 0
    for outline in here:
        arcs = outline.arcs[outline.is_open]
        rows.append(arcs + first)
        lengths.append(np.hypot(*(outline.points[arcs[:, 0]] - outline.points[arcs[:, 1]]).T) + 1e-3)
        first += len(outline.points)
    joints = [(number[door.outer], number[door.inner]) for door in doors if door.inner in number]
    rows.append(np.array(joints, np.int64).reshape(-1, 2))
    lengths.append(np.full(len(joints), SAME_M / 2))
    ends = np.concatenate(rows)
    return csr_array((np.concatenate(lengths), (ends[:, 0], ends[:, 1])), shape=(len(number), len(number)))
