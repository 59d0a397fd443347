"""The demo over storeys: a rider maps two storeys by joystick, they are joined by a lift, and the chair travels by itself.

On each storey the rider drives through the rooms of the journey, into the lift, whose door somebody holds open, and along the
mapping route. The maps know nothing of each other until the graph joins them: by the place before the lift's door, and by the
cabin that each map shows behind it. Then the chair drives from a room to a room of the other storey, by the moving lift.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from waychair.calibration.chair_body import CHAIR_A
from waychair.control.journey.building_legs import legs_of_route, sites_of_building
from waychair.control.journey.lift_site import LiftSite, stand_in
from waychair.errors import BuildingError, WorldError
from waychair.maps.building.building import (
    Building,
    add_storey,
    new_building,
    place_of,
    save_building,
    save_with_map,
)
from waychair.maps.building.hgraph import HGraph, NodeRef, Storey
from waychair.maps.building.hgraph_edits import with_lift
from waychair.maps.drawn.places import load_places, save_places
from waychair.maps.editing.cabins import cabin_ahead
from waychair.maps.folders.map_files import load_map
from waychair.maps.grid.cells import OCCUPIED_FROM, cells_from_points, inside
from waychair.maps.grid.distance_field import are_within, distance_field
from waychair.offline.mapping import Mapping as MadeMap
from waychair.offline.mapping import MappingSettings, save_mapping
from waychair.planning.building.generation.storey_generation import (
    aligned_storey,
    generated_storey,
    save_generation,
    with_lift_stop,
)
from waychair.planning.building.hierarchical import RoutePlanner
from waychair.planning.grid.costmap import costmap_from_grid
from waychair.planning.route.global_planner import plan
from waychair.runtime.chair import ChairSettings
from waychair.runtime.journeys import TravelState
from waychair.simulation.lifts.lifts import Lifts
from waychair.simulation.plan.world import World, load_levels
from waychair.simulation.simulator import SimulationSettings, Simulator
from waychair.slam.trajectory_errors import TruthErrors
from waychair.topics import IMU
from waychair.trials.demo.demo import (
    DemoWatcher,
    StageProgress,
    Stages,
    map_by_joystick,
    place_in_map,
    randomised_settings,
)
from waychair.trials.ride import RecordingSimulator
from waychair.trials.travel.building_drive import storey_maps
from waychair.trials.travel.journey_runs import random_ends
from waychair.trials.travel.journeys import JourneyRecord, sites_of, travel
from waychair.trials.travel.world_building import lift_place, storey_title
from waychair.types import FloatArray, Goal, Place, Pose2

PASSENGERS = 1
"""People who ride the lifts while the chair travels."""

SPACING = 0.3
"""m; distance between the points of a rider's way, which so bends through a door as planned."""


@dataclass(frozen=True, slots=True)
class BuildingDemo:
    """The result of a demo over storeys.

    By storey, in the order of the drives: `mappings` with their `errors`, and `driven` (N, 3), the true poses of the journey in
    that storey's map. `seconds`: wall time of each stage.
    """

    world: str
    lift: str
    building: Building
    mappings: dict[str, MadeMap]
    errors: dict[str, TruthErrors]
    record: JourneyRecord
    driven: dict[str, FloatArray]
    seconds: dict[str, float]
    seed: int


def is_building(world: str | Path) -> bool:
    """Return whether a world has several levels that lifts join."""
    levels = load_levels(world)
    return len(levels) > 1 and any(level.lifts for level in levels)


