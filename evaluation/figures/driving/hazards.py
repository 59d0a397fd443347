"""Drop-offs, glass and people: no wheel over a drop-off, no person hit; unprotected cases are reported.

The environment variable `HAZARDS_RUNS` reduces the hundred runs of each scene, for a quick look. A run depends only on
its seed; the runs of a row are spread over the processors.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path

import numpy as np

from evaluation.runs.kept_runs import over_seeds
from evaluation.scenes.hazards import (
    DROP_OFFS,
    ContactCause,
    Hazard,
    HazardResult,
    Protection,
    glass,
    hazard_of_scene,
    movers,
    run_hazard,
    to_the_lift,
    to_the_restroom,
)
from evaluation.scenes.sudden_person import SuddenPerson, run_sudden_person
from evaluation.scenes.tight_places import (
    APPROACHES,
    TightScene,
    corner_scene,
    dead_end_scene,
    door_scene,
    drive_variants,
)
from evaluation.scenes.worst_ride import limits_row, worst_of
from waychair.calibration.chair_body import CHAIR_A, CHAIR_B
from waychair.control.speed.limiter import LimiterSettings
from waychair.trials.barn import upper_bound
from waychair.trials.ride import ride_row
from waychair.types import Json

RUNS = int(os.environ.get("HAZARDS_RUNS", "100"))
FEW_MOVERS, MANY_MOVERS, SUCCESS_OF_MANY = 3, 10, 0.97
PAPER_004_S = {0: 14.0, 3: 18.33, 10: 27.08}
"""Median times of harmonic planning on another robot, only for orientation."""

AHEAD_M = (0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.2, 1.5)
FAR_M, KEPT_M = 0.9, 0.3
"""The chair never comes nearer than `KEPT_M` to a person who appears at least `FAR_M` ahead."""

NEAR_M, FULL_BRAKING = 0.5, 0.8
"""For a person who appears nearer the chair brakes fully: on average at least this share of the emergency's 1.5 m/s^2,
or of the plant's limit if that is less."""


def edges(out: Path) -> Json:
    """A drop-off ahead, beside a turning chair, behind a reversing chair: seen by the camera, in a zone, or on the map.

    A contact is the footprint (which contains the wheels) over a drop-off. The rows without protection show that the
    scenes are dangerous; they have no bar.
    """
    guards = (Protection.CAMERA, Protection.ZONE, Protection.MAP, Protection.NOTHING)
    rows = [
        _row(f"edge {where}, {guard.value}", partial(scene, guard), guard is not Protection.NOTHING)
        for where, scene in DROP_OFFS.items()
        for guard in guards
    ]
    judged = [row for row in rows if row["judged"]]
    return _figures(rows, not sum(row["edge"] for row in judged))


def glass_door(out: Path) -> Json:
    """Glass across the straight path: no contact with sonars or a zone; the result with lidar alone is reported."""
    rows = [
        _row(f"glass, {guard.value}", partial(glass, guard), guard is not Protection.NOTHING)
        for guard in (Protection.SONAR, Protection.ZONE, Protection.NOTHING)
    ]
    return _figures(rows, not sum(row["glass"] + row["solid"] for row in rows if row["judged"]))


def paper_scenes(out: Path) -> Json:
    """Along the corridor to the lift, and through the basement to the restroom with a person suddenly in front."""
    rows = [_row("corridor to the lift", to_the_lift, True), _row("basement to the restroom", to_the_restroom, True)]
    return _figures(rows, all(row["reached"] == row["runs"] for row in rows) and not sum(map(_by_chair, rows)))


def among_movers(out: Path) -> Json:
    """None, three or ten drifting discs in a room of 3 by 3 m: all goals reached (97 % with ten), no disc hit."""
    rows = []
    for count, paper_s in PAPER_004_S.items():
        row = _row(f"{count} movers", partial(movers, count), True)
        rows.append({**row, "paper_004_s": paper_s})
    enough = all(
        row["success"] >= (1.0 if count <= FEW_MOVERS else SUCCESS_OF_MANY)
        for count, row in zip(PAPER_004_S, rows, strict=True)
    )
    return _figures(rows, enough and not sum(map(_by_chair, rows)))


def appears(out: Path) -> Json:
    """A person suddenly appears ahead of a chair at 0.8 m/s: least distance and contact speed."""
    rows = []
    for ahead_m in AHEAD_M:
        found = over_seeds(f"appears {ahead_m} m ahead", partial(run_sudden_person, ahead_m), RUNS)
        rows.append(_appearance_row(ahead_m, found))
        print(f"  {rows[-1]}", flush=True)
    far = [row for row in rows if row["ahead_m"] >= FAR_M]
    near = [row["least_part_of_braking"] for row in rows if row["ahead_m"] < NEAR_M]
    return {
        "passed": all(row["nearest_m"] >= KEPT_M for row in far)
        and all(part is None or part >= FULL_BRAKING for part in near),
        "runs_at_0.9_m_and_more": RUNS * len(far),
        "contacts_at_0.9_m_and_more": sum(row["contacts"] for row in far),
        "contact_rate_bound_95": round(upper_bound(sum(row["contacts"] for row in far), RUNS * len(far)), 4),
        "nearest_m": min(row["nearest_m"] for row in far),
        "rows": rows,
    }


