"""Journeys between random places on different storeys of the hospital, and rides whose storey is to be found out.

`JOURNEYS_RUNS` and `JOURNEYS_RIDES` take samples.
"""

from __future__ import annotations

import os
from functools import partial
from pathlib import Path

from evaluation.runs.kept_runs import over_seeds
from waychair.simulation.plan.world import HOSPITAL, load_levels
from waychair.trials.travel.journey_runs import seeded_journey, summary
from waychair.trials.travel.which_storey_study import alike_counts, counts, rides
from waychair.types import Json

RUNS = int(os.environ.get("JOURNEYS_RUNS", "100"))
RIDES = int(os.environ.get("JOURNEYS_RIDES", "1000"))
ARRIVE, RIGHT, OK_S = 0.97, 0.99, 2.0
ALIKE = ("2", "3")
"""The storeys of the hospital that look alike."""


def journeys(out: Path) -> Json:
    """At least 97 % arrive without help, nothing touched, no leaf near, no wrong map; the storey of 1,000 rides found out."""
    records = over_seeds("journeys", partial(seeded_journey, HOSPITAL), RUNS)
    found = summary(records, range(RUNS))
    for each in found["journeys"]:
        print(f"  {each['start']} to {each['goal']}: {each['why']}, {each['seconds']:.0f} s", flush=True)
    levels = load_levels(HOSPITAL)
    felt, unfelt = rides(levels, RIDES), rides(levels, RIDES, imu=False)
    by_itself, alike = counts(felt), alike_counts(unfelt, ALIKE)
    clean = not (found["contacts"] or found["near_a_moving_leaf"] or found["drives_on_a_wrong_map"])
    return {
        "passed": clean
        and found["arrived"] >= ARRIVE * RUNS
        and (found["open_door_to_ok_s"] or 0.0) <= OK_S
        and by_itself["right"] >= RIGHT * RIDES
        and by_itself["wrong"] == 0
        and counts(unfelt)["wrong"] == 0
        and alike["asked"] == alike["rides"],
        **found,
        "which_storey": {"imu and map": by_itself, "map": counts(unfelt), "map, storeys alike": alike},
    }
