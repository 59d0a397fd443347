"""The harmonic planner: bands after the paper's figure 5, fields on real maps, solver times, and a drive among movers.

`HARMONIC_RUNS` in the environment takes fewer than a hundred runs among movers, to look rather than to judge.
"""

from __future__ import annotations

import os
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.acceptance.logs import DATA
from benchmarks.acceptance.runs import over_seeds
from benchmarks.harmonic import SCENES, field_row, floors, open_floor, rooms, row_of, solver_rows, speed_row
from waychair.planning.laplace_gpu import gpu_at_hand
from waychair.trials.hazards import Hazard, HazardResult, Struck, movers, run_hazard
from waychair.types import Json

SHARPEST_DEG = 15.0
COLD_MS, UPDATE_MS = 500.0, 60.0
RUNS = int(os.environ.get("HARMONIC_RUNS", "100"))
PAPER_S, SUCCESS_OF_MANY = {0: 14.0, 3: 18.33, 10: 27.08}, 0.97


def harmonic_bands(out: Path) -> Json:
    """Four scenes: after the band no turn above 15 degrees at every 0.10 m, no longer than before, the chair fits.

    The rooms are ours, at the size of a wheelchair: the paper's drawings are lost, and its lengths are a small robot's.
    """
    rows = [row_of(scene) for scene in SCENES]
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
        "rows": rows,
    }


def harmonic_fields(out: Path) -> Json:
    """All Moving AI maps, real ones among them, five goals each: a better neighbour everywhere, all descents arrive."""
    rows = []
    for name, free in floors(DATA / "movingai").items():
        rows.append(field_row(name, free, 5, 1000, 0))
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


def harmonic_speed(out: Path) -> Json:
    """1024 x 1024: CPU time of one thread to 1e-8, and of an update; every solver beside the others on 256 x 256.

    Nothing is said of a GPU where there is none.
    """
    rows = [speed_row("rooms", rooms(), (500, 300)), speed_row("open", open_floor(), (500, 300))]
    return {
        "passed": all(
            row["cold_cpu_ms"] <= COLD_MS and row["update_cpu_ms"] <= UPDATE_MS and row["residual"] <= 1.01e-8
            for row in rows
        ),
        "gpu": "at hand, not measured here" if gpu_at_hand() else "none at hand",
        "worst_cold_cpu_ms": max(row["cold_cpu_ms"] for row in rows),
        "worst_update_cpu_ms": max(row["update_cpu_ms"] for row in rows),
        "rows": rows,
        "solvers_256": solver_rows(rooms(256, 4), (125, 75)),
    }


def harmonic_movers(out: Path) -> Json:
    """None, three or ten discs in a room of 3 by 3 m: harmonic planner beside D* Lite, both with DWA, same seeds."""
    rows = []
    for count, paper_s in PAPER_S.items():
        for planner in ("harmonic", "dstar-lite"):
            found = over_seeds(f"{count} movers, {planner}", partial(_run, planner, count), RUNS)
            rows.append(_movers_row(count, planner, paper_s, found))
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


def with_planner(hazard: Hazard, planner: str) -> Hazard:
    """The same scene with another global planner."""
    navigator = hazard.chair.navigator
    told = replace(navigator, planner=replace(navigator.planner, planner=planner))
    return replace(hazard, chair=replace(hazard.chair, navigator=told))


def _run(planner: str, count: int, seed: int) -> HazardResult:
    return run_hazard(with_planner(movers(count, seed), planner), seed)


def _movers_row(count: int, planner: str, paper_s: float, found: list[HazardResult]) -> Json:
    own = [kind for kind in Struck if kind is not Struck.BUMPED]
    return {
        "movers": count,
        "planner": planner,
        "runs": len(found),
        "reached": sum(each.reached for each in found),
        "contacts_by_chair": sum(bool(each.count(*own)) for each in found),
        "median_s": round(float(np.median([each.seconds for each in found])), 1),
        "paper_s": paper_s,
        "failures": {each.seed: each.reason for each in found if not each.reached},
    }
