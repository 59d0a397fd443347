"""The demo: a recording becomes a map, and a simulated chair drives to three places in it through joystick volts.

With the real recording at hand, the building is the one that was recorded: the world is raised from its map. Without
it, the small world that ships is first driven along its mapping route, recorded to a bag, and mapped from that bag;
the chair then drives in the true world, by the map it made.
"""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

from waychair.calibration.chair import CHAIR_A, ChairBody
from waychair.calibration.dac import DEFAULT
from waychair.geometry import wrap_angle
from waychair.maps.map_files import load_map
from waychair.maps.places import load_places, save_places
from waychair.recording import RecordingWriter, read_recording
from waychair.runtime.mapping import Mapping, MappingSettings, map_recording, save_mapping
from waychair.simulation.follower import Follower, follow
from waychair.simulation.plant import PlantSettings, randomised
from waychair.simulation.simulator import Simulator, SimulatorSettings
from waychair.simulation.world import World, load_world, world_from_grid
from waychair.slam.odometry import WheelOdometry
from waychair.trials.drive import Leg, Setting, drive_to_places
from waychair.types import Odometry, Place, Pose2, Scan, WheelTicks

REAL_LOG = Path("lidar_intel") / "intel_first1088s.clf.gz"
"""Intel Research Lab, Seattle, recorded by D. Haehnel: within the folder of recordings."""

REAL_PLACES = (
    Place("north office", Pose2(4.3, 3.0, 1.57)),
    Place("east lounge", Pose2(15.5, -7.0, 0.0)),
    Place("south corridor", Pose2(-5.0, -19.0, 3.14)),
)
"""Poses in the frame of the log's first scan, put where the recording robot went; the names are ours."""

SMALL_WORLD = "small_clinic"
SMALL_PLACES = ("bath", "ward", "reception")

Progress = Callable[[str, float], None]
_Stamped = TypeVar("_Stamped", Scan, Odometry)


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


def run_demo(out: Path, seed: int = 0, log: Path | None = None, progress: Progress = lambda stage, share: None) -> Demo:
    """Maps `log`, or the small world without one, into `out`/map and drives to three places there."""
    seconds: dict[str, float] = {}
    stage = _Stages(seconds, progress)
    folder = out / "map"
    if log is not None:
        title, lead = "Intel Research Lab, from a real recording", f"Mapped from {log.name}; driven in a world raised from that map."  # fmt: skip
        mapping = _mapped(log, folder, stage)
        save_places(folder, {place.name: place for place in REAL_PLACES})
        world, map_from_world = world_from_grid(load_map(folder), Pose2()), Pose2()
        goals = tuple(place.name for place in REAL_PLACES)
    else:
        world = load_world(SMALL_WORLD)
        title = "The small clinic, a world that ships with waychair"
        lead = "No real recording was found (set WAYCHAIR_DATA to a folder that holds lidar_intel), so a simulated drive was recorded, mapped, and driven in."  # fmt: skip
        bag = out / "drive.mcap"
        with stage("record"):
            _record(world, bag, seed, CHAIR_A)
        mapping = _mapped(bag, folder, stage)
        map_from_world = world.start.inverse()
        save_places(folder, {place.name: _in_map(place, map_from_world) for place in world.places})
        goals = SMALL_PLACES
    setting = Setting(load_map(folder), load_places(folder), CHAIR_A, DEFAULT, map_from_world)
    with stage("drive"):
        simulator = Simulator(world, CHAIR_A, chair_of(seed), seed)
        legs = drive_to_places(setting, simulator, goals, progress=lambda share: progress("drive", share))
    return Demo(title, lead, mapping, setting, legs, seconds, seed)


def chair_of(seed: int) -> SimulatorSettings:
    """A chair whose drive differs from what the calibration believes, another one for each seed."""
    return SimulatorSettings(plant=randomised(PlantSettings(), seed))


def _mapped(log: Path, folder: Path, stage: _Stages) -> Mapping:
    settings = MappingSettings()
    with stage("read"):
        recording = read_recording(log)
    with stage("map"):
        mapping = map_recording(recording, settings, lambda share: stage.progress("map", share))
    with stage("save"):
        save_mapping(folder, mapping, settings)
    return mapping


def _record(world: World, bag: Path, seed: int, body: ChairBody) -> None:
    """Drives the world's mapping route by joystick and records scans and wheel odometry as a ROS 2 bag."""
    simulator = Simulator(world, body, chair_of(seed), seed)
    odometry = WheelOdometry(body)
    epoch_ns = 1_700_000_000 * 10**9  # bags of a robot carry wall-clock stamps
    if bag.is_dir():
        shutil.rmtree(bag)
    bag.unlink(missing_ok=True)
    with RecordingWriter(bag, body.base_from_laser) as writer:
        for message in follow(simulator, Follower(world.route, body.track, PlantSettings())):
            if isinstance(message, WheelTicks):
                writer.write(_later(odometry.update(message), epoch_ns))
            else:
                writer.write(_later(message, epoch_ns))


def _later(message: _Stamped, offset_ns: int) -> _Stamped:
    return replace(message, stamp_ns=message.stamp_ns + offset_ns)


class _Stages:
    """Times the stages by the clock on the wall and tells which one has begun."""

    def __init__(self, seconds: dict[str, float], progress: Progress) -> None:
        self._seconds = seconds
        self.progress = progress

    @contextmanager
    def __call__(self, name: str) -> Iterator[None]:
        self.progress(name, 0.0)
        started = time.perf_counter()
        yield
        self._seconds[name] = time.perf_counter() - started
        self.progress(name, 1.0)


def _in_map(place: Place, map_from_world: Pose2) -> Place:
    pose = map_from_world @ place.pose
    return Place(place.name, Pose2(round(pose.x, 3), round(pose.y, 3), round(wrap_angle(pose.theta), 4)))
