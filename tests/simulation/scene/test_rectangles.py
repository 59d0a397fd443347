"""Blocks made from the cells of a grid."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from waychair.maps.grid.cells import occupied, points_from_cells
from waychair.simulation.plan.plan_fittings import within_any
from waychair.simulation.scene.rectangles import blocks_from_grid
from waychair.simulation.scene.scene import Finish
from waychair.types import BoolArray, OccupancyGrid, Pose2


@given(
    arrays(np.bool_, array_shapes(min_dims=2, max_dims=2, min_side=1, max_side=9)),
    st.floats(-3.0, 3.0),
)
def test_blocks_cover_exactly_the_occupied_cells_of_a_rotated_grid(cells: BoolArray, theta: float) -> None:
    grid = OccupancyGrid(np.where(cells, 100, -1).astype(np.int8), 0.05, Pose2(-1.0, 2.0, theta))
    blocks = blocks_from_grid(grid, "map", Finish(height=2.4))
    every = np.argwhere(np.ones(cells.shape, np.bool_))
    points = np.column_stack([points_from_cells(grid, every), np.full(len(every), 1.0)])
    np.testing.assert_array_equal(within_any(points, blocks).reshape(cells.shape), occupied(grid))
    assert sum(block.length * block.width for block in blocks) == pytest.approx(cells.sum() * 0.05**2)
    assert {(block.low, block.high) for block in blocks} <= {(0.0, 2.4)}
    assert len({block.seed for block in blocks}) == len(blocks)


def test_blocks_of_one_grid_under_another_name_look_different() -> None:
    grid = OccupancyGrid(np.full((2, 2), 100, np.int8), 0.05)
    assert blocks_from_grid(grid, "a", Finish())[0].seed != blocks_from_grid(grid, "b", Finish())[0].seed
