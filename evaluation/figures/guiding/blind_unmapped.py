"""Ways without a map: simulated drivers are led by odometry and the chair's scans out of dead ends, and through the next door.

Beside them, chairs that have the paper's sensors alone, without a guard: led by our advice, and by the paper's own signals.
`BLIND_UNMAPPED_RUNS=8` takes so many dead ends and doors instead of 50 and 100. `BLIND_UNMAPPED_ONLY=paper` takes the paper's chairs alone.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np

from evaluation.runs.kept_runs import over_seeds
from evaluation.scenes.guided_drives import GuidedBars, GuidedRun, guided_row, judged_run, unled_run
from evaluation.scenes.tight_places import APPROACHES, WALL, TightScene, door_scene
from waychair.calibration.chair_body import CHAIR_A
from waychair.control.haptics.next_door import DoorSide
from waychair.geometry import wrap_angle
from waychair.maps.grid.distance_field import distance_field
from waychair.planning.body.footprint import fits
from waychair.simulation.plan.floor_plan import FloorPlan, PlanWall
from waychair.simulation.plan.world import World, world_from_plan
from waychair.trials.guiding.guided import GuidedRecord, GuidedSensors, GuidedSetup, RiderTold, guided_trial
from waychair.types import HelpLevel, Json, OccupancyGrid, Place, Pose2

DEAD_ENDS, DOORS = (int(os.environ.get("BLIND_UNMAPPED_RUNS", count)) for count in ("50", "100"))

ONLY_PAPER = os.environ.get("BLIND_UNMAPPED_ONLY", "") == "paper"

PAPER_DOORS = min(DOORS, 20)
"""Doors for the chairs with the paper's sensors: a minute's drive takes a minute, for its pictures."""

OUT_S, DOOR_S = 60.0, 180.0
"""s; limits."""

NO_MAP = OccupancyGrid(np.full((100, 100), -1, np.int8), 0.05)
"""The map of a chair that has none: nothing is known of its cells."""

EDGE, LONG, WIDE, END = 0.2, 7.5, 7.0, 4.8
"""m: free space round a hall, its sides, and how far the dead end's end is from the hall's."""

DEEP, BROAD = (1.2, 3.0), (0.9, 2.4)
"""m; a dead end's sizes: in the narrow ones the chair cannot turn."""

OUT_OF = 0.9
"""The share of drivers who have to be out in time."""


@dataclass(frozen=True, slots=True)
class DeadEnd:
    """A dead end in a hall: the world, the goal across its end, and the x [m] of its mouth."""

    world: World
    goal: Place
    mouth: float


def blind_unmapped(out: Path) -> Json:
    """Drivers who are out of dead ends in time, and through the next door; and contacts."""
    rows = [] if ONLY_PAPER else _usual_rows()
    passed = all(row["passed"] for row in rows)
    for told in (RiderTold.GUIDED, RiderTold.PAPER):
        runs = over_seeds(f"blind paper door {told.value}", partial(through_door_as_paper, told=told), PAPER_DOORS)
        rows.append(guided_row("next door, the paper's sensors", told.value, runs))
    return {"passed": passed, "rows": rows}


def _usual_rows() -> list[Json]:
    ends = guided_row("dead end", "without a map", over_seeds("blind dead end", out_of_dead_end, DEAD_ENDS))
    # contacts do not decide here: a chair's rear may touch, slowly, a wall that no sensor has ever seen
    ends["passed"] = ends["reached"] >= OUT_OF * ends["runs"]
    doors = over_seeds("blind next door", through_next_door, DOORS)
    return [ends, guided_row("next door", "without a map", doors, GuidedBars(0.95))]


def out_of_dead_end(seed: int) -> GuidedRun:
    """Lead a driver towards a place across the end of a dead end; it has ended once the chair's middle is out of the mouth."""
    scene = dead_end(seed)
    setup = GuidedSetup(scene.world, NO_MAP, CHAIR_A, seed=seed)

    def out_s(record: GuidedRecord) -> float | None:
        middle = record.truth[:, 0] + (CHAIR_A.front - CHAIR_A.rear) / 2 * np.cos(record.truth[:, 2])
        out = np.flatnonzero(middle < scene.mouth)
        return float(record.times_s[out[0]] - record.times_s[0]) if len(out) else None

    with guided_trial(setup) as trial:
        return judged_run(trial, setup, lambda: trial.drive_by_odometry(scene.goal, OUT_S), out_s)


