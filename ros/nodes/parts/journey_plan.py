"""The plan of a journey through the building of a map: its legs, and the maps and lifts of the storeys on the way."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from waychair.calibration.chair_body import ChairBody
from waychair.control.journey.building_legs import sites_of_building, stops_without_map
from waychair.control.journey.journey import Leg
from waychair.control.journey.lift_site import LiftSite
from waychair.errors import BuildingError
from waychair.maps.building.building import Building, goals, place_of
from waychair.maps.building.hgraph import HGraph, NodeRef, full_name
from waychair.maps.building.zone_rules import with_zones
from waychair.maps.drawn.places import find, load_places
from waychair.maps.drawn.zones import load_zones
from waychair.maps.folders.map_files import load_map
from waychair.planning.building.hierarchical import RoutePlanner
from waychair.planning.building.learnt_drives import building_of_map
from waychair.planning.building.pose_ends import nearest_node
from waychair.planning.grid.costmap import costmap_from_grid
from waychair.ros.messages.floor import StoreyGoal
from waychair.runtime.journeys import StoreyMap
from waychair.runtime.pages.building_goals import legs_to
from waychair.types import Pose2


@dataclass(frozen=True, slots=True)
class JourneyPlan:
    """A journey from a storey: the goal's full name, the legs, the sites of all lifts, and the maps of all their storeys.

    `folders`: the storeys' map folders, absolute. `unmapped`: see `Traveller`.
    """

    goal: str
    storey: str
    legs: tuple[Leg, ...]
    sites: tuple[LiftSite, ...]
    maps: tuple[StoreyMap, ...]
    folders: Mapping[str, str]
    unmapped: Mapping[str, Mapping[str, float]]


def planned(map_folder: Path, pose: Pose2, body: ChairBody, goal: StoreyGoal) -> JourneyPlan:
    """Return the journey from a pose on a map to a goal of the building that the map is a storey of.

    Raises:
        BuildingError: the map is of no building, there is no such goal, or a lift on the way has no cabin.
        NoPath, PlanningError: there is no way, or the chair does not stand on free ground.
        WaychairError: a map cannot be read.
    """
    building, storey = known_building(map_folder)
    planner = RoutePlanner(with_zones(building))
    ref = _goal_node(planner, building, goal)
    place = place_of(building, ref)
    if place is None:
        raise BuildingError(f"'{goal.goal}' is no place of its storey's map: set the place, or choose another goal")
    costmap = costmap_from_grid(load_map(map_folder), body, zones=load_zones(map_folder))
    start, _ = nearest_node(building.hgraph, storey, pose, costmap)
    sites = sites_of_building(building.hgraph)
    legs = legs_to(planner, sites, body, start, ref, place)
    taken = {leg.lift for leg in legs if leg.lift}
    wanted = {leg.storey for leg in legs} | {site.storey for site in sites if site.lift in taken}
    maps, folders = [], {}
    for each in building.hgraph.storeys:
        folder = building.map_folder(each.id)
        if each.id in wanted and folder is not None:
            maps.append(StoreyMap(each.id, load_map(folder), {}, each.height))
            folders[each.id] = str(folder.resolve())
    if missing := sorted({leg.storey for leg in legs} - set(folders)):
        raise BuildingError(f"storey '{missing[0]}' has no map: add it with waychair building add")
    unmapped = stops_without_map(building.hgraph, sites, folders)
    return JourneyPlan(full_name(planner.hgraph, ref), storey, legs, sites, tuple(maps), folders, unmapped)


def known_building(map_folder: Path) -> tuple[Building, str]:
    """Return the building that a map is a storey of, and the storey.

    Raises:
        BuildingError: it is of none, or the building is damaged.
    """
    found = building_of_map(map_folder)
    if found is None:
        raise BuildingError("the map belongs to no building: start with a map folder of one")
    return found


def storey_named(building: Building, name: str) -> tuple[str, Path]:
    """Return the id of a storey, given by its id or its name, and its map folder.

    Raises:
        BuildingError: there is no such storey, or it has no map.
    """
    storey = storey_id(building, name)
    folder = building.map_folder(storey)
    if folder is None:
        raise BuildingError(f"storey '{storey}' has no map: add it with waychair building add")
    return storey, folder


def storey_id(building: Building, name: str) -> str:
    """Return the id of a storey, given by its id or its name.

    Raises:
        BuildingError: there is no such storey.
    """
    wanted = name.strip().casefold()
    for each in building.hgraph.storeys:
        if wanted in (each.id.casefold(), each.name.casefold()):
            return each.id
    known = ", ".join(each.name or each.id for each in building.hgraph.storeys)
    raise BuildingError(f"there is no storey '{name}': take one of {known}")


def start_named(building: Building, goal: StoreyGoal) -> tuple[str, Path, Pose2]:
    """Return the storey, its map folder and the pose at which a chair stands: a place of a storey, or the path of a goal.

    Raises:
        BuildingError: there is no such storey or goal, or it is no place of its storey's map.
        UnknownPlace, PlaceError: the storey has no such place, or its places cannot be read.
    """
    if goal.storey:
        storey, folder = storey_named(building, goal.storey)
        return storey, folder, find(load_places(folder), goal.goal, f"storey {storey}").pose
    ref = _named(building.hgraph, goal.goal, "")
    place, there = place_of(building, ref), building.hgraph.storey_of(ref.submap)
    mapped = building.map_folder(there)
    if place is None or mapped is None:
        raise BuildingError(f"'{goal.goal}' is no place of its storey's map: set the place, or choose another one")
    return there, mapped, place.pose


def _goal_node(planner: RoutePlanner, building: Building, goal: StoreyGoal) -> NodeRef:
    """Return the node of a goal.

    Raises:
        BuildingError: there is none, or more than one.
    """
    if not goal.storey:
        return planner.node(goal.goal)
    return _named(planner.hgraph, goal.goal, storey_named(building, goal.storey)[0])


def _named(hgraph: HGraph, goal: str, storey: str) -> NodeRef:
    """Return the node of a goal by its own name or its path, on a storey, "" for any.

    Raises:
        BuildingError: there is none, or more than one.
    """
    wanted, found = goal.strip().casefold(), []
    for name, ref in goals(hgraph).items():
        node = hgraph.node(ref)
        own = "" if node is None else (node.name or node.id).casefold()
        if storey in ("", hgraph.storey_of(ref.submap)) and wanted in (own, name.casefold()):
            found.append(ref)
    if len(found) != 1:
        count = f"there are {len(found)} goals" if found else "there is no goal"
        where = f" on storey '{storey}'" if storey else ""
        raise BuildingError(f"{count} '{goal}'{where}: see waychair building stats, and give a path")
    return found[0]
