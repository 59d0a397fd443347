"""The checks of one sub-map: its nodes, arcs, doorways and names (E1 to E7, E12 to E14, E17)."""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from waychair.maps.building.checks.building_checks import BESIDE_M
from waychair.maps.building.checks.graph_findings import (
    FindingSeverity,
    GraphFinding,
    GraphSurroundings,
    error,
    warning,
)
from waychair.maps.building.checks.storey_checks import LARGEST_M, SAME_M, crossing_pairs
from waychair.maps.building.connections import folded
from waychair.maps.building.hgraph import (
    Arc,
    GraphDoorway,
    HGraph,
    Node,
    NodeKind,
    NodeRef,
    SubMap,
    SubmapFrame,
    inner_end,
    parent_path,
)
from waychair.maps.building.hgraph_edits import arc_ref
from waychair.maps.drawn.zones import Rule, zone_contains
from waychair.maps.grid.cells import OCCUPIED_FROM, cells_from_points, inside
from waychair.types import FloatArray, OccupancyGrid

MOST_ARCS = 4
CLOSEST_ANGLE = math.radians(45.0)
"""Two arcs of a node closer than this [rad] are one direction for a rider."""

_FEW = 64
"""So many arcs are compared with each other at once; more are sorted first."""

_COINCIDE_M = 1e-6
_SHORTEST, _LONGEST, _DETOUR = 0.9, 3.0, 1.5
"""An arc's length is suspicious below and above these multiples of the distance; so is a drive of the last one."""

_NARROWEST_DOOR_M, _WIDEST_DOOR_M = 0.3, 3.0
"""A door as narrow or as wide [m] has a wrong unit or scale."""


@dataclass(frozen=True, slots=True)
class Outside:
    """What leads into a sub-map: the doorways of its parent that do, and its nodes at which a lift stops."""

    doorways: tuple[GraphDoorway, ...] = ()
    lifts: frozenset[str] = frozenset()


def outsides(hgraph: HGraph) -> dict[str, Outside]:
    """Return what leads into each sub-map, by its path."""
    doorways: dict[str, list[GraphDoorway]] = defaultdict(list)
    for submap in hgraph.submaps.values():
        for doorway in submap.doorways:
            doorways[inner_end(submap, doorway).submap].append(doorway)
    lifts: dict[str, set[str]] = defaultdict(set)
    for lift in hgraph.lifts.values():
        for stop in lift.stops:
            lifts[stop.at.submap].add(stop.at.node)
    return {
        path: Outside(tuple(doorways[path]), frozenset(lifts[path]))
        for path in hgraph.submaps
        if path in doorways or path in lifts
    }


def submap_findings(
    hgraph: HGraph, path: str, frames: Mapping[str, SubmapFrame], outside: Outside, around: GraphSurroundings
) -> Iterator[GraphFinding]:
    """Yield the faults of one sub-map, given all frames in the building's, and what leads into it."""
    submap, frame = hgraph.submaps[path], frames[path]
    points = {key: frame.point(node.x, node.y) for key, node in submap.nodes.items()}
    yield from _nodes(submap, outside)
    yield from _crowded(hgraph, submap, points, frames, outside, around)
    on_map = points
    if hgraph.storey_of(path) in around.grids:
        map_frame = hgraph.map_frame_of(path)
        on_map = {key: map_frame.point(node.x, node.y) for key, node in submap.nodes.items()}
    yield from _arcs(hgraph, submap, points, on_map, around)
    yield from _doorways(hgraph, submap, points, frames, around)
    yield from _almost_joined(submap, points)
    yield from _names(submap)
    yield from _on_map(hgraph, submap, on_map, around)
    yield from _size(submap, points)


def _nodes(submap: SubMap, outside: Outside) -> Iterator[GraphFinding]:
    entered = {doorway.node for doorway in outside.doorways}
    used = {end for arc in submap.arcs for end in (arc.start, arc.end)} | {each.start for each in submap.doorways}
    for node in submap.nodes.values():
        ref = NodeRef(submap.path, node.id)
        if node.id not in used and node.id not in entered and node.id not in outside.lifts:
            yield error("E1", ref, f"node {ref} has no arc", "join it by an arc, or delete it")
        if node.kind is NodeKind.BRIDGE and node.id not in entered:
            yield error("E7", ref, f"the doorway of {ref} has no other side", "name it in a door of the parent sub-map")
        if node.kind is NodeKind.LIFT and node.id not in outside.lifts:
            yield error("E8", ref, f"{ref} stands in front of no lift", "make it a stop of a lift, or a cross node")


