"""The traffic graph of a building: `building_traffic(hgraph)` makes sections, refuges and lifts of its H-graph.

An H-graph states the widths of doors, not of corridors. Where no clear width is known, a section is taken as single file: two
chairs are then never sent past each other where they might not fit.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations
from types import MappingProxyType

from waychair.errors import BuildingError, TrafficError
from waychair.maps.building.costs import CostSettings, door_cost_m
from waychair.maps.building.hgraph import (
    Arc,
    ArcRef,
    Closure,
    GraphDoorway,
    HGraph,
    Lift,
    NodeKind,
    NodeRef,
    Stop,
    Way,
    full_name,
    inner_end,
)
from waychair.maps.building.hgraph_edits import arc_ref
from waychair.maps.building.indexed import stop_costs_m
from waychair.maps.traffic.traffic_graph import (
    LONGEST_SECTION,
    SINGLE_FILE_ROOM,
    Refuge,
    RefugeKind,
    Section,
    TrafficGraph,
    TrafficLift,
    TrafficNode,
    lanes_for,
)

LOBBY_SLOTS = 3
"""Chairs that have room before a lift's door: one that waits, one that comes out, and one behind."""

_SHORTEST = 0.1
"""m; two nodes in one point are taken to be so far apart, as a section has a length."""


@dataclass(frozen=True, slots=True)
class BuildingTraffic:
    """A building's traffic graph, and `notes`: a sentence for each part that is left out or guessed."""

    graph: TrafficGraph
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class _Joined:
    """An arc or doorway between two nodes that is open, from `start` to `end` where it is one-way."""

    ref: ArcRef
    start: NodeRef
    end: NodeRef
    way: Way


def building_traffic(
    hgraph: HGraph,
    *,
    chair_width: float = 0.60,
    widths: Mapping[ArcRef, float] = MappingProxyType({}),
    now_ns: int | None = None,
) -> BuildingTraffic:
    """Return the traffic graph of a building for chairs of a width [m]; closures that have ended by `now_ns` are open.

    Goals become places of one slot, the nodes before lifts refuges in which any chair may wait. `widths` [m] are clear
    widths of arcs and doorways, of the storeys' maps; a door's own width counts where it is less.

    Raises:
        BuildingError: the other side of a doorway is missing, or the node in front of a lift's stop.
        TrafficError: no arc is open and wide enough.
    """
    notes: list[str] = []
    joined: list[_Joined] = []
    narrow: list[_Joined] = []
    for each in _joined(hgraph, now_ns):
        fits = lanes_for(_width(each, widths, chair_width), chair_width) > 0
        (joined if fits else narrow).append(each)
    if not joined:
        raise TrafficError(f"'{hgraph.name}' has no open way for a chair of {chair_width:.2f} m; add arcs to its graph")
    if narrow:
        notes.append(
            f"{narrow[0].ref} is {_width(narrow[0], widths, chair_width):.2f} m wide, too narrow for a chair of "
            f"{chair_width:.2f} m, and is left out{_more(len(narrow) - 1)}"
        )
    unknown = sum(each.way.width is None and each.ref not in widths for each in joined)
    if unknown:
        notes.append(f"the clear width of {unknown} of {len(joined)} arcs is unknown: they are taken as single file")
    nodes, sections = _sections(hgraph, joined, widths, chair_width)
    lifts, rides = _lifts(hgraph, chair_width, now_ns, notes)
    used = {end for each in joined for end in (each.start, each.end)} | {
        stop.at for _, stops in lifts for stop in stops
    }
    refuges = _refuges(hgraph, used, lifts)
    lone = [ref for ref, node in hgraph.nodes() if ref not in used and node.kind is NodeKind.END]
    if lone:
        notes.append(f"no way leads to {full_name(hgraph, lone[0])}, which is left out{_more(len(lone) - 1)}")
    graph = TrafficGraph(
        hgraph.name,
        (*(_node(hgraph, ref) for ref, _ in hgraph.nodes() if ref in used), *nodes),
        (*sections, *rides),
        refuges,
        tuple(TrafficLift(lift.id, tuple(dict.fromkeys(str(stop.at) for stop in stops))) for lift, stops in lifts),
        chair_width=chair_width,
    )
    return BuildingTraffic(graph, tuple(notes))


