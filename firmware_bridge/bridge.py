"""The bridge, the last check on the computer: it sends only fresh, finite, allowed commands to the board.

It fails silent: on any problem it drops ENABLE, so that the rider's joystick is live, and tells the caller why. A bad
command raises no error. The board (`firmware/`) checks everything again and trusts none of it.

Between two commands `beat` repeats the last one at 50 Hz as a heartbeat, but only while it is fresh: if the planner
hangs, zero is sent after LATE_MS, and ENABLE is dropped after MAX_AGE_MS.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from dataclasses import dataclass, replace

from waychair.calibration.calibration_file import ChairCalibration
from waychair.calibration.fits.dac import DacModel
from waychair.config import Settings, setting
from waychair.errors import CalibrationError, CalibrationMismatch
from waychair.firmware_bridge.advice import fault_advice, is_of_host
from waychair.firmware_bridge.caps import STALE_CAP, Caps, StickMotion
from waychair.firmware_bridge.line_counts import LineCounts
from waychair.firmware_bridge.protocol import (
    BoardState,
    CommandFlag,
    Family,
    HelloReply,
    line_millivolts,
    setpoint_from_millivolts,
)
from waychair.firmware_bridge.session import SILENT, BoardSession
from waychair.firmware_bridge.transports import Reconnecting
from waychair.types import SentCommand, Telemetry, WheelSpeeds

RESET_NS = 1_000_000_000
"""Time for which a reset is requested: the board accepts it only when everything is in order."""

AT_REST = 0.1
"""Part of the swing within which a stick counts as at rest; a board's own setting may differ."""

PERIOD_MS = 20
"""Time between two heartbeats."""

LATE_MS = 100
"""Time without a command, two control periods, after which zero is sent."""

MAX_AGE_MS = 150
"""Age beyond which a command is stale; a late command is zero before it is stale."""

MAX_FUTURE_MS = 10
"""A command stamped later than now by more than this has a wrong clock."""

CAPS_DEAD_MS = 1000
"""Age of the caps beyond which the bridge falls silent, so that the board ends the guard by itself."""

SLEW = 6.0
"""Fastest change of a line [V/s], like the board's own limit."""

USUAL_FAMILY = Family.EIGHT_PIN_3V3
"""The joystick family of simulated chairs, and of chairs whose file and settings name none."""

TAKEN_OVER = "the rider took over by joystick"

GUARDED = "the rider drives by joystick, within the guard's caps"

GUARD_RESET = "the board ended the guard or was reset: choose the guard again"


@dataclass(frozen=True, slots=True)
class BridgeSettings(Settings):
    """Limits of the commands that the bridge passes on."""

    family: int = setting(
        0,
        "",
        "joystick family: 0 that of the chair's file, 1 hall_5v, 2 inductive_12v, 3 eight_pin_3v3; for old files without it",
        low=0,
        high=3,
    )
    max_wheel_speed: float = setting(
        1.6,
        "m/s",
        "wheel speed beyond which a command releases the lines; larger: faster commands pass",
        low=0.1,
        high=4.0,
    )


@dataclass(frozen=True, slots=True)
class _Order:
    """The last command as counts, or None if it must not be sent; `reason` tells why it is None or zero.

    `caps`: instead of a command, those of the rider's own stick.
    """

    counts: tuple[int, int] | None
    reason: str
    stamp_ns: int
    given_ns: int
    caps: Caps | None = None


@dataclass(slots=True)
class _Reset:
    """A requested reset of all faults or of the computer's faults; RESET_NS begins at the first call of `is_over`."""

    by_rider: bool
    since_ns: int | None = None
    rises: bool = False  # set in every other command, because the board needs a rising edge

    def is_over(self, now_ns: int) -> bool:
        """Return whether RESET_NS have passed since the first call."""
        self.since_ns = now_ns if self.since_ns is None else self.since_ns
        return not 0 <= now_ns - self.since_ns < RESET_NS


@dataclass(slots=True)
class _DriveAtBoard:
    """Whether the board drives for this computer, why it ended the last drive, and whether it still has to release."""

    lasts: bool = False
    ended: str = ""
    releasing: bool = False  # until the board reports that it has released the lines
    guards: bool = False  # the board guards the rider's own stick for this computer