def _crowded(
    hgraph: HGraph,
    submap: SubMap,
    points: Mapping[str, tuple[float, float]],
    frames: Mapping[str, SubmapFrame],
    outside: Outside,
    around: GraphSurroundings,
) -> Iterator[GraphFinding]:
    """Yield nodes with more than four arcs, and those with two arcs within 45 degrees; doubled arcs count once."""
    directions: dict[str, dict[object, float]] = defaultdict(dict)
    for arc in submap.arcs:
        if arc.start != arc.end:
            directions[arc.start][arc.end] = _direction(points[arc.start], points[arc.end])
            directions[arc.end][arc.start] = _direction(points[arc.end], points[arc.start])
    for doorway in submap.doorways:
        end = inner_end(submap, doorway)
        other = _point(hgraph, frames, end)
        if other is not None:
            directions[doorway.start][end] = _direction(points[doorway.start], other)
    for doorway in outside.doorways:
        start = _point(hgraph, frames, NodeRef(parent_path(submap.path), doorway.start))
        if start is not None and doorway.node in submap.nodes:
            directions[doorway.node][start, "outside"] = _direction(points[doorway.node], start)
    for key, of_node in directions.items():
        ref = NodeRef(submap.path, key)
        if len(of_node) > MOST_ARCS:
            yield error("E2", ref, f"node {ref} has {len(of_node)} arcs", "split it, so that none has more than four")
        angles = sorted(of_node.values())
        if len(angles) > 1:
            gaps = [*np.diff(angles).tolist(), angles[0] + math.tau - angles[-1]]
            if min(gaps) < CLOSEST_ANGLE - 1e-9:
                degrees = math.degrees(min(gaps))
                severity = FindingSeverity.ERROR if around.guides else FindingSeverity.WARNING
                sentence = f"two arcs of node {ref} are only {degrees:.0f} degrees apart"
                yield GraphFinding("E3", severity, str(ref), sentence, "move a node, or split this one")


def _arcs(
    hgraph: HGraph,
    submap: SubMap,
    points: Mapping[str, tuple[float, float]],
    on_map: Mapping[str, tuple[float, float]],
    around: GraphSurroundings,
) -> Iterator[GraphFinding]:
    pairs: Counter[frozenset[str]] = Counter()
    storey = hgraph.storey_of(submap.path)
    grid = around.grids.get(storey)
    for arc in submap.arcs:
        ref = arc_ref(submap, arc)
        one, other = points[arc.start], points[arc.end]
        distance = math.dist(one, other)
        pairs[frozenset((arc.start, arc.end))] += 1
        if arc.start == arc.end or distance < _COINCIDE_M:
            yield error("E4", ref, f"both ends of arc {ref} are at one point", "delete it, or move a node")
            continue
        if pairs[frozenset((arc.start, arc.end))] == 2:
            yield error("E4", ref, f"arc {ref} is there twice", "delete one")
        yield from _length(ref, arc, distance)
        yield from _width(ref, arc, around)
        one, other = on_map[arc.start], on_map[arc.end]
        if grid is not None and around.driven is not None and not _is_clear(grid, one, other, around):
            driven = around.driven(storey, one, other)
            if driven is None or driven > _DETOUR * distance:
                how = "no way" if driven is None else f"a way of {driven:.1f} m only"
                sentence = f"arc {ref} of {distance:.1f} m crosses a wall: the planner finds {how}"
                yield error("E5", ref, sentence, "move its nodes to where the chair can drive")


def _length(ref: object, arc: Arc | GraphDoorway, distance: float) -> Iterator[GraphFinding]:
    length = arc.way.length
    if length is not None and not _SHORTEST * distance <= length <= _LONGEST * distance:
        sentence = f"arc {ref} is {length:.1f} m long between ends {distance:.1f} m apart"
        yield error("E5", ref, sentence, "measure it again, or move a node")


