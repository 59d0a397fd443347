"""The demo: a rider drives a simulated chair round a floor while it maps; then the chair drives by itself.

The rider's joystick moves the chair through the shipped firmware, and the mapper maps live. The map is saved and a new
chair starts on it: it localises itself while the rider drives it a little. Then it drives to three named places among
walking people, one of whom may suddenly step in front. One door on the planned path is closed.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from waychair.calibration.chair_body import CHAIR_A
from waychair.calibration.fits.dac import DEFAULT
from waychair.errors import PlanningError
from waychair.firmware_bridge.board import HostBoard, board_program
from waychair.geometry import wrap_angle
from waychair.maps.drawn.places import load_places, save_places
from waychair.maps.drawn.zones import load_zones
from waychair.maps.folders.map_files import load_map
from waychair.maps.grid.distance_field import are_within, distance_field
from waychair.offline.mapping import Mapping, MappingSettings, live_result, save_mapping
from waychair.planning.grid.costmap import costmap_from_grid
from waychair.planning.route.global_planner import plan
from waychair.runtime.chair import Chair, ChairSettings, ChairState
from waychair.simulation.follower import Follower
from waychair.simulation.plan.world import World, load_world
from waychair.simulation.plant.plant import PlantSettings, randomised
from waychair.simulation.simulator import SimulationSettings, SimulatorSettings
from waychair.slam.frames.frame_synchroniser import Synchroniser
from waychair.slam.mapping.live_mapping import LiveMapping
from waychair.slam.trajectory_errors import TruthErrors, truth_errors
from waychair.topics import SCAN, WHEELS
from waychair.trials.drive import (
    DriveRecord,
    DriveSetup,
    SelfLocalisation,
    black_box,
    board_settings,
    drive_to_place,
    localise_by_joystick,
    simulated_chair,
)
from waychair.trials.record import drive_route, true_trajectory
from waychair.trials.ride import RecordingSimulator, Ride, ride_of
from waychair.types import FloatArray, Place, Pose2, Scan, SensorMessage, WheelTicks

WORLD = "second_floor"
SMALL_WORLD = "small_clinic"
MOST_GOALS = 3
"""In a world with more places, only the first ones are goals."""

FIRST_GOALS = ("lift", "restroom")
"""Places that are the first goals, if the world has them."""

_FARTHEST_AHEAD, _TURNING_CLEARANCE = 2.0, 0.2
"""To turn round, the rider drives at most so far [m] ahead and needs this clearance [m] round the chair's circle."""

_AT_DOOR = 0.5
"""A path that passes a door's middle within this distance [m] leads through the door."""

StageProgress = Callable[[str, float], None]


@dataclass(frozen=True, slots=True)
class Demo:
    """The results of a demo: the map and its errors, the drives on it, and the time [s] of each stage.

    `localised`: how the chair localised itself. `closed`: name of the closed door, empty for none. `person_m`: least
    distance [m] to a person while the chair drove itself, +inf without people.
    """

    world: str
    mapping: Mapping
    errors: TruthErrors
    setup: DriveSetup
    legs: tuple[DriveRecord, ...]
    localised: SelfLocalisation
    closed: str
    person_m: float
    ride: Ride
    seconds: dict[str, float]
    seed: int

    @property
    def reached(self) -> int:
        """The number of goals reached."""
        return sum(leg.reached for leg in self.legs)


class DemoWatcher:
    """Callbacks of a running demo, called in its thread; these do nothing."""

    def scan_mapped(self, live: LiveMapping, scan: Scan) -> None:
        """A scan was added to the map during the rider's drive."""

    def drive_began(self, setup: DriveSetup, chair: Chair) -> None:
        """From now on this chair localises itself and drives, on the map of `setup`."""

    def goal_chosen(self, goal: str) -> None:
        """The chair is about to drive to a place."""

    def tick_ended(self, messages: Sequence[SensorMessage], state: ChairState) -> None:
        """A tick of the chair has ended."""

    @property
    def stop_requested(self) -> bool:
        """Whether the demo should drive to no further goals."""
        return False


