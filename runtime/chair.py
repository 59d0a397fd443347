"""The whole chair as one object: sensor messages in, commands to the board out, one tick at a time.

It has no clock and no threads of its own: whoever owns it (a trial, a ROS node, the page) calls `step` at
`topics.COMMAND.rate_hz` with the messages since the last tick, and `beat` in between, at `topics.TELEMETRY.rate_hz` or
faster, so that the board knows that the computer lives.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import TypeAlias

from waychair.calibration.chair import ChairBody
from waychair.calibration.dac import DacModel
from waychair.calibration.fitted_dac import DeadBand, FittedDac
from waychair.config import Settings
from waychair.control.closed_loop import ClosedLoop, ClosedLoopSettings
from waychair.control.kinematics import wheel_speeds_from_twist
from waychair.control.navigator import Navigation, Navigator, NavigatorSettings
from waychair.control.supervisor import Override, Situation, SupervisorSettings, Verdict, supervise
from waychair.firmware_bridge.bridge import Bridge, BridgeSettings
from waychair.firmware_bridge.transports import Reconnecting
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
    OccupancyGrid,
    Odometry,
    Place,
    Pose2,
    RgbdFrame,
    Scan,
    Sent,
    SonarReadings,
    Telemetry,
    Twist,
    WheelTicks,
)

Message: TypeAlias = WheelTicks | Scan | ImuSample | SonarReadings | RgbdFrame
"""What a chair's sensors say; it drives by its wheels and its lidar, the rest is not used yet.

The rider's joystick is no message: the board reads it, and says so in its telemetry.
"""


@dataclass(frozen=True, slots=True)
class ChairSettings(Settings):
    """The parts' own settings."""

    localiser: LocaliserSettings = field(default_factory=LocaliserSettings)
    navigator: NavigatorSettings = field(default_factory=NavigatorSettings)
    closed_loop: ClosedLoopSettings = field(default_factory=ClosedLoopSettings)
    supervisor: SupervisorSettings = field(default_factory=SupervisorSettings)
    bridge: BridgeSettings = field(default_factory=BridgeSettings)


@dataclass(frozen=True, slots=True)
class ChairState:
    """What the chair knows and did in one tick: where it is, who drives and why, what was asked and what was sent.

    `telemetry` is the board's last report, None while there is no board that could be driven through.
    """

    stamp_ns: int
    map_from_base: Pose2
    twist: Twist
    localisation: Localisation | None
    verdict: Verdict
    navigation: Navigation
    sent: Sent
    telemetry: Telemetry | None


class Chair:
    """A chair on a known map from a known start, at the end of a cable to its board."""

    def __init__(
        self,
        grid: OccupancyGrid,
        places: Mapping[str, Place],
        body: ChairBody,
        calibration: DacModel,
        cable: Reconnecting,
        start: Pose2,
        settings: ChairSettings | None = None,
    ) -> None:
        """
        Raises:
            BridgeError: the chair's name is too long for a board.
        """
        self.settings = settings or ChairSettings()
        self.body = body
        self.navigator = Navigator(grid, places, body, self.settings.navigator)
        self._odometry = WheelOdometry(body)
        self._localiser = Localiser(grid, body.base_from_laser, start, self.settings.localiser)
        model = DeadBand(calibration) if isinstance(calibration, FittedDac) else calibration
        self.bridge = Bridge(cable, model, body.chair_id, self.settings.bridge)
        self._loop = ClosedLoop(model, body.track, self.settings.closed_loop)
        self._sent: Sent | None = None
        self._override = Override(self.settings.supervisor)
        self._start = start
        self._mode = DriveMode.MANUAL
        self._stop_pressed = False
        self._wheels: Odometry | None = None
        self._scan: Scan | None = None
        self._localisation: Localisation | None = None

    def go(self, goal: Goal) -> None:
        """Drive there; raises `UnknownPlace` for a name that is not on the map.

        What the computer itself did to the board (a lost cable, a pause) is forgiven by asking for a goal.
        """
        self.navigator.go(goal)
        self._stop_pressed = False
        self.bridge.reset()

    def stop(self) -> None:
        """The rider's Stop: nothing moves by itself until a new goal is asked for."""
        self._stop_pressed = True

    def reset(self) -> None:
        """Somebody's deliberate act: the faults were seen to, the emergency stop was released on purpose.

        Nothing drives because of it: a goal that was waiting for it has to be asked for again.
        """
        self.navigator.cancel("the faults were reset; ask for the goal again")
        self.bridge.reset(by_rider=True)
        self._loop.acknowledge()

    def beat(self, now_ns: int) -> None:
        """Keep the board company between two ticks."""
        self.bridge.beat(now_ns)

    def step(self, now_ns: int, messages: Iterable[Message]) -> ChairState:
        """One tick: take in the messages, decide who drives, and let the bridge send what that comes to."""
        obstacles = self._take_in(messages)
        pose = self._map_from_base(now_ns)
        telemetry = self.bridge.listen(now_ns)
        verdict = self._supervise(now_ns, telemetry)
        navigation = self.navigator.step(now_ns, pose, obstacles)
        driving = verdict.computer_drives and navigation.driving
        measured = self._wheels.twist if self._wheels is not None else Twist()
        asked = Twist(verdict.share * navigation.twist.v, verdict.share * navigation.twist.omega)
        trimmed = self._loop.step(asked if driving and self.bridge.armed else None, measured, now_ns, self._sent)
        speeds = wheel_speeds_from_twist(trimmed, self.body.track) if driving else None
        sent = self.bridge.send(speeds, now_ns, now_ns)
        self._follow_up(sent, driving=driving)
        return ChairState(now_ns, pose, measured, self._localisation, verdict, navigation, sent, telemetry)

    def _supervise(self, now_ns: int, telemetry: Telemetry | None) -> Verdict:
        """Who drives in this tick; what was interrupted never resumes by itself."""
        stick = None if telemetry is None else telemetry.joystick
        taken_over = self._override.update(stick) or self.bridge.taken_over
        faults = self._faults(now_ns)
        situation = Situation(stick, taken_over, self._stop_pressed, self.navigator.active, faults)
        verdict = supervise(self._mode, situation, self.settings.supervisor)
        drove = self._mode in (DriveMode.AUTONOMOUS, DriveMode.ASSISTED)
        if drove and not verdict.computer_drives:
            self.navigator.cancel(verdict.reason)
        self._mode = verdict.mode
        return verdict

    def _follow_up(self, sent: Sent, *, driving: bool) -> None:
        """What was really sent is news to the navigator, and the end of a drive that bridge or board have ended."""
        if not sent.active:
            self.navigator.at_rest()
            if driving and self._sent is not None and self._sent.active:
                self.navigator.cancel(sent.reason)
        self._sent = sent

    def _take_in(self, messages: Iterable[Message]) -> FloatArray | None:
        """Odometry and localisation up to date; what the latest of these scans saw, (N, 2) [m] in map."""
        seen = None
        for message in messages:
            if isinstance(message, WheelTicks):
                self._wheels = self._odometry.update(message)
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
        faults = [*self.bridge.trouble]
        if self._loop.fault:
            faults.append(self._loop.fault)
        if SCAN.is_stale(None if self._scan is None else self._scan.stamp_ns, now_ns):
            faults.append("the lidar is silent: check its cable and power")
        if WHEELS.is_stale(None if self._wheels is None else self._wheels.stamp_ns, now_ns):
            faults.append("the wheel encoders are silent: check their cable")
        if self._localisation is not None and self._localisation.lost:
            faults.append("the chair no longer knows where it is: drive it to a known place and set its pose")
        return tuple(faults)
