"""Exact distances from a person to the solid cells of its level and to the rectangles of chairs."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numba import njit

from waychair.calibration.chair_body import ChairBody
from waychair.maps.grid.cells import occupied
from waychair.types import BoolArray, FloatArray, OccupancyGrid, Pose2, Twist

FAR = 1e9
"""Distance [m] when nothing is in reach."""


class Walls(NamedTuple):
    """Cells (H, W) with a solid border, `resolution` [m], and x, y [m], cosine, sine of cells_from_map."""

    solid: BoolArray
    resolution: float
    x: float
    y: float
    cosine: float
    sine: float


class ChairRectangle(NamedTuple):
    """The chair's rectangle: pose in map, extent about its base [m], and the base's velocity in map [m/s, rad/s]."""

    x: float
    y: float
    cosine: float
    sine: float
    front: float
    rear: float
    half_width: float
    vx: float
    vy: float
    omega: float


def walls_from_grid(grid: OccupancyGrid) -> Walls:
    """Return the occupied cells of a grid with a solid border, which no person may cross."""
    solid = np.pad(occupied(grid), 1, constant_values=True)
    grid_from_padded = Pose2(-grid.resolution, -grid.resolution, 0.0)
    padded_from_map = (grid.map_from_grid @ grid_from_padded).inverse()
    c, s = math.cos(padded_from_map.theta), math.sin(padded_from_map.theta)
    return Walls(solid=solid, resolution=grid.resolution, x=padded_from_map.x, y=padded_from_map.y, cosine=c, sine=s)


def chair_rectangle(body: ChairBody, map_from_base: Pose2, twist: Twist) -> ChairRectangle:
    """Return the chair's rectangle with its pose and velocity."""
    c, s = math.cos(map_from_base.theta), math.sin(map_from_base.theta)
    reach = (body.front, body.rear, body.width / 2)
    return ChairRectangle(map_from_base.x, map_from_base.y, c, s, *reach, twist.v * c, twist.v * s, twist.omega)


def chair_rows(chairs: Iterable[ChairRectangle]) -> FloatArray:
    """Return the chairs' rectangles as rows (N, 10), for loops over them."""
    return np.array([tuple(chair) for chair in chairs], np.float64).reshape(-1, len(ChairRectangle._fields))


@njit(cache=True)
def chair_of(row: FloatArray) -> ChairRectangle:
    """Return a row of `chair_rows` as a rectangle."""
    return ChairRectangle(row[0], row[1], row[2], row[3], row[4], row[5], row[6], row[7], row[8], row[9])


@njit(cache=True)
def nearest_walls(walls: Walls, x: float, y: float, reach: float) -> FloatArray:
    """Return vectors (4, 2) [m, map] to (x, y) from the nearest point of a solid cell in each of four quarters.

    A quarter spans 45 degrees to both sides of a grid axis; (FAR, FAR) if it holds no solid cell within `reach`. One
    point per quarter, instead of the nearest of all, balances the forces of a door's or a corridor's two sides.
    """
    left = walls.cosine * x - walls.sine * y + walls.x
    low = walls.sine * x + walls.cosine * y + walls.y
    nearest = np.full((4, 2), FAR)
    squares = np.full(4, reach * reach)
    size, (rows, cols) = walls.resolution, walls.solid.shape
    for row in range(max(0, math.floor((low - reach) / size)), min(rows, math.floor((low + reach) / size) + 1)):
        dy = low - min(max(low, row * size), (row + 1) * size)
        for col in range(max(0, math.floor((left - reach) / size)), min(cols, math.floor((left + reach) / size) + 1)):
            if not walls.solid[row, col]:
                continue
            dx = left - min(max(left, col * size), (col + 1) * size)
            quarter = (0 if dx > 0.0 else 1) if abs(dx) >= abs(dy) else (2 if dy > 0.0 else 3)
            square = dx * dx + dy * dy
            if square <= squares[quarter]:
                squares[quarter] = square
                nearest[quarter, 0] = walls.cosine * dx + walls.sine * dy
                nearest[quarter, 1] = walls.cosine * dy - walls.sine * dx
    return nearest


@njit(cache=True)
def nearest_wall(walls: Walls, x: float, y: float, reach: float) -> tuple[float, float, float]:
    """Return the distance [m] to the nearest solid cell and the unit vector away from it; FAR if none is in `reach`.

    In a solid cell both are 0.
    """
    best, away_x, away_y = FAR, 0.0, 0.0
    for vector in nearest_walls(walls, x, y, reach):
        distance = math.hypot(vector[0], vector[1])
        if distance < best:
            best, away_x, away_y = distance, vector[0], vector[1]
    return (best, away_x / best, away_y / best) if 0.0 < best < FAR else (best, 0.0, 0.0)


@njit(cache=True)
def nearest_on_chair(chair: ChairRectangle, x: float, y: float) -> tuple[float, float, float]:
    """Return the distance [m] from (x, y) to the chair's rectangle, and the unit vector [map] away from it.

    Inside, the distance to the nearest side is negative, and the vector points out through this side.
    """
    dx, dy = x - chair.x, y - chair.y
    ahead, aside = dx * chair.cosine + dy * chair.sine, dy * chair.cosine - dx * chair.sine
    past_end = ahead - min(max(ahead, -chair.rear), chair.front)
    past_side = aside - min(max(aside, -chair.half_width), chair.half_width)
    distance = math.hypot(past_end, past_side)
    if distance > 0.0:
        along, across = past_end / distance, past_side / distance
    else:
        to_end, to_side = min(chair.front - ahead, chair.rear + ahead), chair.half_width - abs(aside)
        distance = -min(to_end, to_side)
        if to_end < to_side:
            along, across = (1.0 if chair.front - ahead <= chair.rear + ahead else -1.0), 0.0
        else:
            along, across = 0.0, (1.0 if aside >= 0.0 else -1.0)
    return distance, along * chair.cosine - across * chair.sine, along * chair.sine + across * chair.cosine


@njit(cache=True)
def velocity_at(chair: ChairRectangle, x: float, y: float) -> tuple[float, float]:
    """Return the velocity [m/s, map] of the chair's point at (x, y)."""
    return chair.vx - chair.omega * (y - chair.y), chair.vy + chair.omega * (x - chair.x)
