"""The last gate on the computer: a fresh, finite, allowed command goes to the board, anything else lets the lines go.

Fails silent: whatever is wrong, ENABLE is dropped, so that the rider's own joystick is live, and the caller is told
why. Nothing here raises on account of a command. The board (`firmware/`) checks everything again and trusts none of it.

Between two commands `beat` repeats the last one at 50 Hz, so that the board knows that the computer lives; but only
for as long as the command is fresh: a planner that hangs behind a living heartbeat is zero after `late_ms` and silent
after `max_age_ms`.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from dataclasses import dataclass, replace

from waychair.calibration.dac import (
    DacModel,
    counts_from_wheel_speeds,
    nearest,
    neutral_counts,
    volts_from_counts,
    wheel_speeds_from_counts,
)
from waychair.config import Settings, setting
from waychair.errors import CalibrationError, ConfigError
from waychair.firmware_bridge.advice import fault_advice, is_of_host
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
from waychair.types import Sent, Telemetry, WheelSpeeds

CREEP = 0.05
"""Speed [m/s] that a chair may at most have at the board's neutral, by its calibration (F21's own limit)."""

RESET_NS = 1_000_000_000
"""For so long a reset is asked for: the board takes one only when everything is in order."""

AT_REST = 0.1
"""Part of the swing within which a stick is at rest; a board may be set to less or more."""

TAKEN_OVER = "the rider took over by joystick"


@dataclass(frozen=True, slots=True)
class BridgeSettings(Settings):
    """What the bridge lets through."""

    family: int = setting(Family.EIGHT_PIN_3V3, "", "joystick family, see firmware/families.c", low=1, high=3)
    period_ms: int = setting(20, "ms", "between two heartbeats", low=5, high=40)
    late_ms: int = setting(100, "ms", "two control periods: without a command for longer, zero", low=20, high=500)
    max_age_ms: int = setting(150, "ms", "age beyond which a command is stale", low=10, high=1000)
    max_future_ms: int = setting(10, "ms", "a command later than now by more has a wrong clock", low=0, high=500)
    max_wheel_speed: float = setting(1.6, "m/s", "a wheel command beyond this is a fault", low=0.1, high=4.0)
    slew: float = setting(6.0, "V/s", "fastest change of a line; the board's own limit is 6 too", low=0.5, high=12.0)

    def __post_init__(self) -> None:
        Settings.__post_init__(self)
        if self.late_ms > self.max_age_ms:
            raise ConfigError(
                f"late_ms = {self.late_ms} ms must not exceed max_age_ms = {self.max_age_ms} ms: a command that is late "
                "is zero before it is stale"
            )


@dataclass(frozen=True, slots=True)
class _Order:
    """The last command as counts, None for one that must not be sent; `reason` why it is none, or why it is zero."""

    counts: tuple[int, int] | None
    reason: str
    stamp_ns: int
    given_ns: int


@dataclass(slots=True)
class _Reset:
    """A reset that is asked for, of all faults or the computer's; its second begins at the first time that is known."""

    by_rider: bool
    since_ns: int | None = None
    rises: bool = False  # in every other command, since the board takes its rising edge

    def is_over(self, now_ns: int) -> bool:
        """Whether its second is."""
        self.since_ns = now_ns if self.since_ns is None else self.since_ns
        return not 0 <= now_ns - self.since_ns < RESET_NS


