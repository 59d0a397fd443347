"""Scenes and measurements of the harmonic planner: the paper's figure 5, fields on maps, times of the solvers.

`python -m evaluation.speed.harmonic` prints one JSON object with all of them.
"""

from __future__ import annotations

import json
import math
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from evaluation.speed.paper_band import paper_band, polyline_length
from waychair.calibration.chair_body import CHAIR_A
from waychair.geometry import evenly_spaced
from waychair.maps.grid.moving_ai import load_free_cells
from waychair.planning.body.clearance import PLANNED
from waychair.planning.body.footprint import footprint, room
from waychair.planning.grid.costmap import Costmap, costmap_from_grid
from waychair.planning.grid.grid_graph import Cell
from waychair.planning.harmonic.harmonic_field import LogField, count_summits, descend, log_field, streamline
from waychair.planning.harmonic.laplace_solvers import SolverOptions, laplace_problem, relative_residual, solve
from waychair.planning.route.flowing_line import flowing
from waychair.planning.route.global_planner import PlannerSettings, plan
from waychair.planning.route.path_turns import turning_angles
from waychair.resumable import finished
from waychair.types import BoolArray, FloatArray, OccupancyGrid, Pose2

CELL = 0.05


Result = TypeVar("Result")


@dataclass(frozen=True, slots=True)
class BandScene:
    """A room [m] with boxes (x0, y0, x1, y1), start and goal, and the paper's lengths before and after the band."""

    name: str
    size: tuple[float, float]
    boxes: tuple[tuple[float, float, float, float], ...]
    start: tuple[float, float]
    goal: tuple[float, float]
    paper_m: tuple[float, float]


SCENES = (
    BandScene("one box", (6.0, 6.0), ((2.2, 0.0, 3.0, 3.2),), (1.0, 1.0), (5.0, 1.2), (2.34, 2.34)),
    BandScene(
        "two walls", (8.0, 6.0), ((2.4, 0.0, 2.7, 3.8), (5.0, 2.2, 5.3, 6.0)), (1.0, 1.0), (7.0, 5.0), (3.80, 3.72)
    ),
    BandScene("door", (8.0, 6.0), ((3.8, 0.0, 4.1, 3.2), (3.8, 4.8, 4.1, 6.0)), (1.0, 1.0), (7.0, 1.5), (2.85, 2.75)),
    BandScene(
        "scattered boxes",
        (8.0, 6.0),
        ((2.0, 2.4, 2.6, 3.2), (3.8, 3.4, 4.4, 6.0), (4.2, 0.6, 4.8, 1.6), (5.8, 2.6, 6.4, 3.2)),
        (0.9, 4.8),
        (6.9, 1.2),
        (3.22, 3.26),
    ),
)


def costmap_of(scene: BandScene) -> Costmap:
    """Return the scene's costmap for chair A, with walls all round."""
    height, width = round(scene.size[1] / CELL), round(scene.size[0] / CELL)
    cells = np.zeros((height, width), np.int8)
    cells[[0, -1]], cells[:, [0, -1]] = 100, 100
    for x0, y0, x1, y1 in scene.boxes:
        cells[round(y0 / CELL) : round(y1 / CELL), round(x0 / CELL) : round(x1 / CELL)] = 100
    return costmap_from_grid(OccupancyGrid(cells, CELL), CHAIR_A)


def cell_at(point: tuple[float, float]) -> Cell:
    """Return row and column of a point [m]."""
    return int(point[1] / CELL), int(point[0] / CELL)


@dataclass(frozen=True, slots=True)
class Bands:
    """The paths of one scene, points (N, 2) [cells]: by best neighbours, by the paper's band, and by ours."""

    found: LogField
    costmap: Costmap
    descent: FloatArray
    paper: FloatArray
    ours: FloatArray


def bands(scene: BandScene) -> Bands:
    """Return the descent and both bands in a scene."""
    costmap = costmap_of(scene)
    found = log_field(laplace_problem(costmap.prices > 0, cell_at(scene.goal)))
    cells = descend(found, cell_at(scene.start))
    points: FloatArray = cells[:, ::-1].astype(np.float64) + 0.5
    poses = finished(flowing(points * CELL, costmap.field, costmap.body, price=40000.0))
    ours: FloatArray = poses[:, :2] / CELL
    return Bands(found, costmap, points, paper_band(found, points), ours)


