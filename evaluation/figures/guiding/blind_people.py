"""Different simulated drivers without sight at the door of 0.90 m: as they come, and after doors from which the chair learns.

`BLIND_PEOPLE_RUNS=1` takes so many runs of each direction instead of 15; `BLIND_PEOPLE_DOORS=4` lets the chair learn from so many
doors in a row instead of 20, `BLIND_PEOPLE_ONLY=older` takes one driver.
"""

from __future__ import annotations

import os
import statistics
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from evaluation.figures.guiding.blind_doors import DOORS, run_at_door
from evaluation.runs.kept_runs import over_seeds
from evaluation.scenes.guided_drives import GuidedBars, GuidedRun, guided_row, learnt_figures
from evaluation.scenes.static_points import static_points
from evaluation.scenes.tight_places import APPROACHES
from waychair.control.haptics.rider import RiderModel
from waychair.types import Json

RUNS = int(os.environ.get("BLIND_PEOPLE_RUNS", "15"))
LEARNS_FROM = int(os.environ.get("BLIND_PEOPLE_DOORS", "20"))
ONLY = os.environ.get("BLIND_PEOPLE_ONLY", "")

LESSONS_FROM = 5000
"""Seeds of the doors from which the chair learns begin here: none of them is counted."""

MOST_SLOWER = 1.05
"""Of the median time: learning makes no driver slower by more."""


@dataclass(frozen=True, slots=True)
class Person:
    """A preset of a driver, what it has to reach, and whether only after learning, or by static points only."""

    driver: str
    bars: GuidedBars
    learns: bool = False
    points: bool = False

    @property
    def name(self) -> str:
        """The row's name."""
        return f"{self.driver}, static points" if self.points else self.driver


PEOPLE = (
    Person("default", GuidedBars(0.97)),
    Person("older", GuidedBars(0.97)),
    Person("second_task", GuidedBars(0.97)),
    Person("sure_85", GuidedBars(0.97)),
    Person("sure_70", GuidedBars(0.97)),
    Person("warnings_90", GuidedBars(0.97)),
    Person("fast_swivel", GuidedBars(0.97)),
    Person("noisy_hand", GuidedBars(0.90), learns=True),
    Person("default", GuidedBars(0.90), points=True),
)


def blind_people(out: Path) -> Json:
    """Successes and contacts of each driver, before and after learning, and what was learnt."""
    rows = [row for person in PEOPLE if not ONLY or person.name == ONLY for row in _rows(person)]
    return {"passed": all(row.get("passed", True) for row in rows), "rows": rows}


def lessons(person: Person, doors: int, seed: int) -> RiderModel:
    """Return what the chair knows of a driver after so many doors in a row."""
    known = RiderModel()
    for door in range(doors):
        known = _run(person, known, LESSONS_FROM + seed * doors + door).learnt
    return known


def _run(person: Person, known: RiderModel | None, seed: int) -> GuidedRun:
    return run_at_door(DOORS[0], "guide", seed, person.driver, known, words=static_points() if person.points else None)


def _rows(person: Person) -> list[Json]:
    name, count = person.name, RUNS * len(APPROACHES)
    fresh = over_seeds(f"blind person {name}", partial(_run, person, None), count)
    known = over_seeds(f"blind lessons {name} {LEARNS_FROM}", partial(lessons, person, LEARNS_FROM), 1)[0]
    learnt = over_seeds(f"blind person {name} after {LEARNS_FROM}", partial(_run, person, known), count)
    before = guided_row(name, "as they come", fresh, None if person.learns else person.bars)
    after = guided_row(name, f"after {LEARNS_FROM} doors", learnt, person.bars)
    after["learnt"] = learnt_figures(known)
    slower = _slower(fresh, learnt)
    after["times_slower"] = slower
    after["passed"] = bool(after["passed"]) and (slower is None or slower <= MOST_SLOWER)
    return [before, after]


def _slower(before: list[GuidedRun], after: list[GuidedRun]) -> float | None:
    """Return the median of the times after learning over before, of the runs that arrived both times."""
    both = [(a.seconds, b.seconds) for b, a in zip(before, after, strict=True) if a.reached and b.reached]
    if not both:
        return None
    return round(statistics.median(a for a, _ in both) / statistics.median(b for _, b in both), 3)
