"""Bars of the dynamic window approach: its speed, and its need for the global planner."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path as FilePath

import numpy as np

from evaluation.scenes.hazards import (
    DROP_OFFS,
    Hazard,
    Protection,
    hazard_of_scene,
    setup_of,
    to_the_lift,
    to_the_restroom,
)
from evaluation.scenes.tight_places import DOORS, corner_scene, dead_end_scene, door_scene
from evaluation.speed.dwa import choice_speed, fan_speed
from waychair.calibration.chair_body import CHAIR_A, CHAIR_B
from waychair.control.drive.navigator import Stage
from waychair.geometry import arc
from waychair.planning.body.footprint import fits
from waychair.planning.grid.costmap import Costmap, costmap_from_grid
from waychair.planning.route.global_planner import plan
from waychair.planning.window.dwa import choose
from waychair.planning.window.motion_limits import PERIOD, DwaSettings
from waychair.planning.window.paper_dwa import choose_as_paper
from waychair.simulation.plan.world import load_world
from waychair.simulation.simulator import Simulator, with_all_sensors
from waychair.topics import COMMAND
from waychair.trials.demo.demo import randomised_settings
from waychair.trials.drive import advance_tick, simulated_chair, start_drive
from waychair.types import FloatArray, Goal, Json, OccupancyGrid, Path, Pose2, Twist

FAN_MS, STEP_MS = 2.0, 15.0
TRAPS = 20
LIMIT_S, CAUGHT_S = 60.0, 4.0
LIMITS = replace(DwaSettings(), reaction_time=0.0)
CELL = 0.05


def fan(out: FilePath) -> Json:
    """At least 2,000 candidates of 30 poses with the exact rectangle in clutter, in at most 2 ms of processor time."""
    speed = fan_speed()
    return {"passed": speed["candidates"] >= 2000 and speed["median_ms"] <= FAN_MS, **speed}


def step(out: FilePath) -> Json:
    """The whole control step: 99 % of the steps within 15 ms of processor time, in drives that reach their places.

    A step reads the sensors, localises, plans, chooses, limits, and commands the bridge; its time is the processor time
    of the whole process. A first drive through a door loads the kernels. `worst_p99_ms` is that of the slowest drive.
    """
    timed(hazard_of_scene(door_scene(DOORS[0], 30.0, CHAIR_B, 0)), 0)
    rows, spent = [], []
    for name, hazard in _drives().items():
        times, reached = timed(hazard, _SEED)
        spent.append(times)
        rows.append({"scene": name, "steps": len(times), "reached": reached, **_quantiles(times)})
        print(f"  {rows[-1]}", flush=True)
    whole = _quantiles(np.concatenate(spent))
    choice = {f"choice_{key}": value for key, value in choice_speed().items()}
    reached = all(row["reached"] for row in rows)
    worst = max(row["p99_ms"] for row in rows)
    passed = whole["p99_ms"] <= STEP_MS and reached
    return {"passed": passed, "reached": reached, **whole, "worst_p99_ms": worst, **choice, "rows": rows}


_SEED = 1


def _drives() -> dict[str, Hazard]:
    """Return the drives: a building's places in turn, the tightest door, corner and dead end, and people on the path.

    All use wheels and lidar; three also use IMU, sonars and camera at their rates.
    """
    world = load_world("small_clinic").without_people()
    clinic = Hazard("small clinic", world, world.grid, world.places)
    full = {
        "small clinic": clinic,
        "basement to the restroom": to_the_restroom(_SEED),
        "edge behind": DROP_OFFS["behind"](Protection.CAMERA, _SEED),
    }
    return {
        "small clinic": clinic,
        "door": hazard_of_scene(door_scene(DOORS[0], 90.0, CHAIR_B, _SEED)),
        "corner": hazard_of_scene(corner_scene(CHAIR_A, _SEED)),
        "dead end": hazard_of_scene(dead_end_scene(CHAIR_A, _SEED)),
        "corridor to the lift": to_the_lift(_SEED),
        "basement to the restroom": to_the_restroom(_SEED),
        **{
            f"{name}, all sensors": replace(hazard, sensors=with_all_sensors(hazard.sensors))
            for name, hazard in full.items()
        },
    }


def short_drive() -> Hazard:
    """Return a drive of some ten seconds, along a corridor to a lift."""
    return to_the_lift(_SEED)


def timed(
    hazard: Hazard, seed: int, limit_s: float = 150.0, each_tick: Callable[[], object] | None = None
) -> tuple[FloatArray, bool]:
    """Return the processor time [ms] of each step of a drive to a hazard's places, and whether all were reached.

    `each_tick` is called in each step, within the time.
    """
    simulator = Simulator(
        hazard.world, hazard.body, replace(hazard.sensors, plant=randomised_settings(seed).plant), seed
    )
    spent, reached = [], True
    with simulated_chair(setup_of(hazard), simulator) as chair:
        for goal in hazard.goals:
            start_drive(simulator, chair, Goal(goal.name))
            stage = Stage.IDLE
            for _ in range(round(limit_s * COMMAND.rate_hz)):
                messages = advance_tick(simulator, chair)
                begun = time.process_time_ns()
                if each_tick is not None:
                    each_tick()
                stage = chair.step(simulator.now_ns, messages).navigation.stage
                spent.append((time.process_time_ns() - begun) * 1e-6)
                if stage in (Stage.ARRIVED, Stage.FAILED):
                    break
            reached = reached and stage is Stage.ARRIVED
    return np.array(spent), reached


def _quantiles(times: FloatArray) -> Json:
    """Return median, 99th percentile and worst [ms]."""
    return {
        "median_ms": round(float(np.median(times)), 2),
        "p99_ms": round(float(np.percentile(times, 99)), 2),
        "worst_ms": round(float(times.max()), 1),
    }


def u_trap(out: FilePath) -> Json:
    """Section 2.3 of the source paper: the window alone is trapped in a U, with D* Lite it is not.

    Traps have random depth, width and place; the chair follows its commands exactly. Alone, the window's path is the
    straight line to the goal, with the default and with the paper's preset.
    """
    rng = np.random.default_rng(23)
    traps = [random_trap(rng) for _ in range(TRAPS)]
    found = {name: [drive(trap, name) for trap in traps] for name in ("alone", "as_paper", "with_dstar_lite")}
    reached = {f"{name}_reached": sum(run.reached for run in runs) for name, runs in found.items()}
    touched = {f"{name}_contacts": sum(run.touched for run in runs) for name, runs in found.items()}
    passed = reached["with_dstar_lite_reached"] == TRAPS and reached["alone_reached"] == 0
    return {"passed": passed and touched["with_dstar_lite_contacts"] == 0, "traps": TRAPS, **reached, **touched}


@dataclass(frozen=True, slots=True)
class Trap:
    """A hall of 14 by 10 m with a U that opens towards the start, between start and goal."""

    costmap: Costmap
    start: Pose2
    goal: Pose2


@dataclass(frozen=True, slots=True)
class DwaRun:
    """The result of one drive."""

    reached: bool
    touched: bool


def random_trap(rng: np.random.Generator) -> Trap:
    """Return a trap with walls of 0.2 m; the goal lies behind the bottom of the U, level with the start."""
    cells = np.zeros((round(10 / CELL), round(14 / CELL)), np.int8)
    cells[[0, -1]], cells[:, [0, -1]] = 100, 100
    depth, half = rng.uniform(1.8, 2.8), rng.uniform(1.2, 1.8)
    bottom, middle = rng.uniform(8.0, 9.0), rng.uniform(4.5, 5.5)
    for x0, y0, x1, y1 in (
        (bottom, middle - half, bottom + 0.2, middle + half),
        (bottom - depth, middle + half, bottom + 0.2, middle + half + 0.2),
        (bottom - depth, middle - half - 0.2, bottom + 0.2, middle - half),
    ):
        cells[round(y0 / CELL) : round(y1 / CELL), round(x0 / CELL) : round(x1 / CELL)] = 100
    start = Pose2(rng.uniform(1.5, 3.0), middle + rng.uniform(-0.3, 0.3), rng.uniform(-0.3, 0.3))
    grid = OccupancyGrid(cells, CELL)
    return Trap(costmap_from_grid(grid, CHAIR_A), start, Pose2(12.0, middle, 0.0))


def drive(trap: Trap, name: str) -> DwaRun:
    """Drive until the goal, a contact, a stuck chair, or the time limit."""
    pose, command, stood = trap.start, Twist(), 0
    path = plan(trap.costmap, trap.start, trap.goal, check_footprint=False)
    if name != "with_dstar_lite":
        at = np.linspace(0.0, 1.0, 101)[:, None]
        points = (1 - at) * (trap.start.x, trap.start.y) + at * (trap.goal.x, trap.goal.y)
        heading = math.atan2(trap.goal.y - trap.start.y, trap.goal.x - trap.start.x)
        path = Path(np.column_stack([points, np.full(len(points), heading)]))
    for _ in range(round(LIMIT_S / PERIOD)):
        if name == "as_paper":
            command = choose_as_paper(pose, command, path, trap.costmap.field, CHAIR_A, LIMITS).twist
        else:
            command = choose(pose, command, path, trap.costmap.field, CHAIR_A, LIMITS).twist
        stood = stood + 1 if max(abs(command.v), abs(command.omega)) < 0.03 else 0
        if stood * PERIOD > CAUGHT_S:
            break
        pose = pose @ arc(command.v * PERIOD, command.omega * PERIOD)
        if not fits(CHAIR_A, -CELL / 2, trap.costmap.field, pose):
            return DwaRun(reached=False, touched=True)
        if math.hypot(pose.x - trap.goal.x, pose.y - trap.goal.y) < 0.3:
            return DwaRun(reached=True, touched=False)
    return DwaRun(reached=False, touched=False)
