"""Paths are straight before they enter a door."""

from __future__ import annotations

import math

import numpy as np
import pytest

from waychair.calibration.chair_body import CHAIR_A
from waychair.planning.grid.costmap import Costmap, costmap_from_grid
from waychair.planning.route.door_alignment import line_up
from waychair.planning.route.global_planner import GlobalPlanner, plan
from waychair.planning.route.legs import DrivingManner, PathLeg
from waychair.types import FloatArray, OccupancyGrid, Pose2

CELL = 0.05


def doorway(width: float, corridor: float = 0.15) -> Costmap:
    """12 x 8 m with a wall at x = 5 m of a thickness [m] and an opening round y = 4 m."""
    cells = np.zeros((160, 240), np.int8)
    cells[[0, -1]], cells[:, [0, -1]] = 100, 100
    cells[:, 100 : 100 + round(corridor / CELL)] = 100
    half = round(width / CELL / 2)
    cells[80 - half : 80 + half, 100 : 100 + round(corridor / CELL)] = 0
    return costmap_from_grid(OccupancyGrid(cells, CELL), CHAIR_A)


@pytest.mark.parametrize("width", [0.8, 0.9, 1.1])
@pytest.mark.parametrize(("x", "y"), [(2.0, 1.0), (2.0, 4.0), (3.0, 7.0)])
def test_the_path_is_on_the_doors_axis_from_80_cm_before_it(width: float, x: float, y: float) -> None:
    poses = plan(doorway(width), Pose2(x, y), Pose2(9.0, 5.5)).poses
    run = poses[(poses[:, 0] > 4.3) & (poses[:, 0] < 5.4)]
    assert len(run) > 8
    assert np.abs(run[:, 1] - 4.0).max() < 0.06
    goes = np.hypot(*np.diff(run[:, :2], axis=0).T) > 0.0
    assert np.abs(run[:-1, 2][goes]).max() < math.radians(12)


def test_without_the_straight_approach_the_path_would_cut_the_corner() -> None:
    poses = plan(doorway(0.9), Pose2(3.0, 7.0), Pose2(9.0, 5.5), check_footprint=False).poses
    before = poses[(poses[:, 0] > 4.0) & (poses[:, 0] < 4.3)]
    assert np.abs(before[:, 1] - 4.0).max() > 0.2


def points_of(poses: FloatArray) -> FloatArray:
    points: FloatArray = poses[:, :2] / CELL
    return points


def test_a_wide_opening_and_a_long_corridor_leave_the_path_unchanged() -> None:
    wide = points_of(plan(doorway(2.0), Pose2(2.0, 4.0), Pose2(9.0, 4.0)).poses)
    np.testing.assert_array_equal(line_up(doorway(2.0), wide, 0.6, 1.0)[0], wide)
    long = points_of(plan(doorway(1.0, 3.0), Pose2(2.0, 4.0), Pose2(10.0, 4.0)).poses)
    np.testing.assert_array_equal(line_up(doorway(1.0, 3.0), long, 0.6, 1.0)[0], long)


def test_two_doors_in_a_row_share_one_straight_approach() -> None:
    cells = np.zeros((160, 240), np.int8)
    for column in (100, 108):
        cells[:, column : column + 2] = 100
        cells[72:88, column : column + 2] = 0
    costmap = costmap_from_grid(OccupancyGrid(cells, CELL), CHAIR_A)
    bent = np.column_stack([np.arange(60.0, 130.0), 80.0 + 4.0 * np.sin(np.arange(70) / 8.0)])
    lined, run_ends = line_up(costmap, bent, 0.6, 1.0)
    assert len(lined) < len(bent)
    assert run_ends.sum() == 2
    assert np.abs(lined[run_ends, 1] - 80.0).max() < 1.0


