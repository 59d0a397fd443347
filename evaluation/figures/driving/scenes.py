"""Tight scenes from random starts: success >= 95 %, no contact, at most 2 cm off the axis in a door.

The environment variable `SCENES_STARTS` reduces the hundred starts per scene, for a quick look.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path

from evaluation.runs.kept_runs import over_seeds
from evaluation.scenes.tight_places import (
    APPROACHES,
    DOORS,
    PARKED_AT,
    SceneResult,
    TightScene,
    corner_scene,
    dead_end_scene,
    door_scene,
    drive_variants,
    map_of,
    parked_scene,
    run_scene,
)
from waychair.calibration.chair_body import CHAIR_A, CHAIR_B
from waychair.errors import NoPath
from waychair.planning.grid.costmap import costmap_from_grid
from waychair.planning.route.global_planner import plan
from waychair.trials.barn import upper_bound
from waychair.types import Json

STARTS = int(os.environ.get("SCENES_STARTS", "100"))
SUCCESS, DOOR_ERROR_M = 0.95, 0.02


def doors(out: Path) -> Json:
    """Body B, rear drive, through doors of 0.80, 0.815 and 0.90 m from 0, 30, 60 and 90 degrees."""
    body = drive_variants(CHAIR_B)["rear"]
    return _scored(
        "doors",
        [
            (f"{width} m from {angle:.0f} degrees", partial(door_scene, width, angle, body))
            for width in DOORS
            for angle in APPROACHES
        ],
    )


def door_drives(out: Path) -> Json:
    """Body B, mid and front drive, through the tightest door from straight ahead and from beside."""
    return _scored(
        "door_drives",
        [
            (f"{drive} drive from {angle:.0f} degrees", partial(door_scene, DOORS[0], angle, body))
            for drive, body in drive_variants(CHAIR_B).items()
            if drive != "rear"
            for angle in (0.0, 90.0)
        ],
    )


def corner(out: Path) -> Json:
    """Body A, all drives, round the corner of the 0.915 m corridor; body B is refused, as it does not fit."""
    figures = _scored(
        "corner", [(f"{drive} drive", partial(corner_scene, body)) for drive, body in drive_variants(CHAIR_A).items()]
    )
    refused = {drive: _refused(corner_scene(body, 0)) for drive, body in drive_variants(CHAIR_B).items()}
    return {**figures, "refused_b": refused, "passed": figures["passed"] and all(refused.values())}


def dead_end(out: Path) -> Json:
    """Bodies A and B, all drives, turn round in a dead end of 1.5 m."""
    return _scored(
        "dead_end",
        [
            (f"{name} {drive} drive", partial(dead_end_scene, body))
            for name, base in (("A", CHAIR_A), ("B", CHAIR_B))
            for drive, body in drive_variants(base).items()
        ],
    )


def parked(out: Path) -> Json:
    """Body B, all drives, leaves a parking place two to four centimetres from one wall, or from two in a corner."""
    return _scored(
        "parked",
        [
            (f"{place}, {drive} drive", partial(parked_scene, place, body))
            for place in PARKED_AT
            for drive, body in drive_variants(CHAIR_B).items()
        ],
    )


def _refused(scene: TightScene) -> str:
    """Return the planner's refusal; empty if there is a path."""
    try:
        plan(costmap_from_grid(map_of(scene.world), scene.body), scene.world.start, scene.goal.pose)
    except NoPath as error:
        return str(error)
    return ""


def _scored(kind: str, scenes: Iterable[tuple[str, Callable[[int], TightScene]]]) -> Json:
    rows = [_row(kind, name, scene) for name, scene in scenes]
    runs, contacts = sum(row["runs"] for row in rows), sum(row["contacts"] for row in rows)
    errors = [row["max_door_error_m"] for row in rows if row["max_door_error_m"] is not None]
    return {
        "passed": all(row["success"] >= SUCCESS for row in rows)
        and contacts == 0
        and max(errors, default=0.0) <= DOOR_ERROR_M,
        "runs": runs,
        "reached": sum(row["reached"] for row in rows),
        "contacts": contacts,
        "contact_rate_bound_95": round(upper_bound(contacts, runs), 4),
        "max_door_error_m": max(errors, default=None),
        "rows": rows,
    }


def _row(kind: str, name: str, scene: Callable[[int], TightScene]) -> Json:
    results = over_seeds(f"{kind} {name}", partial(_run, scene), STARTS)
    reached, contacts = sum(each.reached for each in results), sum(each.contacts for each in results)
    errors = [each.door_error_m for each in results if each.door_error_m is not None]
    row = {
        "scene": name,
        "runs": STARTS,
        "reached": reached,
        "success": reached / STARTS,
        "failure_rate_bound_95": round(upper_bound(STARTS - reached, STARTS), 4),
        "contacts": contacts,
        "contact_rate_bound_95": round(upper_bound(contacts, STARTS), 4),
        "max_door_error_m": round(max(errors), 4) if errors else None,
        "min_clearance_m": round(min(each.min_clearance_m for each in results), 4),
        "seconds": sorted(round(each.seconds, 1) for each in results)[STARTS // 2],
        "failures": {each.seed: each.reason for each in results if not each.reached},
    }
    print(f"  {name}: {reached} of {STARTS}, {contacts} contacts, {row['max_door_error_m']} m", flush=True)
    return row


def _run(scene: Callable[[int], TightScene], seed: int) -> SceneResult:
    return run_scene(scene(seed), seed)
