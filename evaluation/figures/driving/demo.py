"""Twenty seeds of the demo: map errors, goal errors, and contacts, also with people who step in front."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from evaluation.runs.kept_runs import over_seeds
from waychair.trials.barn import upper_bound
from waychair.trials.demo.demo import run_demo
from waychair.trials.demo.demo_report import report
from waychair.types import Json

SEEDS = int(os.environ.get("DEMO_SEEDS", "20"))
"""Number of seeds; fewer are only for a quick look."""

ATE_M, ERROR_M, ERROR_DEG = 0.10, 0.15, 5.0


def run(out: Path) -> Json:
    """20 maps within 0.10 m, 60 of 60 goals within 0.15 m and 5 degrees, no contact."""
    runs = over_seeds("demo", _run, SEEDS)
    goals, reached = sum(run["goals"] for run in runs), sum(run["goals_reached"] for run in runs)
    contacts = sum(run["contacts"] for run in runs)
    legs = [leg for run in runs for leg in run["legs"]]
    near = [run["min_person_distance_m"] for run in runs if run["min_person_distance_m"] is not None]
    figures = {
        "seeds": SEEDS,
        "ate_m_max": max(run["ate_m"] for run in runs),
        "found": sum(run["found"]["found"] for run in runs),
        "goals": goals,
        "goals_reached": reached,
        "contacts": contacts,
        "contact_rate_bound_95": round(upper_bound(contacts, goals), 4),
        "min_clearance_m": min(run["min_clearance_m"] for run in runs),
        "min_person_distance_m": min(near, default=None),
        "max_error_m": max(leg["error_m"] for leg in legs),
        "max_error_deg": max(leg["error_deg"] for leg in legs),
    }
    passed = (
        figures["ate_m_max"] <= ATE_M
        and reached == goals
        and contacts == 0
        and figures["max_error_m"] <= ERROR_M
        and figures["max_error_deg"] <= ERROR_DEG
    )
    return {"passed": passed, **figures, "runs": runs}


def _run(seed: int) -> Json:
    with tempfile.TemporaryDirectory() as folder:
        return report(run_demo(Path(folder), seed))
