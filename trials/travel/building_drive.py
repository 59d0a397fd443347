"""Journeys in a building's folder: its storeys' maps raised to worlds, with its lifts moving between them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from math import pi

from waychair.calibration.chair_body import CHAIR_A
from waychair.control.journey.building_legs import legs_of_route, sites_of_building
from waychair.control.journey.lift_site import LiftSite
from waychair.errors import BuildingError
from waychair.maps.building.building import Building, place_of
from waychair.maps.building.hgraph import NodeRef
from waychair.maps.drawn.places import load_places
from waychair.maps.drawn.zones import load_zones
from waychair.maps.folders.depth_layer import load_depth_layer, scanned_part
from waychair.maps.folders.map_files import load_map
from waychair.planning.building.hierarchical import RoutePlanner
from waychair.runtime.journeys import StoreyMap, TravelState
from waychair.simulation.lifts.lifts import Lifts
from waychair.simulation.plan.world import ClosableDoor, World, world_from_grid
from waychair.simulation.scene.scene import LiftCabin
from waychair.simulation.simulator import Simulator
from waychair.topics import IMU
from waychair.trials.demo.demo import randomised_settings
from waychair.trials.navigate import with_closed_borders
from waychair.trials.travel.journeys import JourneyRecord, travel
from waychair.types import Goal, Place, Pose2


def drive_in_building(
    building: Building,
    planner: RoutePlanner,
    start: NodeRef,
    goal: NodeRef,
    seed: int = 0,
    passengers: int = 0,
    on_tick: Callable[[TravelState, Simulator], None] = lambda state, simulator: None,
) -> JourneyRecord:
    """Travel between two places of a building along its route, in worlds raised from its storeys' maps.

    Raises:
        BuildingError: an end is no place of a map, a storey on the way has no map, or a lift no cabin there.
        NoPath: there is no way.
        WorldError: the chair does not fit at the start, or a lift's cabin is not free on a map.
    """
    hgraph = building.hgraph
    route = planner.route(start, goal)
    begin, end = (_place(building, ref) for ref in (start, goal))
    sites = sites_of_building(hgraph)
    legs = legs_of_route(hgraph, route, sites, CHAIR_A, Goal(end.pose, end.tolerance_m, end.tolerance_rad))
    first = hgraph.storey_of(start.submap)
    storeys = storey_maps(building)
    worlds = [_raised(each, sites, begin.pose if each.storey == first else None) for each in storeys]
    heights = {each.storey: each.height for each in storeys}
    settings = randomised_settings(seed)
    settings = replace(settings, imu=replace(settings.imu, rate_hz=IMU.rate_hz))
    lifts = Lifts(worlds, seed, passengers, heights=heights)
    simulator = Simulator(next(world for world in worlds if world.level == first), CHAIR_A, settings, seed, lifts)
    ends = (first, begin.name), (hgraph.storey_of(goal.submap), end.name)
    return travel(simulator, storeys, sites, legs, ends, end, on_tick=on_tick)


def raised_worlds(building: Building) -> tuple[World, ...]:
    """Return the worlds of a building's maps, from bottom to top, with its lifts' cabins; the chair starts at a place.

    Raises:
        BuildingError: no storey has a map, or one has neither a place nor a lift's cabin.
        WorldError: the chair does not fit at a start, or a lift's cabin is not free on a map.
    """
    sites = sites_of_building(building.hgraph)
    worlds = tuple(
        _raised(each, sites, next((p.pose for p in each.places.values()), None)) for each in storey_maps(building)
    )
    if not worlds:
        raise BuildingError(f"no storey of {building.folder} has a map: add one with waychair building add --map")
    return worlds


def storey_maps(building: Building) -> list[StoreyMap]:
    """Return the storeys with a map, from bottom to top.

    Raises:
        MapError, PlaceError, ZoneError: a storey's map folder is damaged.
    """
    found = []
    for storey in building.hgraph.storeys:
        folder = building.map_folder(storey.id)
        if folder is None:
            continue
        grid = load_map(folder)
        scanned = scanned_part(grid, load_depth_layer(folder, grid))
        found.append(StoreyMap(storey.id, grid, load_places(folder), storey.height, load_zones(folder), scanned))
    return found


def _place(building: Building, ref: NodeRef) -> Place:
    place = place_of(building, ref)
    if place is None:
        raise BuildingError(f"{ref} is no place of its storey's map: name a goal, such as Ground/Ward/Bed 1")
    return place


def _raised(storey: StoreyMap, sites: Sequence[LiftSite], start: Pose2 | None) -> World:
    """Return the world of a storey's map, with its lifts' cabins and doors; `start` None: in a lobby or at a place."""
    here = [site for site in sites if site.storey == storey.storey]
    anywhere = [site.lobby for site in here] + [place.pose for place in storey.places.values()]
    if start is None and not anywhere:
        raise BuildingError(f"storey '{storey.storey}' has neither a place nor a lift's cabin: add one")
    world = world_from_grid(with_closed_borders(storey.grid), start or anywhere[0], name=storey.storey)
    lifts = tuple(LiftCabin(site.lift, site.cabin, site.length, site.width, ()) for site in here)
    doors = tuple(
        ClosableDoor(f"lift {site.lift}", site.door @ Pose2(0.0, 0.0, pi / 2), site.door_width, 0.1) for site in here
    )
    return replace(world, level=storey.storey, lifts=lifts, doors=doors)
