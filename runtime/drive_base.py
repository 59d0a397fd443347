"""The drive base: odometry, stops, supervisor, limits, collision monitor and the bridge to the board.

Of goals it knows only whether there is one, and nothing of paths. Each tick it takes in sensor messages and the
localiser's pose, decides who drives (`supervise`), and sends the requested twist within all limits to the board
(`drive`); in between, the navigator hears its verdict. Without a call of `drive` it lets go of the lines.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TypeAlias

from waychair.calibration.calibration_file import ChairCalibration
from waychair.calibration.fits.dac import DEFAULT, DacModel
from waychair.calibration.fits.fitted_dac import DeadBand, FittedDac
from waychair.control.safety.collision_monitor import is_at_rest
from waychair.control.safety.fitness import Fitness
from waychair.control.safety.own_parts import OwnParts
from waychair.control.safety.pushing import Pushing
from waychair.control.safety.stops import STOPS, Halt, board_halt, halt, halt_as_told
from waychair.control.safety.supervisor import DRIVEN, SupervisorVerdict, supervise
from waychair.control.speed.closed_loop import ClosedLoop
from waychair.control.speed.kinematics import saturate, wheel_speeds_from_twist
from waychair.firmware_bridge.bridge import Bridge, with_family_of
from waychair.firmware_bridge.transports import Reconnecting
from waychair.maps.drawn.zones import Zone
from waychair.runtime.base_settings import BaseSettings
from waychair.runtime.command_limits import CommandLimits
from waychair.runtime.halt_watch import HaltWatch
from waychair.runtime.measured_motion import MeasuredMotion
from waychair.runtime.monitor_process import MonitorInStep, MonitorPort, Watched
from waychair.runtime.rider.rider_guard import RiderGuard
from waychair.runtime.rider.rider_input import RiderInput
from waychair.slam.localising.localisation import Localisation
from waychair.types import (
    ChairStatus,
    DriveMode,
    FloatArray,
    HelpLevel,
    ImuSample,
    Pose2,
    PressureSample,
    Scan,
    SensorMessage,
    SentCommand,
    SonarReadings,
    Telemetry,
    Twist,
    WheelSpeeds,
    WheelTicks,
)

ChairMessage: TypeAlias = SensorMessage | ChairStatus
"""A message of a chair's sensors or contacts. Wheels and lidar are required; every other one that comes is supervised.