def rectangle_fits(costmap: Costmap, points: FloatArray) -> bool:
    """Return whether chair A with the band's margin fits all along a path, headed along it."""
    shape = footprint(costmap.body, PLANNED, costmap.field)
    line = evenly_spaced(points, 0.05 / CELL)
    ahead = np.diff(line, axis=0)
    return all(
        room(shape, x, y, math.atan2(dy, dx), 0.0) >= 0.0
        for (x, y), (dx, dy) in zip(line[1:-1].tolist(), ahead[1:].tolist(), strict=True)
    )


def row_of(scene: BandScene) -> dict[str, Any]:
    """Return lengths [m], sharpest turns [deg] at every 0.10 m, and least clearances [m] of a scene's paths."""
    lines = bands(scene)
    row: dict[str, Any] = {"scene": scene.name, "paper_m": scene.paper_m}
    for name, points in (("descent", lines.descent), ("paper_band", lines.paper), ("band", lines.ours)):
        even = evenly_spaced(points, 0.10 / CELL)
        degrees = np.degrees(turning_angles(even))
        rows, columns = np.floor(even[:, ::-1]).astype(int).T
        row[name] = {
            "length_m": round(polyline_length(points) * CELL, 3),
            "sharpest_deg": round(float(degrees.max()), 1),
            "histogram_by_10_deg": np.histogram(degrees, np.arange(0, 100, 10))[0].tolist(),
            "rectangle_fits": rectangle_fits(lines.costmap, points),
            "clearance_m": round(float(lines.costmap.clearance[rows, columns].min()), 3),
        }
    return row


DOORS = (0.8, 0.9, 1.0, 1.2, 1.5)
DOOR_ENDS = {
    "straight on": (Pose2(1.0, 3.2, 0.0), Pose2(7.0, 2.9, 0.0)),
    "across the room": (Pose2(1.0, 1.0, 0.8), Pose2(7.0, 5.0, 0.5)),
    "from beside it": (Pose2(3.2, 0.8, 1.5), Pose2(5.4, 4.6, 1.0)),
}


def door_row(door: float, name: str) -> dict[str, Any]:
    """Return length [m] and sharpest turn [deg] of the harmonic planner's path between two rooms through a door."""
    cells = np.zeros((120, 162), np.int8)
    cells[[0, -1]], cells[:, [0, -1]], cells[:, 80:82] = 100, 100, 100
    half = round(door / CELL / 2)
    cells[60 - half : 60 + half, 80:82] = 0
    costmap = costmap_from_grid(OccupancyGrid(cells, CELL), CHAIR_A)
    path = plan(costmap, *DOOR_ENDS[name], PlannerSettings(planner="harmonic"))
    degrees = np.degrees(turning_angles(evenly_spaced(path.poses[:, :2], 0.10)))
    return {
        "door_m": door,
        "comes": name,
        "length_m": round(path.length(), 2),
        "sharpest_deg": round(float(degrees.max()), 1),
        "turns_above_15_deg": int((degrees > 15.0).sum()),
    }


def floors(folder: Path) -> dict[str, BoolArray]:
    """Return the free cells (H, W) of the Moving AI maps in a folder, by name."""
    return {path.stem: load_free_cells(path) for path in sorted(folder.glob("*.map"))}


@dataclass(frozen=True, slots=True)
class FieldRun:
    """A field to one goal: cells without a better neighbour, and arrived descents and streamlines of all."""

    lacking: int
    descents: int
    arrived: int
    lines: int
    lines_arrived: int
    lowest: float
    cpu_ms: float