def _more(count: int) -> str:
    return f", as are {count} more" if count else ""


def _holds(closure: Closure | None, now_ns: int | None) -> bool:
    return closure is not None and closure.holds(now_ns)


def _joined(hgraph: HGraph, now_ns: int | None) -> list[_Joined]:
    """Return the open arcs and doorways; two that join the same nodes are one, the wider."""
    found: dict[frozenset[NodeRef], _Joined] = {}
    for path, submap in hgraph.submaps.items():
        both: tuple[Arc | GraphDoorway, ...] = (*submap.arcs, *submap.doorways)
        for arc in both:
            if _holds(arc.way.closure, now_ns):
                continue
            start = NodeRef(path, arc.start)
            outwards = not isinstance(arc, Arc) and arc.way.one_way and arc.outwards
            end = NodeRef(path, arc.end) if isinstance(arc, Arc) else inner_end(submap, arc)
            if hgraph.node(start) is None or hgraph.node(end) is None:
                missing = start if hgraph.node(start) is None else end
                raise BuildingError(f"{arc_ref(submap, arc)} leads to {missing}, which is no node: add it")
            each = _Joined(arc_ref(submap, arc), *((end, start) if outwards else (start, end)), arc.way)
            other = found.get(frozenset((start, end)))
            if start != end and (other is None or _is_better(each, other)):
                found[frozenset((start, end))] = each
    return list(found.values())


def _is_better(one: _Joined, other: _Joined) -> bool:
    """Return whether an arc leaves a chair more freedom than another between the same nodes."""
    return (not one.way.one_way, one.way.width or math.inf) > (not other.way.one_way, other.way.width or math.inf)


def _width(each: _Joined, widths: Mapping[ArcRef, float], chair_width: float) -> float:
    """Return the least clear width [m] that is known along an arc, that of a single file if none is."""
    known = [width for width in (each.way.width, widths.get(each.ref)) if width is not None]
    return min(known) if known else chair_width + SINGLE_FILE_ROOM


def _sections(
    hgraph: HGraph, joined: list[_Joined], widths: Mapping[ArcRef, float], chair_width: float
) -> tuple[list[TrafficNode], list[Section]]:
    """Return the sections, at most 8 m long, with the nodes between them."""
    nodes: list[TrafficNode] = []
    sections: list[Section] = []
    for each in joined:
        start, end = _node(hgraph, each.start), _node(hgraph, each.end)
        frames = [hgraph.frame_of(ref.submap) for ref in (each.start, each.end)]
        points = [
            frame.point(node.x, node.y)
            for frame, node in zip(frames, (hgraph.node(each.start), hgraph.node(each.end)), strict=True)
            if node is not None
        ]
        length = max(math.dist(*points) if each.way.length is None else each.way.length, _SHORTEST)
        count = max(1, math.ceil(length / LONGEST_SECTION - 1e-9))
        width = _width(each, widths, chair_width)
        lanes = lanes_for(width, chair_width) if each.ref in widths else 1  # a door tells nothing of the way behind it
        names = [start.name]
        for k in range(1, count):
            along = k / count
            name = f"{each.ref} {k}"
            x, y = (a + (b - a) * along for a, b in ((start.x, end.x), (start.y, end.y)))
            nodes.append(TrafficNode(name, x, y, start.storey))
            names.append(name)
        names.append(end.name)
        delay_s = _delay_s(each.way, length, hgraph.costs) / count
        for k in range(count):
            name = f"{each.ref}" if count == 1 else f"{each.ref} part {k + 1}"
            sections.append(
                Section(name, names[k], names[k + 1], length / count, width, lanes, each.way.one_way, delay_s)
            )
    return nodes, sections


