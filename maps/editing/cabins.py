"""Where a lift's cabin is on a map, seen from the place in front of its door: a narrow gap ahead, and a small room behind it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from waychair.maps.grid.cells import OCCUPIED_FROM, cells_from_points, inside
from waychair.types import BoolArray, FloatArray, OccupancyGrid, Pose2

FARTHEST_DOOR_M, DEEPEST_M, WIDEST_M = 2.5, 3.5, 3.5
"""A lift's door is no farther ahead of its lobby [m], and its cabin no larger."""

NARROWEST_M, WIDEST_DOOR_M, SMALLEST_M = 0.6, 1.6, 0.8
"""Clear widths of a door [m], and least width and depth of a cabin."""

_STEP = 0.025


@dataclass(frozen=True, slots=True)
class Cabin:
    """A cabin: the pose of its middle, facing its door, its width and depth, and its door's clear width [m]."""

    middle: Pose2
    width: float
    depth: float
    door: float


def cabin_ahead(grid: OccupancyGrid, lobby: Pose2) -> Cabin | None:
    """Return the cabin ahead of a pose that looks at its door; None if the map shows none (its door was shut, maybe).

    The pose need not stand in line with the door's middle: the gap is looked for to both sides.
    """
    ahead = np.arange(0.0, FARTHEST_DOOR_M + DEEPEST_M, _STEP)
    aside = np.arange(-WIDEST_M / 2, WIDEST_M / 2 + _STEP / 2, _STEP)
    free = _free(grid, lobby, ahead, aside)
    middle = len(aside) // 2
    gap = _door(free[: int(FARTHEST_DOOR_M / _STEP)], middle)
    if gap is None:
        return None
    row, left, right = gap
    centre = (left + right) // 2
    behind = np.flatnonzero(~free[row:, centre])
    depth_cells = int(behind[0]) if len(behind) else 0
    back = row + depth_cells
    widths = [_span(free[at], centre) for at in range(row, back)]
    wide = [(low, high) for low, high in widths if (high - low + 1) > (right - left + 1) * 1.1]
    spans = wide if len(wide) * _STEP >= SMALLEST_M else widths
    if not spans:
        return None
    low, high = (float(np.median([span[side] for span in spans])) for side in (0, 1))
    width, depth = (high - low + 1) * _STEP, len(spans) * _STEP
    door_width = (right - left + 1) * _STEP
    if not (SMALLEST_M <= width <= WIDEST_M - 2 * _STEP and SMALLEST_M <= depth <= DEEPEST_M):
        return None
    first = back - len(spans)
    at = Pose2(float(ahead[first] + depth / 2), float(aside[0] + (low + high) / 2 * _STEP), math.pi)
    return Cabin(lobby @ at, round(width, 2), round(depth, 2), round(door_width, 2))


def _free(grid: OccupancyGrid, lobby: Pose2, ahead: FloatArray, aside: FloatArray) -> BoolArray:
    """Return (ahead, aside) whether the points before a pose are known to be free."""
    x, y = np.meshgrid(ahead, aside, indexing="ij")
    c, s = math.cos(lobby.theta), math.sin(lobby.theta)
    points = np.column_stack([(lobby.x + c * x - s * y).ravel(), (lobby.y + s * x + c * y).ravel()])
    cells = cells_from_points(grid, points)
    within = inside(grid, cells)
    free = np.zeros(len(points), np.bool_)
    values = grid.cells[tuple(cells[within].T)]
    free[within] = (values >= 0) & (values < OCCUPIED_FROM)
    return free.reshape(x.shape)


def _door(free: BoolArray, middle: int) -> tuple[int, int, int] | None:
    """Return the row of the narrowest gap and its first and last column; None if there is no door."""
    best: tuple[int, int, int] | None = None
    for row, line in enumerate(free):
        if not line[middle]:
            break
        low, high = _span(line, middle)
        width = (high - low + 1) * _STEP
        if NARROWEST_M <= width <= WIDEST_DOOR_M and (best is None or width <= (best[2] - best[1] + 1) * _STEP):
            best = row, low, high
    return best


def _span(line: BoolArray, middle: int) -> tuple[int, int]:
    """Return the first and last free column around the middle one."""
    shut = np.flatnonzero(~line)
    left, right = shut[shut < middle], shut[shut > middle]
    return (int(left[-1]) + 1 if len(left) else 0), (int(right[0]) - 1 if len(right) else len(line) - 1)
