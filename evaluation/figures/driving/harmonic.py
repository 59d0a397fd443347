"""The harmonic planner: bands as in the paper's figure 5, fields on real maps, solver times, drives among movers.

The environment variable `HARMONIC_RUNS` reduces the hundred runs among movers, for a quick look.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from dataclasses import replace
from functools import cache, partial
from pathlib import Path

import numpy as np

from evaluation.figures.mapping.logs import DATA
from evaluation.runs.kept_runs import over_seeds
from evaluation.scenes.hazards import ContactCause, Hazard, HazardResult, movers, run_hazard
from evaluation.speed.harmonic import (
    DOOR_ENDS,
    DOORS,
    SCENES,
    FieldRun,
    door_row,
    field_row,
    field_run,
    floors,
    open_floor,
    rooms,
    row_of,
    solver_rows,
    speed_row,
)
from waychair.maps.folders.map_files import load_map
from waychair.maps.grid.cells import occupied
from waychair.planning.harmonic.laplace_gpu import gpu_at_hand
from waychair.planning.route.global_planner import PlannerSettings
from waychair.planning.seen.forecast import ForecastSettings
from waychair.types import BoolArray, Json

SHARPEST_DEG = 15.0
COLD_MS, UPDATE_MS = 500.0, 60.0
GOALS, DESCENTS = 5, 1000
RUNS = int(os.environ.get("HARMONIC_RUNS", "100"))
SUCCESS_OF_MANY = 0.97
PAPER: dict[int, Json] = {
    0: {"s": 14.0, "way_m": 2.21, "recreations": 0.0, "reached_percent": 100},
    3: {"s": 18.33, "way_m": 2.73, "recreations": 0.42, "reached_percent": 100},
    10: {"s": 27.08, "way_m": 3.85, "recreations": 2.36, "reached_percent": 87},
}
"""The source paper's section V, means of a hundred runs."""


def harmonic_bands(out: Path) -> Json:
    """Four scenes: after the band no turn above 15 degrees at every 0.10 m, no longer path, and the chair fits.

    The rooms are of our own design for a wheelchair, as the paper's drawings are lost and its lengths are for a small
    robot. Whole plans through doors are reported without a bar; before a narrow door the chair may turn on the spot.
    """
    rows = [row_of(scene) for scene in SCENES]
    doors = [door_row(door, name) for door in DOORS for name in DOOR_ENDS]
    return {
        "passed": all(
            row["band"]["sharpest_deg"] <= SHARPEST_DEG
            and row["band"]["length_m"] <= row["descent"]["length_m"]
            and row["band"]["rectangle_fits"]
            for row in rows
        ),
        "sharpest_before_deg": max(row["descent"]["sharpest_deg"] for row in rows),
        "sharpest_after_papers_band_deg": max(row["paper_band"]["sharpest_deg"] for row in rows),
        "sharpest_after_deg": max(row["band"]["sharpest_deg"] for row in rows),
        "doors_with_turns_above_15_deg": [
            f"{row['door_m']} m, {row['comes']}: {row['sharpest_deg']}"
            for row in doors
            if row["sharpest_deg"] > SHARPEST_DEG
        ],
        "rows": rows,
        "doors": doors,
    }


def harmonic_fields(out: Path) -> Json:
    """All Moving AI maps and two maps made by robots: every cell has a better neighbour.

    With five goals each: a better neighbour everywhere, and all of 1,000 descents and 100 streamlines arrive.
    """
    rows = []
    for name, free in _grounds().items():
        runs = over_seeds(f"field of {name}", partial(_field_on, name), GOALS)
        rows.append(field_row(name, free, runs))
        print(f"  {rows[-1]}", flush=True)
    return {
        "passed": all(
            row["cells_without_a_better_neighbour"] == 0
            and row["arrived"] == row["descents"]
            and row["streamlines_arrived"] == row["streamlines"]
            for row in rows
        ),
        "maps": len(rows),
        "descents": sum(row["descents"] for row in rows),
        "least_log_v": min(row["least_log_v"] for row in rows),
        "rows": rows,
    }