def _delay_s(way: Way, length: float, costs: CostSettings) -> float:
    """Return the time [s] that an arc takes beside driving its length at the usual speed: doors and slow parts."""
    if way.drive_s is not None:
        return max(0.0, way.drive_s - length / costs.speed_mps)
    slow = 0.0 if way.speed is None else max(0.0, length / way.speed - length / costs.speed_mps)
    return slow + door_cost_m(way.width, costs) / costs.speed_mps


def _lifts(
    hgraph: HGraph, chair_width: float, now_ns: int | None, notes: list[str]
) -> tuple[list[tuple[Lift, list[Stop]]], list[Section]]:
    """Return the lifts that a chair can ride with their open stops, and a section for each pair of these."""
    levels = {storey.id: level for level, storey in enumerate(hgraph.storeys)}
    found: list[tuple[Lift, list[Stop]]] = []
    sections: list[Section] = []
    for lift in hgraph.lifts.values():
        for stop in lift.stops:
            if hgraph.node(stop.at) is None:
                raise BuildingError(f"lift '{lift.id}' stops at {stop.at}, which is no node: add it there")
        widths = [width for width in (lift.door_width, lift.cabin_width) if width is not None]
        if widths and lanes_for(min(widths), chair_width) == 0:
            notes.append(f"lift {lift.id} is {min(widths):.2f} m wide, too narrow for the chair, and is left out")
            continue
        stops = [stop for stop in lift.stops if not _holds(stop.closure, now_ns)]
        if len({stop.at for stop in stops}) < 2:
            notes.append(f"lift {lift.id} has fewer than two open stops and is left out")
            continue
        wait_m, board_m, storey_m = stop_costs_m(lift, hgraph.costs)
        width = min([*widths, 2 * chair_width])
        for one, other in combinations(stops, 2):
            storeys = abs(levels.get(other.storey, 0) - levels.get(one.storey, 0))
            ride_s = (wait_m + storey_m * storeys) / hgraph.costs.speed_mps
            name = f"lift {lift.id} {one.storey} {other.storey}"
            length = max(2 * board_m, _SHORTEST)
            sections.append(Section(name, str(one.at), str(other.at), length, width, 1, delay_s=ride_s, lift=lift.id))
        found.append((lift, stops))
    return found, sections


def _refuges(hgraph: HGraph, used: set[NodeRef], lifts: list[tuple[Lift, list[Stop]]]) -> tuple[Refuge, ...]:
    """Return the goals and the lobbies; one of several of one name has its node behind it."""
    lobbies: dict[NodeRef, str] = {}
    for lift, stops in lifts:
        for stop in stops:
            lobbies.setdefault(stop.at, f"lobby of {lift.name or lift.id} on {stop.storey}")
    refuges: dict[str, Refuge] = {}
    for ref, node in hgraph.nodes():
        if ref not in used or (node.kind is not NodeKind.END and ref not in lobbies):
            continue
        name = lobbies.get(ref) or full_name(hgraph, ref)
        name = f"{name} ({ref})" if name in refuges else name
        slots = LOBBY_SLOTS if ref in lobbies else 1
        kind = RefugeKind.BAY if ref in lobbies else RefugeKind.PLACE
        refuges[name] = Refuge(name, str(ref), slots, kind, waiting=ref in lobbies)
    return tuple(refuges.values())


def _node(hgraph: HGraph, ref: NodeRef) -> TrafficNode:
    """Return a node in the frame of its storey's map; its storey has the building's name where none is stated."""
    node = hgraph.node(ref)
    assert node is not None
    x, y = hgraph.map_frame_of(ref.submap).point(node.x, node.y)
    return TrafficNode(str(ref), x, y, hgraph.storey_of(ref.submap) or hgraph.name)
