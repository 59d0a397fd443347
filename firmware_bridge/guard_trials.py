"""Trials of the guard: the computer is killed at random moments of a rider's guarded drive, with the stick held.

The caps must then be those of a lost guard within 100 ms; the line never has more than the stick, and two seconds after
the rider has let go the joystick is free. Process, SIGKILL, pseudo-terminal and firmware are real; time and the hardware
around the board are simulated, as in `fail_safe`.
"""

from __future__ import annotations

import os
import random
import subprocess
import sys
from dataclasses import dataclass, replace
from pathlib import Path

from waychair.errors import BridgeError
from waychair.firmware_bridge.board import BoardInputs, HostBoard, LineState, at_rest
from waychair.firmware_bridge.fail_safe import BUDGET_MS, ticks_until
from waychair.firmware_bridge.protocol import SETPOINT_MAX, BoardState, BoardTelemetry, Decoder, Holder
from waychair.firmware_bridge.steady_computer import DRIVE_FROM_MS, PERIOD_MS, TICK, WRITTEN

SWING_MV, LOST_CAP = 1200, 2500
"""mV, 1/10000 of the swing: of the 5 V Hall family, and the board's default for a lost guard."""

RISEN_MS = 520
"""Time until every cap is in force."""

REST_MS = 2000
FREE_WITHIN_MS = 10
"""Two seconds of rest, and the time within which the joystick must then be free."""

STEP_MV = 1
"""The converter's step at 12 bits, by which a line may differ from the voltage that is meant."""


@dataclass(frozen=True, slots=True)
class GuardTrial:
    """One trial: the caps and the stick [mV from neutral] at the death, and what followed it.

    `narrow_ms`: the time from the death until the caps were those of a lost guard for good. `free_ms`: the time from a stick
    at rest to a free joystick. `wider`: whether a line ever had more than the stick, another sign, or more than before.
    """

    caps: tuple[int, ...]
    stick_mv: tuple[int, int]
    moment_ms: int
    narrow_ms: int | None
    free_ms: int | None
    wider: bool

    @property
    def safe(self) -> bool:
        """Whether everything was as it should be."""
        narrow = self.narrow_ms is not None and self.narrow_ms <= BUDGET_MS
        return narrow and not self.wider and self.free_ms is not None and self.free_ms <= REST_MS + FREE_WITHIN_MS


@dataclass(frozen=True, slots=True)
class GuardReport:
    """All trials of a run."""

    trials: tuple[GuardTrial, ...]

    @property
    def failures(self) -> tuple[GuardTrial, ...]:
        """The trials that were not safe."""
        return tuple(trial for trial in self.trials if not trial.safe)

    @property
    def longest_ms(self) -> int:
        """The longest time to narrow caps."""
        return max((trial.narrow_ms for trial in self.trials if trial.narrow_ms is not None), default=0)

    @property
    def longest_rest_ms(self) -> int:
        """The longest time from a stick at rest to a free joystick."""
        return max((trial.free_ms for trial in self.trials if trial.free_ms is not None), default=0)


def kill_guard(program: Path, moments: int, seed: int = 0) -> GuardReport:
    """Kill the computer's process at `moments` random moments of a guarded drive, some of them in the middle of a frame.

    `program` is the board's, from `build_board`.

    Raises:
        BridgeError: the board did not guard before the death, so that the trial proves nothing.
    """
    chance = random.Random(seed)
    return GuardReport(tuple(_kill_one(program, chance) for _ in range(moments)))


class _Watched:
    """A board, the rider's stick and the last telemetry, from which lines and caps are checked in every millisecond."""

    def __init__(self, board: HostBoard) -> None:
        self.board = board
        self.inputs: BoardInputs = at_rest()
        self.caps: tuple[int, ...] = ()
        self.wider = False
        self._decoder = Decoder()

    def step(self, now_ms: int) -> LineState:
        """Run the board up to this time, and read its telemetry."""
        lines = self.board.step(now_ms, self.inputs)
        for received in self._decoder.feed(self.board.transport.read()):
            message = received.message
            if isinstance(message, BoardTelemetry):
                self.caps = message.front_cap, message.rear_cap, message.left_cap, message.right_cap
        return lines

    def check(self, lines: LineState) -> None:
        """Note a line that has more than its stick, or another sign."""
        neutral = self.inputs.reference_mv
        pairs = (lines.forward_mv, self.inputs.joystick_forward_mv), (lines.turn_mv, self.inputs.joystick_turn_mv)
        for line, stick in ((line - neutral, stick - neutral) for line, stick in pairs):
            self.wider = self.wider or abs(line) > abs(stick) + STEP_MV or line * stick < -abs(stick) * STEP_MV

    def push(self, forward_mv: int, turn_mv: int) -> None:
        """Hold the stick [mV from neutral]."""
        rest = at_rest()
        self.inputs = replace(
            rest,
            joystick_forward_mv=rest.joystick_forward_mv + forward_mv,
            joystick_turn_mv=rest.joystick_turn_mv + turn_mv,
        )


