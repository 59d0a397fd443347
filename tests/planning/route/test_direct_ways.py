"""Straight ways to near goals, in both gears, and back out of corridors without room to turn."""

from __future__ import annotations

import math

import numpy as np
import pytest

from waychair.calibration.chair_body import CHAIR_A
from waychair.maps.drawn.zones import Rule, Zone
from waychair.planning.grid.costmap import Costmap, costmap_from_grid
from waychair.planning.route.global_planner import GlobalPlanner
from waychair.planning.route.legs import PathLeg, joined_legs
from waychair.planning.route.way_making import turning_leg
from waychair.planning.route.way_pieces import is_against_one_way
from waychair.types import OccupancyGrid, Pose2


def room(width: float, length: float = 9.0) -> OccupancyGrid:
    """Return a free rectangle from the origin between walls of one cell."""
    cells = np.full((round(width / 0.05) + 2, round(length / 0.05) + 2), 100, np.int8)
    cells[1:-1, 1:-1] = 0
    return OccupancyGrid(cells, 0.05, Pose2(-0.05, -0.05, 0.0))


def legs_to(goal: Pose2, costmap: Costmap, start: Pose2) -> tuple[PathLeg, ...]:
    planner = GlobalPlanner(goal)
    planner.replan(costmap, start)
    return planner.legs


def turned(poses: np.ndarray) -> float:
    return float(np.abs(np.diff(np.unwrap(poses[:, 2]))).sum())


@pytest.mark.parametrize("back", [0.1, 0.4, 0.9])
def test_a_chair_backs_to_a_goal_that_is_straight_behind_it(back: float) -> None:
    start = Pose2(4.0, 2.5, 0.3)
    (leg,) = legs_to(start @ Pose2(-back), costmap_from_grid(room(5.0), CHAIR_A), start)
    assert leg.backwards
    assert turned(leg.path.poses) == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("goal", [(0.5, 0.1, 0.3), (-0.6, 0.1, -0.2), (0.05, 0.4, 0.0), (-0.3, -0.3, math.pi)])
def test_a_way_to_a_near_goal_is_one_leg_and_turns_at_most_once_round(goal: tuple[float, float, float]) -> None:
    start = Pose2(4.0, 2.5, 1.1)
    legs = legs_to(start @ Pose2(*goal), costmap_from_grid(room(5.0), CHAIR_A), start)
    poses = np.concatenate([start.array()[None], joined_legs(legs).poses])
    assert len(legs) == 1
    assert poses[-1, :2] == pytest.approx((start @ Pose2(*goal)).array()[:2])
    assert math.cos(poses[-1, 2] - (start @ Pose2(*goal)).theta) == pytest.approx(1.0)
    assert turned(poses) < math.tau


def test_a_chair_with_room_to_turn_backs_to_no_far_goal() -> None:
    legs = legs_to(Pose2(2.0, 2.5), costmap_from_grid(room(5.0), CHAIR_A), Pose2(4.0, 2.5))
    assert not any(leg.backwards for leg in legs)


@pytest.mark.parametrize("width", [1.15, 1.25, 1.4])
def test_in_a_corridor_too_narrow_to_turn_in_the_chair_backs_out(width: float) -> None:
    start, goal = Pose2(6.0, width / 2), Pose2(2.0, width / 2)
    planner = GlobalPlanner(goal)
    path = planner.replan(costmap_from_grid(room(width), CHAIR_A), start)
    assert [leg.backwards for leg in planner.legs] == [True]
    assert path.length() == pytest.approx(4.0, abs=0.05)


def test_no_straight_way_leads_against_a_one_way_zone() -> None:
    zone = Zone("ramp", Rule.ONE_WAY, np.array([[3.0, 0.0], [5.0, 0.0], [5.0, 5.0], [3.0, 5.0]]), math.pi / 2)
    costmap = costmap_from_grid(room(5.0), CHAIR_A, zones=(zone,))
    legs = legs_to(Pose2(4.0, 2.1, -math.pi / 2), costmap, Pose2(4.0, 2.5, -math.pi / 2))
    assert not any(is_against_one_way(costmap, leg.path.poses[:, :2]) for leg in legs)


def test_a_turn_on_the_spot_needs_room_all_round() -> None:
    start = Pose2(4.0, 0.5)
    assert turning_leg(costmap_from_grid(room(5.0), CHAIR_A), Pose2(4.0, 2.5), 2.0) is not None
    assert turning_leg(costmap_from_grid(room(1.0), CHAIR_A), start, math.pi / 2) is None
