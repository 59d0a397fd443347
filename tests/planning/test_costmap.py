"""Where the chair may go and what it costs."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waychair.calibration.chair import CHAIR_A, CHAIR_B
from waychair.planning.costmap import CostmapSettings, costmap_from_grid
from waychair.types import OccupancyGrid, Pose2


def corridor(width: float, resolution: float = 0.05, length: float = 4.0) -> OccupancyGrid:
    """Free floor of a width between two walls along x."""
    rows = round(width / resolution)
    cells = np.zeros((rows + 2, round(length / resolution)), np.int8)
    cells[[0, -1]] = 100
    return OccupancyGrid(cells, resolution)


@pytest.mark.parametrize(("width", "passable"), [(0.60, False), (0.65, False), (0.75, True), (0.80, True)])
def test_a_corridor_is_passable_from_the_chairs_width_and_margins_on(width: float, passable: bool) -> None:
    assert bool((costmap_from_grid(corridor(width), CHAIR_A).prices[:, 40] > 0).any()) is passable


def test_a_wider_chair_needs_a_wider_corridor() -> None:
    assert not costmap_from_grid(corridor(0.75), CHAIR_B).prices.any()


def test_the_middle_of_a_corridor_is_the_cheapest_place() -> None:
    prices = costmap_from_grid(corridor(1.55), CHAIR_A).prices[:, 40]
    passable = np.flatnonzero(prices)
    assert int(passable[np.argmin(prices[passable])]) == len(prices) // 2
    middle = prices[len(prices) // 2 : passable[-1] + 1]
    assert (np.diff(middle) > 0).all()


def test_open_floor_has_the_price_of_a_free_cell() -> None:
    costmap = costmap_from_grid(corridor(4.0), CHAIR_A)
    assert costmap.prices[42, 40] == 1000
    assert costmap.clearance[42, 40] > 1.0


def test_unknown_cells_are_free_at_a_price_and_no_obstacles() -> None:
    grid = OccupancyGrid(np.full((9, 9), -1, np.int8), 0.1)
    costmap = costmap_from_grid(grid, CHAIR_A, CostmapSettings(unknown_price=2500))
    assert (costmap.prices == 3500).all()


def test_live_points_close_cells_and_points_off_the_map_are_ignored() -> None:
    grid = OccupancyGrid(np.zeros((60, 60), np.int8), 0.05, Pose2(1.0, 2.0))
    points = np.array([[2.5, 3.5], [-90.0, 0.0], [1.0, 50.0]])
    costmap = costmap_from_grid(grid, CHAIR_A, live_points=points)
    assert (costmap.clearance == 0).sum() == 1
    assert costmap.clearance[30, 30] == 0
    assert costmap.prices[30, 30] == 0
    assert costmap.grid.cells[30, 30] == 100
    assert grid.cells[30, 30] == 0
    assert costmap.prices[30, 37] == 0
    assert costmap.prices[30, 38] > 0


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=30, deadline=None)
def test_price_never_rises_with_clearance(seed: int) -> None:
    rng = np.random.default_rng(seed)
    grid = OccupancyGrid(np.where(rng.random((40, 40)) < 0.005, 100, 0).astype(np.int8), 0.05)
    costmap = costmap_from_grid(grid, CHAIR_A)
    order = np.argsort(costmap.clearance, axis=None)
    prices = costmap.prices.ravel()[order]
    passable = prices[prices > 0]
    assert (np.diff(passable) <= 0).all()
    assert (costmap.clearance[costmap.prices == 0] < 0.36).all()
