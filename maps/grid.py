"""Where cells lie: indices are (row=y, col=x) of `OccupancyGrid.cells`, points (N, 2) [m] are in the map frame."""

from __future__ import annotations

import numpy as np

from waychair.errors import MapError
from waychair.geometry import transform_points
from waychair.types import BoolArray, FloatArray, IntArray, OccupancyGrid

OCCUPIED_FROM = 65
"""Smallest value of an occupied cell [%] (map_server's default occupied_thresh)."""


MOST_CELLS = 64_000_000
"""A map that is read has no more cells than this, 400 m by 400 m at 5 cm: a plan takes some fifty bytes for each."""


def check_size(what: str, height: int, width: int) -> None:
    """Refuse a map with more cells than there is memory for; `what` it is begins the sentence.

    Raises:
        MapError: it has more than `MOST_CELLS`.
    """
    if height * width > MOST_CELLS:
        raise MapError(
            f"{what} is of {width} by {height} cells, and {MOST_CELLS} are the most that can be planned on; cut it to "
            "the part that is driven in, or take coarser cells"
        )


def cells_from_points(grid: OccupancyGrid, points: FloatArray) -> IntArray:
    """(N, 2) row and column of the cells that hold the points; not limited to the grid's extent."""
    local = transform_points(grid.map_from_grid.inverse(), np.atleast_2d(points))
    return np.floor(local[:, ::-1] / grid.resolution).astype(np.int64)


def points_from_cells(grid: OccupancyGrid, cells: IntArray) -> FloatArray:
    """(N, 2) centres [m] of cells given as (N, 2) row and column."""
    local = (np.atleast_2d(cells)[:, ::-1].astype(np.float64) + 0.5) * grid.resolution
    return transform_points(grid.map_from_grid, local)


def inside(grid: OccupancyGrid, cells: IntArray) -> BoolArray:
    """(N,) whether each (row, column) lies in the grid."""
    rows, cols = cells.T
    height, width = grid.cells.shape
    result: BoolArray = (rows >= 0) & (rows < height) & (cols >= 0) & (cols < width)
    return result


def cells_under(grid: OccupancyGrid, points: FloatArray) -> IntArray:
    """(K, 2) row and column of those of points (N, 2) [m] in map that lie in the grid."""
    cells = cells_from_points(grid, points)
    return cells[inside(grid, cells)]


def occupied(grid: OccupancyGrid) -> BoolArray:
    """(H, W) cells that are surely occupied."""
    result: BoolArray = grid.cells >= OCCUPIED_FROM
    return result


def cells_where(mask: BoolArray) -> IntArray:
    """(N, 2) rows and columns of the cells that hold, in order: `np.argwhere`, many times as fast where there are few."""
    return np.column_stack(np.unravel_index(np.flatnonzero(mask), mask.shape))


def occupied_points(grid: OccupancyGrid) -> FloatArray:
    """(N, 2) centres [m] of the occupied cells."""
    return points_from_cells(grid, cells_where(occupied(grid)))