def run_demo(
    out: Path,
    seed: int = 0,
    progress: StageProgress = lambda stage, share: None,
    world: str | Path = WORLD,
    surprises: bool = True,
    box: Path | None = None,
    watcher: DemoWatcher | None = None,
    mapping_settings: MappingSettings | None = None,
    chair_settings: ChairSettings | None = None,
    simulation: SimulationSettings | None = None,
) -> Demo:
    """Map a drive through `world` into `out`/map, and drive to up to three places on that map.

    Without `surprises` there are no people and all doors stay open. `box` is the folder of a black box. `watcher`
    receives callbacks. The settings are those of mapping, of the chair, and of its simulated sensors and plant.

    Raises:
        WorldError: the world does not exist, it has no mapping route, or the rider ran into something.
        BoardBuildError: the firmware cannot be built: no C compiler.
    """
    stage, watcher = Stages(progress), watcher or DemoWatcher()
    building = load_world(world) if surprises else load_world(world).without_people()
    mapping_settings, chair_settings = mapping_settings or MappingSettings(), chair_settings or ChairSettings()
    simulated = (simulation or SimulationSettings()).over(randomised_settings(seed))
    simulator = RecordingSimulator(building, CHAIR_A, simulated, seed)
    with stage("map"):
        mapping, errors = map_by_joystick(out, simulator, stage, watcher, mapping_settings, chair_settings)
    with stage("save"):
        save_mapping(out / "map", mapping, mapping_settings)
        map_from_world = building.start.inverse()
        save_places(out / "map", {place.name: place_in_map(place, map_from_world) for place in building.places})
    setup = _setup_on_map(out / "map", map_from_world, chair_settings)
    goals = _goals(building)
    closed = _door_to_close(building, goals) if surprises else ""
    if closed:
        simulator.close(closed)
    simulator.populate(building.people)
    with (
        black_box(setup, box) as log,
        simulated_chair(setup, simulator, log, start_known=False) as chair,
    ):
        watcher.drive_began(setup, chair)
        with stage("find"):
            back = Follower(return_route(building), CHAIR_A.track, PlantSettings())
            found = localise_by_joystick(simulator, chair, back, watcher.tick_ended)
        began_ns, legs = simulator.now_ns, []
        with stage("drive"):
            for index, goal in enumerate(goals):
                if watcher.stop_requested:
                    break
                watcher.goal_chosen(goal)
                legs.append(drive_to_place(setup, simulator, chair, goal, on_tick=watcher.tick_ended))
                progress("drive", (index + 1) / len(goals))
    motion = simulator.motion().since(began_ns)
    person_m = float(motion.people.min(initial=np.inf))
    return Demo(
        world=building.name,
        mapping=mapping,
        errors=errors,
        setup=setup,
        legs=tuple(legs),
        localised=found,
        closed=closed,
        person_m=person_m,
        ride=ride_of(motion),
        seconds=stage.seconds,
        seed=seed,
    )


def randomised_settings(seed: int) -> SimulatorSettings:
    """Return the settings of a simulated chair whose plant differs from the calibration, randomised by the seed."""
    return SimulatorSettings(plant=randomised(PlantSettings(), seed))


def map_by_joystick(
    out: Path,
    simulator: RecordingSimulator,
    stage: Stages,
    watcher: DemoWatcher,
    settings: MappingSettings,
    chair: ChairSettings,
    route: FloatArray | None = None,
    name: str = "map",
) -> tuple[Mapping, TruthErrors]:
    """Return a floor's map and its errors; a rider drives a route through the firmware meanwhile.

    `route` (N, 2) [m, world], by default the world's mapping route. `name` is that of the stage whose progress is told.
    """
    bag = out / "drive.mcap"
    bag.unlink(missing_ok=True)
    live = LiveMapping(settings, CHAIR_A.base_from_laser, CHAIR_A)
    wiring = board_settings(DriveSetup(simulator.world.grid, {}, CHAIR_A, DEFAULT, chair=chair))
    route = simulator.world.route() if route is None else route
    with HostBoard(board_program(), wiring) as board:
        simulator.wire(board)
        try:
            on_message = _FrameMapper(live, watcher).message
            drive_route(
                simulator=simulator,
                body=CHAIR_A,
                route=route,
                bag=bag,
                progress=lambda share: stage.progress(name, share),
                on_message=on_message,
            )
        finally:
            simulator.wire(None)
    mapping = live_result(live, bag, "a simulated drive, mapped live")
    return mapping, truth_errors(mapping.result.trajectory, true_trajectory(bag))


