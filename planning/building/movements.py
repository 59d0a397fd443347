"""A route as movements for people: straight 12 m, left, through the door, lift to 2. Their costs add up to the route's.

A movement is told when the chair has to do something else than before; turns are exactly those that cost something.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from waychair.maps.building.costs import door_cost_m, millimetres
from waychair.maps.building.graph_arrays import NO_HEADING, Int32Array
from waychair.maps.building.hgraph import Arc, ArcRef, GraphDoorway, HGraph, Lift
from waychair.maps.building.hgraph_edits import arc_ref
from waychair.maps.building.indexed import IndexedGraph, stop_costs_m
from waychair.planning.building.overlay import turn
from waychair.planning.movements import Movement, MovementKind


def movements(hgraph: HGraph, built: IndexedGraph, arcs: Int32Array) -> tuple[Movement, ...]:
    """Return the movements along directed arcs (K,), the last of which is to have arrived."""
    found: list[Movement] = []
    for each in _movements(hgraph, built, arcs):
        last = found[-1] if found else None
        if last is not None and each.kind is last.kind and each.kind in (MovementKind.STRAIGHT, MovementKind.PRESS):
            joined = replace(last, cost=last.cost + each.cost, distance=last.distance + each.distance)
            found[-1] = replace(joined, storey=each.storey)
        else:
            found.append(each)
    return tuple(found)


def _movements(hgraph: HGraph, built: IndexedGraph, arcs: Int32Array) -> Iterator[Movement]:
    graph = built.graph
    for k, arc in enumerate(arcs.tolist()):
        at = built.refs[graph.tail[arc]]
        if k > 0:
            cost = turn(graph.heading, graph.turns, arcs[k - 1], arc)
            if cost > 0 or _is_sharp(built, int(arcs[k - 1]), arc):
                yield Movement(_side(built, int(arcs[k - 1]), arc), at, int(cost))
        if graph.heading[arc] == NO_HEADING:
            yield from _in_lift(hgraph, built, arc)
        else:
            yield from _along(hgraph, built, arc)
    if len(arcs):
        yield Movement(MovementKind.ARRIVED, built.refs[graph.head[arcs[-1]]], 0)


def _change(built: IndexedGraph, arc: int, onto: int) -> int:
    """Return the change of heading from arc to arc, in parts of a turn, positive to the left; 0 at a lift."""
    one, other = int(built.graph.heading[arc]), int(built.graph.heading[onto])
    if NO_HEADING in (one, other):
        return 0
    return ((other - one + 32768) & 65535) - 32768


def _is_sharp(built: IndexedGraph, arc: int, onto: int) -> bool:
    return abs(_change(built, arc, onto)) > 8192


def _side(built: IndexedGraph, arc: int, onto: int) -> MovementKind:
    change = _change(built, arc, onto)
    if abs(change) > 24576:
        return MovementKind.TURN_ROUND
    return MovementKind.LEFT if change > 0 else MovementKind.RIGHT


def _along(hgraph: HGraph, built: IndexedGraph, arc: int) -> Iterator[Movement]:
    owner, cost = built.owners[arc], int(built.graph.cost[arc])
    at, graph = built.refs[built.graph.tail[arc]], built.graph
    distance = float(((graph.xy[graph.head[arc]] - graph.xy[graph.tail[arc]]) ** 2).sum() ** 0.5)
    record = None if owner is None else record_of(hgraph, owner)
    if record is None:
        yield Movement(MovementKind.STRAIGHT, at, cost, distance)
        return
    way = record.way
    length = distance if way.length is None else way.length
    if isinstance(record, Arc) and way.width is None:
        yield Movement(MovementKind.STRAIGHT, at, cost, length)
        return
    door = min(cost, millimetres(door_cost_m(way.width, hgraph.costs)))
    yield Movement(MovementKind.STRAIGHT, at, cost - door, length)
    yield Movement(MovementKind.DOOR, at, door)


def record_of(hgraph: HGraph, ref: ArcRef) -> Arc | GraphDoorway | None:
    """Return the arc or doorway at an address."""
    submap = hgraph.submaps[ref.submap]
    both: tuple[Arc | GraphDoorway, ...] = (*submap.arcs, *submap.doorways)
    for each in both:
        if arc_ref(submap, each) == ref:
            return each
    return None


def _in_lift(hgraph: HGraph, built: IndexedGraph, arc: int) -> Iterator[Movement]:
    graph, cost = built.graph, int(built.graph.cost[arc])
    start, end = built.refs[graph.tail[arc]], built.refs[graph.head[arc]]
    cabin = start if start.submap.startswith("@") else end
    lift = hgraph.lifts[cabin.submap[1:]]
    name = lift_title(lift)
    if start is not cabin:
        board = min(cost, millimetres(stop_costs_m(lift, hgraph.costs)[1]))
        yield Movement(MovementKind.WAIT, start, cost - board, lift=name)
        yield Movement(MovementKind.INTO_LIFT, start, board, lift=name)
    elif end.submap.startswith("@"):
        yield Movement(MovementKind.PRESS, start, cost, lift=name, storey=storey_title(hgraph, end.node))
    else:
        yield Movement(MovementKind.LEAVE_LIFT, start, cost, lift=name)


def lift_title(lift: Lift) -> str:
    """Return a lift's name for people."""
    return lift.name or f"lift {lift.id}"


def storey_title(hgraph: HGraph, storey: str) -> str:
    """Return a storey's name for people."""
    return next((each.name for each in hgraph.storeys if each.id == storey and each.name), storey)