@cache
def _grounds() -> dict[str, BoolArray]:
    """Return the free cells (H, W) of the maps, by name."""
    robots = {}
    for path in sorted((DATA / "maps_real").glob("*.yaml")):
        with tempfile.TemporaryDirectory() as folder:  # their YAML files name another image file
            shutil.copy(path, Path(folder) / "map.yaml")
            shutil.copy(path.with_suffix(".pgm"), Path(folder) / "map.pgm")
            grid = load_map(Path(folder))
        robots[path.stem] = (grid.cells >= 0) & ~occupied(grid)
    return floors(DATA / "movingai") | robots


def _field_on(name: str, seed: int) -> FieldRun:
    return field_run(_grounds()[name], DESCENTS, seed)


def harmonic_speed(out: Path) -> Json:
    """1024 x 1024: time to 1e-8 and of an update on two cores; all solvers on 256 x 256.

    GPU figures are left out without a GPU.
    """
    rows = [speed_row("rooms", rooms(), (500, 300)), speed_row("open", open_floor(), (500, 300))]
    return {
        "passed": all(
            row["cold_ms"] <= COLD_MS and row["update_ms"] <= UPDATE_MS and row["residual"] <= 1.01e-8 for row in rows
        ),
        "gpu": "at hand, not measured here" if gpu_at_hand() else "none at hand",
        "worst_cold_ms": max(row["cold_ms"] for row in rows),
        "worst_update_ms": max(row["update_ms"] for row in rows),
        "rows": rows,
        "solvers_256": solver_rows(rooms(256, 4), (125, 75)),
    }


def harmonic_movers(out: Path) -> Json:
    """None, three or ten discs in a room of 3 by 3 m: harmonic planner and D* Lite, both with DWA, with the same seeds.

    The harmonic planner without prediction shows the value of the prediction. A path's re-creations are the plans after
    its first.
    """
    rows = []
    for count, paper in PAPER.items():
        for told in PLANNERS:
            found = over_seeds(f"{count} movers, {told}", partial(_run, told, count), RUNS)
            rows.append(_movers_row(count, told, paper, found))
            print(f"  {rows[-1]}", flush=True)
    harmonic = [row for row in rows if row["planner"] == "harmonic"]
    return {
        "passed": all(
            row["reached"] >= (SUCCESS_OF_MANY if row["movers"] > 3 else 1.0) * RUNS and not row["contacts_by_chair"]
            for row in harmonic
        ),
        "runs_each": RUNS,
        "rows": rows,
    }


PLANNERS = {
    "harmonic": PlannerSettings(planner="harmonic"),
    "harmonic, nobody foreseen": PlannerSettings(planner="harmonic", forecast=ForecastSettings(window=0.0)),
    "dstar-lite": PlannerSettings(),
}


def with_planner(hazard: Hazard, planner: PlannerSettings) -> Hazard:
    """Return the scene with another global planner."""
    navigator = replace(hazard.chair.navigator, planner=planner)
    return replace(hazard, chair=replace(hazard.chair, navigator=navigator))


def _run(told: str, count: int, seed: int) -> HazardResult:
    return run_hazard(with_planner(movers(count, seed), PLANNERS[told]), seed)


def _movers_row(count: int, planner: str, paper: Json, found: list[HazardResult]) -> Json:
    own = [kind for kind in ContactCause if kind is not ContactCause.BUMPED]
    return {
        "movers": count,
        "planner": planner,
        "runs": len(found),
        "reached": sum(each.reached for each in found),
        "contacts_by_chair": sum(bool(each.count(*own)) for each in found),
        "median_s": round(float(np.median([each.seconds for each in found])), 1),
        "recreations": round(float(np.mean([max(each.plans - 1, 0) for each in found])), 2),
        "median_way_m": round(float(np.median([each.distance_m for each in found])), 2),
        "paper": paper,
        "failures": {each.seed: each.reason for each in found if not each.reached},
    }