class _FrameMapper:
    """Assembles sensor messages into frames and maps each complete frame."""

    def __init__(self, live: LiveMapping, watcher: DemoWatcher) -> None:
        topics = (SCAN, WHEELS)
        self._live, self._watcher = live, watcher
        self._frames = Synchroniser(topics)
        self._topics = {topic.type: topic for topic in topics}

    def message(self, message: SensorMessage) -> None:
        """Add a message and map the frames that it completes."""
        if isinstance(message, Scan | WheelTicks):
            for frame in self._frames.add(self._topics[type(message)], message):
                self._live.process(frame)
                if frame.scan is not None:
                    self._watcher.scan_mapped(self._live, frame.scan)


def _setup_on_map(folder: Path, map_from_world: Pose2, chair: ChairSettings) -> DriveSetup:
    """Return the setting of a drive on the saved map."""
    places = load_places(folder)
    return DriveSetup(
        grid=load_map(folder),
        places=places,
        body=CHAIR_A,
        calibration=DEFAULT,
        map_from_world=map_from_world,
        chair=chair,
        zones=load_zones(folder),
    )


def _goals(world: World) -> list[str]:
    """Return the names of the goals, in the order of the drives."""
    names = [place.name for place in world.places]
    first = [name for name in FIRST_GOALS if name in names]
    return [*first, *(name for name in names if name not in first)][:MOST_GOALS]


def _door_to_close(world: World, goals: list[str]) -> str:
    """Return a door on a planned path that a detour can avoid, searching the last drives first; empty for none."""
    places = {place.name: place.pose for place in world.places}
    for begin, end in reversed([(places[a], places[b]) for a, b in pairwise(goals)]):
        way = plan(costmap_from_grid(world.grid, CHAIR_A), begin, end).poses[:, :2]
        for door in world.doors:
            if np.hypot(*(way - (door.middle.x, door.middle.y)).T).min() > _AT_DOOR:
                continue
            try:
                plan(costmap_from_grid(world.with_closed([door.name]).grid, CHAIR_A), begin, end)
            except PlanningError:
                continue
            return door.name
    return ""


def return_route(world: World) -> FloatArray:
    """Return the reversed mapping route (N, 2) [m], after a spot straight ahead with space to turn round."""
    route, field = world.route(), distance_field(world.grid)
    if len(route) < 2:
        return route[:0]
    ahead = (route[-1] - route[-2]) / math.dist(route[-1], route[-2])
    spots = route[-1] + np.arange(0.0, _FARTHEST_AHEAD, field.resolution)[:, None] * ahead
    shut = are_within(field.metres, world.grid, spots, CHAIR_A.width / 2)
    tight = are_within(field.metres, world.grid, spots, CHAIR_A.circumscribed_radius + _TURNING_CLEARANCE)
    first = int(np.argmin(tight))
    reached = not tight[first] and not shut[:first].any()
    return np.concatenate([spots[first : first + 1] if first and reached else route[:0], route[-2::-1]])


class Stages:
    """Measures the wall time of the stages and reports each stage's progress."""

    def __init__(self, progress: StageProgress) -> None:
        self.seconds: dict[str, float] = {}
        self.progress = progress

    @contextmanager
    def __call__(self, name: str) -> Iterator[None]:
        self.progress(name, 0.0)
        started = time.perf_counter()
        yield
        self.seconds[name] = time.perf_counter() - started
        self.progress(name, 1.0)


def place_in_map(place: Place, map_from_world: Pose2) -> Place:
    """Return a place of the world in a map's frame."""
    pose = map_from_world @ place.pose
    return replace(place, pose=Pose2(round(pose.x, 3), round(pose.y, 3), round(wrap_angle(pose.theta), 4)))
