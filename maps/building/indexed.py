"""A building's graph as arrays, with the address of every node and arc: `indexed(hgraph)`."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from waychair.errors import BuildingError
from waychair.maps.building.costs import CLOSED_MM, CostSettings, door_cost_m, millimetres
from waychair.maps.building.graph_arrays import GraphArrays, Int32Array, assembled, turn_costs
from waychair.maps.building.hgraph import (
    ROOT,
    Arc,
    ArcRef,
    Closure,
    GraphDoorway,
    HGraph,
    Lift,
    NodeRef,
    SubmapFrame,
    Way,
    inner_end,
    parent_path,
)
from waychair.maps.building.hgraph_edits import arc_ref


@dataclass(frozen=True, slots=True)
class IndexedGraph:
    """The arrays of a graph, and what their indices stand for.

    `refs` are the nodes' addresses; a cabin's is its lift's id at a storey, in no sub-map: `NodeRef("@A", "2")`. `index`
    is the inverse. `paths` are the sub-maps' paths. `arcs` are the two directed arcs of each arc and doorway, -1 for the
    direction that a one-way arc does not have. `open_cost` (A,) int32 [mm] is each directed arc's cost were it open, and
    `owners` the address behind each directed arc, None for a lift's.
    """

    graph: GraphArrays
    refs: tuple[NodeRef, ...]
    index: Mapping[NodeRef, int]
    paths: tuple[str, ...]
    arcs: Mapping[ArcRef, tuple[int, int]]
    open_cost: Int32Array
    owners: tuple[ArcRef | None, ...]


@dataclass(frozen=True, slots=True)
class _Directed:
    """A directed arc in the making."""

    start: int
    end: int
    cost: int
    is_open: bool
    owner: ArcRef | None


def lift_node(lift: str, storey: str) -> NodeRef:
    """Return the address of a lift's cabin at a storey."""
    return NodeRef(f"@{lift}", storey)


def indexed(hgraph: HGraph, now_ns: int | None = None) -> IndexedGraph:
    """Return the arrays of a building's graph; closures that have ended by `now_ns` [ns UTC] are open.

    Raises:
        BuildingError: the other side of a doorway is missing, or the node in front of a lift's stop.
    """
    paths = _parents_first(hgraph)
    number = {path: index for index, path in enumerate(paths)}
    levels = {storey.id: index for index, storey in enumerate(hgraph.storeys)}
    frames = _frames(hgraph, paths)
    refs: list[NodeRef] = []
    rows: list[tuple[int, float, float, int]] = []
    for lift in hgraph.lifts.values():  # the cabins are nodes of the root
        for stop in lift.stops:
            at = hgraph.node(stop.at)
            if at is None:
                raise BuildingError(
                    f"lift '{lift.id}' stops at {stop.at} on storey '{stop.storey}', which is no node: add it there"
                )
            refs.append(lift_node(lift.id, stop.storey))
            rows.append((0, *frames[stop.at.submap].point(at.x, at.y), levels.get(stop.storey, 0)))
    for path in paths:
        frame, level = frames[path], levels.get(hgraph.storey_of(path), 0)
        for node in hgraph.submaps[path].nodes.values():
            refs.append(NodeRef(path, node.id))
            rows.append((number[path], *frame.point(node.x, node.y), level))
    index = {ref: at for at, ref in enumerate(refs)}
    table = np.array(rows, np.float64).reshape(-1, 4)
    xy = np.ascontiguousarray(table[:, 1:3])
    directed = [*_ways(hgraph, paths, index, xy, now_ns), *_lifts(hgraph, index, levels, now_ns)]
    ends = np.array([(each.start, each.end) for each in directed], np.int32).reshape(-1, 2)
    open_cost = np.array([each.cost for each in directed], np.int32)
    cost = np.array([each.cost if each.is_open else CLOSED_MM for each in directed], np.int32)
    graph, place = assembled(
        table[:, 0].astype(np.int32),
        xy,
        table[:, 3].astype(np.int32),
        np.array([-1, *(number[parent_path(path)] for path in paths[1:])], np.int32),
        ends,
        cost,
        np.array([each.owner is None for each in directed], np.bool_),
        turn_costs(hgraph.costs),
    )
    return _named(graph, place, directed, open_cost, tuple(refs), index, tuple(paths))


def arc_cost_m(way: Way, distance: float, costs: CostSettings) -> float:
    """Return the cost of an arc between ends at this distance [m], in metres of straight driving.

    A price replaces everything, a measured driving time everything else: it includes doors and slow parts.
    """
    if way.price is not None:
        return way.price
    if way.drive_s is not None:
        return way.drive_s * costs.speed_mps
    length = distance if way.length is None else way.length
    slow = 1.0 if way.speed is None else max(1.0, costs.speed_mps / way.speed)
    return length * slow + door_cost_m(way.width, costs)