class Bridge:
    """From wheel speeds to the board: `send` once a control tick, `beat` at least at 50 Hz. Safe to call from threads.

    Starts silent: the board is greeted, and armed by two seconds of zero before it takes its first command. Whatever
    ended a drive has to be answered by a `send(None)` before the next one, which a chair does by giving up its goal.
    """

    def __init__(
        self,
        cable: Reconnecting,
        calibration: DacModel,
        chair_id: str,
        settings: BridgeSettings | None = None,
        gate: Callable[[int], str] = lambda now_ns: "",
    ) -> None:
        """`gate` is asked at every command and heartbeat: why no speed may pass now, "" when it may.

        Raises:
            BridgeError: the chair's name is longer than 16 bytes.
        """
        self._gate = gate
        self._settings = settings or BridgeSettings()
        self._calibration = calibration
        self._session = BoardSession(cable, chair_id, self._settings.family, self._misfit)
        self._lock = threading.Lock()
        self._rest = neutral_counts(calibration)
        self._volts_low, high = volts_from_counts(calibration, 0, calibration.counts_max)
        self._volts_per_count = (high - self._volts_low) / calibration.counts_max
        self._order = _Order(None, "no command", 0, 0)
        self._now_ns = 0
        self._called_ns: int | None = None  # each caller's own clock readings: a tick that began before a beat is not
        self._beaten_ns: int | None = None  # a clock that goes back
        self._told_ns: int | None = None
        self._volts: tuple[float, float] | None = None  # what the lines were last told, None while they are let go
        self._letting_go = False  # until the board says that it has
        self._drives = False
        self._ended = ""
        self._failure = ""  # of the heartbeat, until the next beat
        self._reset: _Reset | None = None
        self._sent = self._released(0, SILENT)

    @property
    def telemetry(self) -> Telemetry | None:
        """What the board reported last; None when it is silent, refused or gone."""
        return self._session.telemetry

    @property
    def greeting(self) -> HelloReply | None:
        """What the board said of itself; None while it is silent, refused or gone."""
        return self._session.reply

    @property
    def armed(self) -> bool:
        """Whether the board acts on set-points: before, only zero is sent."""
        board = self._session.board
        return board is not None and board.state in (BoardState.ARMED, BoardState.DRIVE) and not self._letting_go

    @property
    def taken_over(self) -> bool:
        """Whether the rider's stick ended the drive at the board (F19), until `send(None)`."""
        return self._ended == TAKEN_OVER

    @property
    def trouble(self) -> tuple[str, ...]:
        """Why the board cannot drive at this moment, as sentences with a remedy; without faults that are being reset."""
        problem = self._problem(self._now_ns)
        if problem:
            return (problem,)
        return () if self._resetting else fault_advice(self._faults)

    def reset(self, *, by_rider: bool = False) -> None:
        """Ask the board to clear its faults, for a second or until it did, whether it can be told in that time or not.

        Only faults of the computer; `by_rider`, which is somebody's deliberate act, all of them, and that the emergency
        stop was released on purpose. A reset drives nothing.
        """
        with self._lock:
            self._reset = _Reset(by_rider or (self._reset is not None and self._reset.by_rider))

    def listen(self, now_ns: int) -> Telemetry | None:
        """Take in what the board said; its last report."""
        with self._lock:
            self._listen(max(now_ns, self._now_ns))
            return self.telemetry

    def send(self, speeds: WheelSpeeds | None, stamp_ns: int, now_ns: int) -> Sent:
        """Send wheel speeds [m/s] decided at `stamp_ns`, or let the lines go; what was really sent.

        None means that the computer does not want to drive. `stamp_ns` and `now_ns` are of one monotonic clock. While
        the board is not armed zero is sent, and `Sent` says so.
        """
        with self._lock:
            back_ns, self._called_ns = self._step_back(now_ns, self._called_ns), now_ns
            now_ns = max(now_ns, self._now_ns)
            self._order = self._order_from(speeds, stamp_ns, now_ns, back_ns)
            if speeds is None:
                self._letting_go = self._letting_go or self.armed
                self._drives, self._ended = False, ""
            self._listen(now_ns)
            return self._tell(now_ns)

    def beat(self, now_ns: int) -> Sent:
        """Take in what the board said and, when it is time, repeat the last command while it is fresh."""
        with self._lock:
            back_ns, self._beaten_ns = self._step_back(now_ns, self._beaten_ns), now_ns
            now_ns = max(now_ns, self._now_ns)
            if back_ns:
                self._order = replace(self._order, counts=None, reason=_went_back(back_ns))
            self._listen(now_ns)
            self._failure = ""
            period_ns = self._settings.period_ms * 1_000_000
            if back_ns or self._told_ns is None or now_ns - self._told_ns >= period_ns:
                return self._tell(now_ns)
            return self._sent

    def fail(self, reason: str) -> None:
        """Told why a heartbeat could not be: a drive is over, and the board is in trouble until one can."""
        with self._lock:
            self._failure = reason
            self._ended = self._ended or reason

    def _step_back(self, now_ns: int, before_ns: int | None) -> int:
        """By how much a caller's clock went back [ns]; then time is what it says now."""
        if before_ns is None or now_ns >= before_ns:
            return 0
        self._now_ns = now_ns
        return before_ns - now_ns

    def _order_from(self, speeds: WheelSpeeds | None, stamp_ns: int, now_ns: int, back_ns: int) -> _Order:
        """The command as counts, or why it must not be sent."""
        reason = self._refusal(speeds, stamp_ns, now_ns, back_ns)
        if speeds is None or reason:
            return _Order(None, reason, stamp_ns, now_ns)
        try:
            counts = counts_from_wheel_speeds(self._calibration, speeds)
        except CalibrationError as error:
            return _Order(None, str(error), stamp_ns, now_ns)
        if not all(isinstance(count, int) and 0 <= count <= self._calibration.counts_max for count in counts):
            return _Order(None, f"the calibration gave {counts}, which are no counts", stamp_ns, now_ns)
        late_ns = 0 if self._order.counts is None else now_ns - self._order.given_ns
        if late_ns > self._settings.late_ms * 1_000_000:  # F17: what this tick decided was decided in a hurry
            return _Order(self._rest, _was_late(late_ns), stamp_ns, now_ns)
        return _Order(counts, "", stamp_ns, now_ns)

    def _refusal(self, speeds: WheelSpeeds | None, stamp_ns: int, now_ns: int, back_ns: int) -> str:
        """Why this command must not be sent; empty when it may be."""
        s = self._settings
        if speeds is None:
            return "no command"
        if back_ns:
            return _went_back(back_ns)
        if stamp_ns - now_ns > s.max_future_ms * 1_000_000:
            return f"the command is {(stamp_ns - now_ns) / 1e6:g} ms from the future"
        if now_ns - stamp_ns > s.max_age_ms * 1_000_000:
            return f"the command is {(now_ns - stamp_ns) / 1e6:g} ms old"
        if not (math.isfinite(speeds.left) and math.isfinite(speeds.right)):
            return f"wheel speeds {speeds.left}, {speeds.right} are not finite"
        if max(abs(speeds.left), abs(speeds.right)) > s.max_wheel_speed:
            return f"wheel speeds {speeds.left:g}, {speeds.right:g} m/s are beyond {s.max_wheel_speed:g}"
        return ""

    def _listen(self, now_ns: int) -> None:
        """Take in what the board said, and notice when it has ended a drive by itself."""
        self._now_ns = now_ns
        self._session.listen(now_ns)
        board = self._session.board
        if board is None or board.state not in (BoardState.ARMED, BoardState.DRIVE):
            self._letting_go = False
        if self._reset is not None and (self._reset.is_over(now_ns) or (board is not None and board.faults == 0)):
            self._reset = None
        if board is not None and board.state == BoardState.DRIVE:
            self._drives = self._drives or not self._letting_go
        elif self._drives:
            self._drives = False
            self._ended = self._problem(now_ns) or next(iter(fault_advice(self._faults)), self._silence())

    def _problem(self, now_ns: int) -> str:
        """Why nothing may be driven through this bridge, whatever the board's faults; empty when it may."""
        return self._session.problem(now_ns) or self._failure

    def _silence(self) -> str:
        """Why a board is silent that was told to drive and reports no fault."""
        return TAKEN_OVER if self._session.echoes else "the board was reset during the drive: ask for the goal again"

    def _tell(self, now_ns: int) -> Sent:
        """One command to the board, by the last order and what the board said."""
        elapsed_ns = self._settings.period_ms * 1_000_000 if self._told_ns is None else now_ns - self._told_ns
        self._told_ns = now_ns
        reason = self._reason(now_ns)
        reply = self._session.reply
        if reason or reply is None:
            self._ended = reason if self._drives else self._ended
            self._letting_go = self._letting_go or self.armed
            self._drives, self._volts = False, None
            if reply is not None:
                self._session.command(0, 0, self._reset_flags(), now_ns)
            self._sent = self._released(now_ns, reason)
        else:
            self._sent = self._driven(reply, now_ns, elapsed_ns)
        return self._sent

    def _reason(self, now_ns: int) -> str:
        """Why the lines are let go now; empty when the order may be carried out."""
        order, problem = self._order, self._problem(now_ns)
        if order.counts is None:
            return order.reason
        if problem:
            return problem
        if self._faults:
            return "the board is being reset" if self._resetting else fault_advice(self._faults)[0]
        if now_ns - order.stamp_ns > self._settings.max_age_ms * 1_000_000:
            return f"the command is {(now_ns - order.stamp_ns) / 1e6:g} ms old"
        return self._ended or ("the board lets go of the lines" if self._letting_go else "")

    def _driven(self, reply: HelloReply, now_ns: int, elapsed_ns: int) -> Sent:
        """The order on its way to the board: enabled, no faster than the slew; a full cable leaves the last one."""
        order, why = self._order, self._order.reason
        late_ns = now_ns - order.given_ns
        if late_ns > self._settings.late_ms * 1_000_000:
            order, why = replace(order, counts=self._rest), _was_late(late_ns)
        closed = self._gate(now_ns)
        if closed:
            order, why = replace(order, counts=self._rest), closed
        if not self.armed:
            order, why = replace(order, counts=self._rest), self._arming()
        neutral = reply.reference_mv / 1000.0
        wanted = self._line_volts(order, neutral)
        limit = self._settings.slew * min(max(elapsed_ns * 1e-9, 0.0), 0.001 * self._settings.late_ms)
        line_volts = _towards(self._volts or (neutral, neutral), wanted, limit)
        forward, turn = (setpoint_from_millivolts(reply, 1000.0 * volts) for volts in line_volts)
        if not self._session.command(forward, turn, CommandFlag.ENABLE, now_ns):
            why = "the cable to the board is full: the command was not taken"
            return replace(self._sent, stamp_ns=now_ns, active=self._sent.active and self.armed, reason=why)
        self._volts = line_volts
        lines = line_millivolts(reply, forward) / 1000.0, line_millivolts(reply, turn) / 1000.0
        counts = self._counts(lines[0]), self._counts(lines[1])
        speeds = wheel_speeds_from_counts(self._calibration, *counts) if (forward, turn) != (0, 0) else WheelSpeeds()
        return Sent(now_ns, speeds, *counts, *lines, active=self.armed, reason=why)

    def _arming(self) -> str:
        """Why the board is not armed yet."""
        telemetry = self._session.telemetry
        if telemetry is not None and max(abs(telemetry.joystick.forward), abs(telemetry.joystick.turn)) > AT_REST:
            return "the board waits for the joystick to rest: let go of it"
        return "the board arms: two seconds at rest come first"

    def _line_volts(self, order: _Order, neutral: float) -> tuple[float, float]:
        """Volts of an order; an axis at rest is at the board's own neutral, which follows the reference line."""
        counts = order.counts or self._rest
        volts = volts_from_counts(self._calibration, *counts)
        forward, turn = (neutral if counts[axis] == self._rest[axis] else volts[axis] for axis in (0, 1))
        return forward, turn

    def _counts(self, volts: float) -> int:
        """The calibration's nearest count to line volts."""
        count = nearest((volts - self._volts_low) / self._volts_per_count)
        return min(max(count, 0), self._calibration.counts_max)

    @property
    def _faults(self) -> int:
        board = self._session.board
        return 0 if board is None else board.faults

    @property
    def _resetting(self) -> bool:
        return self._reset is not None and (self._reset.by_rider or is_of_host(self._faults))

    def _reset_flags(self) -> CommandFlag:
        """What a command that lets go says of a reset that is asked for."""
        if self._reset is None or not self._resetting:
            return CommandFlag(0)
        self._reset.rises = not self._reset.rises
        flags = CommandFlag.RESET if self._reset.rises else CommandFlag(0)
        return flags | CommandFlag.ESTOP_ACK if self._reset.by_rider else flags

    def _misfit(self, reply: HelloReply) -> str:
        """Why a board's neutral does not suit the calibration: by it the chair would drive off (F22)."""
        volts = reply.reference_mv / 1000.0
        counts = self._counts(volts)
        speeds = wheel_speeds_from_counts(self._calibration, counts, counts)
        reached = abs(volts - self._volts_low - counts * self._volts_per_count) <= self._volts_per_count
        if reached and max(abs(speeds.left), abs(speeds.right)) <= CREEP:
            return ""
        return (
            f"the board rests the lines at {reply.reference_mv / 1000.0:g} V, where this calibration expects motion: "
            "load the calibration of this chair and its joystick family"
        )

    def _released(self, now_ns: int, reason: str) -> Sent:
        volts = volts_from_counts(self._calibration, *self._rest)
        return Sent(now_ns, WheelSpeeds(), *self._rest, *volts, active=False, reason=reason)


def _towards(volts: tuple[float, float], wanted: tuple[float, float], limit: float) -> tuple[float, float]:
    """On the straight line to `wanted`, neither axis changed by more than `limit` [V]."""
    forward, turn = wanted[0] - volts[0], wanted[1] - volts[1]
    fraction = min(1.0, limit / max(abs(forward), abs(turn), 1e-12))
    return volts[0] + fraction * forward, volts[1] + fraction * turn


def _went_back(by_ns: int) -> str:
    return f"the clock went back by {by_ns / 1e6:g} ms"


def _was_late(by_ns: int) -> str:
    return f"the control loop gave no command for {by_ns / 1e6:g} ms"
