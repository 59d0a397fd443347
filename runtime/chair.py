"""The whole chair as one object: sensor messages in, commands to the board out, one tick at a time.

It has no clock and no threads of its own: whoever owns it (a trial, a ROS node, the page) calls `step` at
`topics.COMMAND.rate_hz` with the messages since the last tick, and `beat` in between, at `topics.TELEMETRY.rate_hz` or
faster, so that the board knows that the computer lives.

Nothing drives because it was asked for: `go` takes a goal, and `confirm`, the rider's own yes, begins it, if nothing is
wrong at that moment. Otherwise the goal is dropped, and so it is by whatever ends a drive.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeAlias

import numpy as np

from waychair.calibration.calibration_file import ChairCalibration
from waychair.calibration.dac import DEFAULT, DacModel
from waychair.calibration.fitted_dac import DeadBand, FittedDac
from waychair.calibration.stopping import StopTable, permitted_speed
from waychair.calibration.time_offset import SensorDelays, without_delay
from waychair.config import Settings
from waychair.control.closed_loop import ClosedLoop, ClosedLoopSettings
from waychair.control.collision_monitor import MonitorSettings, is_silent, permitted_share, refusal
from waychair.control.fitness import Fitness, FitnessSettings
from waychair.control.kinematics import wheel_speeds_from_twist
from waychair.control.limiter import Limiter, LimiterSettings
from waychair.control.navigator import Navigation, Navigator, NavigatorSettings
from waychair.control.stops import STOPS, Braking, Halt, Severity, board_halt, halt, halt_as_told
from waychair.control.supervisor import DRIVEN, Override, Situation, SupervisorSettings, Verdict, supervise
from waychair.control.unseen import Sector, UnseenSettings, sectors_of_scan, sight_share
from waychair.firmware_bridge.bridge import Bridge, BridgeSettings
from waychair.firmware_bridge.transports import Reconnecting
from waychair.geometry import arc, transform_points
from waychair.maps.zones import Zone, speed_limit
from waychair.planning.motion import measured
from waychair.runtime.monitor_process import MonitorInStep, MonitorPort, Watched
from waychair.slam.localiser import Localisation, Localiser, LocaliserSettings
from waychair.slam.odometry import OdometryFilter
from waychair.slam.scan_points import scan_points
from waychair.slam.tilt import TiltFilter
from waychair.types import (
    ChairStatus,
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

Message: TypeAlias = WheelTicks | Scan | ImuSample | SonarReadings | RgbdFrame | ChairStatus
"""What a chair's sensors and contacts say; it drives by its wheels and its lidar, and watches all that it is given.

The rider's joystick is no message: the board reads it, and says so in its telemetry.
"""


@dataclass(frozen=True, slots=True)
class ChairSettings(Settings):
    """The parts' own settings."""

    localiser: LocaliserSettings = field(default_factory=LocaliserSettings)
    navigator: NavigatorSettings = field(default_factory=NavigatorSettings)
    closed_loop: ClosedLoopSettings = field(default_factory=ClosedLoopSettings)
    supervisor: SupervisorSettings = field(default_factory=SupervisorSettings)
    fitness: FitnessSettings = field(default_factory=FitnessSettings)
    limiter: LimiterSettings = field(default_factory=LimiterSettings)
    monitor: MonitorSettings = field(default_factory=MonitorSettings)
    unseen: UnseenSettings = field(default_factory=UnseenSettings)
    bridge: BridgeSettings = field(default_factory=BridgeSettings)


@dataclass(frozen=True, slots=True)
class ChairState:
    """What the chair knows and did in one tick: where it is, who drives and why, what was asked and what was sent.

    `halts`: all that keeps it from driving or holds it up, each with its remedy. `command`: the navigator's twist
    within the limits, None when the computer does not drive. `telemetry` is the board's last report, None while there
    is no board that could be driven through.
    """

    stamp_ns: int
    map_from_base: Pose2
    twist: Twist
    localisation: Localisation | None
    verdict: Verdict
    halts: tuple[Halt, ...]
    navigation: Navigation
    command: Twist | None
    sent: Sent
    telemetry: Telemetry | None


@dataclass(frozen=True, slots=True)
class _Sight:
    """What a scan saw, (N, 2) [m] in map, and how far its other beams went, (M, 2); None when there was no scan."""

    points: FloatArray | None = None
    beyond: FloatArray | None = None


