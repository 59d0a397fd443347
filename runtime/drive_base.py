"""The drive base: odometry, stops, supervisor, limits, collision monitor and the bridge to the board.

Of goals it knows only whether there is one, and nothing of paths. Each tick it takes in sensor messages and the
localiser's pose, decides who drives (`supervise`), and sends the requested twist within all limits to the board
(`drive`); in between, the navigator hears its verdict. Without a call of `drive` it lets go of the lines.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np

from waychair.calibration.calibration_file import ChairCalibration
from waychair.calibration.fits.dac import DEFAULT, DacModel
from waychair.calibration.fits.fitted_dac import DeadBand, FittedDac
from waychair.calibration.fits.stopping import permitted_speed
from waychair.config import Settings
from waychair.control.drive.steering import Steering, SteeringSettings
from waychair.control.safety.collision_monitor import SILENT_MS, MonitorSettings, is_silent, permitted_share, stale_stop
from waychair.control.safety.fitness import Fitness, FitnessSettings
from waychair.control.safety.pushing import Pushing
from waychair.control.safety.sight_speed import Sector, UnseenSettings, sectors_of_scan, sight_share
from waychair.control.safety.stops import STOPS, Braking, Halt, Severity, board_halt, halt, halt_as_told
from waychair.control.safety.supervisor import (
    DRIVEN,
    Override,
    Situation,
    SupervisorSettings,
    SupervisorVerdict,
    supervise,
)
from waychair.control.speed.closed_loop import ClosedLoop
from waychair.control.speed.kinematics import saturate, twist_from_wheel_speeds, wheel_speeds_from_twist
from waychair.control.speed.limiter import Limiter, LimiterSettings, is_possible
from waychair.control.speed.speed_loop import SpeedLoopSettings
from waychair.firmware_bridge.bridge import LATE_MS, Bridge, BridgeSettings, with_family_of
from waychair.firmware_bridge.transports import Reconnecting
from waychair.geometry import arc, transform_points
from waychair.maps.drawn.zones import Zone, zone_speed_limit
from waychair.runtime.monitor_process import MonitorInStep, MonitorPort, Watched
from waychair.slam.localising.localisation import Localisation
from waychair.slam.odometry.odometry_filter import OdometryFilter
from waychair.slam.odometry.tilt import Tilt, TiltFilter
from waychair.types import (
    ChairStatus,
    DriveMode,
    FloatArray,
    ImuSample,
    Odometry,
    Pose2,
    Scan,
    SensorMessage,
    SentCommand,
    SonarReadings,
    Telemetry,
    Twist,
    WheelTicks,
)

ChairMessage: TypeAlias = SensorMessage | ChairStatus
"""A message of a chair's sensors or contacts. Wheels and lidar are required; every other one that comes is supervised.

The rider's joystick is no message: the board reads it and reports it in its telemetry.
"""


@dataclass(frozen=True, slots=True)
class BaseSettings(Settings):
    """The settings of the drive base's parts."""

    speed_loop: SpeedLoopSettings = field(default_factory=SpeedLoopSettings)
    supervisor: SupervisorSettings = field(default_factory=SupervisorSettings)
    fitness: FitnessSettings = field(default_factory=FitnessSettings)
    limiter: LimiterSettings = field(default_factory=LimiterSettings)
    monitor: MonitorSettings = field(default_factory=MonitorSettings)
    unseen: UnseenSettings = field(default_factory=UnseenSettings)
    bridge: BridgeSettings = field(default_factory=BridgeSettings)
    steering: SteeringSettings = field(default_factory=SteeringSettings)


@dataclass(frozen=True, slots=True)
class DriveResult:
    """The command of a tick within the limits, None when the computer does not drive, and the bridge's record of it.

    `ended`: the reason for which bridge or board ended a drive that the supervisor would have continued, else empty.
    """

    command: Twist | None
    sent: SentCommand
    ended: str = ""