def _width(ref: object, arc: Arc | GraphDoorway, around: GraphSurroundings) -> Iterator[GraphFinding]:
    width = arc.way.width
    if width is None:
        return
    if not _NARROWEST_DOOR_M < width < _WIDEST_DOOR_M:
        sentence = f"the door of {ref} is {width:g} m wide"
        yield error("E17", ref, sentence, "give metres; leave the width out where there is no door")
    if around.width is not None and width < around.width + 2 * BESIDE_M:
        fits = width - 2 * BESIDE_M
        sentence = f"the door of {ref} is {width:.2f} m wide, and this chair is {around.width:.2f} m"
        yield error("E6", ref, sentence, f"take it out for this chair: one of at most {fits:.2f} m fits")


def _doorways(
    hgraph: HGraph,
    submap: SubMap,
    points: Mapping[str, tuple[float, float]],
    frames: Mapping[str, SubmapFrame],
    around: GraphSurroundings,
) -> Iterator[GraphFinding]:
    for doorway in submap.doorways:
        ref, end = arc_ref(submap, doorway), inner_end(submap, doorway)
        node, other = hgraph.node(end), _point(hgraph, frames, end)
        yield from _width(ref, doorway, around)
        if node is None or other is None:
            yield error("E7", ref, f"the doorway {ref} leads to {end}, which is no node", "add it, or delete the door")
            continue
        if node.kind is not NodeKind.BRIDGE:
            sentence = f"the doorway {ref} leads to {end}, which is of kind '{node.kind}'"
            yield error("E7", ref, sentence, f"make it of kind '{NodeKind.BRIDGE}'")
        distance = math.dist(points[doorway.start], other)
        if distance > SAME_M + 1e-9:
            sentence = f"the two sides of the doorway {ref} are {distance:.2f} m apart"
            yield error("E7", ref, sentence, f"move one side, or the frame of '{end.submap}', to within {SAME_M} m")


def _almost_joined(submap: SubMap, points: Mapping[str, tuple[float, float]]) -> Iterator[GraphFinding]:
    """Yield pairs of nodes that are not joined though they almost touch, and arcs that cross without a node."""
    keys = list(points)
    joined = {frozenset((arc.start, arc.end)) for arc in submap.arcs}
    if len(keys) > 1:
        tree = cKDTree(np.array([points[key] for key in keys]))
        for i, j in sorted(tree.query_pairs(SAME_M)):
            if frozenset((keys[i], keys[j])) not in joined:
                ref = NodeRef(submap.path, keys[i])
                distance = math.dist(points[keys[i]], points[keys[j]])
                sentence = f"nodes {ref} and {keys[j]} are {distance:.2f} m apart and not joined"
                yield warning("E12", ref, sentence, "join them by an arc, or make them one node")
    arcs = [arc for arc in submap.arcs if arc.start != arc.end]
    starts = np.array([points[arc.start] for arc in arcs]).reshape(-1, 2)
    stops = np.array([points[arc.end] for arc in arcs]).reshape(-1, 2)
    for i, j in _crossings(starts, stops):
        if not {arcs[i].start, arcs[i].end} & {arcs[j].start, arcs[j].end}:
            crossed = arc_ref(submap, arcs[i])
            sentence = f"arcs {crossed} and {arcs[j].start}>{arcs[j].end} cross without a node"
            yield warning("E12", crossed, sentence, "put a cross node where they meet, or move one")


def _crossings(starts: FloatArray, stops: FloatArray) -> list[tuple[int, int]]:
    """Return the pairs of segments (N, 2), (N, 2) that cross in their inside."""
    if len(starts) <= _FEW:
        both = crossing_pairs(starts, stops, (starts, stops))
        return [(i, j) for i, j in both.tolist() if i < j]
    low, high = np.minimum(starts, stops), np.maximum(starts, stops)
    order = np.argsort(low[:, 0], kind="stable")
    ends = np.searchsorted(low[order, 0], high[order, 0], side="right")
    found = []
    for rank, i in enumerate(order.tolist()):
        near = order[rank + 1 : ends[rank]]
        near = near[(low[near, 1] <= high[i, 1]) & (low[i, 1] <= high[near, 1])]
        if len(near):
            pairs = crossing_pairs(starts[i : i + 1], stops[i : i + 1], (starts[near], stops[near]))
            found += [(min(i, j), max(i, j)) for j in near[pairs[:, 1]].tolist()]
    return sorted(found)


