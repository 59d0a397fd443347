"""Fail-safe trials: computer or board is killed at random moments of a drive; the joystick must then be live.

Process, SIGKILL, pseudo-terminal and firmware are real; time and the hardware around the board are simulated, so that
a busy machine does not change the results.
"""

from __future__ import annotations

import os
import random
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from waychair.errors import BridgeError
from waychair.firmware_bridge.board import BoardInputs, Defect, HostBoard, LineState, at_rest
from waychair.firmware_bridge.protocol import BoardState, Family, Holder, encode, hello
from waychair.firmware_bridge.steady_computer import DRIVE_FROM_MS, PERIOD_MS, TICK, WRITTEN, command_at

BUDGET_MS = 100
"""Longest time from the death to a live joystick (F1, F29)."""

LONGEST_DRIVE_MS = 1000
"""Latest death after the start of the drive: on the ramp or at the full command."""

WATCHED_MS = 500
"""Time for which the lines are watched after the death: the command must not return."""


@dataclass(frozen=True, slots=True)
class KillTrial:
    """One trial: the side killed at `moment_ms` of simulated time, and the time until the joystick was live for good."""

    killed: str
    moment_ms: int
    commanded: tuple[int, int]
    released_ms: int | None

    @property
    def safe(self) -> bool:
        """Whether the joystick was live in time."""
        return self.released_ms is not None and self.released_ms <= BUDGET_MS


@dataclass(frozen=True, slots=True)
class KillReport:
    """All trials of a run."""

    trials: tuple[KillTrial, ...]

    @property
    def failures(self) -> tuple[KillTrial, ...]:
        """The trials in which the joystick was not live in time."""
        return tuple(trial for trial in self.trials if not trial.safe)

    @property
    def longest_ms(self) -> int:
        """The longest time to a live joystick among the trials that reached one."""
        return max((trial.released_ms for trial in self.trials if trial.released_ms is not None), default=0)

    @property
    def failure_bound(self) -> float:
        """Upper end of the one-sided 95 % interval of the failure rate (Clopper and Pearson 1934)."""
        from scipy.stats import beta

        count, failed = len(self.trials), len(self.failures)
        return 1.0 if failed == count else float(beta.ppf(0.95, failed + 1, count - failed))


def kill_host(program: Path, moments: int, seed: int = 0) -> KillReport:
    """Kill the computer's process at `moments` random moments of a drive, some of them in the middle of a frame.

    `program` is the board's, from `build_board`.

    Raises:
        BridgeError: the board did not drive before the death, so that the trial proves nothing.
    """
    chance = random.Random(seed)
    return KillReport(tuple(_kill_one_host(program, chance) for _ in range(moments)))


def kill_board(program: Path, moments: int, seed: int = 0) -> KillReport:
    """Freeze the board, cut its power or kill its program, in turn, at `moments` random moments of a drive.

    Raises:
        BridgeError: the board did not drive before the death, so that the trial proves nothing.
    """
    chance = random.Random(seed)
    ways = ("frozen", "brown-out", "killed")
    return KillReport(tuple(_kill_one_board(program, ways[i % 3], chance) for i in range(moments)))


def _random_moment(chance: random.Random) -> tuple[int, tuple[int, int]]:
    """Return a random moment of the drive [ms] and a random command."""
    moment = DRIVE_FROM_MS + PERIOD_MS + chance.randrange(LONGEST_DRIVE_MS)
    return moment, (chance.choice((-1, 1)) * chance.randint(500, 10_000), chance.randint(-10_000, 10_000))


def _kill_one_host(program: Path, chance: random.Random) -> KillTrial:
    moment, commanded = _random_moment(chance)
    with HostBoard(program) as board:
        words = [sys.executable, "-m", "waychair.firmware_bridge.steady_computer", board.path, *map(str, commanded)]
        computer = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0)
        assert computer.stdin is not None
        assert computer.stdout is not None
        try:
            for now_ms in ticks_until(moment):
                os.write(computer.stdin.fileno(), TICK.pack(now_ms, now_ms % PERIOD_MS != 0))
                board.transport.written = WRITTEN.unpack(os.read(computer.stdout.fileno(), WRITTEN.size))[0]
                lines = board.step(now_ms, at_rest())
        finally:
            computer.kill()
            computer.wait()
            computer.stdin.close()
            computer.stdout.close()
        _require_drive(lines)
        return KillTrial("host", moment, commanded, _released_ms(board, moment, at_rest(), lambda _now_ms: None))


def _kill_one_board(program: Path, way: str, chance: random.Random) -> KillTrial:
    moment, commanded = _random_moment(chance)
    with HostBoard(program) as board:
        board.transport.write(encode(hello(board.settings.chair_id, Family.HALL_5V), 0))

        def send(now_ms: int) -> None:
            if now_ms % PERIOD_MS == 0:
                board.transport.write(encode(command_at(now_ms, *commanded), now_ms // PERIOD_MS))

        for now_ms in ticks_until(moment):
            send(now_ms)
            lines = board.step(now_ms, at_rest())
        _require_drive(lines)
        inputs = at_rest()
        if way == "killed":
            board.kill()
        else:
            inputs = replace(inputs, defect=Defect.FROZEN if way == "frozen" else Defect.BROWN_OUT)
        return KillTrial(way, moment, commanded, _released_ms(board, moment, inputs, send))


def ticks_until(moment: int) -> list[int]:
    """Return one tick per command until one or two commands before the moment, then one per millisecond."""
    coarse = (moment // PERIOD_MS - 1) * PERIOD_MS
    return [*range(PERIOD_MS, coarse + 1, PERIOD_MS), *range(coarse + 1, moment + 1)]


def _released_ms(board: HostBoard, moment: int, inputs: BoardInputs, send: Callable[[int], None]) -> int | None:
    """Return the time [ms] after which the joystick was on the lines for good; None if it was not at the end."""
    released = None
    for after in range(1, WATCHED_MS + 1):
        send(moment + after)
        lines = board.step(moment + after, inputs)
        at_stick = (lines.forward_mv, lines.turn_mv) == (inputs.joystick_forward_mv, inputs.joystick_turn_mv)
        if lines.holder is not Holder.JOYSTICK or not at_stick:
            released = None
        elif released is None:
            released = after
    return released


def _require_drive(lines: LineState) -> None:
    if lines.state is not BoardState.DRIVE or lines.holder is not Holder.BOARD:
        raise BridgeError(
            f"the board did not drive before the death ({lines}): the trial proves nothing; see its faults"
        )
