"""Gaps on the path between mapped obstacles: glass may stand there, which no lidar sees."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from waychair.geometry import compose
from waychair.maps.grid.cells import OCCUPIED_FROM
from waychair.types import Cells, FloatArray, IntArray, OccupancyGrid

_SKEW, _CHORDS = math.radians(50.0), 11
"""Largest angle [rad] between path and a gap's normal, and the number of directions that are tried within it."""

_LONGEST = 1.6
"""A narrow stretch longer than this [m] is a corridor: the chair looks along it, so only its ends count as gaps."""


def openings(grid: OccupancyGrid, poses: FloatArray, widest: float) -> IntArray:
    """Return the indices of poses (N, 3) [m, m, rad] in map, each headed to the next, in the middle of a gap.

    A gap is at most `widest` [m] wide, between two mapped obstacles. Of a corridor that narrow, both ends count.
    """
    cell, turns = grid.resolution, np.linspace(-_SKEW, _SKEW, _CHORDS)
    in_cells = compose(grid.map_from_grid.inverse().array(), poses) / (cell, cell, 1.0)
    width = cell * _chords(grid.cells, OCCUPIED_FROM, in_cells, turns, widest / cell)
    along = np.concatenate([[0.0], np.hypot(*np.diff(poses[:, :2], axis=0).T).cumsum()])
    edges = np.flatnonzero(np.diff(np.concatenate([[False], width <= widest, [False]]).astype(np.int8)))
    found: list[int] = []
    for first, after in edges.reshape(-1, 2).tolist():
        if along[after - 1] - along[first] > _LONGEST:
            found += [first, after - 1]
        else:
            found.append((first + after - 1) // 2)
    return np.array(found, np.int64)


@njit(cache=True, nogil=True)
def _chords(cells: Cells, occupied_from: int, poses: FloatArray, turns: FloatArray, reach: float) -> FloatArray:
    """Return (N,) the shortest line through each pose between two occupied cells; +inf where none is within `reach`.

    The lines are normal to the poses (N, 3) [cells, cells, rad], turned by each of `turns` [rad]; lengths in cells.
    """
    shortest = np.full(len(poses), np.inf)
    for i in range(len(poses)):
        for turn in turns:
            dx, dy = -math.sin(poses[i, 2] + turn), math.cos(poses[i, 2] + turn)
            left = _free(cells, occupied_from, poses[i, 0], poses[i, 1], dx, dy, reach)
            if left < reach:
                right = _free(cells, occupied_from, poses[i, 0], poses[i, 1], -dx, -dy, reach - left)
                if right < reach - left:
                    shortest[i] = min(shortest[i], left + right)
    return shortest


@njit(cache=True, nogil=True)
def _free(cells: Cells, occupied_from: int, x: float, y: float, dx: float, dy: float, reach: float) -> float:
    """Return how far [cells] a ray is free before an occupied cell, in steps of half a cell; +inf if it meets none."""
    for step in range(math.ceil(2.0 * reach)):
        column, row = math.floor(x + 0.5 * step * dx), math.floor(y + 0.5 * step * dy)
        if row < 0 or column < 0 or row >= cells.shape[0] or column >= cells.shape[1]:
            return np.inf
        if cells[row, column] >= occupied_from:
            return 0.5 * step
    return np.inf