class DriveBase:
    """Odometry, fitness, supervisor, limits, monitor and bridge of one chair."""

    def __init__(
        self,
        calibration: ChairCalibration,
        cable: Reconnecting,
        start: Pose2,
        settings: BaseSettings | None = None,
        model: DacModel | None = None,
        monitor: MonitorPort | None = None,
        zones: Sequence[Zone] = (),
    ) -> None:
        """Missing parts of the calibration are replaced by careful defaults: without measured stops the chair crawls.

        start: the chair's assumed pose in map until the localiser has found one. `model` replaces the calibration's DAC
        model. `monitor`: a `MonitorProcess`, for a real chair; by default the monitor runs in the tick, as the
        simulator's clock needs it. `zones` are the map's.

        Raises:
            BridgeError: the chair's name is too long for a board.
            CalibrationMismatch: the settings name another joystick family than the calibration.
        """
        self.settings = s = settings or BaseSettings()
        self.body = body = calibration.body
        self._calibration = calibration
        self._odometry = OdometryFilter(body)
        self._tilt = TiltFilter(body)
        model = model or calibration.dac or DEFAULT
        model = DeadBand(model) if isinstance(model, FittedDac) else model
        watched = Watched(body, s.monitor, calibration.stops, calibration.self_mask)
        self._monitor = monitor or MonitorInStep(watched)
        self.bridge = Bridge(cable, model, calibration.chair_id, with_family_of(s.bridge, calibration), self._gate)
        self._loop = ClosedLoop(model, body.track, s.speed_loop, calibration.stops)
        self._limiter = Limiter(s.limiter)
        self._fitness = Fitness(body, s.fitness)
        self._override = Override(s.supervisor)
        self._steering, self._pushing = Steering(s.steering), Pushing(s.supervisor.at_rest)
        self._motion_from_ns: int | None = None  # the confirmed drive may move from this stamp on
        self.stopped_after_push = False
        """Whether the chair came to rest in this tick after a push by hand; its pose may be wrong."""
        self._start = start
        self.zones = tuple(zones)
        """The map's zones; they may be replaced at any time."""
        self._mode = DriveMode.MANUAL
        self._requested = self._confirmed = self._stop_pressed = False
        self._latched: Halt | None = None
        self.halts: tuple[Halt, ...] = (halt("lidar_stale"),)
        self._sent: SentCommand | None = None
        self._wheels: Odometry | None = None
        self._twists: list[Twist] = []  # since the last tick
        self._measured = Twist()  # mean of _twists
        self._ticked_ns, self._on_time_since_ns = 0, 0  # stamps of the last tick and of the first one since a gap
        self._sectors: list[Sector] = []  # directions in which the latest scan measured something
        self._localisation: Localisation | None = None

    @property
    def ready(self) -> bool:
        """Whether, at the last tick, a confirmed drive could have begun."""
        return not any(halted.stop.severity is not Severity.PAUSES for halted in self.halts)

    @property
    def odometry(self) -> Odometry | None:
        """The latest odometry; None before the first wheel reading."""
        return self._wheels

    @property
    def twist(self) -> Twist:
        """The chair's twist as measured by wheels and gyro."""
        return Twist() if self._wheels is None else self._wheels.twist

    @property
    def twist_covariance(self) -> FloatArray:
        """Covariance (3, 3) of forward speed, lateral speed and turn rate [m^2/s^2, m rad/s^2, rad^2/s^2]."""
        return self._odometry.twist_covariance

    @property
    def tilt(self) -> Tilt | None:
        """The chair's tilt; None before the first IMU message."""
        return self._tilt.tilt

    def odom_from_base(self, stamp_ns: int) -> Pose2:
        """Return the odometry at a stamp, extrapolated by at most 0.1 s; the origin before the first wheel reading."""
        if self._wheels is None:
            return Pose2()
        seconds = min(max((stamp_ns - self._wheels.stamp_ns) * 1e-9, -0.1), 0.1)
        twist = self._wheels.twist
        return self._wheels.odom_from_base @ arc(twist.v * seconds, twist.omega * seconds)

    def map_from_base(self, now_ns: int) -> Pose2:
        """Return the chair's pose in map by localiser and odometry."""
        if self._localisation is None:
            return self._start
        return self._localisation.map_from_odom @ self.odom_from_base(now_ns)

    def request(self) -> None:
        """Note that another goal was asked for: it waits for a `confirm` of its own.

        This also resets board faults that the computer caused (a lost cable, a gap in its messages).
        """
        self._requested, self._confirmed, self._stop_pressed = True, False, False
        self._steering.end()
        self.bridge.reset()

    def confirm(self) -> None:
        """Take the rider's yes: unless something is wrong the drive begins in the next tick, with the countdown."""
        self._confirmed = True

    def countdown_s(self, now_ns: int) -> float | None:
        """Return the time until a drive that has begun may move [s]; None outside the countdown."""
        if self._motion_from_ns is None or now_ns >= self._motion_from_ns:
            return None
        return (self._motion_from_ns - now_ns) * 1e-9

    def stop(self) -> None:
        """Obey the rider's Stop: nothing moves by itself until a new goal is asked for or a page steers."""
        self._stop_pressed = True
        self._steering.end()

    def steer(self, forward: float, turn: float, now_ns: int) -> None:
        """Take the position of a page's joystick, each axis in [-1, 1], left positive; see `Steering`."""
        if self._steering.push(forward, turn, now_ns):
            self._stop_pressed = False
            self.bridge.reset()

    def let_go(self, now_ns: int) -> None:
        """Note that a page's joystick was let go."""
        self._steering.let_go(now_ns)

    def reset(self) -> None:
        """Reset faults and the emergency stop, by a person's deliberate act."""
        self.bridge.reset(by_rider=True)
        self._loop.acknowledge()
        if any(halted.stop is STOPS["monitor_silent"] for halted in self.halts):
            self._monitor.restart()
        self._latched = None

    def beat(self, now_ns: int) -> None:
        """Send the board a heartbeat between two ticks."""
        self.bridge.beat(now_ns)

    def with_true_stamp(self, late: ChairMessage) -> ChairMessage:
        """Return a message with its stamp corrected by the measured latency of its sensor."""
        return self._calibration.with_true_stamp(late)

    def hear(self, message: ChairMessage) -> None:
        """Take in a sensor message after `with_true_stamp`; scans before the first wheel reading are ignored."""
        if isinstance(message, WheelTicks):
            self._wheels = self._odometry.update_wheels(message)
            self._twists.append(self._wheels.twist)
        elif isinstance(message, ImuSample):
            self._odometry.update_imu(message)
            self._tilt.update(message, self.twist)
        elif isinstance(message, Scan) and self._wheels is not None:
            self._monitor.see(message)
            self._sectors = sectors_of_scan(self._calibration.masked(message), self.body.base_from_laser)
        if not isinstance(message, SonarReadings):
            self._fitness.hear(message, self.twist)

    def locate(self, localisation: Localisation, stamp_ns: int) -> None:
        """Take in the localiser's result for a stamp."""
        self._localisation = localisation
        self._fitness.locate(localisation, self.odom_from_base(stamp_ns))

    def supervise(
        self, now_ns: int, active: bool, other_halts: Iterable[Halt] = ()
    ) -> tuple[SupervisorVerdict, Telemetry | None]:
        """Decide who drives in this tick; return the verdict and the board's last report.

        `active`: whether there is a goal. `other_halts` are halts that only the caller knows of. The report is None while
        no usable board is connected.
        """
        telemetry = self.bridge.listen(now_ns)
        stick = None if telemetry is None else telemetry.joystick
        released = self._sent is not None and not self._sent.active and self._mode not in DRIVEN
        self.stopped_after_push = self._pushing.update(now_ns, released, stick, self._wheels)
        self.halts = self._collect_halts(now_ns, other_halts)
        taken_over = self._override.update(stick) or self.bridge.taken_over
        steered, confirmed = self._steering.counts(now_ns), self._confirmed
        situation = Situation(
            joystick=stick,
            taken_over=taken_over,
            stop_pressed=self._stop_pressed,
            goal_active=active,
            requested=self._requested,
            confirmed=confirmed,
            halts=self.halts,
            steered=steered,
        )
        self._requested = self._confirmed = False
        verdict = supervise(self._mode, situation, self.settings.supervisor)
        self._mode = verdict.mode
        if steered and not verdict.steered:
            self._steering.end()
        if not verdict.computer_drives or verdict.steered:
            self._motion_from_ns = None
        elif confirmed:
            self._motion_from_ns = now_ns + round(self.settings.supervisor.countdown_s * 1e9)
        return verdict, telemetry

    def drive(self, now_ns: int, verdict: SupervisorVerdict, asked: Twist | None) -> DriveResult:
        """Send a requested twist within all limits; with None the chair comes to rest.

        While a page steers, the twist of its joystick replaces the request.
        """
        self._average_twists()
        asked = self._steering.twist(now_ns) if verdict.steered else asked
        command = self._limited(now_ns, verdict, asked)
        trimmed = self._loop.step(command if self.bridge.armed else None, self._measured, now_ns, self._sent)
        fastest, track = self.settings.bridge.max_wheel_speed, self.body.track
        speeds = None if command is None else saturate(wheel_speeds_from_twist(trimmed, track), fastest)
        before, self._sent = self._sent, self.bridge.send(speeds, now_ns, now_ns)
        if self._sent.active and command is not None:
            return DriveResult(command, self._sent)
        self._limiter.rest()
        was_driving = command is not None and before is not None and before.active
        ended = self._sent.reason if was_driving else ""
        if ended and verdict.steered:
            self._steering.end()  # otherwise the lines would be requested again for as long as the page pushes
        return DriveResult(command, self._sent, ended)

    def note_mapped_legs(self, mapped: FloatArray, scan_ns: int) -> None:
        """Take a scan's points that look like legs but are on the map, (N, 2) [m] in the base frame of `scan_ns`."""
        self._monitor.note_mapped_legs(mapped, scan_ns)

    def _average_twists(self) -> None:
        """Average the twists of a tick, since one encoder sample is coarse."""
        twists, self._twists = self._twists, []
        if twists:
            v, omega = sum(twist.v for twist in twists), sum(twist.omega for twist in twists)
            self._measured = Twist(v / len(twists), omega / len(twists))

    def _collect_halts(self, now_ns: int, other_halts: Iterable[Halt]) -> tuple[Halt, ...]:
        """Return all present halts, and the latched one of the last drive until it is reset."""
        verdict = self._monitor.verdict
        self._note_tick_gap(now_ns)
        if self._mode not in DRIVEN:
            self._fitness.settle()
        halts = [*map(board_halt, self.bridge.trouble), *self._fitness.halts(now_ns), *other_halts]
        if self._pushing.pushed:
            halts.append(halt("pushed"))
        if self._loop.fault:
            halts.append(halt_as_told("disobeys", self._loop.fault))
        can_judge = verdict is None or now_ns - self._on_time_since_ns > SILENT_MS * 1_000_000
        if can_judge and is_silent(verdict, now_ns):
            halts.append(halt("monitor_silent"))
        elif verdict is not None and verdict.stop:
            halts.append(halt(verdict.stop))
        if self._mode in DRIVEN:
            latching = (halted for halted in halts if halted.stop.severity is Severity.LATCHES)
            self._latched = self._latched or next(latching, None)
        if self._latched is not None and self._latched not in halts:
            halts.append(self._latched)
        return tuple(halts)

    def _note_tick_gap(self, now_ns: int) -> None:
        """Note a gap between ticks (F17): a loop that was held up cannot tell whether the monitor was silent meanwhile.

        The command from before the gap is stale: by its age the bridge sends zero, then lets go.
        """
        if now_ns - self._ticked_ns > LATE_MS * 1_000_000:
            self._on_time_since_ns = now_ns
        self._ticked_ns = now_ns

    def _limited(self, now_ns: int, verdict: SupervisorVerdict, twist: Twist | None) -> Twist | None:
        """Return the command: the twist within all limits, or a step towards rest; None to let go of the lines."""
        driving = verdict.computer_drives and twist is not None
        braking = None if driving else verdict.braking
        asked = self._limiter.command
        if driving and self.countdown_s(now_ns) is not None:
            asked, braking = Twist(), Braking.COMFORT
        elif driving and twist is not None:
            asked = self._within_wheels(Twist(verdict.share * twist.v, verdict.share * twist.omega))
        self._monitor.judge(asked, self.twist, now_ns)
        if not driving and (braking is Braking.RELEASE or not self._limiter.moving):
            self._limiter.rest()
            return None
        found = self._monitor.verdict
        if found is not None and found.stop:
            braking = STOPS[found.stop].braking
        if self._gate(now_ns):  # the bridge sends zero, so there is no command to limit
            braking = Braking.RELEASE
        cap = self._speed_limit(now_ns)
        share = 0.0 if found is None else permitted_share(asked, found)
        share = min(share, sight_share(asked, self.body, self._sectors, self.settings.unseen))
        return self._limiter.step(asked, now_ns, cap, share, braking)

    def _within_wheels(self, twist: Twist) -> Twist:
        """Slow a twist down along its arc to the greatest wheel speed; an impossible twist is returned as it is."""
        track = self.body.track
        speeds = wheel_speeds_from_twist(twist, track)
        slower = saturate(speeds, self.settings.bridge.max_wheel_speed)
        return twist if slower is speeds or not is_possible(twist) else twist_from_wheel_speeds(slower, track)

    def _speed_limit(self, now_ns: int) -> float:
        """Return the speed limit [m/s] by the control loop's faults, sensors, measured stops and slow zones."""
        v, limits = self._limiter.command.v, self.settings.limiter
        seconds = limits.braking / limits.jerk / 2 + self.settings.monitor.reaction_s  # the chair lags its command
        slows_down_in = math.copysign(abs(v) * seconds + v * v / (2.0 * limits.braking), v)
        here = self.map_from_base(now_ns)
        there = here @ Pose2(slows_down_in)
        outline = np.concatenate([transform_points(pose, self.body.outline()) for pose in (here, there)])
        return min(
            self._loop.speed_limit,
            self._fitness.speed_limit(now_ns),
            permitted_speed(self._calibration.stops),
            zone_speed_limit(self.zones, outline),
        )

    def _gate(self, now_ns: int) -> str:
        """Return why the bridge may send no speed, by the age of the monitor's verdict and scan; empty if it may."""
        stop_id = stale_stop(self._monitor.verdict, now_ns)
        return halt(stop_id).text if stop_id else ""
