"""Different simulated drivers without sight at the door of 0.90 m: as they come, and after doors from which the chair learns.

What the chair has learnt of each is compared with the lag and the nudge that this driver truly has on the same chairs.

`BLIND_PEOPLE_RUNS=1` takes so many runs of each direction instead of 15; `BLIND_PEOPLE_DOORS=4` lets the chair learn from so many
doors in a row instead of 20, `BLIND_PEOPLE_ONLY=older` takes one driver.
"""

from __future__ import annotations

import math
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
from evaluation.scenes.true_riders import TrueRider, true_rider
from waychair.control.haptics.learning import RiderValues, rider_from_values
from waychair.types import Json

RUNS = int(os.environ.get("BLIND_PEOPLE_RUNS", "15"))
LEARNS_FROM = int(os.environ.get("BLIND_PEOPLE_DOORS", "20"))
ONLY = os.environ.get("BLIND_PEOPLE_ONLY", "")

LESSONS_FROM = 5000
"""Seeds of the doors from which the chair learns begin here: none of them is counted."""

MOST_SLOWER = 1.05
"""Of the median time: learning makes no driver slower by more."""

LAG_OFF, NUDGE_OFF = 0.08, math.radians(1.0)
"""s, rad; what was learnt is within so much of the truth."""


@dataclass(frozen=True, slots=True)
class Person:
    """A preset of a driver, what it has to reach, the motors that it feels; whether only after learning, or by static points."""

    driver: str
    bars: GuidedBars
    layout: str = "glove_3x3"
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
    Person("waist", GuidedBars(0.97), "belt_8"),
    Person("noisy_hand", GuidedBars(0.90), learns=True),
    Person("default", GuidedBars(0.90), points=True),
)


def blind_people(out: Path) -> Json:
    """Successes and contacts of each driver, before and after learning, and what was learnt."""
    rows = [row for person in PEOPLE if not ONLY or person.name == ONLY for row in _rows(person)]
    return {"passed": all(row.get("passed", True) for row in rows), "rows": rows}


def lessons(person: Person, doors: int, seed: int) -> GuidedRun:
    """Return the last of so many doors in a row, at each of which the chair knows the driver from those before."""
    run = _run(person, None, LESSONS_FROM + seed * doors)
    for door in range(1, doors):
        run = _run(person, run.remembered, LESSONS_FROM + seed * doors + door)
    return run


def _run(person: Person, known: RiderValues | None, seed: int) -> GuidedRun:
    words = static_points() if person.points else None
    return run_at_door(DOORS[0], "guide", seed, person.driver, known, person.layout, words)


def _truth(person: Person, seed: int) -> TrueRider:
    """Return what the driver does on the chair of one of the doors from which was learnt."""
    return true_rider(DOORS[0].body, person.driver, LESSONS_FROM + seed, person.layout)


def _rows(person: Person) -> list[Json]:
    name, count = person.name, RUNS * len(APPROACHES)
    fresh = over_seeds(f"blind person {name}", partial(_run, person, None), count)
    taught = over_seeds(f"blind lessons {name} {LEARNS_FROM}", partial(lessons, person, LEARNS_FROM), 1)[0]
    learnt = over_seeds(f"blind person {name} after {LEARNS_FROM}", partial(_run, person, taught.remembered), count)
    before = guided_row(name, "as they come", fresh, None if person.learns else person.bars)
    after = guided_row(name, f"after {LEARNS_FROM} doors", learnt, person.bars)
    after["learnt"] = learnt_figures(taught.remembered)
    slower = _slower(fresh, learnt)
    after["times_slower"] = slower
    after["passed"] = bool(after["passed"]) and (slower is None or slower <= MOST_SLOWER)
    if not person.points:
        truth = over_seeds(f"blind truth {name}", partial(_truth, person), LEARNS_FROM)
        rider = rider_from_values(taught.remembered)
        lag_off = rider.lag_s - statistics.median(lag for each in truth for lag in each.lags_s)
        nudge_off = rider.nudge - statistics.median(turn for each in truth for turn in each.nudges)
        after["lag_off_s"], after["nudge_off_deg"] = round(lag_off, 3), round(math.degrees(nudge_off), 2)
        print(
            f"  {name}: learnt lag {lag_off:+.3f} s, learnt nudge {math.degrees(nudge_off):+.2f} degrees off the truth",
            flush=True,
        )
        after["passed"] = after["passed"] and abs(lag_off) <= LAG_OFF and abs(nudge_off) <= NUDGE_OFF
    return [before, after]


def _slower(before: list[GuidedRun], after: list[GuidedRun]) -> float | None:
    """Return the median of the times after learning over before, of the runs that arrived both times."""
    both = [(a.seconds, b.seconds) for b, a in zip(before, after, strict=True) if a.reached and b.reached]
    if not both:
        return None
    return round(statistics.median(a for a, _ in both) / statistics.median(b for _, b in both), 3)
