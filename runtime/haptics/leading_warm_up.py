"""Loading the kernels that lead a rider, before one is led: the glove feels a silent host while they are compiled."""

from __future__ import annotations

import math
from functools import cache

import numpy as np

from waychair.calibration.chair_body import CHAIR_A
from waychair.planning.steps.clear_ground import ClearGround
from waychair.planning.steps.step_planner import StepPlanner
from waychair.runtime.haptics.live_ground import LiveGround
from waychair.runtime.haptics.seen_ground import SeenGround
from waychair.types import Goal, OccupancyGrid, Pose2, Scan, Twist


@cache
def warm_up() -> None:
    """Plan steps over seen ground and over a map, and plan them anew after a change; later calls do nothing."""
    here, goal = Pose2(), Pose2(0.5, 0.0, 0.0)
    seen = SeenGround(CHAIR_A)
    mapped = LiveGround(CHAIR_A, OccupancyGrid(np.zeros((80, 80), np.int8), 0.05, Pose2(-2.0, -2.0, 0.0)))
    by_odometry, on_map = StepPlanner(Goal(goal), goal), StepPlanner(Goal(goal), goal)
    for wall in (3.0, 1.7):
        scan = Scan(0, np.full(360, wall, np.float32), -math.pi, math.tau / 360, range_max=10.0)
        for ground in (seen, mapped):
            ground.see(scan, here, Twist())
        for planner, costmap in ((by_odometry, seen.ask(goal)()), (on_map, mapped.ask()())):
            ClearGround(costmap).is_free_from(planner.replan(costmap, here).steps, here)
    seen.walls(here, 1.0)
