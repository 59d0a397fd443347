"""The whole chair as one object: sensor messages in, joystick volts out, one tick at a time.

It has no clock and no threads of its own: whoever owns it (a trial, a ROS node, the page) calls `step` at
`topics.COMMAND.rate_hz` with the messages since the last tick.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import TypeAlias

from waychair.calibration.chair import ChairBody
from waychair.calibration.dac import LinearDac
from waychair.config import Settings
from waychair.control.kinematics import wheel_speeds_from_twist
from waychair.control.navigator import Navigation, Navigator, NavigatorSettings
from waychair.control.speed_loop import SpeedLoop, SpeedLoopSettings
from waychair.control.supervisor import Situation, SupervisorSettings, Verdict, supervise
from waychair.firmware_bridge.bridge import Bridge, BridgeSettings, Lines
from waychair.geometry import transform_points
from waychair.slam.localiser import Localisation, Localiser, LocaliserSettings
from waychair.slam.odometry import WheelOdometry, arc
from waychair.slam.scan_points import scan_points
from waychair.topics import SCAN, WHEELS
from waychair.types import (
    DriveMode,
    FloatArray,
    Goal,
    ImuSample,
    JoystickInput,
    OccupancyGrid,
    Odometry,
    Place,
    Pose2,
    RgbdFrame,
    Scan,
    Sent,
    SonarReadings,
    Twist,
    WheelTicks,
)

Message: TypeAlias = WheelTicks | Scan | JoystickInput | ImuSample | SonarReadings | RgbdFrame
"""What a chair's sensors say; it drives by its wheels and its lidar, the rest is not used yet."""


@dataclass(frozen=True, slots=True)
class ChairSettings(Settings):
    """The parts' own settings."""

    localiser: LocaliserSettings = field(default_factory=LocaliserSettings)
    navigator: NavigatorSettings = field(default_factory=NavigatorSettings)
    speed_loop: SpeedLoopSettings = field(default_factory=SpeedLoopSettings)
    supervisor: SupervisorSettings = field(default_factory=SupervisorSettings)
    bridge: BridgeSettings = field(default_factory=BridgeSettings)


@dataclass(frozen=True, slots=True)
class ChairState:
    """What the chair knows and did in one tick: where it is, who drives and why, what was asked and what was sent."""

    stamp_ns: int
    map_from_base: Pose2
    twist: Twist
    localisation: Localisation | None
    verdict: Verdict
    navigation: Navigation
    sent: Sent


class Chair:
    """A chair on a known map from a known start."""

    def __init__(
        self,
        grid: OccupancyGrid,
        places: Mapping[str, Place],
        body: ChairBody,
        calibration: LinearDac,
        lines: Lines,
        start: Pose2,
        settings: ChairSettings | None = None,
    ) -> None:
        self.settings = settings or ChairSettings()
        self.body = body
        self.navigator = Navigator(grid, places, body, self.settings.navigator)
        self._odometry = WheelOdometry(body)
        self._localiser = Localiser(grid, body.base_from_laser, start, self.settings.localiser)
        self._speed_loop = SpeedLoop(self.settings.speed_loop)
        self._bridge = Bridge(lines, calibration, self.settings.bridge)
        self._start = start
        self._mode = DriveMode.MANUAL
        self._stop_pressed = False
        self._wheels: Odometry | None = None
        self._scan: Scan | None = None
        self._joystick: JoystickInput | None = None
        self._localisation: Localisation | None = None

    def go(self, goal: Goal) -> None:
        """Drive there; raises `UnknownPlace` for a name that is not on the map."""
        self.navigator.go(goal)
        self._stop_pressed = False

    def stop(self) -> None:
        """The rider's Stop: nothing moves by itself until a new goal is asked for."""
        self._stop_pressed = True

    def step(self, now_ns: int, messages: Iterable[Message]) -> ChairState:
        """One tick: take in the messages, decide who drives, and let the bridge send what that comes to."""
        obstacles = self._take_in(messages)
        pose = self._map_from_base(now_ns)
        situation = Situation(self._joystick, self._stop_pressed, self.navigator.active, self._faults(now_ns))
        verdict = supervise(self._mode, situation, self.settings.supervisor)
        if verdict.mode is not DriveMode.AUTONOMOUS and self._mode is DriveMode.AUTONOMOUS:
            self.navigator.cancel(verdict.reason)  # what was interrupted never resumes by itself
        self._mode = verdict.mode
        navigation = self.navigator.step(now_ns, pose, obstacles)
        driving = verdict.mode is DriveMode.AUTONOMOUS and navigation.driving
        measured = self._wheels.twist if self._wheels is not None else Twist()
        trimmed = self._speed_loop.step(navigation.twist if driving else None, measured, now_ns)
        speeds = wheel_speeds_from_twist(trimmed, self.body.track) if driving else None
        sent = self._bridge.send(speeds, now_ns, now_ns)
        if not sent.active:
            self.navigator.at_rest()
        return ChairState(now_ns, pose, measured, self._localisation, verdict, navigation, sent)

    def _take_in(self, messages: Iterable[Message]) -> FloatArray | None:
        """Odometry and localisation up to date; what the latest of these scans saw, (N, 2) [m] in map."""
        seen = None
        for message in messages:
            if isinstance(message, WheelTicks):
                self._wheels = self._odometry.update(message)
            elif isinstance(message, JoystickInput):
                self._joystick = message
            elif isinstance(message, Scan) and self._wheels is not None:
                self._scan = message
                self._localisation = self._localiser.process(
                    message, self._odom_from_base(message.stamp_ns), self._wheels.twist
                )
                reach = self.settings.navigator.obstacle_range
                points = scan_points(message, self.body.base_from_laser, reach, self._wheels.twist).points
                seen = transform_points(self._localisation.map_from_base, points)
        return seen

    def _odom_from_base(self, stamp_ns: int) -> Pose2:
        """Odometry at a stamp, its last speeds taken to go on for at most 0.1 s."""
        assert self._wheels is not None
        seconds = min(max((stamp_ns - self._wheels.stamp_ns) * 1e-9, -0.1), 0.1)
        twist = self._wheels.twist
        return self._wheels.odom_from_base @ arc(twist.v * seconds, twist.omega * seconds)

    def _map_from_base(self, now_ns: int) -> Pose2:
        if self._localisation is None:
            return self._start
        return self._localisation.map_from_odom @ self._odom_from_base(now_ns)

    def _faults(self, now_ns: int) -> tuple[str, ...]:
        """What makes the computer let go, as plain sentences."""
        faults = []
        if SCAN.is_stale(None if self._scan is None else self._scan.stamp_ns, now_ns):
            faults.append("the lidar is silent: check its cable and power")
        if WHEELS.is_stale(None if self._wheels is None else self._wheels.stamp_ns, now_ns):
            faults.append("the wheel encoders are silent: check their cable")
        if self._localisation is not None and self._localisation.lost:
            faults.append("the chair no longer knows where it is: drive it to a known place and set its pose")
        return tuple(faults)
