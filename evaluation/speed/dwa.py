"""The speed of the dynamic window approach: the fan of arcs, and the whole choice of a command.

    python -m evaluation.speed.dwa

Processor times of one thread over fixed scenes with loaded kernels. The best of several rounds counts, so that other
load of the machine has little effect.
"""

from __future__ import annotations

import math
import time

import numpy as np

from waychair.calibration.chair_body import CHAIR_B
from waychair.maps.grid.distance_field import DistanceField, distances
from waychair.planning.body.arc_fan import free_times
from waychair.planning.body.footprint import fits, footprint, in_cells
from waychair.planning.window.dwa import choose
from waychair.planning.window.motion_limits import PERIOD, DwaSettings
from waychair.types import BoolArray, FloatArray, Json, Path, Pose2, Twist

SCENES, ROUNDS, SEED = 40, 5, 3
CELL, SIDE = 0.025, 8.0
POSTS = 0.0006  # share of occupied cells: about 60 posts in the square
HORIZON = 2.5


def scenes() -> list[tuple[DistanceField, Pose2]]:
    """Return squares of 8 m with posts, and in each a pose that is 0.50 to 0.80 m from the nearest post."""
    rng = np.random.default_rng(SEED)
    found: list[tuple[DistanceField, Pose2]] = []
    while len(found) < SCENES:
        cells = round(SIDE / CELL)
        occupied: BoolArray = rng.random((cells, cells)) < POSTS
        occupied[[0, -1]], occupied[:, [0, -1]] = True, True
        field = DistanceField(distances(occupied, CELL), CELL)
        for x, y, theta in rng.uniform((2, 2, -math.pi), (6, 6, math.pi), (300, 3)):
            near = field.metres[int(y / CELL), int(x / CELL)]
            if 0.5 <= near <= 0.8 and fits(CHAIR_B, 0.03, field, Pose2(x, y, theta)):
                found.append((field, Pose2(float(x), float(y), float(theta))))
                break
    return found


def fan() -> FloatArray:
    """Return candidates (2040, 2): 40 speeds by 51 turn rates over the comfortable limits."""
    v, omega = np.linspace(-0.2, 0.8, 40), np.linspace(-0.8, 0.8, 51)
    return np.stack(np.meshgrid(v, omega), axis=-1).reshape(-1, 2)


def fan_speed() -> Json:
    """Return the time [ms] for all arcs of 2.5 s with the exact rectangle of chair B, certain as long as it brakes."""
    candidates, limits = fan(), DwaSettings()
    brake = np.maximum(np.abs(candidates[:, 0]) / limits.braking, np.abs(candidates[:, 1]) / limits.alpha)
    certain = PERIOD + brake / 2
    spent, feasible = [], []
    places = scenes()
    for _ in range(ROUNDS):
        for field, pose in places:
            shape, start = footprint(CHAIR_B, limits.clearance, field), in_cells(field, pose)
            begun = time.thread_time_ns()
            times = free_times(shape, start, candidates, certain, HORIZON)
            spent.append((time.thread_time_ns() - begun) * 1e-6)
            feasible.append(float((times >= HORIZON).mean()))
    return {"candidates": len(candidates), **_over_scenes(spent), "free_to_the_end": float(np.mean(feasible))}


def choice_speed() -> Json:
    """Return the time [ms] of `choose` as the chair calls it: window, arcs, critics, and the check for stopping."""
    spent, limits = [], DwaSettings()
    places = scenes()
    for _ in range(ROUNDS):
        for field, pose in places:
            ahead = np.linspace(0.0, 6.0, 61)
            x, y = pose.x + ahead * math.cos(pose.theta), pose.y + ahead * math.sin(pose.theta)
            path = Path(np.column_stack([x, y, np.full(len(ahead), pose.theta)]))
            begun = time.thread_time_ns()
            result = choose(pose, Twist(0.3, 0.0), path, field, CHAIR_B, limits)
            spent.append((time.thread_time_ns() - begun) * 1e-6)
    return {"candidates": len(result.candidates), **_over_scenes(spent)}


def _over_scenes(spent: list[float]) -> Json:
    """Return the median and the worst scene [ms], each by its best round."""
    best = np.array(spent).reshape(ROUNDS, SCENES).min(axis=0)
    return {"median_ms": float(np.median(best)), "worst_ms": float(best.max())}


def main() -> None:
    """Print all figures."""
    for name, figure in (("fan", fan_speed), ("choice", choice_speed)):
        print(f"{name}: " + ", ".join(f"{key} {value:.4g}" for key, value in figure().items()), flush=True)


if __name__ == "__main__":
    main()
