"""Paths are straight before they enter a door."""

from __future__ import annotations

import math

import numpy as np
import pytest

from waychair.calibration.chair import CHAIR_A
from waychair.planning.costmap import Costmap, costmap_from_grid
from waychair.planning.global_planner import PlannerSettings, plan
from waychair.planning.narrows import line_up
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
    assert np.abs(run[:-1, 2]).max() < math.radians(12)


def test_without_the_run_up_the_path_would_cut_the_corner() -> None:
    poses = plan(doorway(0.9), Pose2(3.0, 7.0), Pose2(9.0, 5.5), PlannerSettings(narrow=0.0)).poses
    before = poses[(poses[:, 0] > 4.0) & (poses[:, 0] < 4.3)]
    assert np.abs(before[:, 1] - 4.0).max() > 0.2


def points_of(poses: FloatArray) -> FloatArray:
    points: FloatArray = poses[:, :2] / CELL
    return points


def test_a_wide_opening_and_a_long_corridor_leave_the_path_as_it_is() -> None:
    wide = points_of(plan(doorway(2.0), Pose2(2.0, 4.0), Pose2(9.0, 4.0)).poses)
    np.testing.assert_array_equal(line_up(doorway(2.0), wide, 0.6, 1.0), wide)
    long = points_of(plan(doorway(1.0, 3.0), Pose2(2.0, 4.0), Pose2(10.0, 4.0)).poses)
    np.testing.assert_array_equal(line_up(doorway(1.0, 3.0), long, 0.6, 1.0), long)


def test_a_single_pillar_is_no_door() -> None:
    cells = np.zeros((160, 240), np.int8)
    cells[80:84, 100:104] = 100
    costmap = costmap_from_grid(OccupancyGrid(cells, CELL), CHAIR_A)
    past = np.column_stack([np.arange(60.0, 160.0, 2.0), np.full(50, 92.0)])
    np.testing.assert_array_equal(line_up(costmap, past, 0.6, 1.0), past)


def test_a_start_inside_the_door_is_left_alone() -> None:
    poses = plan(doorway(0.9), Pose2(5.0, 4.0), Pose2(9.0, 5.5)).poses
    np.testing.assert_allclose(poses[0, :2], [5.0, 4.0])
    assert (np.diff(poses[:, 0]) > 0).all()