def run_building_demo(
    out: Path,
    seed: int = 0,
    progress: StageProgress = lambda stage, share: None,
    world: str | Path = "hospital",
    surprises: bool = True,
    box: Path | None = None,
    watcher: DemoWatcher | None = None,
    mapping_settings: MappingSettings | None = None,
    chair_settings: ChairSettings | None = None,
    simulation: SimulationSettings | None = None,
) -> BuildingDemo:
    """Map the two lowest levels of a world that a lift joins, make `out`/building of them, and travel between two places.

    Without `surprises` there are neither people nor passengers. `box` is the folder of a black box. The settings are those of mapping, of the chair, and of its
    simulated sensors and plant.

    Raises:
        WorldError: the world does not exist, no lift joins its lowest levels, or the rider ran into something.
        BuildingError: a map does not show the lift's cabin.
        NoPath: the maps show no way.
        BoardBuildError: the firmware cannot be built: no C compiler.
    """
    stage, watcher = Stages(progress), watcher or DemoWatcher()
    mapping_settings, chair_settings = mapping_settings or MappingSettings(), chair_settings or ChairSettings()
    levels = load_levels(world)[:2]
    levels = levels if surprises else tuple(level.without_people() for level in levels)
    lifts = Lifts(levels, seed, PASSENGERS if surprises else 0)
    lift = _joining(lifts)
    ends = random_ends(levels, seed)
    simulated = (simulation or SimulationSettings()).over(randomised_settings(seed))
    simulated = replace(simulated, imu=replace(simulated.imu, rate_hz=IMU.rate_hz))
    mappings, errors = dict[str, MadeMap](), dict[str, TruthErrors]()
    for level in levels:
        name, folder = f"map {level.level}", out / "maps" / level.level
        with stage(name):
            room = next(place for there, place in ends if there == level.level)
            site = next(each for each in sites_of(lifts, CHAIR_A) if (each.lift, each.storey) == (lift, level.level))
            mapped = RecordingSimulator(level, CHAIR_A, simulated, seed)
            folder.mkdir(parents=True, exist_ok=True)
            mapping, error = map_by_joystick(
                folder,
                mapped,
                stage,
                watcher,
                mapping_settings,
                chair_settings,
                riders_route(level, room, site),
                name,
            )
            save_mapping(folder, mapping, mapping_settings)
            save_places(folder, _seen_places(level, mapping))
            mappings[level.level], errors[level.level] = mapping, error
    with stage("join"):
        building = _joined(out / "building", levels, lifts, lift, out / "maps", progress)
    driven: dict[str, list[FloatArray]] = {level.level: [] for level in levels}
    frames = {level.level: level.start.inverse() for level in levels}

    def note(state: TravelState, simulator: Simulator) -> None:
        driven[simulator.world.level].append((frames[simulator.world.level] @ simulator.truth()).array())

    with stage("travel"):
        begin = next(place.pose for place in _level(levels, ends[0][0]).places if place.name == ends[0][1])
        first = replace(_level(levels, ends[0][0]), start=begin)
        simulator = Simulator(first, CHAIR_A, simulated, seed, lifts)
        record = _travel(building, simulator, ends, chair_settings, note, frames, watcher, box)
    paths = {level: np.array(poses).reshape(-1, 3) for level, poses in driven.items()}
    name = levels[0].name.partition("/")[0]
    return BuildingDemo(name, lift, building, mappings, errors, record, paths, stage.seconds, seed)


def riders_route(world: World, room: str, site: LiftSite) -> FloatArray:
    """Return a rider's way (N, 2) [m, world]: into a room, into a lift and out again, then along the mapping route."""
    costmap = costmap_from_grid(world.grid, CHAIR_A)
    inside_lift = site.cabin @ stand_in(site, CHAIR_A)
    before = site.door @ Pose2(1.6, 0.0)
    place = next(place.pose for place in world.places if place.name == room)
    rest = world.route()
    stops = [world.start, place, before, inside_lift, before]
    parts = [_spaced(plan(costmap, one, other).poses[:, :2]) for one, other in pairwise(stops)]
    if len(rest):
        parts += [_spaced(plan(costmap, before, Pose2(*rest[0])).poses[:, :2]), rest]
    return np.concatenate(parts)


def _spaced(path: FloatArray) -> FloatArray:
    """Return points of a path (N, 2) so far apart as a rider looks ahead, its end among them."""
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])
    wanted = np.linspace(0.0, along[-1], max(2, round(along[-1] / SPACING) + 1))[1:]
    return np.column_stack([np.interp(wanted, along, path[:, k]) for k in (0, 1)])


