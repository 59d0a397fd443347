"""Chairs that do not drive as their file says: slower through tight places, or refused by name, but never in contact.

The environment variable `WRONG_CHAIRS_STARTS` reduces the twenty starts of each scene and fault.
"""

from __future__ import annotations

import os
from dataclasses import replace
from functools import partial
from pathlib import Path

from evaluation.runs.kept_runs import over_seeds
from evaluation.scenes.tight_places import SceneResult, TightScene, corner_scene, door_scene, drive_variants, run_scene
from waychair.calibration.chair_body import CHAIR_A, CHAIR_B
from waychair.simulation.plant.plant import PlantSettings
from waychair.trials.barn import upper_bound
from waychair.trials.demo.demo import randomised_settings
from waychair.types import Json

STARTS = int(os.environ.get("WRONG_CHAIRS_STARTS", "20"))

SLOW_ANSWER_S, LAZY_TURN = 0.4, 0.5
"""[s] Delay of a chair that answers late, and share of its turning of one that turns lazily."""

FAULTS = ("none", "slow answer", "lazy turn")

_REAR_B = drive_variants(CHAIR_B)["rear"]
SCENES = {
    "door 0.9 m from 30 degrees": partial(door_scene, 0.9, 30.0, _REAR_B),
    "corner": partial(corner_scene, CHAIR_A),
}


def wrong_chairs(out: Path) -> Json:
    """No contact with a delay of 0.4 s or half the turning; the times are reported beside those of a sound chair."""
    rows = [_row(name, fault) for name in SCENES for fault in FAULTS]
    contacts, runs = sum(row["contacts"] for row in rows), STARTS * len(rows)
    return {
        "passed": contacts == 0,
        "runs": runs,
        "contacts": contacts,
        "contact_rate_bound_95": round(upper_bound(contacts, runs), 4),
        "rows": rows,
    }


def wrong_plant(fault: str, seed: int) -> PlantSettings:
    """Return the drive of a chair of this seed with one of `FAULTS`."""
    plant = randomised_settings(seed).plant
    if fault == "slow answer":
        return replace(plant, delay_s=SLOW_ANSWER_S)
    return replace(plant, turn_gain=LAZY_TURN * plant.turn_gain) if fault == "lazy turn" else plant


def run_wrong_chair(name: str, fault: str, seed: int) -> SceneResult:
    """Drive a chair with one of `FAULTS` through one of `SCENES`."""
    scene: TightScene = SCENES[name](seed)
    return run_scene(scene, seed, plant=wrong_plant(fault, seed))


def _row(name: str, fault: str) -> Json:
    found = over_seeds(f"wrong chair {name} {fault}", partial(run_wrong_chair, name, fault), STARTS)
    row = {
        "scene": name,
        "fault": fault,
        "reached": sum(each.reached for each in found),
        "contacts": sum(each.contacts for each in found),
        "median_s": sorted(round(each.seconds, 1) for each in found)[len(found) // 2],
        "least_clearance_m": round(min(each.min_clearance_m for each in found), 4),
        "failures": {each.seed: each.reason for each in found if not each.reached},
    }
    print(f"  {row}", flush=True)
    return row
