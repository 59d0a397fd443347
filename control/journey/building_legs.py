"""The lifts and routes of a building's graph as sites and legs of journeys."""

from __future__ import annotations

import math
from collections.abc import Container, Sequence

from waychair.calibration.chair_body import ChairBody
from waychair.control.journey.journey import Leg
from waychair.control.journey.lift_site import LOBBY_AHEAD, LiftSite, stand_in
from waychair.errors import BuildingError
from waychair.maps.building.hgraph import HGraph, Lift, NodeRef, Stop
from waychair.planning.building.hierarchical import Route
from waychair.planning.building.movements import lift_title
from waychair.types import Goal, Pose2

WALL = 0.1
"""m; thickness of the wall between a cabin and its door's leaves."""

USUAL_DOOR = 0.9
"""m; clear width of a lift's door that the building does not tell (EN 81-70, type 2)."""

LOBBY_TOLERANCE_M, LOBBY_TOLERANCE_RAD = 0.3, math.radians(20.0)
"""m, rad; a lobby need not be met exactly."""

CABIN_TOLERANCE_M, CABIN_TOLERANCE_RAD = 0.1, math.radians(8.0)
"""m, rad; of the place in a cabin."""


def sites_of_building(hgraph: HGraph) -> tuple[LiftSite, ...]:
    """Return the sites of all stops with a cabin.

    Raises:
        BuildingError: a lift with such a stop has no size.
    """
    return tuple(
        _site(hgraph, lift, stop) for lift in hgraph.lifts.values() for stop in lift.stops if stop.cabin is not None
    )


def stops_without_map(hgraph: HGraph, sites: Sequence[LiftSite], mapped: Container[str]) -> dict[str, dict[str, float]]:
    """Return of each lift the heights [m] of its stops on storeys without a map, or where its cabin is not known."""
    known = {(site.lift, site.storey) for site in sites if site.storey in mapped}
    heights = {storey.id: storey.height for storey in hgraph.storeys}
    return {
        lift.id: {stop.storey: heights[stop.storey] for stop in lift.stops if (lift.id, stop.storey) not in known}
        for lift in hgraph.lifts.values()
    }


def legs_of_route(
    hgraph: HGraph, route: Route, sites: Sequence[LiftSite], body: ChairBody, goal: Goal
) -> tuple[Leg, ...]:
    """Return the legs of a route to a goal in its last storey's map.

    Raises:
        BuildingError: a lift on the way has no cabin on one of its storeys.
    """
    known = {(site.lift, site.storey): site for site in sites}
    storey, legs = hgraph.storey_of(route.start.submap), list[Leg]()
    for part in route.legs:
        if part.lift:
            for stop in (storey, part.storey):
                if (part.lift, stop) not in known:
                    title = lift_title(hgraph.lifts[part.lift])
                    raise BuildingError(f"{title} has no cabin on storey '{stop}': set it with waychair building cabin")
            legs.append(leg_to_lift(known[part.lift, storey], body))
            storey = part.storey
    legs.append(Leg(storey, goal))
    return tuple(legs)


def leg_to_lift(site: LiftSite, body: ChairBody) -> Leg:
    """Return the leg that ends in a lift."""
    cabin = site.cabin @ stand_in(site, body)
    return Leg(
        site.storey,
        Goal(site.lobby, LOBBY_TOLERANCE_M, LOBBY_TOLERANCE_RAD, (site.waiting,)),
        site.lift,
        Goal(cabin, CABIN_TOLERANCE_M, CABIN_TOLERANCE_RAD, (site.waiting,)),
    )


def _site(hgraph: HGraph, lift: Lift, stop: Stop) -> LiftSite:
    if lift.cabin_depth is None or lift.cabin_width is None:
        raise BuildingError(f"{lift_title(lift)} has no size: give its record cabin_width_m and cabin_depth_m")
    assert stop.cabin is not None
    ahead = lift.cabin_depth / 2 + WALL
    width = stop.door_width or lift.door_width or USUAL_DOOR
    lobby = _lobby(stop.cabin @ Pose2(ahead, 0.0), _in_map(hgraph, stop.at))
    return LiftSite(lift.id, stop.storey, stop.cabin, lift.cabin_depth, lift.cabin_width, ahead, width, lobby)


def _lobby(door: Pose2, node: tuple[float, float]) -> Pose2:
    """Return where a chair waits: at the stop's node if that is before the door, facing it, else straight before it."""
    at = door.inverse() @ Pose2(*node)
    spot = door @ Pose2(at.x if at.x >= 1.0 else LOBBY_AHEAD, at.y if at.x >= 1.0 else 0.0)
    return Pose2(spot.x, spot.y, math.atan2(door.y - spot.y, door.x - spot.x))


def _in_map(hgraph: HGraph, ref: NodeRef) -> tuple[float, float]:
    """Return where a node is in its storey's map [m]."""
    node = hgraph.node(ref)
    if node is None:
        raise BuildingError(f"there is no node {ref} in this building: see waychair building stats")
    return hgraph.map_frame_of(ref.submap).point(node.x, node.y)