def _kill_one(program: Path, chance: random.Random) -> GuardTrial:
    caps = tuple(chance.choice((0, 1000, 2500, 6000, SETPOINT_MAX)) for _ in range(4))
    stick = chance.randint(-SWING_MV, SWING_MV), chance.randint(-SWING_MV, SWING_MV)
    moment = DRIVE_FROM_MS + RISEN_MS + PERIOD_MS + chance.randrange(1000)
    with HostBoard(program) as board:
        watched = _Watched(board)
        before = _drive_until(moment, watched, caps, stick)
        if before.state is not BoardState.GUARD or before.holder is not Holder.BOARD or watched.caps != caps:
            raise BridgeError(f"the board did not guard before the death ({before}): the trial proves nothing")
        narrow_ms, now_ms = _narrow_ms(watched, moment, before, caps)
        watched.push(0, 0)
        return GuardTrial(caps, stick, moment, narrow_ms, _free_ms(watched, now_ms), watched.wider)


def _drive_until(moment: int, watched: _Watched, caps: tuple[int, ...], stick: tuple[int, int]) -> LineState:
    """Run a computer as a process that gives these caps, with the stick held from its guard on, and kill it."""
    words = [sys.executable, "-m", "waychair.firmware_bridge.steady_computer", watched.board.path, *map(str, caps)]
    computer = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0)
    assert computer.stdin is not None
    assert computer.stdout is not None
    try:
        for now_ms in ticks_until(moment):
            os.write(computer.stdin.fileno(), TICK.pack(now_ms, now_ms % PERIOD_MS != 0))
            watched.board.transport.written = WRITTEN.unpack(os.read(computer.stdout.fileno(), WRITTEN.size))[0]
            if now_ms >= DRIVE_FROM_MS + RISEN_MS:
                watched.push(*stick)
            lines = watched.step(now_ms)
    finally:
        computer.kill()
        computer.wait()
        computer.stdin.close()
        computer.stdout.close()
    return lines


def _narrow_ms(watched: _Watched, moment: int, before: LineState, caps: tuple[int, ...]) -> tuple[int | None, int]:
    """Return the time [ms] after which the caps were narrow for good, None if they were not, and the time at the end."""
    wanted, narrow = tuple(min(cap, LOST_CAP) for cap in caps), None
    neutral = at_rest().reference_mv
    widest = [abs(before.forward_mv - neutral), abs(before.turn_mv - neutral)]
    for after in range(1, 501):
        lines = watched.step(moment + after)
        watched.check(lines)
        now = [abs(lines.forward_mv - neutral), abs(lines.turn_mv - neutral)]
        watched.wider = watched.wider or any(a > b + STEP_MV for a, b in zip(now, widest, strict=True))
        highest = [_highest(wanted[0], wanted[1]), _highest(wanted[2], wanted[3])]
        within = all(a <= b + STEP_MV for a, b in zip(now, highest, strict=True))
        if lines.state is not BoardState.FAULT or not within:
            narrow = None
        elif narrow is None:
            narrow = after
    return narrow if watched.caps == wanted else None, moment + 500


def _highest(one: int, other: int) -> int:
    """Return the larger deflection [mV] of two caps."""
    return max(one, other) * SWING_MV // SETPOINT_MAX


def _free_ms(watched: _Watched, since_ms: int) -> int | None:
    """Return the time [ms] from a stick at rest to a free joystick, None if it was not free in time."""
    for after in (*range(20, REST_MS - 20, 20), *range(REST_MS - 20, REST_MS + FREE_WITHIN_MS + 1)):
        lines = watched.step(since_ms + after)
        if lines.holder is Holder.JOYSTICK:
            watched.push(SWING_MV, -SWING_MV)
            lines = watched.step(since_ms + after + 1)
            full = (lines.forward_mv, lines.turn_mv) == (
                watched.inputs.joystick_forward_mv, watched.inputs.joystick_turn_mv,
            )  # fmt: skip
            return after if full and lines.state is BoardState.SILENT else None
    return None
