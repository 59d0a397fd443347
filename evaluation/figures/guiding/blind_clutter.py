"""Random rooms full of boxes without a map: simulated drivers are led to a beacon by odometry, round what the chair's scans show.

Beside it, in the first of the rooms: the free space of the source paper by its own signals, which know nothing of a goal.
`BLIND_CLUTTER_RUNS=4` takes so many rooms instead of 100, `BLIND_CLUTTER_BASELINES=0` leaves out the paper.
"""

from __future__ import annotations

import math
import os
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from evaluation.figures.guiding.blind_unmapped import NO_MAP
from evaluation.runs.kept_runs import over_seeds
from evaluation.scenes.guided_drives import GuidedBars, GuidedRun, guided_row, judged_run, unled_run
from waychair.calibration.chair_body import CHAIR_A
from waychair.errors import PlanningError
from waychair.maps.grid.distance_field import distance_field
from waychair.planning.body.footprint import fits
from waychair.planning.grid.costmap import LiveCostmap
from waychair.planning.steps.step_planner import StepPlanner
from waychair.simulation.plan.floor_plan import FloorPlan, PlanBox, walls_round
from waychair.simulation.plan.world import World, world_from_plan
from waychair.trials.guiding.guided import GuidedSetup, RiderTold, guided_trial
from waychair.types import Goal, HelpLevel, Json, Place, Pose2

RUNS = int(os.environ.get("BLIND_CLUTTER_RUNS", "100"))

BASELINES = os.environ.get("BLIND_CLUTTER_BASELINES", "1") == "1"

PAPER_RUNS = 20
"""Rooms with the paper's signals, at most: nearly each lasts until the limit."""

SIDE, EDGE, BOXES = 7.0, 0.2, 8
"""m of a room and of the free space round its walls; and boxes in it."""

CLEAR = 0.10
"""m round the chair at the start and at the goal."""

LIMIT_S = 180.0


def blind_clutter(out: Path) -> Json:
    """Arrivals and contacts in the rooms that have a way of pivots and straight legs; the other rooms are counted apart."""
    found = over_seeds("blind clutter", run_in_clutter, RUNS)
    possible = [run for run in found if run is not None]
    rows = [guided_row("clutter", "guide", possible, GuidedBars(0.90))]
    if BASELINES:
        tried = over_seeds("blind clutter paper", partial(run_in_clutter, told=RiderTold.PAPER), min(RUNS, PAPER_RUNS))
        rows.append(guided_row("clutter", "paper", [run for run in tried if run is not None]))
    return {
        "passed": rows[0]["passed"],
        "rooms": len(found),
        "without_a_way": len(found) - len(possible),
        "rows": rows,
    }


def run_in_clutter(seed: int, told: RiderTold = RiderTold.GUIDED) -> GuidedRun | None:
    """Drive across one room; None where no steps lead across even if all boxes are known."""
    cluttered, goal = clutter(seed)
    try:
        StepPlanner(Goal(goal.pose), goal.pose).replan(
            LiveCostmap(cluttered.grid, CHAIR_A, ()).costmap(), cluttered.start
        )
    except PlanningError:
        return None
    setup = GuidedSetup(cluttered, NO_MAP, CHAIR_A, seed=seed, told=told)
    if told is RiderTold.GUIDED:
        with guided_trial(setup) as trial:
            return judged_run(trial, setup, lambda: trial.drive_by_odometry(goal, LIMIT_S))

    def there(pose: Pose2) -> bool:
        return math.hypot(pose.x - goal.pose.x, pose.y - goal.pose.y) <= setup.near_m

    return unled_run(replace(setup, level=HelpLevel.GUARD), there, LIMIT_S)


def clutter(seed: int) -> tuple[World, Place]:
    """Return a room with boxes and a goal across it; the chair fits at start and goal."""
    rng = np.random.default_rng(seed)
    while True:
        boxes = [_box(rng) for _ in range(BOXES)]
        start = Pose2(EDGE + 1.0, EDGE + float(rng.uniform(1.0, SIDE - 1.0)), float(rng.uniform(-0.5, 0.5)))
        end = Pose2(EDGE + SIDE - 1.0, EDGE + float(rng.uniform(1.0, SIDE - 1.0)), 0.0)
        world = _room(boxes, start)
        field = distance_field(world.grid)
        if fits(CHAIR_A, CLEAR, field, start) and fits(CHAIR_A, CLEAR, field, end):
            return world, Place("beacon", end, 0.5, math.pi)


def _box(rng: np.random.Generator) -> PlanBox:
    centre = float(rng.uniform(EDGE + 0.4, EDGE + SIDE - 0.4)), float(rng.uniform(EDGE + 0.4, EDGE + SIDE - 0.4))
    size = float(rng.uniform(0.3, 0.8)), float(rng.uniform(0.3, 0.8))
    return PlanBox(centre=centre, size=size)


def _room(boxes: list[PlanBox], start: Pose2) -> World:
    walls = walls_round((SIDE, SIDE), corner=(EDGE, EDGE))
    size = SIDE + 2.0 * EDGE
    plan = FloorPlan(name="clutter", size=(size, size), start=(start.x, start.y, start.theta), walls=walls, boxes=boxes)
    return world_from_plan(plan, "clutter")
