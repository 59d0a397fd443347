"""Twenty seeds of the demo's drive: every goal reached, no contact. The map is made once, it has no seed."""

from __future__ import annotations

from pathlib import Path

from waychair.trials.demo import real_log, run_demo
from waychair.trials.demo_report import report
from waychair.types import Json

SEEDS = 20


def run(out: Path) -> Json:
    """On the map of the real recording."""
    log = real_log()
    if log is None:
        raise SystemExit("set WAYCHAIR_DATA to the folder that holds lidar_intel")
    return _seeds(out, log)


def run_small(out: Path) -> Json:
    """In the small world that ships, recorded and mapped anew with every seed."""
    return _seeds(out, None)


def _seeds(out: Path, log: Path | None) -> Json:
    runs = []
    for seed in range(SEEDS):
        result = report(run_demo(out.with_suffix(""), seed, log))
        runs.append(
            {key: result[key] for key in ("seed", "goals", "goals_reached", "contacts", "min_clearance_m", "legs")}
        )
        print(
            f"  seed {seed}: {result['goals_reached']} of {result['goals']}, {result['contacts']} contacts", flush=True
        )
    goals, reached = sum(run["goals"] for run in runs), sum(run["goals_reached"] for run in runs)
    contacts = sum(run["contacts"] for run in runs)
    legs = [leg for run in runs for leg in run["legs"]]
    return {
        "passed": reached == goals and contacts == 0,
        "seeds": SEEDS,
        "goals": goals,
        "goals_reached": reached,
        "contacts": contacts,
        # none in n drives: with 95 % confidence the rate is below 1 - 0.05^(1/n)
        "contact_rate_bound_95": round(1 - 0.05 ** (1 / goals), 4) if contacts == 0 else None,
        "min_clearance_m": min(run["min_clearance_m"] for run in runs),
        "max_error_m": max(leg["error_m"] for leg in legs),
        "max_error_deg": max(leg["error_deg"] for leg in legs),
        "runs": runs,
    }