@dataclass(slots=True)
class _Clock:
    """The latest time, and the last times of `send` and `beat` by themselves.

    A tick that began before a beat is not a clock that goes back.
    """

    now_ns: int = 0
    sender_ns: int | None = None
    beater_ns: int | None = None

    def at_send(self, now_ns: int) -> tuple[int, int]:
        """Return the time of a `send`, and by how much the sender's clock went back [ns]."""
        before_ns, self.sender_ns = self.sender_ns, now_ns
        return self._after(now_ns, before_ns)

    def at_beat(self, now_ns: int) -> tuple[int, int]:
        """Return the time of a `beat`, and by how much the heartbeat's clock went back [ns]."""
        before_ns, self.beater_ns = self.beater_ns, now_ns
        return self._after(now_ns, before_ns)

    def _after(self, now_ns: int, before_ns: int | None) -> tuple[int, int]:
        """Return the later of the caller's time and the latest one; a clock that went back sets the latest one."""
        back_ns = 0 if before_ns is None or now_ns >= before_ns else before_ns - now_ns
        if back_ns:
            self.now_ns = now_ns
        return max(now_ns, self.now_ns), back_ns


def with_family_of(settings: BridgeSettings, calibration: ChairCalibration) -> BridgeSettings:
    """Return the settings with the joystick family of the chair's file.

    Raises:
        CalibrationMismatch: the settings name another family than the file.
    """
    if calibration.family is None:
        return settings
    known = Family[calibration.family.upper()]
    if settings.family not in (0, known):
        raise CalibrationMismatch(
            f"`bridge.family: {settings.family}` is set, and the file of chair '{calibration.chair_id}' is of the joystick "
            f"family {known.value} ({calibration.family}): remove the setting, or measure the chair again"
        )
    return replace(settings, family=int(known))