def stop_costs_m(lift: Lift, costs: CostSettings) -> tuple[float, float, float]:
    """Return the costs of waiting for a lift, of boarding or alighting, and of riding one storey [m]."""
    wait = costs.lift_wait_m if lift.wait is None else lift.wait
    board = costs.lift_board_m if lift.board is None else lift.board
    return wait, board, costs.lift_storey_m if lift.per_storey is None else lift.per_storey


def _parents_first(hgraph: HGraph) -> list[str]:
    """Return the paths of all sub-maps, each behind its parent and before its siblings' descendants, the root first."""
    children: dict[str, list[str]] = {}
    for path in hgraph.submaps:
        if path != ROOT:
            children.setdefault(parent_path(path), []).append(path)
    found, waiting = [], [ROOT]
    while waiting:
        path = waiting.pop()
        found.append(path)
        waiting += reversed(children.get(path, []))
    if len(found) != len(hgraph.submaps):
        orphan = next(path for path in hgraph.submaps if path not in set(found))
        raise BuildingError(f"sub-map '{orphan}' has no parent: add '{parent_path(orphan)}', or take it out")
    return found


def _frames(hgraph: HGraph, paths: list[str]) -> dict[str, SubmapFrame]:
    frames = {ROOT: hgraph.submaps[ROOT].frame}
    for path in paths[1:]:
        frames[path] = frames[parent_path(path)] @ hgraph.submaps[path].frame
    return frames


def _is_open(closure: Closure | None, now_ns: int | None) -> bool:
    return closure is None or not closure.holds(now_ns)


def _ways(
    hgraph: HGraph, paths: list[str], index: Mapping[NodeRef, int], xy: np.ndarray, now_ns: int | None
) -> Iterator[_Directed]:
    for path in paths:
        submap = hgraph.submaps[path]
        both: tuple[Arc | GraphDoorway, ...] = (*submap.arcs, *submap.doorways)
        for arc in both:
            one = index[NodeRef(path, arc.start)]
            if isinstance(arc, Arc):
                other = index[NodeRef(path, arc.end)]
            else:
                inner = inner_end(submap, arc)
                if inner not in index:
                    raise BuildingError(
                        f"the doorway {arc_ref(submap, arc)} leads to {inner}, which is no node: add it"
                    )
                other = index[inner]
            distance = math.dist(xy[one], xy[other])
            cost = max(1, millimetres(arc_cost_m(arc.way, distance, hgraph.costs)))
            outwards = isinstance(arc, GraphDoorway) and arc.way.one_way and arc.outwards
            is_open, owner = _is_open(arc.way.closure, now_ns), arc_ref(submap, arc)
            if not outwards:
                yield _Directed(one, other, cost, is_open, owner)
            if outwards or not arc.way.one_way:
                yield _Directed(other, one, cost, is_open, owner)


def _lifts(
    hgraph: HGraph, index: Mapping[NodeRef, int], levels: Mapping[str, int], now_ns: int | None
) -> Iterator[_Directed]:
    for lift in hgraph.lifts.values():
        wait, board, per_storey = (millimetres(each) for each in stop_costs_m(lift, hgraph.costs))
        for stop in lift.stops:
            floor, cabin = index[stop.at], index[lift_node(lift.id, stop.storey)]
            is_open = _is_open(stop.closure, now_ns)
            yield _Directed(floor, cabin, wait + board, is_open, None)
            yield _Directed(cabin, floor, board, is_open, None)
        for lower, upper in zip(lift.stops, lift.stops[1:], strict=False):
            below, above = index[lift_node(lift.id, lower.storey)], index[lift_node(lift.id, upper.storey)]
            ride = max(1, per_storey * abs(levels.get(upper.storey, 0) - levels.get(lower.storey, 0)))
            yield _Directed(below, above, ride, True, None)
            yield _Directed(above, below, ride, True, None)


def _named(
    graph: GraphArrays,
    place: Int32Array,
    directed: list[_Directed],
    open_cost: Int32Array,
    refs: tuple[NodeRef, ...],
    index: Mapping[NodeRef, int],
    paths: tuple[str, ...],
) -> IndexedGraph:
    owners: list[ArcRef | None] = [None] * len(directed)
    arcs: dict[ArcRef, tuple[int, int]] = {}
    for each, at in zip(directed, place.tolist(), strict=True):
        owners[at] = each.owner
        if each.owner is None:
            continue
        forward, backward = arcs.get(each.owner, (-1, -1))
        starts_here = refs[each.start] == NodeRef(each.owner.submap, each.owner.start)
        arcs[each.owner] = (at, backward) if starts_here and forward < 0 else (forward, at)
    sorted_cost = np.empty_like(open_cost)
    sorted_cost[place] = open_cost
    return IndexedGraph(graph, refs, index, paths, arcs, sorted_cost, tuple(owners))
