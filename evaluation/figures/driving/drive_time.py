"""Time of drives beside the least time for each: 60 random drives in each of five buildings, nobody about.

The chair drives on maps of its own making; the last building is the map of a real log, raised to a world. The
environment variable `DRIVE_TIME_DRIVES` reduces the 300 drives, evenly over the buildings. Besides, three named drives
through the small clinic on its plan.

Each random drive is of a chair that is on: its clock begins once the board is armed, which takes two seconds with the
stick at rest. The clock of a named drive begins with its request, as in `waychair navigate`.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from functools import cache, partial
from pathlib import Path

import numpy as np

from evaluation.figures.mapping.logs import DATA
from evaluation.runs.kept_runs import over_seeds
from evaluation.runs.own_maps import MAPS, map_of_log, map_of_world
from evaluation.scenes.timed_drives import (
    MappedWorld,
    TimedDrive,
    drives,
    ground_of_map,
    ground_of_plan,
    ground_of_world,
    random_poses,
)
from waychair.trials.barn import upper_bound
from waychair.types import Json, Place

WORLDS = ("small_clinic", "apartment", "second_floor", "basement")
LOG = ("intel", "lidar_intel/intel_first1088s.clf.gz")
DRIVES = int(os.environ.get("DRIVE_TIME_DRIVES", "300"))
BUILDINGS = tuple(os.environ.get("DRIVE_TIME_BUILDINGS", ",".join((*WORLDS, LOG[0]))).split(","))
"""The buildings; fewer are only for a quick look."""

MEDIAN, P90, STOPS = 1.3, 1.6, 0.2
"""Bars: ratio of driven to best time in the median and in nine of ten drives, and faultless stops for each drive."""

NAMED = {"lift": 16.0, "bath": 40.0, "ward": 32.0}
"""[s] The named drives through the small clinic, one after the other from its start, and the bar of each."""


def drive_time(out: Path) -> Json:
    """Ratio of driven to best time <= 1.3 in the median and 1.6 in 90 %, <= 0.2 faultless stops, no contact, all reached."""
    each = max(1, DRIVES // len(BUILDINGS))
    found: list[TimedDrive] = []
    rows = []
    for name in BUILDINGS:
        _folder(name)  # made before the processes begin
        of_building = over_seeds(f"drive time {name}", partial(_random_drive, name), each)
        rows.append({"building": name, **_summary(of_building)})
        print(f"  {rows[-1]}", flush=True)
        found += of_building
    (named,) = over_seeds("drive time named", _named_drives, 1)
    for one in named:
        print(
            f"  {one.ground} to {one.name}: {one.driven_s:.1f} s, best {one.best_s:.1f} s, {one.ratio:.2f}", flush=True
        )
    whole = _summary(found)
    passed = (
        whole["ratio_median"] <= MEDIAN
        and whole["ratio_p90"] <= P90
        and whole["stops"] <= STOPS
        and whole["contacts"] == 0
        and whole["reached"] == whole["drives"]
        and whole["without_best"] == 0
        and all(one.reached and one.driven_s <= NAMED[one.name] for one in named)
    )
    table = [_row(one) for one in (*found, *named)]
    return {"passed": passed, **whole, "buildings": rows, "table": table}


def _random_drive(building: str, seed: int) -> TimedDrive:
    ground = _ground(building)
    start, goal = random_poses(ground, seed)
    (found,) = drives(ground, start, [Place(f"goal {seed}", goal)], seed, armed=True)
    return found


def _named_drives(seed: int) -> list[TimedDrive]:
    ground = ground_of_plan("small_clinic")
    places = {place.name: place for place in ground.world.places}
    return drives(ground, ground.world.start, [places[name] for name in NAMED], seed)


@cache
def _ground(building: str) -> MappedWorld:
    if building in WORLDS:
        return ground_of_world(building, MAPS / building)
    return ground_of_map(building, MAPS / building)


def _folder(building: str) -> Path:
    return map_of_world(building) if building in WORLDS else map_of_log(building, DATA / LOG[1])


def _summary(found: Sequence[TimedDrive]) -> Json:
    """Return the figures of several drives; ratios are those of drives that reached their goal."""
    ratios = np.array([one.ratio for one in found if one.reached and not one.no_best] or [np.nan])
    contacts = sum(one.contacts for one in found)
    beyond = [one.manners.turned - one.best_turned for one in found if not one.no_best]
    return {
        "drives": len(found),
        "reached": sum(one.reached for one in found),
        "contacts": contacts,
        "contact_rate_bound_95": round(upper_bound(contacts, len(found)), 4),
        "ratio_median": round(float(np.median(ratios)), 3),
        "ratio_p90": round(float(np.quantile(ratios, 0.9)), 3),
        "driven_s": round(sum(one.driven_s for one in found), 1),
        "best_s": round(float(np.nansum([one.best_s for one in found])), 1),
        "way_m": round(sum(one.way_m for one in found), 1),
        "best_way_m": round(float(np.nansum([one.best_way_m for one in found])), 1),
        "stops": round(float(np.mean([one.manners.stops for one in found])), 3),
        "swings": round(float(np.mean([one.manners.swings for one in found])), 3),
        "turned_beyond_best_rad": round(float(np.mean(beyond)), 3) if beyond else None,
        "slow_share": round(
            float(np.average([one.manners.slow_share for one in found], weights=[one.driven_s for one in found])), 3
        ),
        "largest_jerk": round(max(one.manners.jerk for one in found), 2),
        "without_best": sum(bool(one.no_best) for one in found),
    }


def _row(one: TimedDrive) -> Json:
    return {
        "building": one.ground,
        "goal": one.name,
        "reached": one.reached,
        "reason": one.reason if not one.reached else "",
        "contacts": one.contacts,
        "driven_s": round(one.driven_s, 2),
        "best_s": None if one.no_best else round(one.best_s, 2),
        "ratio": None if one.no_best else round(one.ratio, 3),
        "way_m": round(one.way_m, 2),
        "best_way_m": None if one.no_best else round(one.best_way_m, 2),
        "stops": one.manners.stops,
        "swings": one.manners.swings,
        "turned": round(one.manners.turned, 2),
        "best_turned": None if one.no_best else round(one.best_turned, 2),
        "slow_share": round(one.manners.slow_share, 3),
        "jerk": round(one.manners.jerk, 2),
        "no_best": one.no_best,
    }