class Bridge:
    """From wheel speeds to the board: `send` once a control tick, `beat` at least at 50 Hz. Thread-safe.

    It starts silent: after the handshake, two seconds of zero arm the board before it takes its first command. After a
    drive has ended, `send(None)` must come before the next drive; a chair does this when it gives up its goal.
    """

    def __init__(
        self,
        cable: Reconnecting,
        calibration: DacModel,
        chair_id: str,
        settings: BridgeSettings | None = None,
        gate: Callable[[int], str] = lambda now_ns: "",
    ) -> None:
        """`gate` is called at every command and heartbeat; it returns why no speed may pass now, or "".

        Raises:
            BridgeError: the chair's name is longer than 16 bytes.
        """
        self._gate = gate
        self._settings = settings or BridgeSettings()
        self._lines = LineCounts.of(calibration)
        self._session = BoardSession(
            cable, chair_id, self._settings.family or USUAL_FAMILY, self._lines.neutral_problem
        )
        self._lock = threading.Lock()
        self._clock = _Clock()
        self._order = _Order(None, "no command", 0, 0)
        self._drive = _DriveAtBoard()
        self._failure = ""  # of the heartbeat, until the next beat
        self._reset: _Reset | None = None
        self._sent_ns: int | None = None
        self._volts: tuple[float, float] | None = None  # last volts commanded on the lines; None while released
        self._sent = self._released(0, SILENT)

    @property
    def telemetry(self) -> Telemetry | None:
        """The board's last report; None if the board is silent, refused or disconnected."""
        return self._session.telemetry

    @property
    def greeting(self) -> HelloReply | None:
        """The board's handshake reply; None while the board is silent, refused or disconnected."""
        return self._session.reply

    def stick_motion(self, track: float) -> StickMotion | None:
        """Return the chair's motion at deflections of its own stick, `track` [m] wide; None without a usable board."""
        reply = self._session.reply
        return None if reply is None else StickMotion.of(self._lines, reply, track)

    @property
    def armed(self) -> bool:
        """Whether the board acts on set-points; before that only zero is sent."""
        board = self._session.board
        return board is not None and board.state in (BoardState.ARMED, BoardState.DRIVE) and not self._drive.releasing

    @property
    def taken_over(self) -> bool:
        """Whether the rider's stick ended the drive at the board (F19), until `send(None)`."""
        return self._drive.ended == TAKEN_OVER

    @property
    def guard_end(self) -> str:
        """Why board or cable ended a guard, until `send(None)`; empty if they did not."""
        return "" if self._order.caps is None else self._drive.ended

    @property
    def trouble(self) -> tuple[str, ...]:
        """Why the board cannot drive now, as sentences with a remedy; faults being reset are left out."""
        problem = self._drive_problem(self._clock.now_ns)
        if problem:
            return (problem,)
        return () if self._resetting else fault_advice(self._faults)

    def reset(self, *, by_rider: bool = False) -> None:
        """Ask the board for up to a second to clear its faults; the request ends even if the board cannot be reached.

        It clears only faults of the computer. `by_rider`, a person's deliberate act, clears all faults and acknowledges
        the emergency stop. A reset does not move the chair.
        """
        with self._lock:
            self._reset = _Reset(by_rider or (self._reset is not None and self._reset.by_rider))

    def listen(self, now_ns: int) -> Telemetry | None:
        """Read the board's messages; return its last report."""
        with self._lock:
            self._read_board(max(now_ns, self._clock.now_ns))
            return self.telemetry

    def send(self, speeds: WheelSpeeds | None, stamp_ns: int, now_ns: int) -> SentCommand:
        """Send wheel speeds [m/s] decided at `stamp_ns`, or release the lines; return what was really sent.

        None means that the computer does not want to drive. `stamp_ns` and `now_ns` are from one monotonic clock. While
        the board is not armed, zero is sent and `SentCommand` says so.
        """
        with self._lock:
            now_ns, back_ns = self._clock.at_send(now_ns)
            guarded = self._order.caps is not None
            self._order = self._order_from(speeds, stamp_ns, now_ns, back_ns)
            if speeds is None or guarded:
                self._drive = _DriveAtBoard(releasing=self._drive.releasing or self.armed)
            self._read_board(now_ns)
            return self._send_order(now_ns)

    def limit(self, caps: Caps, stamp_ns: int, now_ns: int) -> SentCommand:
        """Let the rider drive by the chair's own stick within caps that were decided at `stamp_ns`.

        The board begins once its stick has been at rest for two seconds. A guard that board or cable have ended does not
        begin again before `send(None)`; see `guard_end`. Caps of another clock are narrow, and so are old ones.
        """
        with self._lock:
            now_ns, back_ns = self._clock.at_send(now_ns)
            if back_ns or stamp_ns - now_ns > MAX_FUTURE_MS * 1_000_000:
                caps, stamp_ns = caps.narrowed(STALE_CAP), now_ns
            if self._order.caps is None:
                self._drive = _DriveAtBoard(releasing=self._drive.releasing or self.armed)
            self._order = _Order(None, GUARDED, stamp_ns, now_ns, caps)
            self._read_board(now_ns)
            return self._send_order(now_ns)

    def beat(self, now_ns: int) -> SentCommand:
        """Read the board's messages and, when it is due, repeat the last command while it is fresh."""
        with self._lock:
            now_ns, back_ns = self._clock.at_beat(now_ns)
            if back_ns:
                self._order = replace(self._order, counts=None, reason=_went_back(back_ns))
            self._read_board(now_ns)
            self._failure = ""
            period_ns = PERIOD_MS * 1_000_000
            if back_ns or self._sent_ns is None or now_ns - self._sent_ns >= period_ns:
                return self._send_order(now_ns)
            return self._sent

    def fail(self, reason: str) -> None:
        """Report why a heartbeat failed: it ends a drive, and `trouble` names it until the next heartbeat."""
        with self._lock:
            self._failure = reason
            self._drive.ended = self._drive.ended or reason

    def _order_from(self, speeds: WheelSpeeds | None, stamp_ns: int, now_ns: int, back_ns: int) -> _Order:
        """Return the command as counts, or with the reason why it must not be sent."""
        reason = self._refusal(speeds, stamp_ns, now_ns, back_ns)
        if speeds is None or reason:
            return _Order(None, reason, stamp_ns, now_ns)
        try:
            counts = self._lines.counts(speeds)
        except CalibrationError as error:
            return _Order(None, str(error), stamp_ns, now_ns)
        late_ns = 0 if self._order.counts is None else now_ns - self._order.given_ns
        if late_ns > LATE_MS * 1_000_000:  # F17: the loop stalled before this tick, so this command is not trusted
            return _Order(self._lines.rest, _was_late(late_ns), stamp_ns, now_ns)
        return _Order(counts, "", stamp_ns, now_ns)

    def _refusal(self, speeds: WheelSpeeds | None, stamp_ns: int, now_ns: int, back_ns: int) -> str:
        """Return why this command must not be sent; empty if it may be."""
        fastest = self._settings.max_wheel_speed
        if speeds is None:
            return "no command"
        if back_ns:
            return _went_back(back_ns)
        if stamp_ns - now_ns > MAX_FUTURE_MS * 1_000_000:
            return f"the command is {(stamp_ns - now_ns) / 1e6:g} ms from the future"
        if now_ns - stamp_ns > MAX_AGE_MS * 1_000_000:
            return f"the command is {(now_ns - stamp_ns) / 1e6:g} ms old"
        if not (math.isfinite(speeds.left) and math.isfinite(speeds.right)):
            return f"wheel speeds {speeds.left}, {speeds.right} are not finite"
        if max(abs(speeds.left), abs(speeds.right)) > fastest:
            return f"wheel speeds {speeds.left:g}, {speeds.right:g} m/s are beyond {fastest:g}"
        return ""

    def _read_board(self, now_ns: int) -> None:
        """Read the board's messages, and detect that the board has ended a drive by itself."""
        self._clock.now_ns = now_ns
        self._session.listen(now_ns)
        board, drive = self._session.board, self._drive
        if board is None or board.state not in (BoardState.ARMED, BoardState.DRIVE):
            drive.releasing = False
        if self._reset is not None and (self._reset.is_over(now_ns) or (board is not None and board.faults == 0)):
            self._reset = None
        if board is not None and board.state == BoardState.DRIVE:
            drive.lasts = drive.lasts or not drive.releasing
        elif drive.lasts:
            drive.lasts = False
            drive.ended = self._drive_problem(now_ns) or next(iter(fault_advice(self._faults)), self._end_reason())
        if board is not None and board.state == BoardState.GUARD:
            drive.guards = self._order.caps is not None
        elif drive.guards:
            drive.guards = False
            drive.ended = self._drive_problem(now_ns) or next(iter(fault_advice(self._faults)), GUARD_RESET)

    def _drive_problem(self, now_ns: int) -> str:
        """Return why this bridge cannot drive, apart from the board's faults; empty if it can."""
        return self._session.problem(now_ns) or self._failure

    def _end_reason(self) -> str:
        """Return why a board without faults ended a drive."""
        return TAKEN_OVER if self._session.echoes else "the board was reset during the drive: ask for the goal again"

    def _send_order(self, now_ns: int) -> SentCommand:
        """Send one command to the board, by the last order and the board's state."""
        elapsed_ns = PERIOD_MS * 1_000_000 if self._sent_ns is None else now_ns - self._sent_ns
        self._sent_ns = now_ns
        reason = self._release_reason(now_ns)
        reply, drive = self._session.reply, self._drive
        if reason or reply is None:
            drive.ended = reason if drive.lasts else drive.ended
            drive.releasing = drive.releasing or self.armed
            drive.lasts, self._volts = False, None
            if reply is not None:
                reason = self._send_released(now_ns, reason)
            self._sent = self._released(now_ns, reason)
        else:
            self._sent = self._send_driving(reply, now_ns, elapsed_ns)
        return self._sent

    def _send_released(self, now_ns: int, reason: str) -> str:
        """Send caps, or a command that releases the lines; return why the computer does not drive."""
        caps, age_ns = self._order.caps, abs(now_ns - self._order.stamp_ns)
        if caps is None or self._drive.ended or self._faults:
            self._session.command(0, 0, self._reset_flags(), now_ns)
            return reason if caps is None else self._drive.ended or fault_advice(self._faults)[0]
        if age_ns > CAPS_DEAD_MS * 1_000_000:
            return f"the caps of the joystick are {age_ns / 1e6:g} ms old"
        self._session.limit(caps.narrowed(STALE_CAP) if age_ns > LATE_MS * 1_000_000 else caps, now_ns)
        return reason

    def _release_reason(self, now_ns: int) -> str:
        """Return why the lines are released now; empty if the order may be executed."""
        order, problem = self._order, self._drive_problem(now_ns)
        if order.counts is None:
            return order.reason
        if problem:
            return problem
        if self._faults:
            return "the board is being reset" if self._resetting else fault_advice(self._faults)[0]
        if now_ns - order.stamp_ns > MAX_AGE_MS * 1_000_000:
            return f"the command is {(now_ns - order.stamp_ns) / 1e6:g} ms old"
        return self._drive.ended or ("the board is releasing the lines" if self._drive.releasing else "")

    def _send_driving(self, reply: HelloReply, now_ns: int, elapsed_ns: int) -> SentCommand:
        """Send the order to the board, enabled and within the slew limit; if the cable is full, the last one stays."""
        order, why = self._order, self._order.reason
        late_ns = now_ns - order.given_ns
        if late_ns > LATE_MS * 1_000_000:
            order, why = replace(order, counts=self._lines.rest), _was_late(late_ns)
        closed = self._gate(now_ns)
        if closed:
            order, why = replace(order, counts=self._lines.rest), closed
        if not self.armed:
            order, why = replace(order, counts=self._lines.rest), self._arming()
        neutral = reply.reference_mv / 1000.0
        wanted = self._lines.volts(order.counts or self._lines.rest, neutral)
        limit = SLEW * min(max(elapsed_ns * 1e-9, 0.0), 0.001 * LATE_MS)
        line_volts = _limited_step(self._volts or (neutral, neutral), wanted, limit)
        forward, turn = (setpoint_from_millivolts(reply, 1000.0 * volts) for volts in line_volts)
        if not self._session.command(forward, turn, CommandFlag.ENABLE, now_ns):
            why = "the cable to the board is full: the command was not taken"
            return replace(self._sent, stamp_ns=now_ns, active=self._sent.active and self.armed, reason=why)
        self._volts = line_volts
        lines = line_millivolts(reply, forward) / 1000.0, line_millivolts(reply, turn) / 1000.0
        counts = self._lines.count(lines[0]), self._lines.count(lines[1])
        speeds = self._lines.speeds(counts) if (forward, turn) != (0, 0) else WheelSpeeds()
        return SentCommand(now_ns, speeds, *counts, *lines, active=self.armed, reason=why)

    def _arming(self) -> str:
        """Return why the board is not armed yet."""
        telemetry = self._session.telemetry
        if telemetry is not None and max(abs(telemetry.joystick.forward), abs(telemetry.joystick.turn)) > AT_REST:
            return "the board waits until the joystick is at rest: let go of it"
        return "the board arms after two seconds at rest: wait for it"

    @property
    def _faults(self) -> int:
        board = self._session.board
        return 0 if board is None else board.faults

    @property
    def _resetting(self) -> bool:
        return self._reset is not None and (self._reset.by_rider or is_of_host(self._faults))

    def _reset_flags(self) -> CommandFlag:
        """Return the reset flags of a command that releases the lines."""
        if self._reset is None or not self._resetting:
            return CommandFlag(0)
        self._reset.rises = not self._reset.rises
        flags = CommandFlag.RESET if self._reset.rises else CommandFlag(0)
        return flags | CommandFlag.ESTOP_ACK if self._reset.by_rider else flags

    def _released(self, now_ns: int, reason: str) -> SentCommand:
        rest = self._lines.rest
        return SentCommand(now_ns, WheelSpeeds(), *rest, *self._lines.volts(rest), active=False, reason=reason)


def _limited_step(volts: tuple[float, float], wanted: tuple[float, float], limit: float) -> tuple[float, float]:
    """Return volts on the straight line to `wanted`, with neither axis changed by more than `limit` [V]."""
    forward, turn = wanted[0] - volts[0], wanted[1] - volts[1]
    fraction = min(1.0, limit / max(abs(forward), abs(turn), 1e-12))
    return volts[0] + fraction * forward, volts[1] + fraction * turn


def _went_back(by_ns: int) -> str:
    return f"the clock went back by {by_ns / 1e6:g} ms"


def _was_late(by_ns: int) -> str:
    return f"the control loop gave no command for {by_ns / 1e6:g} ms"
