"""Behaviour cells in a chair's tick: a network hears the chair's sensors and says what is round the chair.

The chair passes its messages and poses on; the tick's command has been sent before the cells run, so that they delay
none. They tell and do not drive. A chair without this switch has no `Perception` and pays nothing.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.control.behaviours.commands import Signal, signal_words
from waychair.control.behaviours.default import VIEW_NS
from waychair.control.behaviours.doorway import FramesSeen, OdometryPose
from waychair.control.behaviours.managers import StickDirection
from waychair.control.behaviours.paper import PaperSettings
from waychair.control.behaviours.presets import Preset, shipped
from waychair.control.behaviours.range_finder import CameraAim, LaserLine
from waychair.control.behaviours.runtime import Innervation, Runtime
from waychair.control.behaviours.view.sensor_parts import doors_seen, map_part, people_fans, picture_fans
from waychair.control.behaviours.view.servo_cells import CameraOrder
from waychair.control.drive.doors.doorway_tracker import DoorwayTracker
from waychair.control.drive.local_obstacles import levelled_ground_view
from waychair.errors import BehaviourError
from waychair.geometry import transform_points
from waychair.maps.depth.ground import GroundView
from waychair.planning.seen.doorways import Doorway
from waychair.planning.seen.range_views import view_from_scan
from waychair.runtime.senses.doorway_sense import DoorwaySense
from waychair.runtime.senses.paper_sensors import PaperSensors
from waychair.runtime.senses.servo_camera_sight import ServoCameraSight, ServoCameraTold
from waychair.slam.localising.localisation import Localisation, LocalisationState
from waychair.slam.odometry.tilt import Tilt
from waychair.types import (
    FloatArray,
    JoystickInput,
    OccupancyGrid,
    Odometry,
    PanTiltCommand,
    Pose2,
    RgbdFrame,
    Scan,
    ServoMessage,
    SonarReadings,
)

T = TypeVar("T")

_MAP_EVERY_NS = 1_000_000_000
"""Period of the map's part: walls do not move."""

_MAP_MOVED = 0.02
"""m; a correction of the pose by more than this tells the map anew."""

_ODOMETRY_NS = 300_000_000
"""Age above which odometry is not passed on: it is extrapolated by 0.1 s at most."""


@dataclass(frozen=True, slots=True)
class _DepthPicture:
    """A picture of the depth camera that waits for the tick, with odometry and tilt at its stamp, and perhaps its ground."""

    frame: RgbdFrame
    odom_from_base: Pose2
    tilt: Tilt | None
    ground: GroundView | None


@dataclass(frozen=True, slots=True)
class Perceived:
    """The cells after a tick: the network, `count` innervations of its run before, the sensors' new values, the ports.

    `doorways` are those near the chair, in odom. `troubles`: a sentence for each sensor or cell that is not to be believed.
    `camera`: the news of the camera on servos in this tick, if any; `aimed`: where it looks instead of where the cells aim it.
    """

    network: Preset
    count: int
    heard: Mapping[str, Any]
    done: Innervation
    doorways: tuple[Doorway, ...] = ()
    troubles: tuple[str, ...] = ()
    camera: ServoCameraTold | None = None
    aimed: PanTiltCommand | None = None

    @property
    def order(self) -> PanTiltCommand | None:
        """The order to the camera on servos; None while nobody wants it, and without one."""
        if self.aimed is not None:
            return self.aimed
        aim = self.done.actions.get("pan/tilt servos")
        if aim is None:
            return None
        pan, tilt = aim
        return PanTiltCommand(self.done.stamp_ns, pan, tilt, bool(self.done.actions.get("laser", False)))

    @property
    def signal(self) -> str:
        """The signal to the rider, in words; empty while there is none."""
        return "" if self.told is None else signal_words(self.told)

    @property
    def told(self) -> Signal | None:
        """The signal to the rider; None while there is none."""
        signal = self.done.ports["Navigation command manager"].eo
        return signal if isinstance(signal, Signal) else None


@dataclass(frozen=True, slots=True)
class CellInputs:
    """What the chair knows in a tick: odometry, `odom_from_base` now, localisation, map, people (K, 2) [m] in odom, stick."""

    odometry: Odometry | None
    odom_from_base: Pose2
    localisation: Localisation | None
    grid: OccupancyGrid
    people: FloatArray
    stick: JoystickInput | None


