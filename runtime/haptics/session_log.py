"""The record of guided drives for a mobility trainer: off until the rider's yes, exported as a table, erased at a press.

Places are kept by their names and times by day and hour; no coordinate is ever written. See `consented_rows` for the file.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

from waychair.control.haptics.symbols import Symbol
from waychair.errors import SessionLogError
from waychair.runtime.haptics.haptic_state import HapticInputs, HapticState
from waychair.runtime.rider.consented_rows import ConsentedRows, data_folder

LONGEST_TICK_S = 0.5
"""s; a longer gap between two ticks is not counted as time driven."""


@dataclass(frozen=True, slots=True)
class GuidedDriveRow:
    """A drive on which the rider was led: its day and hour, its goal by name, the level of help, and how it ended.

    `touches`: contacts, None where nothing counts them. `caps`: how often, and `capped_s` for how long, a cap held the stick
    back; `overrides` of caps. `symbols` said, `warnings` among them, `unfelt` ones, `repeats` at the rider's wish; `by_symbol`
    in words.
    """

    day: str
    hour: int
    goal: str
    level: str
    arrived: bool
    ended: str
    seconds: float
    distance_m: float
    touches: int | None
    caps: int
    capped_s: float
    overrides: int
    symbols: int
    warnings: int
    unfelt: int
    repeats: int
    by_symbol: str


class SessionLog(ConsentedRows[GuidedDriveRow]):
    """The record of one rider's guided drives."""

    NAME: ClassVar[str] = "guided drives"
    KINDS: ClassVar[Mapping[str, type[GuidedDriveRow]]] = {"drive": GuidedDriveRow}
    FAILURE: ClassVar[type[SessionLogError]] = SessionLogError

    def note_drive(self, counted: Counted, goal: str, *, arrived: bool, ended: str, touches: int | None) -> None:
        """Record a drive that has ended, if the rider has said yes."""
        now, told = self._now(), counted.told
        self._note(
            GuidedDriveRow(
                day=f"{now:%Y-%m-%d}",
                hour=now.hour,
                goal=goal,
                level=counted.level,
                arrived=arrived,
                ended=ended,
                seconds=round(counted.seconds, 1),
                distance_m=round(counted.distance_m, 1),
                touches=touches,
                caps=counted.caps,
                capped_s=round(counted.capped_s, 1),
                overrides=counted.overrides,
                symbols=told.total(),
                warnings=told[Symbol.WARNING.value],
                unfelt=counted.unfelt,
                repeats=counted.repeats,
                by_symbol=", ".join(f"{name} {count}" for name, count in sorted(told.items())),
            )
        )


def default_session_log() -> Path:
    """Return the file of this chair's rider."""
    return data_folder() / "guided_drives.jsonl"


@dataclass(slots=True)
class Counted:
    """Counts of the drive under way."""

    level: str = ""
    seconds: float = 0.0
    distance_m: float = 0.0
    caps: int = 0
    capped_s: float = 0.0
    overrides: int = 0
    unfelt: int = 0
    repeats: int = 0
    told: Counter[str] = field(default_factory=Counter)


class SessionCounter:
    """Counts each drive on which the rider is led, and records it at its end."""

    def __init__(self, log: SessionLog, touches: Callable[[], int | None] = lambda: None) -> None:
        """`touches` returns the contacts so far; None where nothing counts them."""
        self.log = log
        self.touches = touches
        self._counted = Counted()
        self._goal = ""
        self._touched: int | None = None
        self._last: tuple[HapticInputs, HapticState] | None = None

    def note(self, now: HapticInputs, state: HapticState, *, asked: bool) -> None:
        """Take in a tick; `asked`: the rider wanted to hear the step again."""
        before = self._last
        self._last = now, state
        if state.goal != self._goal:
            if self._goal and not state.goal:
                self._end(state)
            elif self._goal:
                self._record(arrived=False, ended="another place was chosen")
            self._goal, self._counted, self._touched = state.goal, Counted(level=now.level.value), self.touches()
        if state.goal and before is not None:
            self._count(before, now, state, asked)

    def _count(
        self, before: tuple[HapticInputs, HapticState], now: HapticInputs, state: HapticState, asked: bool
    ) -> None:
        counted, (heard, told) = self._counted, before
        seconds = min((now.now_ns - heard.now_ns) * 1e-9, LONGEST_TICK_S)
        counted.level = now.level.value
        counted.seconds += seconds
        counted.distance_m += abs(now.twist.v) * seconds
        was, guard = heard.guard, now.guard
        if guard is not None and guard.capped:
            counted.capped_s += seconds
            counted.caps += was is None or not was.capped
        counted.overrides += guard is not None and guard.overridden and (was is None or not was.overridden)
        counted.repeats += asked and state.count > told.count
        if state.count > told.count and state.symbol:
            counted.told[state.symbol] += 1
            counted.unfelt += bool(state.unfelt)

    def _end(self, state: HapticState) -> None:
        if state.count > 0 and state.symbol == Symbol.ARRIVED.value and state.arrived:
            self._counted.told.setdefault(state.symbol, 1)
        self._record(arrived=state.arrived, ended=state.reason)

    def _record(self, *, arrived: bool, ended: str) -> None:
        now = self.touches()
        touches = None if now is None or self._touched is None else now - self._touched
        self.log.look_again()  # the rider's yes may have come by another program, such as the page's node
        self.log.note_drive(self._counted, self._goal, arrived=arrived, ended=ended, touches=touches)
