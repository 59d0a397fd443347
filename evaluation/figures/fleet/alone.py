"""Two whole chairs in one run that cannot hear each other, with people about, by seeds.

`FLEET_ALONE_RUNS=4` takes fewer than 100 runs, `FLEET_ALONE_FIRST=10` begins at another seed.
"""

from __future__ import annotations

import math
import os
from pathlib import Path

from evaluation.runs.kept_runs import figure_pool
from waychair.trials.fleet.fleet_alone import AloneRun, drive_alone
from waychair.types import Json

RUNS = 100
ALONE_S, TOGETHER_S = 10.0, 5.0
"""s within which a chair without a warden drives by its own eyes, and within which it follows one again."""


def fleet_alone(out: Path) -> Json:
    """No contact, everybody arrives, nobody backs out twice, alone within 10 s and together again within 5 s."""
    first = int(os.environ.get("FLEET_ALONE_FIRST", "0"))
    seeds = range(first, first + int(os.environ.get("FLEET_ALONE_RUNS", RUNS)))
    runs: dict[int, AloneRun] = {}
    with figure_pool() as pool:
        for seed, run in zip(seeds, pool.map(drive_alone, seeds), strict=True):
            runs[seed] = run
            print(seed, _row(run), flush=True)
    contacts = sum(run.run.contacts for run in runs.values())
    late = [seed for seed, run in runs.items() if not run.run.finished]
    twice = [seed for seed, run in runs.items() if max(run.backed_out) > 1]
    alone_s = max(run.alone_s for run in runs.values())
    together = [run.together_s for run in runs.values() if not math.isnan(run.together_s)]
    return {
        "passed": not contacts
        and not late
        and not twice
        and alone_s <= ALONE_S
        and max(together, default=0.0) <= TOGETHER_S,
        "runs": len(runs),
        "contacts": contacts,
        "not_arrived": late,
        "backed_out": sum(sum(run.backed_out) for run in runs.values()),
        "backed_out_twice": twice,
        "alone_s_max": round(alone_s, 2),
        "together_s_max": round(max(together), 2) if together else None,
        "nearest_chairs_m": round(min(run.run.nearest for run in runs.values()), 3),
        "nearest_person_m": round(min(chair.person_m for run in runs.values() for chair in run.run.chairs), 3),
        "rows": {str(seed): _row(run) for seed, run in runs.items()},
    }


def _row(run: AloneRun) -> Json:
    return {
        "arrived": run.run.finished,
        "contacts": run.run.contacts,
        "seconds": round(run.run.seconds, 1),
        "backed_out": list(run.backed_out),
        "alone_s": round(run.alone_s, 2),
        "together_s": None if math.isnan(run.together_s) else round(run.together_s, 2),
        "ends": [chair.ends for chair in run.run.chairs],
    }
