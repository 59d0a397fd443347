"""Direct legs to near goals: a curve or a line, forwards or backwards, only where they are free."""

from __future__ import annotations

import math

import numpy as np
import pytest

from waychair.calibration.chair_body import CHAIR_A
from waychair.maps.drawn.zones import Rule, Zone
from waychair.planning.grid.costmap import costmap_from_grid
from waychair.planning.route.direct_leg import direct_leg, turning_leg
from waychair.planning.route.global_planner import GlobalPlanner
from waychair.types import OccupancyGrid, Pose2


def room(width: float, length: float = 9.0) -> OccupancyGrid:
    """Return a free rectangle from the origin between walls of one cell."""
    cells = np.full((round(width / 0.05) + 2, round(length / 0.05) + 2), 100, np.int8)
    cells[1:-1, 1:-1] = 0
    return OccupancyGrid(cells, 0.05, Pose2(-0.05, -0.05, 0.0))


def turned(poses: np.ndarray) -> float:
    return float(np.abs(np.diff(np.unwrap(poses[:, 2]))).sum())


@pytest.mark.parametrize("back", [0.1, 0.4, 0.9])
def test_a_chair_backs_to_a_goal_that_is_straight_behind_it(back: float) -> None:
    leg = direct_leg(costmap_from_grid(room(5.0), CHAIR_A), Pose2(4.0, 2.5, 0.3), Pose2(4.0, 2.5, 0.3) @ Pose2(-back))
    assert leg is not None
    assert leg.backwards
    assert turned(leg.path.poses) == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("goal", [(0.5, 0.1, 0.3), (-0.6, 0.1, -0.2), (0.05, 0.4, 0.0), (-0.3, -0.3, math.pi)])
def test_a_direct_leg_ends_at_the_goal_and_turns_at_most_once_round(goal: tuple[float, float, float]) -> None:
    start = Pose2(4.0, 2.5, 1.1)
    leg = direct_leg(costmap_from_grid(room(5.0), CHAIR_A), start, start @ Pose2(*goal))
    assert leg is not None
    assert leg.path.poses[-1, :2] == pytest.approx((start @ Pose2(*goal)).array()[:2])
    assert math.cos(leg.path.poses[-1, 2] - (start @ Pose2(*goal)).theta) == pytest.approx(1.0)
    assert turned(leg.path.poses) < math.tau


def test_far_goals_and_goals_behind_an_obstacle_have_none() -> None:
    costmap = costmap_from_grid(room(5.0), CHAIR_A)
    assert direct_leg(costmap, Pose2(2.0, 2.5), Pose2(4.0, 2.5)) is None
    board = np.column_stack([np.full(40, 3.0), np.linspace(2.0, 3.0, 40)])
    shut = costmap_from_grid(room(5.0), CHAIR_A, board)
    assert direct_leg(shut, Pose2(3.6, 2.5), Pose2(2.9, 2.5)) is None


@pytest.mark.parametrize("width", [1.15, 1.25, 1.4])
def test_in_a_corridor_too_narrow_to_turn_in_the_chair_backs_out(width: float) -> None:
    start, goal = Pose2(6.0, width / 2), Pose2(2.0, width / 2)
    planner = GlobalPlanner(goal)
    path = planner.replan(costmap_from_grid(room(width), CHAIR_A), start)
    assert [leg.backwards for leg in planner.legs] == [True]
    assert path.length() == pytest.approx(4.0, abs=0.05)


def test_no_direct_leg_leads_through_a_one_way_zone() -> None:
    zone = Zone("ramp", Rule.ONE_WAY, np.array([[3.0, 0.0], [5.0, 0.0], [5.0, 5.0], [3.0, 5.0]]), math.pi / 2)
    costmap = costmap_from_grid(room(5.0), CHAIR_A, zones=(zone,))
    assert direct_leg(costmap, Pose2(4.0, 2.5), Pose2(4.4, 2.5)) is None


def test_a_turn_on_the_spot_needs_room_all_round() -> None:
    start = Pose2(4.0, 0.5)
    assert turning_leg(costmap_from_grid(room(5.0), CHAIR_A), Pose2(4.0, 2.5), 2.0) is not None
    assert turning_leg(costmap_from_grid(room(1.0), CHAIR_A), start, math.pi / 2) is None