def _names(submap: SubMap) -> Iterator[GraphFinding]:
    ends = [node for node in submap.nodes.values() if node.kind is NodeKind.END]
    by_name: dict[str, list[Node]] = defaultdict(list)
    for node in ends:
        ref = NodeRef(submap.path, node.id)
        if not node.name.strip():
            yield error("E13", ref, f"the goal {ref} has no name", "give it one")
        else:
            by_name[folded(node.name)].append(node)
    for same in by_name.values():
        for node in same[1:]:
            ref = NodeRef(submap.path, node.id)
            sentence = f"the goals '{same[0].name}' and '{node.name}' of '{submap.path}' are named alike"
            yield error("E13", ref, sentence, "rename one, by more than case and accents")


def _on_map(
    hgraph: HGraph, submap: SubMap, points: Mapping[str, tuple[float, float]], around: GraphSurroundings
) -> Iterator[GraphFinding]:
    storey = hgraph.storey_of(submap.path)
    grid, places = around.grids.get(storey), around.places.get(storey)
    for node in submap.nodes.values():
        if node.kind is not NodeKind.END:
            continue
        ref = NodeRef(submap.path, node.id)
        if places is not None and node.name and node.name not in places:
            yield error("E14", ref, f"the goal '{node.name}' is no place of storey '{storey}'", "add the place")
        point = np.array([points[node.id]])
        for zone in around.zones.get(storey, ()):
            if zone.rule is Rule.KEEP_OUT and zone_contains(zone, point)[0]:
                sentence = f"the goal '{node.name or ref}' lies in the keep-out zone '{zone.name}'"
                yield error("E14", ref, sentence, "move it, or redraw the zone")
        if grid is not None:
            cell = cells_from_points(grid, point)
            if not inside(grid, cell)[0] or grid.cells[tuple(cell[0])] >= OCCUPIED_FROM:
                yield error("E14", ref, f"the goal '{node.name or ref}' lies in a wall or off the map", "move it")
            elif around.turns is not None and not around.turns(storey, points[node.id]):
                sentence = f"the chair has no room to turn at the goal '{node.name or ref}'"
                yield warning("E14", ref, sentence, "move it, or expect the chair to leave it backwards")


def _is_clear(
    grid: OccupancyGrid, one: tuple[float, float], other: tuple[float, float], around: GraphSurroundings
) -> bool:
    """Return whether the straight line between two points is known to be free for the chair's width."""
    count = max(2, math.ceil(2.0 * math.dist(one, other) / grid.resolution))
    line = np.linspace(one, other, count)
    half = (around.width or 0.0) / 2.0
    side = np.array([one[1] - other[1], other[0] - one[0]]) / max(math.dist(one, other), 1e-9)
    points = np.vstack([line + shift * side for shift in (-half, 0.0, half)])
    cells = cells_from_points(grid, points)
    within = inside(grid, cells)
    return bool(within.all() and (grid.cells[tuple(cells.T)] == 0).all())


def _size(submap: SubMap, points: Mapping[str, tuple[float, float]]) -> Iterator[GraphFinding]:
    if len(points) < 2:
        return
    table = np.array(list(points.values()))
    extent = float((table.max(axis=0) - table.min(axis=0)).max())
    if extent > LARGEST_M:
        sentence = f"'{submap.title}' is {extent / 1000.0:.1f} km across"
        yield error("E17", submap.path, sentence, "correct its scale: coordinates are metres, not pixels or feet")


def _point(hgraph: HGraph, frames: Mapping[str, SubmapFrame], ref: NodeRef) -> tuple[float, float] | None:
    node = hgraph.node(ref)
    return None if node is None else frames[ref.submap].point(node.x, node.y)


def _direction(one: tuple[float, float], other: tuple[float, float]) -> float:
    return math.atan2(other[1] - one[1], other[0] - one[0])