def _joining(lifts: Lifts) -> str:
    for name, known in lifts.lifts.items():
        if len(known.stops) > 1:
            return name
    raise WorldError("no lift joins the two lowest levels: take another world, such as hospital or two_floors")


def _level(levels: Sequence[World], name: str) -> World:
    return next(level for level in levels if level.level == name)


def _seen_places(world: World, mapping: MadeMap) -> dict[str, Place]:
    """Return the places at which the map shows room for the chair."""
    grid, metres = mapping.grid, distance_field(mapping.grid).metres
    found = {}
    for place in world.places:
        mine = place_in_map(place, world.start.inverse())
        point = np.array([[mine.pose.x, mine.pose.y]])
        cell = cells_from_points(grid, point)
        seen = inside(grid, cell)[0] and 0 <= grid.cells[tuple(cell[0])] < OCCUPIED_FROM
        if seen and not are_within(metres, grid, point, CHAIR_A.circumscribed_radius)[0]:
            found[place.name] = mine
    return found


def _joined(
    folder: Path, levels: Sequence[World], lifts: Lifts, lift: str, maps: Path, progress: StageProgress
) -> Building:
    """Return the building made of the storeys' maps: a graph of each, and the lift with the cabins that the maps show."""
    if folder.exists():
        shutil.rmtree(folder)  # of a demo before
    building = new_building(folder, levels[0].name.partition("/")[0])
    for number, level in enumerate(levels):
        storey = Storey(level.level, storey_title(level.level), lifts.heights[level.level])
        building = add_storey(building, storey)
        building = save_with_map(building, level.level, maps / level.level)
        made = generated_storey(building, level.level, CHAIR_A)
        save_generation(made, level.level)
        building = made.building
        progress("join", (number + 1) / (len(levels) + 1))
    for level in levels:
        building = replace(building, hgraph=with_lift_stop(building.hgraph, level.level, lift, lift_place(level, lift)))
    building = replace(building, hgraph=aligned_storey(building, levels[1].level))
    for level in levels:
        building = _with_cabin(building, lift, level)
    save_building(building)
    return building


def _with_cabin(building: Building, lift: str, level: World) -> Building:
    folder, known = building.map_folder(level.level), building.hgraph.lifts[lift]
    assert folder is not None
    lobby = load_places(folder)[lift_place(level, lift)].pose
    cabin = cabin_ahead(load_map(folder), lobby)
    if cabin is None:
        raise BuildingError(
            f"the map of '{level.level}' shows no cabin before {lobby}: drive into the lift and map again"
        )
    stops = tuple(replace(each, cabin=cabin.middle) if each.storey == level.level else each for each in known.stops)
    changed = replace(known, stops=stops, cabin_width=cabin.width, cabin_depth=cabin.depth, door_width=cabin.door)
    return replace(building, hgraph=with_lift(building.hgraph, changed))


def _travel(
    building: Building,
    simulator: Simulator,
    ends: tuple[tuple[str, str], tuple[str, str]],
    settings: ChairSettings,
    note: Callable[[TravelState, Simulator], None],
    frames: Mapping[str, Pose2],
    watcher: DemoWatcher,
    box: Path | None,
) -> JourneyRecord:
    """Let the chair travel between two places of the building, from where it stands."""
    hgraph = building.hgraph
    start, goal = (_goal_node(hgraph, *each) for each in ends)
    end = place_of(building, goal)
    assert end is not None
    sites = sites_of_building(hgraph)
    route = RoutePlanner(hgraph).route(start, goal)
    legs = legs_of_route(hgraph, route, sites, CHAIR_A, Goal(end.pose, end.tolerance_m, end.tolerance_rad))
    return travel(
        simulator,
        storey_maps(building),
        sites,
        legs,
        ends,
        end,
        settings,
        note,
        frames=frames,
        watcher=watcher,
        box=box,
    )


def _goal_node(hgraph: HGraph, storey: str, name: str) -> NodeRef:
    for ref, node in hgraph.nodes():
        if node.name == name and hgraph.storey_of(ref.submap) == storey:
            return ref
    raise BuildingError(f"the map of '{storey}' does not show '{name}': drive there and map again")