def ride(out: Path) -> Json:
    """Accelerations and jerk of every scene in one table, with the limiter's limits; a tenth of the runs.

    Passed if every chair moved, was not uncomfortable by its r.m.s., and braked no harder than in an emergency. The
    jerk's limit in the table is no bar.
    """
    few = max(1, RUNS // 10)
    scenes: list[tuple[str, Callable[[int], Hazard]]] = [
        (f"edge {where}, {Protection.ZONE.value}", partial(scene, Protection.ZONE))
        for where, scene in DROP_OFFS.items()
    ]
    scenes += [
        (f"glass, {Protection.SONAR.value}", partial(glass, Protection.SONAR)),
        ("corridor to the lift", to_the_lift),
        ("basement to the restroom", to_the_restroom),
        *((f"{count} movers", partial(movers, count)) for count in PAPER_004_S),
    ]
    body = drive_variants(CHAIR_B)["rear"]
    scenes += [
        (f"door 0.9 m, {angle:.0f} degrees", partial(_tight, partial(door_scene, 0.9, angle, body)))
        for angle in APPROACHES
    ]
    scenes += [
        ("corner", partial(_tight, partial(corner_scene, CHAIR_A))),
        ("dead end", partial(_tight, partial(dead_end_scene, CHAIR_A))),
    ]
    limits = LimiterSettings()
    rows = [limits_row(limits)]
    for name, scene in scenes:
        found = over_seeds(name, partial(_run, scene), few)
        rows.append(ride_row(name, worst_of([result.ride for result in found])))
        print(f"  {rows[-1]}", flush=True)
    driven = rows[1:]
    return {
        "passed": all(
            row["moving_s"] > 0.0 and row["rms"] <= NOT_UNCOMFORTABLE and row["slowing_down"] <= limits.emergency
            for row in driven
        ),
        "runs_each": few,
        "scenes_over_the_jerk_limit": sum(row["jerk"] > limits.jerk for row in driven),
        **{
            f"worst_{key}": max(row[key] for row in driven)
            for key in ("rms", "speeding_up", "slowing_down", "sideways", "jerk")
        },
        "rows": rows,
    }


NOT_UNCOMFORTABLE = 0.315
"""Bar of a drive's r.m.s. acceleration [m/s^2] (ISO 2631-1, annex C)."""


def _tight(scene: Callable[[int], TightScene], seed: int) -> Hazard:
    return hazard_of_scene(scene(seed))


def _run(scene: Callable[[int], Hazard], seed: int) -> HazardResult:
    return run_hazard(scene(seed), seed)


def _by_chair(row: Json) -> int:
    """Return the number of contacts that the chair caused."""
    return int(row["edge"] + row["glass"] + row["person"] + row["solid"])


def _row(name: str, scene: Callable[[int], Hazard], judged: bool) -> Json:
    results = over_seeds(name, partial(_run, scene), RUNS)
    reached = sum(each.reached for each in results)
    struck = {kind.value: sum(each.count(kind) for each in results) for kind in ContactCause}
    at_fault = sum(
        bool(each.count(*(kind for kind in ContactCause if kind is not ContactCause.BUMPED))) for each in results
    )
    row = {
        "scene": name,
        "judged": judged,
        "runs": RUNS,
        "reached": reached,
        "success": reached / RUNS,
        "failure_rate_bound_95": round(upper_bound(RUNS - reached, RUNS), 4),
        **struck,
        "runs_with_contact_by_chair": at_fault,
        "contact_rate_bound_95": round(upper_bound(at_fault, RUNS), 4),
        "fastest_contact": round(max((speed for each in results for _, speed in each.contacts), default=0.0), 2),
        "least_edge_m": _least(each.drop_off_m for each in results),
        "least_person_m": _least(each.person_m for each in results),
        "median_s": round(float(np.median([each.seconds for each in results])), 1),
        "ride": ride_row(name, worst_of([each.ride for each in results])),
        "failures": {each.seed: each.reason for each in results if not each.reached},
    }
    print(
        f"  {name}: {reached} of {RUNS}, {at_fault} with a contact by the chair, {struck}, {row['median_s']} s",
        flush=True,
    )
    return row


def _figures(rows: list[Json], passed: bool) -> Json:
    judged = [row for row in rows if row["judged"]]
    runs, at_fault = RUNS * len(judged), sum(row["runs_with_contact_by_chair"] for row in judged)
    return {
        "passed": passed,
        "runs": runs,
        "reached": sum(row["reached"] for row in judged),
        "runs_with_contact_by_chair": at_fault,
        "contact_rate_bound_95": round(upper_bound(at_fault, runs), 4),
        "rows": rows,
    }


def _appearance_row(ahead_m: float, found: list[SuddenPerson]) -> Json:
    contacts = sum(each.contact_speed > 0.0 for each in found)
    slowed = [each for each in found if math.isfinite(each.braking)]
    reactions = [each.reaction_s for each in found if math.isfinite(each.reaction_s)]
    return {
        "ahead_m": ahead_m,
        "runs": len(found),
        "slowest_start": round(min(each.speed for each in found), 2),
        "contacts": contacts,
        "contact_rate_bound_95": round(upper_bound(contacts, len(found)), 4),
        "nearest_m": round(min(each.nearest_m for each in found), 3),
        "median_contact_speed": _median([each.contact_speed for each in found if each.contact_speed > 0.0]),
        "fastest_contact_speed": round(max(each.contact_speed for each in found), 2),
        "least_braking": round(min(each.braking for each in slowed), 2) if slowed else None,
        "least_part_of_braking": round(min(each.braking / each.can_brake for each in slowed), 2) if slowed else None,
        "median_reaction_s": _median(reactions),
        "longest_reaction_s": round(max(reactions), 2) if reactions else None,
    }


def _median(values: list[float]) -> float | None:
    return round(float(np.median(values)), 2) if values else None


def _least(values: Iterable[float]) -> float | None:
    """Return the least value, or None if it is infinite."""
    least = min(values)
    return round(least, 3) if math.isfinite(least) else None
