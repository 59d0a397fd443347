"""The costmap as RViz has colours for it."""

from __future__ import annotations

import importlib.util

import numpy as np
import pytest

from waychair.calibration.chair import CHAIR_A
from waychair.planning.costmap import costmap_from_grid
from waychair.types import OccupancyGrid, Pose2

if importlib.util.find_spec("rclpy") is None:
    pytest.skip("ROS is not installed (no rclpy)", allow_module_level=True)

from waychair.ros.navigation_display import grid_from_costmap

_AT = Pose2(1.0, -2.0, 0.3)


def hall() -> OccupancyGrid:
    """6 m by 4 m with walls round it, and a corner of which nothing is known."""
    cells = np.zeros((80, 120), np.int8)
    cells[[0, -1]] = 100
    cells[:, [0, -1]] = 100
    cells[60:79, 100:119] = -1
    return OccupancyGrid(cells, 0.05, _AT)


def test_walls_the_room_beside_them_and_the_middle_have_nav2s_costs() -> None:
    grid = hall()
    shown = grid_from_costmap(costmap_from_grid(grid, CHAIR_A))
    assert (shown.cells[grid.cells == 100] == 100).all()
    assert (shown.cells[1:6, 20] == 99).all(), "the chair is wider than that"
    assert shown.cells[40, 60] == 0
    rising = shown.cells[40:5:-1, 60]
    assert (np.diff(rising.astype(int)) >= 0).all()
    assert 0 < rising[-3] <= 98
    assert (shown.resolution, shown.map_from_grid) == (grid.resolution, _AT)


def test_what_is_unknown_stays_so_whatever_it_costs() -> None:
    grid = hall()
    shown = grid_from_costmap(costmap_from_grid(grid, CHAIR_A))
    assert (shown.cells[grid.cells == -1] == -1).all()
    assert (shown.cells == -1).sum() == 19 * 19


def test_a_map_without_room_for_the_chair_has_no_cost_between() -> None:
    shown = grid_from_costmap(costmap_from_grid(OccupancyGrid(np.full((5, 5), 100, np.int8), 0.05, Pose2()), CHAIR_A))
    assert (shown.cells == 100).all()