def test_a_single_pillar_does_not_count_as_a_door() -> None:
    cells = np.zeros((160, 240), np.int8)
    cells[80:84, 100:104] = 100
    costmap = costmap_from_grid(OccupancyGrid(cells, CELL), CHAIR_A)
    past = np.column_stack([np.arange(60.0, 160.0, 2.0), np.full(50, 92.0)])
    np.testing.assert_array_equal(line_up(costmap, past, 0.6, 1.0)[0], past)


def test_a_start_inside_the_door_is_unchanged() -> None:
    poses = plan(doorway(0.9), Pose2(5.0, 4.0), Pose2(9.0, 5.5)).poses
    np.testing.assert_allclose(poses[0, :2], [5.0, 4.0])
    assert (np.diff(poses[:, 0]) >= 0).all()


def corridor_with_door(width: float) -> Costmap:
    """A corridor 2 m wide along y = 2 m, and a room north of it, through a door round x = 6 m."""
    cells = np.zeros((120, 240), np.int8)
    cells[[0, -1]], cells[:, [0, -1]] = 100, 100
    cells[18:20], cells[60:62] = 100, 100
    half = round(width / CELL / 2)
    cells[60:62, 120 - half : 120 + half] = 0
    return costmap_from_grid(OccupancyGrid(cells, CELL), CHAIR_A)


def legs(costmap: Costmap, start: Pose2, goal: Pose2) -> tuple[PathLeg, ...]:
    planner = GlobalPlanner(goal)
    planner.replan(costmap, start)
    return planner.legs


@pytest.mark.parametrize("start", [2.0, 10.0])
def test_a_door_round_a_sharp_corner_is_aligned_with_and_passed_straight(start: float) -> None:
    way = legs(corridor_with_door(0.9), Pose2(start, 2.0), Pose2(6.0, 5.0, math.pi / 2))
    (k,) = (k for k, leg in enumerate(way) if leg.manner is DrivingManner.DOOR)
    before, through = way[k - 1].path.poses, way[k].path.poses
    assert before[-1, 2] == pytest.approx(math.pi / 2, abs=0.05), "straight before the door"
    np.testing.assert_array_equal(before[-1, :2], through[0, :2])
    assert np.abs(through[:, 0] - 6.0).max() < 0.06, "on the door's axis"
    assert through[0, 1] + CHAIR_A.front < 3.05 < through[-1, 1] - CHAIR_A.rear
    assert way[k].door is not None
    assert way[k].door.width == pytest.approx(0.9, abs=0.06)


def test_a_wide_door_is_approached_in_a_curve() -> None:
    way = legs(corridor_with_door(2.0), Pose2(2.0, 2.0), Pose2(6.0, 5.0, math.pi / 2))
    assert [leg.manner for leg in way] == [DrivingManner.FREE, DrivingManner.EXACT]
    assert way[0].flows


def test_a_straight_start_in_the_door_continues_from_there_and_a_goal_in_it_ends_there() -> None:
    costmap = doorway(0.8)
    begin = legs(costmap, Pose2(5.0, 4.0, 0.02), Pose2(9.0, 4.0))
    assert begin[0].manner is DrivingManner.DOOR
    assert begin[0].path.poses[0, 0] == pytest.approx(5.0, abs=0.02)
    end = legs(costmap, Pose2(2.0, 4.0), Pose2(5.0, 4.0, 0.0))
    (door,) = (leg for leg in end if leg.manner is DrivingManner.DOOR)
    assert door.path.poses[-1, 0] == pytest.approx(5.0, abs=0.02)


def test_a_narrow_place_without_a_measured_door_is_planned_like_any_other_from_then_on() -> None:
    costmap = doorway(0.8)
    planner = GlobalPlanner(Pose2(9.0, 4.0))
    planner.replan(costmap, Pose2(2.0, 4.0))
    (leg,) = (leg for leg in planner.legs if leg.manner is DrivingManner.DOOR)
    assert leg.door is not None
    planner.distrust(leg.door)
    path = planner.replan(costmap, Pose2(3.0, 4.2))
    assert path.poses[-1, 0] == pytest.approx(9.0)
    assert not any(leg.manner is DrivingManner.DOOR for leg in planner.legs)