class Chair:
    """A chair on a known map from a known start, at the end of a cable to its board."""

    def __init__(
        self,
        grid: OccupancyGrid,
        places: Mapping[str, Place],
        calibration: ChairCalibration,
        cable: Reconnecting,
        start: Pose2,
        settings: ChairSettings | None = None,
        model: DacModel | None = None,
        monitor: MonitorPort | None = None,
        zones: Sequence[Zone] = (),
        scanned: OccupancyGrid | None = None,
    ) -> None:
        """What the calibration lacks is careful: without measured stops the chair crawls.

        `model` drives the lines in place of the calibration's. `monitor`: a `MonitorProcess`, for a chair on its feet;
        by default the monitor lives in the tick, as the simulator's clock needs it. `zones` are the map's. `scanned`:
        the map as a lidar sees it, where a camera has drawn into it, too (`maps.depth_layer`).

        Raises:
            BridgeError: the chair's name is too long for a board.
        """
        self.settings = s = settings or ChairSettings()
        self.body = body = calibration.body
        self.navigator = Navigator(grid, places, body, _within(s, calibration.stops), zones)
        self._calibration = calibration
        self._zones = zones
        self._delays = calibration.sensor_delays or SensorDelays()
        self._odometry = OdometryFilter(body)
        self._tilt = TiltFilter(body)
        self._localiser = Localiser(grid if scanned is None else scanned, body.base_from_laser, start, s.localiser)
        model = model or calibration.dac or DEFAULT
        model = DeadBand(model) if isinstance(model, FittedDac) else model
        watched = Watched(body, s.monitor, calibration.stops, calibration.self_mask)
        self._monitor = monitor or MonitorInStep(watched)
        self.bridge = Bridge(cable, model, calibration.chair_id, s.bridge, self._gate)
        self._loop = ClosedLoop(model, body.track, s.closed_loop, calibration.stops)
        self._limiter = Limiter(s.limiter)
        self._fitness = Fitness(body, s.fitness)
        self._override = Override(s.supervisor)
        self._start = start
        self._mode = DriveMode.MANUAL
        self._goals: tuple[Goal, ...] = ()  # that wait for a yes
        self._goals_since_ns: int | None = None
        self._requested = self._confirmed = self._stop_pressed = False
        self._latched: Halt | None = None
        self._halts: tuple[Halt, ...] = (halt("lidar_stale"),)
        self._sent: Sent | None = None
        self._wheels: Odometry | None = None
        self._measured = Twist()  # mean of the last tick
        self._sectors: list[Sector] = []  # what the latest scan sees of
        self._localisation: Localisation | None = None

    @property
    def ready(self) -> bool:
        """Whether, at the last tick, a confirmed drive could have begun."""
        return not any(halted.stop.severity is not Severity.PAUSES for halted in self._halts)

    def go(self, goal: Goal, *further: Goal) -> None:
        """Take a goal, and those after it, which wait for `confirm`; raises `UnknownPlace` for one not on the map.

        A drive under way comes to rest first. What the computer itself did to the board (a lost cable, a pause) is
        forgiven by asking for a goal.
        """
        self.navigator.go(goal, *further)
        self._goals, self._goals_since_ns, self._requested = (goal, *further), None, True
        self._confirmed = self._stop_pressed = False
        self.bridge.reset()

    def confirm(self) -> None:
        """The rider's yes to the goal that waits: the drive begins in the next tick, unless something is wrong."""
        self._confirmed = bool(self._goals)

    def stop(self) -> None:
        """The rider's Stop: nothing moves by itself until a new goal is asked for."""
        self._stop_pressed = True

    def reset(self) -> None:
        """Somebody's deliberate act: the faults were seen to, the emergency stop was released on purpose.

        Nothing drives because of it: a goal that was waiting for it has to be asked for again.
        """
        self._drop_goal("the faults were reset; ask for the goal again")
        self.bridge.reset(by_rider=True)
        self._loop.acknowledge()
        if any(halted.stop is STOPS["monitor_silent"] for halted in self._halts):
            self._monitor.restart()
        self._latched = None

    def beat(self, now_ns: int) -> None:
        """Keep the board company between two ticks."""
        self.bridge.beat(now_ns)

    def step(self, now_ns: int, messages: Iterable[Message]) -> ChairState:
        """One tick: take in the messages, decide who drives, and let the bridge send what that comes to."""
        sight = self._take_in(messages)
        pose = self._map_from_base(now_ns)
        telemetry = self.bridge.listen(now_ns)
        halts = self._look_for_halts(now_ns)
        verdict = self._supervise(now_ns, telemetry, halts)
        map_from_odom = None if self._localisation is None else self._localisation.map_from_odom
        navigation = self.navigator.step(now_ns, pose, sight.points, map_from_odom, sight.beyond)
        command = self._limited(now_ns, verdict, navigation)
        trimmed = self._loop.step(command if self.bridge.armed else None, self._measured, now_ns, self._sent)
        speeds = None if command is None else wheel_speeds_from_twist(trimmed, self.body.track)
        sent = self.bridge.send(speeds, now_ns, now_ns)
        self._follow_up(sent, command)
        return ChairState(
            now_ns, pose, self._twist, self._localisation, verdict, halts, navigation, command, sent, telemetry
        )

    @property
    def _twist(self) -> Twist:
        """As measured by wheels and gyro."""
        return Twist() if self._wheels is None else self._wheels.twist

    def _take_in(self, messages: Iterable[Message]) -> _Sight:
        """Odometry and localisation up to date, the navigator told of sonars and camera; what the latest scan saw."""
        seen, twists = _Sight(), []
        for late in messages:
            message = without_delay(late, self._delays)
            if isinstance(message, WheelTicks):
                self._wheels = self._odometry.update_wheels(message)
                twists.append(self._wheels.twist)
            elif isinstance(message, ImuSample):
                self._odometry.update_imu(message)
                self._tilt.update(message, self._twist)
            elif isinstance(message, Scan) and self._wheels is not None:
                self._monitor.see(message)
                seen = self._localise(message)
            elif isinstance(message, SonarReadings) and self._localisation is not None:
                self.navigator.hear(message, self._map_from_base(message.stamp_ns))
            elif isinstance(message, RgbdFrame) and self._localisation is not None:
                tilt = self._tilt.tilt
                lean = None if tilt is None else tilt.level_from_base()
                self.navigator.look(message, self._map_from_base(message.stamp_ns), lean)
            if not isinstance(message, SonarReadings):
                self._fitness.hear(message, self._twist)
        if twists:  # one sample of an encoder is coarse
            self._measured = Twist(
                sum(twist.v for twist in twists) / len(twists), sum(twist.omega for twist in twists) / len(twists)
            )
        return seen

    def _localise(self, raw: Scan) -> _Sight:
        """Where the chair was at a scan, and what this saw, but for the chair itself."""
        mask = self._calibration.self_mask
        scan = raw
        if mask is not None:
            scan = replace(raw, ranges=np.where(mask.hides(raw), np.float32(math.nan), raw.ranges))
        odom_from_base = self._odom_from_base(scan.stamp_ns)
        self._localisation = self._localiser.process(scan, odom_from_base, self._twist)
        self._fitness.locate(self._localisation, odom_from_base)
        self._sectors = sectors_of_scan(scan, self.body.base_from_laser)
        reach, mount = self.settings.navigator.obstacle_range, self.body.base_from_laser
        points = scan_points(scan, mount, reach, self._twist).points
        # of a beam that goes on so far is known that it goes on so far
        clear = replace(scan, ranges=np.where(scan.ranges >= reach, np.float32(0.999 * reach), np.float32(math.nan)))
        beyond = scan_points(clear, mount, reach, self._twist).points
        map_from_base = self._localisation.map_from_base
        return _Sight(transform_points(map_from_base, points), transform_points(map_from_base, beyond))

    def _look_for_halts(self, now_ns: int) -> tuple[Halt, ...]:
        """All that is wrong now, and what was wrong with the last drive until somebody resets it."""
        s, verdict = self.settings.monitor, self._monitor.verdict
        if self._mode not in DRIVEN:
            self._fitness.settle()
        halts = [*map(board_halt, self.bridge.trouble), *self._fitness.halts(now_ns)]
        if self._loop.fault:
            halts.append(halt_as_told("disobeys", self._loop.fault))
        if is_silent(verdict, now_ns, s):
            halts.append(halt("monitor_silent"))
        elif verdict is not None and verdict.stop:
            halts.append(halt(verdict.stop))
        if self._mode in DRIVEN:
            latching = (halted for halted in halts if halted.stop.severity is Severity.LATCHES)
            self._latched = self._latched or next(latching, None)
        if self._latched is not None and self._latched not in halts:
            halts.append(self._latched)
        self._halts = tuple(halts)
        return self._halts

    def _supervise(self, now_ns: int, telemetry: Telemetry | None, halts: tuple[Halt, ...]) -> Verdict:
        """Who drives in this tick; what was interrupted or refused is dropped, and never resumes by itself."""
        self._drop_unconfirmed(now_ns)
        stick = None if telemetry is None else telemetry.joystick
        taken_over = self._override.update(stick) or self.bridge.taken_over
        active = self.navigator.active
        situation = Situation(stick, taken_over, self._stop_pressed, active, self._requested, self._confirmed, halts)
        self._requested = self._confirmed = False
        verdict = supervise(self._mode, situation, self.settings.supervisor)
        if verdict.drops_goal or not active:
            self._drop_goal(verdict.reason)
        elif verdict.computer_drives and self._goals:
            self.navigator.go(*self._goals)  # afresh: what it tried while it waited does not count
            self._goals = ()
        self._mode = verdict.mode
        return verdict

    def _drop_unconfirmed(self, now_ns: int) -> None:
        """A goal waits for its yes for so long only."""
        if not self._goals:
            return
        self._goals_since_ns = now_ns if self._goals_since_ns is None else self._goals_since_ns
        if now_ns - self._goals_since_ns > self.settings.supervisor.confirm_s * 1e9:
            self._drop_goal("nobody has confirmed the drive: ask for the goal again")

    def _drop_goal(self, reason: str) -> None:
        self._goals = ()
        self.navigator.cancel(reason)

    def _limited(self, now_ns: int, verdict: Verdict, navigation: Navigation) -> Twist | None:
        """What is commanded: the navigator's twist within all limits, or the way to rest; None to let go of the lines."""
        driving = verdict.computer_drives and navigation.driving
        braking = None if driving else verdict.braking
        asked = self._limiter.command
        if driving:
            asked = Twist(verdict.share * navigation.twist.v, verdict.share * navigation.twist.omega)
        self._monitor.judge(asked, self._twist, now_ns)
        if not driving and (braking is Braking.RELEASE or not self._limiter.moving):
            self._limiter.rest()
            return None
        found = self._monitor.verdict
        if found is not None and found.stop:
            braking = STOPS[found.stop].braking
        if self._gate(now_ns):  # the bridge sends zero, so the command is none
            braking = Braking.RELEASE
        cap = self._speed_limit(now_ns)
        share = 0.0 if found is None else permitted_share(asked, found, self.settings.monitor)
        share = min(share, sight_share(asked, self.body, self._sectors, self.settings.unseen))
        return self._limiter.step(asked, now_ns, cap, share, braking)

    def _speed_limit(self, now_ns: int) -> float:
        """Greatest speed [m/s] for reasons that are no stops: doubts, sensors, measured brakes, and slow zones."""
        v, limits = self._limiter.command.v, self.settings.limiter
        seconds = limits.braking / limits.jerk / 2 + self.settings.monitor.reaction_s  # the chair is later than told
        slows_down_in = math.copysign(abs(v) * seconds + v * v / (2.0 * limits.braking), v)
        here = self._map_from_base(now_ns)
        there = here @ Pose2(slows_down_in)
        outline = np.concatenate([transform_points(pose, self.body.outline()) for pose in (here, there)])
        return min(
            self._loop.speed_limit,
            self._fitness.speed_limit(now_ns),
            permitted_speed(self._calibration.stops),
            speed_limit(self._zones, outline),
        )

    def _gate(self, now_ns: int) -> str:
        """Why no speed may pass the bridge now, by the age of the monitor's verdict and of its scan."""
        stop_id = refusal(self._monitor.verdict, now_ns, self.settings.monitor)
        return halt(stop_id).text if stop_id else ""

    def _follow_up(self, sent: Sent, command: Twist | None) -> None:
        """What was really sent is news to the navigator, and the end of a drive that bridge or board have ended."""
        if sent.active and command is not None:
            self.navigator.commanded(command)
        else:
            self.navigator.at_rest()
            self._limiter.rest()
            if command is not None and self._sent is not None and self._sent.active:
                self._drop_goal(sent.reason)
        self._sent = sent

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


def _within(chair: ChairSettings, stops: StopTable | None) -> NavigatorSettings:
    """The navigator plans within the rider's comfort and what the chair's brakes were measured for.

    It gives way to people for as long as the monitor does.
    """
    settings, limits = chair.navigator, chair.limiter
    dwa = measured(settings.dwa, stops)
    return replace(
        settings,
        tracks=replace(settings.tracks, room_after_s=chair.monitor.give_way_s),
        dwa=replace(
            dwa,
            max_speed=min(dwa.max_speed, limits.max_speed),
            max_reverse=min(dwa.max_reverse, permitted_speed(stops)),
            max_omega=min(dwa.max_omega, limits.max_omega),
            acceleration=min(dwa.acceleration, limits.acceleration),
            braking=min(dwa.braking, limits.braking),
            alpha=min(dwa.alpha, limits.alpha),
            jerk=min(dwa.jerk, limits.jerk),
            alpha_jerk=min(dwa.alpha_jerk, limits.jerk * limits.alpha / limits.acceleration),
            max_lateral=min(dwa.max_lateral, limits.lateral),
        ),
    )