class Perception:
    """The network of one chair, with the adapters from the chair's messages to the network's sensors."""

    def __init__(
        self,
        body: ChairBody,
        settings: PaperSettings | None = None,
        timer: Callable[[], int] | None = time.thread_time_ns,
        network: str = "default",
    ) -> None:
        """`timer` reads a clock [ns] for cells that take too long; a thread's own one counts no other program's time.

        `network`: "default", or "paper", which hears the sonars in the layout `paper`, the camera on servos, odometry and stick
        alone.
        """
        self.door_wanted = False
        """Whether the rider wants to be led through a doorway."""
        self._body, self._timer = body, timer
        self._paper = PaperSensors() if network == "paper" else None
        usual = PaperSettings() if self._paper is None else self._paper.settings
        self._network = shipped(network, settings or usual, body)
        self._doorways = DoorwaySense(body)
        self._stamp_ns: int | None = None
        self._heard: dict[str, Any] = {}
        self._faults: dict[str, str] = {}
        self._picture: _DepthPicture | None = None
        self._servo_camera = ServoCameraSight()
        self._mapped: tuple[int, OccupancyGrid, Pose2] | None = None
        self._camera_fault = ""
        self._warm_up()
        self._runtime, self._count = Runtime(self._network.wiring, timer=timer), 0

    @property
    def doorways(self) -> tuple[Doorway, ...]:
        """The doorways and candidates near the chair, in odom."""
        return self._doorways.found

    def see(self, scan: Scan, odom_from_base: Pose2) -> None:
        """Take in a scan without the beams that hit the chair itself, and the odometry at its stamp."""
        if self._paper is not None:
            return
        self._heard["lidar"] = scan
        self._servo_camera.compare(scan, self._body.base_from_laser)
        self._told("doorways", self._doorways.work)
        self._doorways.see(scan, odom_from_base)

    def hear(self, readings: SonarReadings, odom_from_base: Pose2) -> None:
        """Take in the sonars' readings, and the odometry at their stamp."""
        if self._paper is not None:
            self._heard["sonar packet"] = self._paper.packet(readings)
            return  # so wide a cone hears the wall beside a doorway, which would count as closed
        self._heard["sonars"] = readings
        self._told("doorways", lambda: self._doorways.hear(readings, odom_from_base))

    def look(
        self, frame: RgbdFrame, odom_from_base: Pose2, tilt: Tilt | None, ground: GroundView | None = None
    ) -> None:
        """Take in a picture of the depth camera, the odometry at its stamp, and the ground in it, if found already."""
        self._picture = _DepthPicture(frame, odom_from_base, tilt, ground) if self._paper is None else None

    def watch(self, message: ServoMessage, odom_from_base: Pose2) -> None:
        """Take in a message of the camera on servos, and the odometry at its stamp."""
        self._servo_camera.take(message, odom_from_base)

    def propose(self, frames: FramesSeen) -> None:
        """Take in the door frames that a picture of the camera on servos proposes (`runtime/senses/frame_sight.py`)."""
        self._heard["frames in the picture"] = frames

    def step(self, now_ns: int, known: CellInputs) -> Perceived:
        """Innervate the network with the messages since the last tick. It never raises."""
        if "lidar" not in self._heard:  # the tick of a scan has enough to do
            self._told("doorways", self._doorways.work)
        if self._picture is not None:
            picture, self._picture = self._picture, None
            self._told("depth", lambda: self._tell_picture(picture))
        camera = self._told("camera on servos", lambda: self._tell_servo_camera(now_ns))
        self._told("odometry", lambda: self._tell_motion(now_ns, known))
        self._told("map round the chair", lambda: self._tell_map(now_ns, known))
        heard: dict[str, Any] = {}
        if now_ns != self._stamp_ns:  # an extra tick at a stamp finds the outputs of that stamp
            heard, self._heard = self._of_network(self._heard), heard
        self._stamp_ns = now_ns
        set_back = ""
        try:
            done = self._runtime.innervate(now_ns, heard)
        except BehaviourError:
            set_back = "the clock was set back, so what was seen before no longer counts"
            self._runtime, self._count = Runtime(self._network.wiring, timer=self._timer), 0
            done = self._runtime.innervate(now_ns, heard)
        count, self._count = self._count, self._count + 1
        watched = done.ports["Sensor watch"].eo if self._paper is None else None
        if watched is not None and watched.leapt:
            self._doorways.forget()
        troubles = [*self._faults.values(), *(f"{name} is inactive: {fault}" for name, fault in done.faults().items())]
        troubles += [*(watched.sentences if watched is not None else ()), *([set_back] if set_back else [])]
        granted = done.ports["grant"].eo
        troubles += [granted.failed] if isinstance(granted, CameraOrder) and granted.failed else []
        troubles += [self._camera_fault] if self._paper is not None and self._camera_fault else []
        aimed = None if self._paper is None else self._paper.order(done, now_ns)
        doorways = self._doorways.found
        return Perceived(self._network, count, heard, done, doorways, tuple(troubles), camera, aimed)

    def _of_network(self, heard: Mapping[str, Any]) -> dict[str, Any]:
        """Return the values of the sensors that the network has."""
        return {name: value for name, value in heard.items() if name in self._network.wiring.sensors}

    def _told(self, name: str, tell: Callable[[], T]) -> T | None:
        """Run an adapter, and return its value; an error in it is named, and the cells get nothing from it."""
        try:
            value = tell()
        except Exception as error:  # noqa: BLE001 - a sensor's odd data must not end the chair's tick
            self._faults[name] = f"the {name} could not be read: {type(error).__name__}: {error}"
            return None
        self._faults.pop(name, None)
        return value

    def _tell_picture(self, picture: _DepthPicture) -> None:
        """Tell of the ground and the things in a picture; without a lidar, doorways are looked for in it as well."""
        level = np.eye(3) if picture.tilt is None else picture.tilt.level_from_base()
        ground = picture.ground
        if ground is None:
            ground = levelled_ground_view(picture.frame, self._body, None if picture.tilt is None else level)
        self._heard["depth"], self._heard["drop-offs"] = picture_fans(ground)
        self._doorways.look(picture.frame, level, picture.odom_from_base)

    def _tell_servo_camera(self, now_ns: int) -> ServoCameraTold | None:
        """Tell the camera's aim, its fault, and the laser's line, and return them; its points show doorways as well."""
        told = self._servo_camera.told(now_ns)
        if told is None:
            return None
        if self._paper is not None:
            self._paper.note(told, now_ns)
        if told.aim is not None:
            self._heard["camera aim"] = told.aim
        if told.fault != self._camera_fault:
            self._heard["camera fault"] = self._camera_fault = told.fault
        if told.sight is not None:
            sight = told.sight
            aim = CameraAim(sight.angles.pan, sight.angles.tilt, sight.angles.settled)
            self._heard["laser line in the picture"] = LaserLine(sight.columns, sight.rows, aim)
            self._doorways.range(sight, told.odom_from_base, told.stamp_ns)
        return told

    def _tell_motion(self, now_ns: int, known: CellInputs) -> None:
        """Tell odometry, stick, wish, people and doorways; the last two at the view's rate."""
        heard = self._heard
        heard["door wanted"] = self.door_wanted
        if known.stick is not None:
            heard["stick"] = StickDirection(known.stick.forward, known.stick.turn)
        odometry = known.odometry
        if odometry is None or now_ns - odometry.stamp_ns > _ODOMETRY_NS:
            return
        at = known.odom_from_base
        heard["odometry"] = OdometryPose(at.x, at.y, at.theta, odometry.twist.v, odometry.twist.omega)
        if self._doorways.is_due:
            heard["people"] = people_fans(transform_points(at.inverse(), known.people))
            doorways = self._doorways.take()
            heard["doorways"] = doors_seen(doorways, at)
            if self._paper is not None:
                heard["frames in the picture"] = self._paper.frames(doorways, at)

    def _tell_map(self, now_ns: int, known: CellInputs) -> None:
        """Tell the map once a second, and when the pose in it was corrected; never while the pose is in doubt."""
        found = known.localisation
        if found is None or found.state is not LocalisationState.OK or found.jumped or known.odometry is None:
            self._mapped = None
            return
        at = found.map_from_odom
        if self._mapped is not None:
            since_ns, grid, before = self._mapped
            moved = before.inverse() @ at
            is_same = grid is known.grid and math.hypot(moved.x, moved.y) + abs(moved.theta) <= _MAP_MOVED
            if is_same and 0 <= now_ns - since_ns < _MAP_EVERY_NS:
                return
        part = map_part(known.grid, at @ known.odom_from_base, at.inverse())
        if part is not None:
            self._heard["map round the chair"] = part
            self._mapped = now_ns, known.grid, at

    def _warm_up(self) -> None:
        """Compile the kernels by a short approach to a doorway, with memory that is thrown away."""
        runtime, tracker = Runtime(self._network.wiring), DoorwayTracker()
        frame = RgbdFrame(0, np.zeros((48, 64), np.uint8), np.full((48, 64), 2.0, np.float32), _CAMERA)
        depth, drops = picture_fans(levelled_ground_view(frame, self._body, None))
        grid = OccupancyGrid(np.full((8, 8), 100, np.int8), 0.05, Pose2())
        for k in range(12):
            at, scan = Pose2(0.15 * k), _scan_of_a_doorway(3.0 - 0.15 * k)
            tracker.see(view_from_scan(scan, at), at)
            heard: dict[str, Any] = {"lidar": scan, "sonars": SonarReadings(0, np.full(8, 1.0, np.float32))}
            heard |= {"odometry": OdometryPose(at.x, at.y, at.theta), "depth": depth, "drop-offs": drops}
            heard |= {"people": people_fans(np.zeros((1, 2))), "map round the chair": map_part(grid, at, Pose2())}
            runtime.innervate((k + 1) * VIEW_NS, self._of_network(heard))
        tracker.hear(np.zeros((1, 3)), np.array([3.0]))
        DoorwaySense(self._body).look(frame, np.eye(3), Pose2())


def _scan_of_a_doorway(ahead: float) -> Scan:
    """Return a scan in a room with a doorway of 0.9 m so far [m] ahead."""
    step = math.tau / 720
    angles = -math.pi + step * np.arange(720)
    c, s = np.cos(angles), np.sin(angles)
    with np.errstate(divide="ignore"):
        wall, beyond = (np.where(c > 0.0, far / c, np.inf) for far in (ahead, ahead + 3.0))
        others = np.minimum(2.5 / np.abs(s), np.where(c < 0.0, -3.0 / c, np.inf))
    through = np.abs(wall * s) < 0.45
    return Scan(0, np.minimum(np.where(through, beyond, wall), others).astype(np.float32), -math.pi, step)


_CAMERA = np.array([[60.0, 0.0, 32.0], [0.0, 60.0, 24.0], [0.0, 0.0, 1.0]])
"""Camera matrix of the picture that warms up."""
