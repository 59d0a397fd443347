"""Hours of simulated driving that accumulate: each call adds shifts and summarises all of them.

The environment variable `NIGHT_HOURS` sets the hours of a call (default 4). Each shift of an hour is written to
`out/nights/` at its end, with its commit; its building and seed follow from its number.
"""

from __future__ import annotations

import os
from dataclasses import asdict
from functools import partial
from itertools import count, islice
from pathlib import Path

import msgspec

from evaluation.runs.kept_runs import commit, figure_pool
from evaluation.scenes.working_shift import BUILDINGS, Shift, run_shift
from waychair.files import write_json
from waychair.trials.barn import upper_bound
from waychair.types import Json

HOURS = float(os.environ.get("NIGHT_HOURS", "4"))
SHIFT_S = 3600.0
NIGHTS = Path("out") / "nights"
SUCCESS = 0.95


class _Written(msgspec.Struct, frozen=True):
    """A shift as stored in its file."""

    commit: str
    shift: Shift


def nights(out: Path, hours: float = HOURS, folder: Path = NIGHTS, shift_s: float = SHIFT_S) -> Json:
    """All shifts so far: no contact caused by the chair, and 95 % of the drives reached their place."""
    missing = (number for number in count() if not (folder / f"{number}.json").exists())
    due = list(islice(missing, max(1, round(hours * 3600.0 / shift_s))))
    with figure_pool() as pool:
        for written in pool.map(partial(_add, folder, shift_s), due):
            print(f"  {written}", flush=True)
    return _summary([msgspec.json.decode(path.read_bytes(), type=_Written) for path in sorted(folder.glob("*.json"))])


def _add(folder: Path, shift_s: float, number: int) -> str:
    shift = run_shift(BUILDINGS[number % len(BUILDINGS)], number, shift_s)
    write_json(folder / f"{number}.json", {"commit": commit(), "shift": asdict(shift)})
    return f"{number}: {shift.building}, {shift.reached} of {shift.drives}, {shift.at_fault} contacts by the chair"


def _summary(written: list[_Written]) -> Json:
    shifts = [each.shift for each in written]
    drives, reached = sum(shift.drives for shift in shifts), sum(shift.reached for shift in shifts)
    hours, at_fault = sum(shift.seconds for shift in shifts) / 3600.0, sum(shift.at_fault for shift in shifts)
    return {
        "passed": at_fault == 0 and reached >= SUCCESS * drives,
        "shifts": len(shifts),
        "hours": round(hours, 2),
        "km": round(sum(shift.way_m for shift in shifts) / 1e3, 2),
        "drives": drives,
        "reached": reached,
        "contacts_by_the_chair": at_fault,
        "contact_rate_bound_95": round(upper_bound(at_fault, drives), 4),
        "walked_into_the_chair": sum(shift.struck.get("bumped", 0) for shift in shifts),
        "nearest_person_m": round(min(shift.person_m for shift in shifts), 3),
        "tick_p99_ms_at_the_end": round(max(shift.tick_ms[1] for shift in shifts), 2),
        "grown_mb": round(max(shift.grown_mb for shift in shifts), 1),
        "commits": sorted({each.commit for each in written}),
        "failures": [f"{shift.building} {shift.seed}, {text}" for shift in shifts for text in shift.failures],
    }
