"""A driver without sight pushes forward without a pause, at the level guard, and nobody advises: no fall, no hard contact.

The whole simulated chair with the board's C. `BLIND_HAZARDS_RUNS=4` takes so many runs of each hazard instead of 100;
`BLIND_HAZARDS_ONLY="glass door"` takes one hazard, `BLIND_HAZARDS_FIRST=200` begins at another seed.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterable
from functools import partial
from pathlib import Path

from evaluation.runs.kept_runs import over_seeds
from evaluation.scenes.pushed_hazards import PUSHED, PushedRun, run_pushed
from waychair.trials.barn import upper_bound
from waychair.types import Json

RUNS = int(os.environ.get("BLIND_HAZARDS_RUNS", "100"))
ONLY = os.environ.get("BLIND_HAZARDS_ONLY", "")
FIRST = int(os.environ.get("BLIND_HAZARDS_FIRST", "0"))

SOFT = 0.1
"""m/s; a contact at this speed or slower does no harm."""


def blind_hazards(out: Path) -> Json:
    """Falls and contacts of each hazard, with the bound of 95 % of their rate."""
    rows = [_row(name) for name in PUSHED if not ONLY or name == ONLY]
    return {"passed": all(row["passed"] for row in rows), "rows": rows}


def _run(name: str, seed: int) -> PushedRun:
    return run_pushed(name, FIRST + seed)


def _least(metres: Iterable[float]) -> float | None:
    """Return the least distance [m]; None where there is nothing to come near to."""
    least = min(metres)
    return round(least, 3) if math.isfinite(least) else None


def _row(name: str) -> Json:
    found = over_seeds(f"blind hazard {name} from {FIRST}", partial(_run, name), RUNS)
    speeds = [speed for each in found for speed in each.contact_speeds]
    hard, falls = sum(speed > SOFT for speed in speeds), sum(each.falls for each in found)
    row: Json = {
        "hazard": name,
        "runs": len(found),
        "falls": falls,
        "contacts": len(speeds),
        "hard_contacts": hard,
        "fastest_contact": round(max(speeds, default=0.0), 3),
        "harm_rate_bound_95": round(upper_bound(hard + falls, len(found)), 4),
        "people_who_walked_into_the_chair": sum(each.bumped for each in found),
        "overrides": sum(each.overridden for each in found),
        "least_to_a_drop_off": _least(each.drop_off_m for each in found),
        "least_to_a_person": _least(each.person_m for each in found),
        "least_driven_m": round(min(each.distance_m for each in found), 2),
        "not_guarded": {FIRST + seed: each.reason for seed, each in enumerate(found) if each.reason},
        "passed": not (falls or hard or any(each.reason for each in found)),
    }
    print(f"  {row}", flush=True)
    return row