def field_run(free: BoolArray, descents: int, seed: int) -> FieldRun:
    """Compute the field to a random goal, descents from random cells, and a tenth as many streamlines."""
    rng = np.random.default_rng(seed)
    cells = np.argwhere(free)
    row, column = cells[rng.integers(len(cells))].tolist()
    found, _, cpu_ms = _timed(lambda: log_field(laplace_problem(free, (row, column))))
    joined = np.argwhere(np.isfinite(found.logs))
    starts = joined[rng.integers(len(joined), size=descents)].tolist()
    begins = joined[rng.integers(len(joined), size=descents // 10)].tolist()
    arrived = sum(descend(found, (i, j))[-1].tolist() == [row, column] for i, j in starts)
    middle = [column + 0.5, row + 0.5]
    lines = sum(streamline(found, np.array([j + 0.5, i + 0.5]))[-1].tolist() == middle for i, j in begins)
    lowest = float(found.logs[np.isfinite(found.logs)].min())
    return FieldRun(count_summits(found), len(starts), arrived, len(begins), lines, lowest, cpu_ms)


def field_row(name: str, free: BoolArray, runs: list[FieldRun]) -> dict[str, Any]:
    """Return the summary of the runs on one map."""
    return {
        "map": name,
        "free": int(free.sum()),
        "goals": len(runs),
        "cells_without_a_better_neighbour": sum(run.lacking for run in runs),
        "descents": sum(run.descents for run in runs),
        "arrived": sum(run.arrived for run in runs),
        "streamlines": sum(run.lines for run in runs),
        "streamlines_arrived": sum(run.lines_arrived for run in runs),
        "least_log_v": round(min(run.lowest for run in runs), 1),
        "median_field_cpu_ms": round(statistics.median(run.cpu_ms for run in runs), 1),
    }


def rooms(side: int = 1024, count: int = 8, seed: int = 0) -> BoolArray:
    """Return free cells (side, side) of a square of rooms with a door of ten cells between neighbours."""
    rng = np.random.default_rng(seed)
    free = open_floor(side)
    step = side // count
    for i in range(1, count):
        free[i * step] = free[:, i * step] = False
    for i in range(1, count):
        for j in range(count):
            for across in (False, True):
                at = j * step + int(rng.integers(5, step - 15))
                (free.T if across else free)[i * step, at : at + 10] = True
    return free


def open_floor(side: int = 1024) -> BoolArray:
    """Return free cells (side, side) with a wall all round."""
    free = np.ones((side, side), np.bool_)
    free[[0, -1]] = free[:, [0, -1]] = False
    return free


def speed_row(name: str, free: BoolArray, goal: Cell, times: int = 9) -> dict[str, Any]:
    """Return the time [ms] for a field to 1e-8, and for its update after a change of 20 neighbouring cells.

    Both as wall time on up to two idle cores, and as processor time of all cores together.
    """
    problem = laplace_problem(free, goal)
    solved = solve(problem)
    rng = np.random.default_rng(1)
    cold = [_timed(lambda: solve(problem))[1:] for _ in range(times)]
    updates, cycles = [], []
    worst = 0.0
    for _ in range(times):
        changed = free.copy()
        middle = rng.integers(60, np.array(free.shape) - 60)
        cells = middle + rng.integers(-20, 21, (20, 2))
        changed[cells[:, 0], cells[:, 1]] ^= True
        changed[goal] = True
        other = laplace_problem(changed, goal)
        warm, *took = _timed(partial(solve, other, SolverOptions(), solved))
        updates.append(took)
        cycles.append(warm.sweeps)
        worst = max(worst, relative_residual(other, warm.v))
    (cold_ms, cold_cpu_ms), (update_ms, update_cpu_ms) = np.median(cold, axis=0), np.median(updates, axis=0)
    return {
        "map": f"{name} {free.shape[0]} x {free.shape[1]}",
        "cold_ms": round(cold_ms, 1),
        "cold_cpu_ms": round(cold_cpu_ms, 1),
        "cycles": solved.sweeps,
        "residual": relative_residual(problem, solved.v),
        "update_ms": round(update_ms, 1),
        "update_cpu_ms": round(update_cpu_ms, 1),
        "slowest_update_ms": round(max(ms for ms, _ in updates), 1),
        "update_cycles_of_all_cells": cycles,
        "update_residual": worst,
    }


def _timed(run: Callable[[], Result]) -> tuple[Result, float, float]:
    """Run a function; return its result, its wall time and its processor time over all threads [ms]."""
    began, worked = time.perf_counter(), time.process_time()
    result = run()
    return result, 1e3 * (time.perf_counter() - began), 1e3 * (time.process_time() - worked)


def solver_rows(free: BoolArray, goal: Cell, tolerance: float = 1e-8) -> list[dict[str, Any]]:
    """Return processor time and sweeps of each solver on one map."""
    rows = []
    for name in ("gauss-seidel", "sor", "multigrid", "direct"):
        settings = SolverOptions(solver=name, tolerance=tolerance, most_sweeps=1_000_000, memory=1e6)
        found, _, took = _timed(partial(solve, laplace_problem(free, goal), settings))
        rows.append({"solver": name, "sweeps": found.sweeps, "cpu_ms": round(took, 1), "residual": found.residual})
    return rows


if __name__ == "__main__":
    print(
        json.dumps(
            {
                "bands": [row_of(scene) for scene in SCENES],
                "speed": [speed_row("rooms", rooms(), (500, 300)), speed_row("open", open_floor(), (500, 300))],
                "solvers": solver_rows(rooms(256, 4), (125, 75)),
            },
            indent=1,
        )
    )
