"""Hours of errands of ten simulated drivers without sight, from place to place of a clinic with people.

Errands come in shifts of `SHIFT_S` simulated seconds, each with another driver and seed. `BLIND_ERRANDS_HOURS=0.2` takes so many
hours instead of 10; shifts that are done are not driven again, so that more hours go on from there. One drive more is listened to:
its sound track is written beside the report.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
from scipy.stats import chi2

from evaluation.runs.kept_runs import over_seeds
from evaluation.scenes.guided_drives import GuidedRun, guided_row, guided_runs
from evaluation.scenes.heard_drive import heard_drive
from waychair.calibration.chair_body import CHAIR_A
from waychair.simulation.plan.world import load_world
from waychair.trials.guiding.guided import GuidedSetup
from waychair.trials.navigate import world_with_people
from waychair.types import Json

HOURS = float(os.environ.get("BLIND_ERRANDS_HOURS", "10"))

SHIFT_S, ERRAND_S = 600.0, 240.0
"""s of a shift, in which no errand begins any more, and of an errand."""

PEOPLE, MOST_ERRANDS = 4, 40
HANDS = ("default", "older", "second_task", "noisy_hand", "sure_85", "sure_70", "warnings_90", "fast_swivel")

TYPES = (*((driver, "glove_3x3") for driver in HANDS), ("waist", "belt_8"), ("default", "bracelets"))
"""Drivers of the shifts in turn, and the motors that they feel."""


def blind_errands(out: Path) -> Json:
    """Contacts caused, near misses and ways wrongly told to be free in so many hours, with their bounds, and the errands that arrived."""
    shifts = max(1, round(HOURS * 3600.0 / SHIFT_S))
    found = over_seeds("blind errands", run_shift, shifts)
    errands = [errand for shift in found for errand in shift]
    row = guided_row("errands", "guide", errands)
    heard = heard_drive(out.with_suffix(".wav"))
    hours = sum(errand.seconds for errand in errands) / 3600.0
    return {
        "passed": not row["contacts"] and heard["passed"],
        "hours": round(hours, 2),
        "errands": len(errands),
        "touched": row["touched"],
        "touched_bound_95": row["touched_bound_95"],
        **{f"{name}_an_hour": _rate(row[name], hours) for name in ("contacts", "near_misses", "wrongly_free")},
        "heard": heard,
        "rows": [row],
    }


def _rate(count: int, hours: float) -> Json:
    """Return how often something happened in an hour, and the upper bound of 95 % of it (Garwood's, of a Poisson rate)."""
    return {
        "count": count,
        "rate": round(count / hours, 3),
        "bound_95": round(chi2.ppf(0.95, 2 * count + 2) / 2 / hours, 3),
    }


def run_shift(seed: int) -> tuple[GuidedRun, ...]:
    """Send one driver from place to place for the time of a shift."""
    rng = np.random.default_rng(seed)
    plan = load_world("small_clinic")
    places = {place.name: place for place in plan.places}
    order = [str(rng.choice(list(places)))]
    while len(order) <= MOST_ERRANDS:
        order.append(str(rng.choice([name for name in places if name != order[-1]])))
    world = world_with_people(plan, places[order[0]].pose, PEOPLE, seed)
    driver, layout = TYPES[seed % len(TYPES)]
    setup = GuidedSetup(world, plan.grid, CHAIR_A, driver, layout=layout, seed=seed)
    return guided_runs(setup, [places[name] for name in order[1:]], ERRAND_S, SHIFT_S)
