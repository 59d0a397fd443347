"""Cells and points of a grid: cells are (row=y, col=x) of `OccupancyGrid.cells`, points (N, 2) [m] are in map."""

from __future__ import annotations

import numpy as np

from waychair.errors import MapError
from waychair.geometry import transform_points
from waychair.types import UNKNOWN, BoolArray, FloatArray, IntArray, OccupancyGrid

OCCUPIED_FROM = 65
"""Smallest value of an occupied cell [%] (map_server's default occupied_thresh)."""

BESIDE = 2
"""Cells by which a depth camera shows the same wall beside a lidar."""

MOST_CELLS = 64_000_000
"""The largest map that is made or planned on [cells], 400 m by 400 m at 5 cm: planning takes some fifty bytes a cell."""


def check_size(what: str, height: int, width: int) -> None:
    """Refuse a map with more cells than there is memory for; `what` begins the error.

    Raises:
        MapError: it has more than `MOST_CELLS`.
    """
    if height * width > MOST_CELLS:
        raise MapError(
            f"{what} has {width} by {height} cells, more than the {MOST_CELLS} that can be planned on; cut it to the "
            "part that the chair drives in, or use coarser cells"
        )


def coarser(grid: OccupancyGrid, times: int) -> OccupancyGrid:
    """Return a grid whose cells are made of `times` by `times` cells: occupied where one is, else unknown where one is.

    The lower left corner stays; beyond the other edges the new cells are unknown.
    """
    if times == 1:
        return grid
    height, width = grid.cells.shape
    rows, cols = -(-height // times), -(-width // times)
    most = np.full((rows, cols), UNKNOWN, np.int8)
    least = np.full((rows, cols), 100, np.int8)
    for row in range(times):
        for col in range(times):
            part = grid.cells[row::times, col::times]
            window = slice(part.shape[0]), slice(part.shape[1])
            np.maximum(most[window], part, out=most[window])
            np.minimum(least[window], part, out=least[window])
            least[part.shape[0] :] = least[:, part.shape[1] :] = UNKNOWN
    cells = np.where((least < 0) & (most < OCCUPIED_FROM), np.int8(UNKNOWN), most)
    return OccupancyGrid(cells, grid.resolution * times, grid.map_from_grid)


def cells_from_points(grid: OccupancyGrid, points: FloatArray) -> IntArray:
    """Return row and column (N, 2) of the cells that hold the points; these may lie outside the grid."""
    local = transform_points(grid.map_from_grid.inverse(), np.atleast_2d(points))
    return np.floor(local[:, ::-1] / grid.resolution).astype(np.int64)


def points_from_cells(grid: OccupancyGrid, cells: IntArray) -> FloatArray:
    """Return the centres (N, 2) [m] of cells given as row and column (N, 2)."""
    local = (np.atleast_2d(cells)[:, ::-1].astype(np.float64) + 0.5) * grid.resolution
    return transform_points(grid.map_from_grid, local)


def inside(grid: OccupancyGrid, cells: IntArray) -> BoolArray:
    """Return (N,) whether each (row, column) lies in the grid."""
    rows, cols = cells.T
    height, width = grid.cells.shape
    result: BoolArray = (rows >= 0) & (rows < height) & (cols >= 0) & (cols < width)
    return result


def cells_under(grid: OccupancyGrid, points: FloatArray) -> IntArray:
    """Return row and column (K, 2) of the points (N, 2) [m] in map that lie in the grid."""
    cells = cells_from_points(grid, points)
    return cells[inside(grid, cells)]


def occupied(grid: OccupancyGrid) -> BoolArray:
    """Return which cells (H, W) are occupied: at least `OCCUPIED_FROM`."""
    result: BoolArray = grid.cells >= OCCUPIED_FROM
    return result


def joined_to(grid: OccupancyGrid, x: float, y: float) -> BoolArray:
    """Return the cells (H, W) that are not occupied and joined by their sides to that of a point [m] in map.

    Raises:
        ValueError: the point is not on the grid.
    """
    at = cells_from_points(grid, np.array([[x, y]]))
    if not inside(grid, at).all():
        raise ValueError(f"({x:g}, {y:g}) is not on the grid")
    import cv2  # here, since a lidar's map is saved without it

    _, labels = cv2.connectedComponents((~occupied(grid)).astype(np.uint8), connectivity=4)
    joined: BoolArray = (labels == labels[at[0, 0], at[0, 1]]) & ~occupied(grid)
    return joined


def cells_where(mask: BoolArray) -> IntArray:
    """Return rows and columns (N, 2) of the true cells in order: `np.argwhere`, but much faster for few cells."""
    return np.column_stack(np.unravel_index(np.flatnonzero(mask), mask.shape))


def occupied_points(grid: OccupancyGrid) -> FloatArray:
    """Return the centres (N, 2) [m] of the occupied cells."""
    return points_from_cells(grid, cells_where(occupied(grid)))


def occupied_edges(grid: OccupancyGrid) -> FloatArray:
    """Return the corners (N, 2) [m] of the occupied cells that border on others: the outline of all that stands."""
    shown = np.pad(occupied(grid), 1).astype(np.int8)
    around = shown[:-1, :-1] + shown[1:, :-1] + shown[:-1, 1:] + shown[1:, 1:]
    corners = cells_where((around > 0) & (around < 4))[:, ::-1].astype(np.float64)
    return transform_points(grid.map_from_grid, corners * grid.resolution)


def are_occupied(grid: OccupancyGrid, points: FloatArray) -> BoolArray:
    """Return (N,) whether points (N, 2) [m] in map lie in occupied cells."""
    cells = cells_from_points(grid, points)
    found = inside(grid, cells)
    found[found] = occupied(grid)[tuple(cells[found].T)]
    return found


def unscanned_points(grid: OccupancyGrid, scanned: OccupancyGrid) -> FloatArray:
    """Return the centres (N, 2) [m] of the occupied cells that lie more than `BESIDE` cells off all that scans show.

    `scanned` is the part of the map that a lidar sees; what is left are tops of tables, shelves and beds.
    """
    if scanned is grid:
        return np.empty((0, 2))
    shown = np.pad(occupied(scanned), BESIDE)
    height, width = scanned.cells.shape
    near = np.zeros((height, width), np.bool_)
    for row, col in np.ndindex(2 * BESIDE + 1, 2 * BESIDE + 1):
        near |= shown[row : row + height, col : col + width]
    points = occupied_points(grid)
    cells = cells_from_points(scanned, points)
    explained = inside(scanned, cells)
    explained[explained] = near[tuple(cells[explained].T)]
    found: FloatArray = points[~explained]
    return found