The rider's joystick is no message: the board reads it and reports it in its telemetry.
"""


@dataclass(frozen=True, slots=True)
class DriveResult:
    """The command of a tick within the limits, None when the computer does not drive, and the bridge's record of it.

    `ended`: the reason for which bridge or board ended a drive that the supervisor would have continued, else empty.
    """

    command: Twist | None
    sent: SentCommand
    ended: str = ""


class DriveBase:
    """Odometry, fitness, supervisor, limits, monitor and bridge of one chair; `motion` is its measured motion."""

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
        self._calibration = calibration
        body = calibration.body
        given = model is not None
        model = model or calibration.dac or DEFAULT
        model = DeadBand(model) if isinstance(model, FittedDac) else model
        watched = Watched(body, s.monitor, calibration.stops, calibration.self_mask)
        self.motion = MeasuredMotion(body, start)
        self._rider = RiderInput(s.supervisor, s.steering)
        self._fitness, self._pushing = Fitness(body, s.fitness), Pushing(body, s.supervisor.at_rest)
        self._own_parts = OwnParts(body)
        self._monitor = monitor or MonitorInStep(watched)
        self._halts = HaltWatch()
        self._limits = CommandLimits(body, calibration.stops, s, self._monitor, zones)
        self._loop = ClosedLoop(model, body.track, s.speed_loop, calibration.stops)
        self.bridge = Bridge(
            cable, model, calibration.chair_id, with_family_of(s.bridge, calibration), self._limits.gate
        )
        measured = calibration.dac is not None or given
        self.guard = RiderGuard(body, calibration.stops, s, self._monitor, self.bridge, calibrated=measured)
        self._mode = DriveMode.MANUAL
        self._sent: SentCommand | None = None

    @property
    def ready(self) -> bool:
        """Whether, at the last tick, a confirmed drive could have begun."""
        return self._halts.allow_driving

    @property
    def stopped_after_push(self) -> bool:
        """Whether the chair came to rest at the last tick after a push by hand; its pose may be wrong."""
        return self._pushing.stands_again

    @property
    def halts(self) -> tuple[Halt, ...]:
        """The halts of the last tick."""
        return self._halts.present

    def replace_zones(self, zones: Sequence[Zone]) -> None:
        """Replace the map's zones, at any time."""
        self._limits.zones = tuple(zones)

    def change_map(self, zones: Sequence[Zone], start: Pose2) -> None:
        """Take another map's zones, and forget where the chair was on the last one; it is assumed at `start` in map."""
        self.replace_zones(zones)
        self.motion.change_map(start)
        self._fitness.change_map()
        self._loop.change_map()

    def request(self) -> None:
        """Note that another goal was asked for: it waits for a `confirm` of its own.

        This also resets board faults that the computer caused (a lost cable, a gap in its messages).
        """
        self._rider.request()
        self.bridge.reset()

    def confirm(self) -> None:
        """Take the rider's yes: unless something is wrong the drive begins in the next tick, with the countdown."""
        self._rider.confirm()

    def countdown_s(self, now_ns: int) -> float | None:
        """Return the time until a drive that has begun may move [s]; None outside the countdown."""
        return self._rider.countdown_s(now_ns)

    def choose_level(self, level: HelpLevel) -> str:
        """Take a level of help by the rider's own act; return the sentence to be spoken. See `RiderGuard`."""
        return self.guard.choose(level)

    def stop(self) -> None:
        """Obey the rider's Stop: nothing moves by itself until a new goal is asked for or a page steers."""
        self._rider.stop()

    def steer(self, forward: float, turn: float, now_ns: int) -> None:
        """Take the position of a page's joystick, each axis in [-1, 1], left positive; see `Steering`."""
        if self._rider.steer(forward, turn, now_ns):
            self.bridge.reset()

    def let_go(self, now_ns: int) -> None:
        """Note that a page's joystick was let go."""
        self._rider.steering.let_go(now_ns)

    def reset(self) -> None:
        """Reset faults and the emergency stop, by a person's deliberate act."""
        self.bridge.reset(by_rider=True)
        self._loop.acknowledge()
        if any(halted.stop is STOPS["monitor_silent"] for halted in self.halts):
            self._monitor.restart()
        self._halts.reset()

    def beat(self, now_ns: int) -> None:
        """Send the board a heartbeat between two ticks."""
        self.bridge.beat(now_ns)

    def with_true_stamp(self, late: ChairMessage) -> ChairMessage:
        """Return a message with its stamp corrected by the measured latency of its sensor."""
        return self._calibration.with_true_stamp(late)

    def hear(self, message: ChairMessage) -> None:
        """Take in a sensor message after `with_true_stamp`; scans before the first wheel reading are ignored."""
        if isinstance(message, WheelTicks | ImuSample):
            self.motion.hear(message)
        elif isinstance(message, Scan) and self.motion.odometry is not None:
            self._monitor.see(message)
            masked = self._calibration.masked(message)
            self._limits.see(masked)
            self._own_parts.see(masked, self.motion.odom_from_base(message.stamp_ns))
        if not isinstance(message, SonarReadings | PressureSample):
            self._fitness.hear(message, self.motion.twist)

    def dismiss(self, message: ChairMessage, age_s: float, now_ns: int) -> None:
        """Note a message that cannot be used because its stamp, so much older [s] than now, is of another clock."""
        if not isinstance(message, SonarReadings | PressureSample):
            self._fitness.dismiss(message, age_s, now_ns)

    def locate(self, localisation: Localisation, stamp_ns: int) -> None:
        """Take in the localiser's result for a stamp."""
        self.motion.locate(localisation)
        odom_from_base = self.motion.odom_from_base(stamp_ns)
        self._fitness.locate(localisation, odom_from_base)
        self._loop.locate(stamp_ns, localisation.map_from_base @ localisation.remaining, odom_from_base)

    def supervise(
        self, now_ns: int, active: bool, other_halts: Iterable[Halt] = ()
    ) -> tuple[SupervisorVerdict, Telemetry | None]:
        """Decide on the driver of this tick; return the verdict and the board's last report.

        `active`: whether there is a goal. `other_halts` are halts that only the caller knows of. The report is None while
        no usable board is connected.
        """
        telemetry, driven = self.bridge.listen(now_ns), self._mode in DRIVEN
        stick = None if telemetry is None else telemetry.joystick
        released = self._sent is not None and not self._sent.active and not driven
        self._pushing.update(now_ns, released, stick, self.motion.wheels)
        self._rider.arming.update(now_ns, stick)
        if not driven:
            self._fitness.settle()
        halts = self._halts.update(now_ns, self._monitor.verdict, self._found_halts(now_ns, other_halts), driven=driven)
        taken_over = self._rider.takes_over(stick) or self.bridge.taken_over
        guarded = self.guard.wanted and not driven
        situation = self._rider.situation(now_ns, stick, taken_over, active, halts, guarded)
        verdict = supervise(self._mode, situation, self.settings.supervisor)
        self._mode = verdict.mode
        self._rider.obey(now_ns, situation, verdict)
        return verdict, telemetry

    def drive(self, now_ns: int, verdict: SupervisorVerdict, asked: Twist | None) -> DriveResult:
        """Send a requested twist within all limits; with None the chair comes to rest.

        While a page steers, the twist of its joystick replaces the request.
        """
        measured = self.motion.mean_twist()
        asked = self._rider.steering.twist(now_ns) if verdict.steered else asked
        limit = min(self._loop.speed_limit, self._fitness.speed_limit(now_ns))
        counts_down = self.countdown_s(now_ns) is not None
        command = self._limits.command(now_ns, verdict, asked, self.motion, limit, counts_down=counts_down)
        asked_now, wheels = command if self.bridge.armed else None, self.motion.wheel_paths()
        trimmed = self._loop.step(asked_now, measured, now_ns, self._sent, wheels)
        fastest, track = self.settings.bridge.max_wheel_speed, self._calibration.body.track
        speeds = None if command is None else saturate(wheel_speeds_from_twist(trimmed, track), fastest)
        before, self._sent = self._sent, self._send(now_ns, verdict, speeds)
        self._rider.arming.note_sent(wants=speeds is not None, holds=self._sent.active)
        if self._sent.active and command is not None:
            return DriveResult(command, self._sent)
        self._limits.rest()
        was_driving = command is not None and before is not None and before.active
        ended = self._sent.reason if was_driving else ""
        if ended and verdict.steered:
            # otherwise the lines would be requested again for as long as the page pushes
            self._rider.steering.end()
        return DriveResult(command, self._sent, ended)

    def _send(self, now_ns: int, verdict: SupervisorVerdict, speeds: WheelSpeeds | None) -> SentCommand:
        """Send wheel speeds to the board, or the caps of the rider's own stick."""
        if speeds is not None or not verdict.guarded:
            return self.bridge.send(speeds, now_ns, now_ns)
        telemetry = self.bridge.telemetry
        stick = None if telemetry is None else telemetry.joystick
        return self.guard.limit(now_ns, stick, self.motion.twist, self._limits.sectors)

    def note_mapped_legs(self, mapped: FloatArray, scan_ns: int) -> None:
        """Take a scan's points that look like legs but are on the map, (N, 2) [m] in the base frame of `scan_ns`."""
        self._monitor.note_mapped_legs(mapped, scan_ns)

    def _found_halts(self, now_ns: int, other_halts: Iterable[Halt]) -> Iterator[Halt]:
        """Yield the halts of board, sensors, caller, hands and control loop."""
        yield from map(board_halt, self.bridge.trouble)
        yield from self._fitness.halts(now_ns)
        yield from self._rider.arming.halts()
        yield from self._own_parts.halts(now_ns, self._mode in DRIVEN and is_at_rest(self.motion.twist))
        yield from other_halts
        if self._pushing.pushed:
            yield halt("pushed")
        if self._loop.fault:
            yield halt_as_told("disobeys", self._loop.fault)
