"""The demo: a recording becomes a map, and a simulated chair drives to three places in it through joystick volts.

With the real recording at hand, the building is the one that was recorded: the world is raised from its map. Without
it, a world that ships is first driven along its mapping route, and mapped on the way; the chair then drives in the true
world, by the map it made. A bag keeps what the sensors said.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from waychair.calibration.chair import CHAIR_A
from waychair.calibration.dac import DEFAULT
from waychair.geometry import wrap_angle
from waychair.maps.map_files import load_map
from waychair.maps.places import load_places, save_places
from waychair.maps.zones import load_zones
from waychair.recording import read_recording
from waychair.runtime.live_mapping import LiveMapping
from waychair.runtime.mapping import Mapping, MappingSettings, live_result, map_recording, save_mapping
from waychair.simulation.plant import PlantSettings, randomised
from waychair.simulation.simulator import SensorMessage, Simulator, SimulatorSettings
from waychair.simulation.world import World, load_world, world_from_grid
from waychair.slam.synchroniser import Synchroniser
from waychair.topics import SCAN, WHEELS
from waychair.trials.drive import Leg, Setting, drive_to_places
from waychair.trials.record import drive_route
from waychair.types import Place, Pose2, Scan, WheelTicks

REAL_LOG = Path("lidar_intel") / "intel_first1088s.clf.gz"
"""Intel Research Lab, Seattle, recorded by D. Haehnel: within the folder of recordings."""

REAL_PLACES = (
    Place("north office", Pose2(4.3, 3.0, 1.57)),
    Place("east lounge", Pose2(15.5, -7.0, 0.0)),
    Place("south corridor", Pose2(-5.0, -19.0, 3.14)),
)
"""Poses in the frame of the log's first scan, put where the recording robot went; the names are ours."""

SMALL_WORLD = "small_clinic"
MOST_GOALS = 3
"""A world with more places than these is driven to its first ones only."""

Progress = Callable[[str, float], None]


@dataclass(frozen=True, slots=True)
class Demo:
    """What the demo made: the map, the legs that were driven in it, and the seconds each stage took."""

    title: str
    lead: str
    mapping: Mapping
    setting: Setting
    legs: tuple[Leg, ...]
    seconds: dict[str, float]
    seed: int

    @property
    def reached(self) -> int:
        """Number of goals reached."""
        return sum(leg.reached for leg in self.legs)


def real_log() -> Path | None:
    """The real recording (in `WAYCHAIR_DATA`, else ../shared/data), when it is there."""
    path = Path(os.environ.get("WAYCHAIR_DATA", "../shared/data")) / REAL_LOG
    return path if path.is_file() else None


def run_demo(
    out: Path,
    seed: int = 0,
    log: Path | None = None,
    progress: Progress = lambda stage, share: None,
    world: str | Path = SMALL_WORLD,
    people: bool = False,
) -> Demo:
    """Maps `log`, or without one a drive through `world`, into `out`/map and drives to up to three places there.

    `people` are those of the world; the chair foresees where they go.

    Raises:
        WorldError: there is no such world, or it has no mapping route.
    """
    stage = _Stages(progress)
    scene = _recorded_scene(out, log, stage) if log else _simulated_scene(out, _world(world, people), seed, stage)
    folder = out / "map"
    save_places(folder, {place.name: _in_map(place, scene.map_from_world) for place in scene.world.places})
    grid, places, zones = load_map(folder), load_places(folder), load_zones(folder)
    setting = Setting(grid, places, CHAIR_A, DEFAULT, scene.map_from_world, zones=zones)
    goals = [place.name for place in scene.world.places[:MOST_GOALS]]
    with stage("drive"):
        simulator = Simulator(scene.world, CHAIR_A, chair_of(seed), seed)
        legs = drive_to_places(setting, simulator, goals, progress=lambda share: progress("drive", share))
    return Demo(scene.title, scene.lead, scene.mapping, setting, legs, stage.seconds, seed)


def _world(name: str | Path, people: bool) -> World:
    world = load_world(name)
    return world if people else world.without_people()


def chair_of(seed: int) -> SimulatorSettings:
    """A chair whose drive differs from what the calibration believes, another one for each seed."""
    return SimulatorSettings(plant=randomised(PlantSettings(), seed))


@dataclass(frozen=True, slots=True)
class _Scene:
    """A world to drive in, with the map that was made of it."""

    title: str
    lead: str
    world: World
    mapping: Mapping
    map_from_world: Pose2


def _recorded_scene(out: Path, log: Path, stage: _Stages) -> _Scene:
    """The building of a real recording: the world is raised from its map."""
    mapping = _mapped(log, out / "map", stage)
    world = world_from_grid(load_map(out / "map"), Pose2(), REAL_PLACES)
    lead = f"Mapped from {log.name}; driven in a world raised from that map."
    return _Scene("Intel Research Lab, from a real recording", lead, world, mapping, Pose2())


def _simulated_scene(out: Path, world: World, seed: int, stage: _Stages) -> _Scene:
    """A world of a floor plan: driven along its mapping route, recorded, and mapped by the chair on the way."""
    route = world.route()
    bag = out / "drive.mcap"
    bag.unlink(missing_ok=True)
    settings = MappingSettings()
    with stage("map"):
        simulator = Simulator(world, CHAIR_A, chair_of(seed), seed)
        live = LiveMapping(settings, CHAIR_A.base_from_laser, CHAIR_A)
        hears = _Hearing(live)
        drive_route(simulator, CHAIR_A, route, bag, lambda share: stage.progress("map", share), hear=hears.message)
        mapping = live_result(live, bag, "a simulated drive, mapped on the way")
    with stage("save"):
        save_mapping(out / "map", mapping, settings)
    title = f"{world.name}, a simulated world"
    lead = "A simulated chair was driven, mapped on the way, and drove in that map; it knows the map only."
    return _Scene(title, lead, world, mapping, world.start.inverse())


class _Hearing:
    """The ears of a live mapping: messages of the sensors come in, frames that are complete are mapped."""

    def __init__(self, live: LiveMapping) -> None:
        topics = (SCAN, WHEELS)
        self._live = live
        self._frames = Synchroniser(topics)
        self._topics = {topic.type: topic for topic in topics}

    def message(self, message: SensorMessage) -> None:
        """Whatever frames it completes are mapped at once."""
        if isinstance(message, Scan | WheelTicks):
            for frame in self._frames.add(self._topics[type(message)], message):
                self._live.process(frame)


def _mapped(log: Path, folder: Path, stage: _Stages) -> Mapping:
    settings = MappingSettings()
    with stage("read"):
        recording = read_recording(log)
    with stage("map"):
        mapping = map_recording(recording, settings, lambda share: stage.progress("map", share))
    with stage("save"):
        save_mapping(folder, mapping, settings)
    return mapping


class _Stages:
    """Times the stages by the clock on the wall and tells which one has begun."""

    def __init__(self, progress: Progress) -> None:
        self.seconds: dict[str, float] = {}
        self.progress = progress

    @contextmanager
    def __call__(self, name: str) -> Iterator[None]:
        self.progress(name, 0.0)
        started = time.perf_counter()
        yield
        self.seconds[name] = time.perf_counter() - started
        self.progress(name, 1.0)


def _in_map(place: Place, map_from_world: Pose2) -> Place:
    pose = map_from_world @ place.pose
    return replace(place, pose=Pose2(round(pose.x, 3), round(pose.y, 3), round(wrap_angle(pose.theta), 4)))