def dead_end(seed: int) -> DeadEnd:
    """Return a dead end whose end the chair faces, from 0.1 to 0.5 m before it."""
    rng = np.random.default_rng(seed)
    end = EDGE + END
    while True:
        depth, width = float(rng.uniform(*DEEP)), float(rng.uniform(*BROAD))
        middle = EDGE + WIDE / 2 + float(rng.uniform(-0.8, 0.8))
        aside = float(rng.uniform(-0.5, 0.5)) * max(width - CHAIR_A.width, 0.0)
        start = Pose2(end - CHAIR_A.front - float(rng.uniform(0.1, 0.5)), middle + aside, float(rng.uniform(-0.4, 0.4)))
        low, high, mouth = middle - width / 2, middle + width / 2, end - depth
        world = _hall([(mouth, low), (end, low), (end, high), (mouth, high)], start)
        if fits(CHAIR_A, 0.05, distance_field(world.grid), start):
            return DeadEnd(world, Place("beacon", Pose2(end + 1.4, middle, 0.0), 0.5, math.pi), mouth)


def through_next_door(seed: int) -> GuidedRun:
    """Let a driver go on a little, and lead them through the next door; the whole chair has to come to a stop behind it."""
    scene = door_scene(0.9, APPROACHES[seed % len(APPROACHES)], CHAIR_A, seed)
    behind = _behind_door(scene)
    setup = GuidedSetup(scene.world, NO_MAP, CHAIR_A, seed=seed, sensors=GuidedSensors.WITH_DOORWAYS)

    with guided_trial(setup) as trial:
        trial.go_nearer()
        turned = wrap_angle(trial.simulator.truth().theta)
        side = DoorSide.AHEAD if abs(turned) <= math.pi / 4 else DoorSide.LEFT if turned < 0.0 else DoorSide.RIGHT
        return judged_run(trial, setup, lambda: trial.drive_through(side, DOOR_S), _through_s(behind))


def through_door_as_paper(seed: int, told: RiderTold = RiderTold.GUIDED) -> GuidedRun:
    """Let a driver on a chair with the paper's sensors alone through the door, from 0 and 30 degrees in turn.

    `told` by our advice the driver first goes on a little; by the paper's signals they are led to no place, and try until they are
    through.
    """
    scene = door_scene(0.9, APPROACHES[seed % 2], CHAIR_A, seed)
    behind = _behind_door(scene)
    setup = GuidedSetup(
        scene.world, NO_MAP, CHAIR_A, level=HelpLevel.INFORM, seed=seed, told=told, sensors=GuidedSensors.PAPER
    )
    if told is RiderTold.PAPER:
        return unled_run(setup, lambda pose: pose.x > behind, DOOR_S, wants_door=True)

    with guided_trial(setup) as trial:
        drive = partial(trial.find_and_drive_through, DoorSide.AHEAD, DOOR_S)
        return judged_run(trial, setup, drive, _through_s(behind))


def _behind_door(scene: TightScene) -> float:
    """Return the x [m] beyond which the whole chair is through the door."""
    assert scene.door is not None
    return scene.door.x + WALL / 2 + CHAIR_A.rear


def _through_s(behind: float) -> Callable[[GuidedRecord], float | None]:
    """Return a function that tells how long [s] a driver took who ended beyond x = `behind` [m], None if it is not reached."""
    return lambda record: record.seconds if record.truth[-1, 0] > behind else None


def _hall(dead_end_line: Sequence[tuple[float, float]], start: Pose2) -> World:
    low, right, high = EDGE, EDGE + LONG, EDGE + WIDE
    outline = [(low, low), (right, low), (right, high), (low, high), (low, low)]
    walls = [PlanWall(start=a, end=b) for line in (outline, dead_end_line) for a, b in pairwise(line)]
    size = LONG + 2.0 * EDGE, WIDE + 2.0 * EDGE
    return world_from_plan(
        FloorPlan(name="dead_end", size=size, start=(start.x, start.y, start.theta), walls=walls), "dead_end"
    )
