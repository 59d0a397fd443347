"""Distance of every cell from the nearest obstacle: the Euclidean distance transform of a grid, in metres.

Convention: distances are measured between cell *centres*, so an occupied cell holds 0 and its neighbour one cell side.
The facing side of an obstacle that fills its cell is half a cell nearer. For a guaranteed distance, subtract
`sqrt(1/2)` of a cell: the obstacle may be anywhere inside its cell.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

from waychair.calibration.chair_body import BodyLayer
from waychair.maps.grid.cells import cells_from_points, inside, occupied
from waychair.types import BoolArray, Float32Array, FloatArray, IntArray, OccupancyGrid, Pose2


@dataclass(frozen=True, slots=True)
class DistanceField:
    """Distances (H, W) float32 [m], `metres[row=y, col=x]`, with the geometry of the grid they were measured on.

    `layers`: for each layer of the chair's body with its own outline, the distances to the obstacles at its heights.
    """

    metres: Float32Array
    resolution: float
    map_from_grid: Pose2 = field(default_factory=Pose2)
    layers: tuple[tuple[BodyLayer, Float32Array], ...] = ()

    def seen_from(self, frame_from_map: Pose2) -> DistanceField:
        """Return the same field in another frame."""
        return replace(self, map_from_grid=frame_from_map @ self.map_from_grid)

    def to_anything(self) -> Float32Array:
        """Return the distances (H, W) [m] to obstacles of any height."""
        nearest: Float32Array = np.minimum.reduce([self.metres, *(metres for _, metres in self.layers)])
        return nearest


def distance_field(grid: OccupancyGrid) -> DistanceField:
    """Return distances to the occupied cells of a grid; unknown cells are no obstacles here."""
    return DistanceField(distances(occupied(grid), grid.resolution), grid.resolution, grid.map_from_grid)


def distances(obstacles: BoolArray, resolution: float) -> Float32Array:
    """Return distances (H, W) float32 [m] from every cell's centre to that of the nearest cell of an (H, W) mask.

    Exact up to float32 rounding (Felzenszwalb and Huttenlocher 2012, as in cv2.distanceTransform's precise mask).
    Without any obstacle every cell holds the diagonal of the grid, which is farther than anything inside it.
    """
    diagonal = resolution * math.hypot(*obstacles.shape)
    if not obstacles.any():
        return np.full(obstacles.shape, diagonal, np.float32)
    cells = cv2.distanceTransform((~obstacles).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    result: Float32Array = np.asarray(cells, np.float32) * np.float32(resolution)
    return result


def are_within(metres: Float32Array, grid: OccupancyGrid, points: FloatArray, reach: float | FloatArray) -> BoolArray:
    """Return (N,) which points (N, 2) [m] in map lie in cells at most `reach` [m] from an obstacle; off the grid, none.

    Args:
        metres: the `distances` (H, W) of the grid's obstacles.
        grid: gives the cells of the points.
        points: (N, 2) [m].
        reach: one distance for all points, or (N,) one for each.
    """
    cells = cells_from_points(grid, points)
    on_grid = inside(grid, cells)
    within = np.zeros(len(points), np.bool_)
    within[on_grid] = metres[tuple(cells[on_grid].T)] <= np.broadcast_to(reach, len(points))[on_grid]
    return within


def near_distances(obstacles: BoolArray, resolution: float, reach: float) -> Float32Array:
    """Return `distances` clipped to `reach` [m]; `update_near` keeps them up to date.

    They are the same to the last bit however the grid is cut, since squared distances in cells are whole numbers. A
    short reach takes less than half the time of `distances`.
    """
    cells = max(1, math.ceil(reach / resolution))
    if cells <= _SHORT and obstacles.size:
        whole = np.ascontiguousarray(obstacles)  # so that no second kernel is compiled for windows of grids
        return _near_distances(whole, cells, np.float32(resolution), np.float32(reach))
    found = distances(obstacles, 1.0)
    exact = np.sqrt(np.rint(found * found)) * np.float32(resolution)
    result: Float32Array = np.minimum(exact, np.float32(reach)) if obstacles.any() else np.full_like(found, reach)
    return result


def window_distances(obstacles: BoolArray, resolution: float) -> Float32Array:
    """Return `near_distances` of a window, up to half its longer side: no cell is farther from the unknown outside."""
    return near_distances(obstacles, resolution, resolution * max(obstacles.shape) / 2)


_SHORT, _AT_ONCE = 178, 4
"""Longest reach [cells] of the fast path, and columns it takes at once: the sum of their squares must fit uint16."""


def update_near(
    metres: Float32Array, obstacles: BoolArray, changed: IntArray, resolution: float, reach: float
) -> list[tuple[slice, slice]]:
    """Update `near_distances` (H, W) in place for obstacles (H, W) that changed only in the cells `changed` (N, 2).

    A cell's distance depends only on obstacles within `reach`, so only cells within `reach` of a change are computed
    anew, from a window twice as wide. Changes are grouped by tiles, so that two distant ones do not cost the area
    between them. Return the windows (rows, columns) that were computed.
    """
    span = math.ceil(reach / resolution)
    windows = []
    tiles, which = np.unique(changed // max(span, 16), axis=0, return_inverse=True)
    for tile in range(len(tiles)):
        cells = changed[which.ravel() == tile]
        low, high = cells.min(axis=0) - span, cells.max(axis=0) + span + 1
        inner, outer = (_window(low - more, high + more, metres.shape) for more in (0, span))
        part = near_distances(obstacles[outer], resolution, reach)
        rows, columns = (slice(i.start - o.start, i.stop - o.start) for i, o in zip(inner, outer, strict=True))
        metres[inner] = part[rows, columns]
        windows.append(inner)
    return windows


def _window(low: IntArray, high: IntArray, shape: tuple[int, ...]) -> tuple[slice, slice]:
    """Return rows and columns from `low` to before `high`, limited to the shape."""
    rows, columns = (slice(max(int(a), 0), min(int(b), n)) for a, b, n in zip(low, high, shape, strict=True))
    return rows, columns


@njit(cache=True, nogil=True)
def _near_distances(obstacles: BoolArray, cells: int, resolution: np.float32, reach: np.float32) -> Float32Array:
    """Return `near_distances` for at most `_SHORT` cells of reach: along the columns, then the squares along each row.

    For each row, columns are compared outwards until their offset exceeds the row's largest distance. This takes more
    operations than the lower envelope of parabolas, but plain loops over uint16 run 32 of them at a time.
    """
    height, width = obstacles.shape
    up_or_down = np.empty((height, width), np.uint16)
    one, far = np.uint16(1), np.uint16(cells)
    for i in range(height):
        row = up_or_down[i]
        for j in range(width):
            row[j] = np.uint16(0) if obstacles[i, j] else far
        if i > 0:
            before = up_or_down[i - 1]
            for j in range(width):
                row[j] = min(row[j], np.uint16(before[j] + one))
    for i in range(height - 2, -1, -1):
        row, after = up_or_down[i], up_or_down[i + 1]
        for j in range(width):
            row[j] = min(row[j], np.uint16(after[j] + one))

    metres = np.empty((height, width), np.float32)
    begin = cells + _AT_ONCE
    squares = np.full(width + 2 * begin, cells * cells, np.uint16)  # beyond the grid there is nothing
    least = np.empty(width, np.uint16)
    for i in range(height):
        row, here = up_or_down[i], squares[begin : begin + width]
        aside, farthest = 1, np.uint16(0)
        for j in range(width):
            here[j] = row[j] * row[j]
            least[j] = here[j]
            farthest = max(farthest, least[j])
        while aside * aside < farthest:
            farthest = _nearer(least, squares, begin, aside)
            aside += _AT_ONCE
        for j in range(width):
            metres[i, j] = min(np.float32(math.sqrt(np.float32(least[j]))) * resolution, reach)
    return metres


@njit(cache=True, inline="always")
def _nearer(least: NDArray[np.uint16], squares: NDArray[np.uint16], begin: int, aside: int) -> np.uint16:
    """Lower a row's smallest squares (W,) by those from four columns on each side; return the largest that is left."""
    width = len(least)
    left_0, right_0 = squares[begin - aside :][:width], squares[begin + aside :][:width]
    left_1, right_1 = squares[begin - aside - 1 :][:width], squares[begin + aside + 1 :][:width]
    left_2, right_2 = squares[begin - aside - 2 :][:width], squares[begin + aside + 2 :][:width]
    left_3, right_3 = squares[begin - aside - 3 :][:width], squares[begin + aside + 3 :][:width]
    more_0, more_1 = np.uint16(aside**2), np.uint16((aside + 1) ** 2)
    more_2, more_3 = np.uint16((aside + 2) ** 2), np.uint16((aside + 3) ** 2)
    farthest = np.uint16(0)
    for j in range(width):
        near = min(
            np.uint16(min(left_0[j], right_0[j]) + more_0),
            np.uint16(min(left_1[j], right_1[j]) + more_1),
        )
        farther = min(
            np.uint16(min(left_2[j], right_2[j]) + more_2),
            np.uint16(min(left_3[j], right_3[j]) + more_3),
        )
        least[j] = min(least[j], min(near, farther))
        farthest = max(farthest, least[j])
    return farthest


@njit(cache=True, inline="always")
def interpolated(metres: Float32Array, column: float, row: float) -> float:
    """Return the bilinear distance [m] at a point in cells (0.5, 0.5 is the centre of cell (0, 0)); 0 off the grid.

    Near obstacles it exceeds the true distance by at most 0.15 cells (the cone round a single obstacle, at the middle
    of four centres); between two obstacles it is below the true distance.
    """
    height, width = metres.shape
    if not (0.0 <= column < width and 0.0 <= row < height):
        return 0.0
    x = min(max(column - 0.5, 0.0), width - 1.0)
    y = min(max(row - 0.5, 0.0), height - 1.0)
    left, below = int(x), int(y)
    right, above = min(left + 1, width - 1), min(below + 1, height - 1)
    x -= left
    y -= below
    low = metres[below, left] + x * (metres[below, right] - metres[below, left])
    high = metres[above, left] + x * (metres[above, right] - metres[above, left])
    return float(low + y * (high - low))
