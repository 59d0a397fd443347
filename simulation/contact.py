"""The chair's rectangle against the solid cells of a world: exact contact and exact distance.

Both are closed-form on convex shapes: contact by separating axes, distance from the corners of one to the other.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from waychair.calibration.chair import ChairBody
from waychair.maps.grid import occupied
from waychair.types import BoolArray, OccupancyGrid, Pose2


@dataclass(frozen=True, slots=True)
class Solid:
    """What bodies and beams run into: cells (H, W) bool, `resolution` [m], and the pose of the map in the grid."""

    cells: BoolArray
    resolution: float
    grid_from_map: Pose2


def solid_from_grid(grid: OccupancyGrid) -> Solid:
    """Occupied cells are solid; free and unknown ones, and all beyond the grid, are not."""
    return Solid(np.ascontiguousarray(occupied(grid)), grid.resolution, grid.map_from_grid.inverse())


def in_contact(solid: Solid, body: ChairBody, map_from_base: Pose2) -> bool:
    """Whether the outline and a solid cell share a point."""
    return bool(_touches(solid.cells, *_box(solid, body, map_from_base)))


def clearance(solid: Solid, body: ChairBody, map_from_base: Pose2) -> float:
    """Smallest distance [m] from the outline to a solid cell: 0 in contact, +inf in a world without solid cells."""
    box = _box(solid, body, map_from_base)
    if _touches(solid.cells, *box):
        return 0.0
    return float(_distance(solid.cells, *box)) * solid.resolution


def _box(solid: Solid, body: ChairBody, map_from_base: Pose2) -> tuple[float, float, float, float, float, float]:
    """The outline in units of cells: centre x, y, cosine and sine of its heading, half length and half width."""
    pose = solid.grid_from_map @ map_from_base
    c, s = math.cos(pose.theta), math.sin(pose.theta)
    ahead = (body.front - body.rear) / 2
    scale = 1.0 / solid.resolution
    return (
        (pose.x + ahead * c) * scale,
        (pose.y + ahead * s) * scale,
        c,
        s,
        (body.front + body.rear) / 2 * scale,
        body.width / 2 * scale,
    )


@njit(cache=True, nogil=True)
def _touches(cells: BoolArray, x: float, y: float, c: float, s: float, half_length: float, half_width: float) -> bool:
    reach_x = half_length * abs(c) + half_width * abs(s)
    reach_y = half_length * abs(s) + half_width * abs(c)
    cell = 0.5 * (abs(c) + abs(s))  # half a cell's extent along either side of the outline
    for row in range(max(0, math.ceil(y - reach_y) - 1), min(cells.shape[0], math.floor(y + reach_y) + 1)):
        for col in range(max(0, math.ceil(x - reach_x) - 1), min(cells.shape[1], math.floor(x + reach_x) + 1)):
            if not cells[row, col]:
                continue
            dx, dy = col + 0.5 - x, row + 0.5 - y
            if abs(dx * c + dy * s) <= half_length + cell and abs(dy * c - dx * s) <= half_width + cell:
                return True
    return False


@njit(cache=True, nogil=True)
def _distance(cells: BoolArray, x: float, y: float, c: float, s: float, half_length: float, half_width: float) -> float:
    """Smallest distance [cells] of a box that touches none, looking ever farther round it."""
    rows, cols = cells.shape
    radius = math.hypot(half_length, half_width) + math.sqrt(0.5)
    look = 16.0
    while True:
        best = math.inf
        reach = radius + look
        for row in range(max(0, math.floor(y - reach)), min(rows, math.floor(y + reach) + 1)):
            for col in range(max(0, math.floor(x - reach)), min(cols, math.floor(x + reach) + 1)):
                if cells[row, col] and math.hypot(col + 0.5 - x, row + 0.5 - y) - radius < best:
                    best = min(best, _apart(col - x, row - y, c, s, half_length, half_width))
        everything = y - reach < 0 and x - reach < 0 and y + reach > rows and x + reach > cols
        if best <= look or everything:
            return best
        look *= 2.0


@njit(cache=True, nogil=True)
def _apart(left: float, low: float, c: float, s: float, half_length: float, half_width: float) -> float:
    """Distance of the unit square with this lower-left corner from a box about the origin that it does not meet."""
    best = math.inf
    for i in range(2):
        for j in range(2):
            # A corner of the square to the box, then a corner of the box to the square.
            px, py = left + i, low + j
            dx = max(abs(px * c + py * s) - half_length, 0.0)
            dy = max(abs(py * c - px * s) - half_width, 0.0)
            best = min(best, math.hypot(dx, dy))
            along, across = (2 * i - 1) * half_length, (2 * j - 1) * half_width
            qx, qy = along * c - across * s, along * s + across * c
            dx = max(left - qx, 0.0, qx - left - 1.0)
            dy = max(low - qy, 0.0, qy - low - 1.0)
            best = min(best, math.hypot(dx, dy))
    return best
