"""Operations on the lifts and the beacons of a building."""

from __future__ import annotations

from dataclasses import replace

from waychair.errors import BuildingError
from waychair.maps.building.hgraph import Beacon, Closure, HGraph, Lift, NodeKind, Origin, Stop
from waychair.maps.building.hgraph_edits import with_lift, with_nodes, with_submap
from waychair.maps.building.text_forms import beacon_line, beacon_of, lift_line, lift_of, stop_line, stop_of
from waychair.maps.editing.addresses import checked_line_of, node_at, node_ref, submap_at
from waychair.maps.editing.arc_edits import Operation
from waychair.maps.editing.draft import Draft
from waychair.types import Pose2


class SetLift(Operation, frozen=True, tag="set_lift"):
    """Add a lift, or change its name, cabin and costs [m]; None where unknown or as the building's."""

    id: str
    name: str = ""
    cabin_width: float | None = None
    cabin_depth: float | None = None
    door_width: float | None = None
    wait: float | None = None
    board: float | None = None
    per_storey: float | None = None


class DeleteLift(Operation, frozen=True, tag="delete_lift"):
    """Delete a lift; the nodes in front of its doors become cross nodes."""

    id: str


class SetStop(Operation, frozen=True, tag="set_stop"):
    """Make a node the stop of a lift on its storey, or change the stop; `cabin`: x, y, theta in the storey's map."""

    lift: str
    at: str
    door_width: float | None = None
    cabin: tuple[float, float, float] | None = None
    closed: str = ""


class DeleteStop(Operation, frozen=True, tag="delete_stop"):
    """Take a stop out of a lift; its node becomes a cross node."""

    lift: str
    at: str


class SetBeacon(Operation, frozen=True, tag="set_beacon"):
    """Add a beacon to a sub-map, or move it: its pose x, y, theta in the sub-map's frame, and the node it stands for."""

    submap: str
    id: str
    x: float
    y: float
    theta: float = 0.0
    node: str = ""


class DeleteBeacon(Operation, frozen=True, tag="delete_beacon"):
    """Delete a beacon."""

    submap: str
    id: str


def set_lift(draft: Draft, asked: SetLift) -> Draft:
    """Return the draft with a lift added or changed."""
    known = draft.hgraph.lifts.get(asked.id, Lift(asked.id))
    changed = replace(
        known,
        name=asked.name.strip(),
        cabin_width=asked.cabin_width,
        cabin_depth=asked.cabin_depth,
        door_width=asked.door_width,
        wait=asked.wait,
        board=asked.board,
        per_storey=asked.per_storey,
    )
    checked_line_of(lift_line(changed), lift_of)
    return replace(draft, hgraph=with_lift(draft.hgraph, changed))


def delete_lift(draft: Draft, asked: DeleteLift) -> Draft:
    """Return the draft without a lift."""
    lift = _lift_at(draft.hgraph, asked.id)
    for stop in lift.stops:
        draft = delete_stop(draft, DeleteStop(lift.id, str(stop.at)))
    lifts = {key: each for key, each in draft.hgraph.lifts.items() if key != asked.id}
    return replace(draft, hgraph=replace(draft.hgraph, lifts=lifts))


def set_stop(draft: Draft, asked: SetStop) -> Draft:
    """Return the draft with a node as the stop of a lift on its storey; the lift's other stop on that storey goes."""
    hgraph, ref = draft.hgraph, node_ref(asked.at)
    node, lift, storey = node_at(hgraph, ref), _lift_at(hgraph, asked.lift), hgraph.storey_of(ref.submap)
    if not storey:
        raise BuildingError(f"{ref} is on no storey: a lift stops at nodes of storeys")
    cabin = None if asked.cabin is None else Pose2(*asked.cabin)
    closure = Closure(asked.closed.strip()) if asked.closed.strip() else None
    stop = Stop(storey, ref, asked.door_width, closure, cabin)
    checked_line_of(stop_line(lift.id, stop), stop_of)
    others = [each for each in lift.stops if each.storey != storey]
    for each in lift.stops:
        if each.storey == storey and each.at != ref:
            draft = delete_stop(draft, DeleteStop(lift.id, str(each.at)))
    submap = draft.hgraph.submaps[ref.submap]
    stop_node = replace(node, kind=NodeKind.LIFT, origin=Origin.HAND)
    hgraph = draft.hgraph if node.kind is NodeKind.LIFT else with_submap(draft.hgraph, with_nodes(submap, [stop_node]))
    hgraph = with_lift(hgraph, replace(lift, stops=(*others, stop)))
    return replace(draft, hgraph=with_stops_in_order(hgraph))


def delete_stop(draft: Draft, asked: DeleteStop) -> Draft:
    """Return the draft without a lift's stop; its node, if no other lift stops there, is a goal or a cross node again."""
    hgraph, ref = draft.hgraph, node_ref(asked.at)
    lift = _lift_at(hgraph, asked.lift)
    stops = tuple(each for each in lift.stops if each.at != ref)
    if len(stops) == len(lift.stops):
        raise BuildingError(f"lift '{lift.id}' does not stop at {ref}")
    hgraph = with_lift(hgraph, replace(lift, stops=stops))
    node = hgraph.node(ref)
    if node is not None and all(stop.at != ref for each in hgraph.lifts.values() for stop in each.stops):
        is_place = node.name in draft.places_of(hgraph.storey_of(ref.submap))
        freed = replace(node, kind=NodeKind.END if is_place else NodeKind.CROSS)
        hgraph = with_submap(hgraph, with_nodes(hgraph.submaps[ref.submap], [freed]))
    return replace(draft, hgraph=hgraph)


def set_beacon(draft: Draft, asked: SetBeacon) -> Draft:
    """Return the draft with a beacon added or changed."""
    submap = submap_at(draft.hgraph, asked.submap)
    if asked.node and asked.node not in submap.nodes:
        raise BuildingError(f"there is no node '{asked.node}' in this sub-map: choose one of its nodes")
    beacon = Beacon(asked.id, Pose2(asked.x, asked.y, asked.theta), asked.node)
    checked_line_of(beacon_line(beacon), beacon_of)
    others = tuple(each for each in submap.beacons if each.id != asked.id)
    return replace(draft, hgraph=with_submap(draft.hgraph, replace(submap, beacons=(*others, beacon))))


def delete_beacon(draft: Draft, asked: DeleteBeacon) -> Draft:
    """Return the draft without a beacon."""
    submap = submap_at(draft.hgraph, asked.submap)
    kept = tuple(each for each in submap.beacons if each.id != asked.id)
    if len(kept) == len(submap.beacons):
        raise BuildingError(f"there is no beacon '{asked.id}' in this sub-map")
    return replace(draft, hgraph=with_submap(draft.hgraph, replace(submap, beacons=kept)))


def _lift_at(hgraph: HGraph, key: str) -> Lift:
    lift = hgraph.lifts.get(key)
    if lift is None:
        raise BuildingError(f"there is no lift '{key}': add it first")
    return lift


def with_stops_in_order(hgraph: HGraph) -> HGraph:
    """Return the graph with the stops of each lift in the order of the storeys."""
    order = {storey.id: at for at, storey in enumerate(hgraph.storeys)}
    lifts = {
        key: replace(lift, stops=tuple(sorted(lift.stops, key=lambda stop: order.get(stop.storey, -1))))
        for key, lift in hgraph.lifts.items()
    }
    return replace(hgraph, lifts=lifts)
