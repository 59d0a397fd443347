"""The rider's habits: decisions at places and drives, recorded on the chair only, and only after the rider's yes.

Places are kept by their names and times by day and hour; no coordinate is ever written. See `consented_rows` for the file.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import timedelta
from pathlib import Path
from typing import ClassVar

from waychair.control.guidance.practice import BEFORE, DecisionMade, Practice, RiderDecision, practised
from waychair.errors import HabitsError
from waychair.planning.movements import MovementKind
from waychair.runtime.rider.consented_rows import ConsentedRows, data_folder

FAVOURITE_DAYS = 60
"""Days over which visits count for favourites."""


@dataclass(frozen=True, slots=True)
class DecisionRow:
    """A decision: its day, its place by name, the movement proposed, what was done, the rest before it [s], and prompts."""

    day: str
    place: str
    proposed: str
    done: str
    hesitation_s: float
    prompts: int


@dataclass(frozen=True, slots=True)
class DriveRow:
    """A drive: its day and hour, its goal by name, and whether it was reached.

    `seconds` it took and `expected_s` by the graph; `stops` on the way; `reversals` of the stick; `interventions` of the
    monitor; `prompts` and `replans` of guidance.
    """

    day: str
    hour: int
    goal: str
    arrived: bool
    seconds: float
    expected_s: float
    stops: int
    reversals: int
    interventions: int
    prompts: int
    replans: int


Row = DecisionRow | DriveRow


def default_path() -> Path:
    """Return the file of this chair's rider."""
    return data_folder() / "habits.jsonl"


class Habits(ConsentedRows[Row]):
    """The record of one rider's habits."""

    NAME: ClassVar[str] = "habits"
    KINDS: ClassVar[Mapping[str, type[DecisionRow | DriveRow]]] = {"decision": DecisionRow, "drive": DriveRow}
    FAILURE: ClassVar[type[HabitsError]] = HabitsError

    def note_decision(self, made: DecisionMade) -> None:
        """Record a decision of guidance."""
        day = f"{self._now():%Y-%m-%d}"
        row = DecisionRow(day, made.place, made.proposed, made.decision, round(made.hesitation_s, 1), made.prompts)
        self._note(row)

    def note_drive(
        self, goal: str, *, arrived: bool, seconds: float, expected_s: float, counts: Mapping[str, int]
    ) -> None:
        """Record a drive that has ended; `counts` are its stops, reversals, interventions, prompts and replans."""
        now = self._now()
        known = {name: int(counts.get(name, 0)) for name in _COUNTS}
        row = DriveRow(f"{now:%Y-%m-%d}", now.hour, goal, arrived, round(seconds, 1), round(expected_s, 1), **known)
        self._note(row)

    def practice(self, level: int = BEFORE) -> dict[str, Practice]:
        """Return the practice at each place, of all its decisions; `level` is that of the first one."""
        found: dict[str, Practice] = {}
        for row in self._rows:
            if isinstance(row, DecisionRow):
                made = DecisionMade(
                    row.place, MovementKind(row.proposed), RiderDecision(row.done), row.hesitation_s, row.prompts
                )
                found[row.place] = practised(found.get(row.place, Practice(min(level, BEFORE))), made)
        return found

    def visits(self) -> Counter[str]:
        """Return how often each goal was reached in the last `FAVOURITE_DAYS`."""
        since = f"{self._now() - timedelta(days=FAVOURITE_DAYS):%Y-%m-%d}"
        return Counter(row.goal for row in self._rows if isinstance(row, DriveRow) and row.arrived and row.day >= since)

    def _check(self, values: Mapping[str, object]) -> None:
        if "proposed" in values:
            MovementKind(str(values["proposed"])), RiderDecision(str(values["done"]))


_COUNTS = ("stops", "reversals", "interventions", "prompts", "replans")
