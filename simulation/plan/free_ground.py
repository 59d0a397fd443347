"""Checks that points and paths lie on free floor, by a world's grid and pits."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import TypeAlias

import numpy as np

from waychair.errors import WorldError
from waychair.geometry import transform_points
from waychair.maps.grid.cells import OCCUPIED_FROM, cells_from_points, inside
from waychair.simulation.plan.floor_plan import Keys
from waychair.simulation.scene.scene import Pit
from waychair.types import FloatArray, OccupancyGrid

ErrorMaker: TypeAlias = Callable[[Keys, str], WorldError]
"""Makes the error about the value at some keys, from a sentence."""


def check_free_point(
    grid: OccupancyGrid, pits: Sequence[Pit], point: FloatArray, keys: Keys, refuse: ErrorMaker
) -> None:
    """Raise `refuse`'s error if a point (2,) [m] lies outside the grid, in something solid or over a pit."""
    _check_free(grid, pits, np.atleast_2d(point), keys, refuse)


def check_free_path(grid: OccupancyGrid, pits: Sequence[Pit], way: FloatArray, keys: Keys, refuse: ErrorMaker) -> None:
    """Raise `refuse`'s error as above for any point of a polyline (N, 2) [m], at the index of the leg's end point."""
    _check_free(grid, pits, way[:1], (*keys, 0), refuse)
    for i, (begin, end) in enumerate(pairwise(way)):
        _check_free(grid, pits, points_between(grid, begin, end), (*keys, i + 1), refuse)


def points_between(grid: OccupancyGrid, begin: FloatArray, end: FloatArray) -> FloatArray:
    """Return points (N, 2) [m] from begin to end, two per cell."""
    count = math.ceil(math.dist(begin, end) / (grid.resolution / 2)) + 2
    return np.linspace(begin, end, count)


def _check_free(grid: OccupancyGrid, pits: Sequence[Pit], points: FloatArray, keys: Keys, refuse: ErrorMaker) -> None:
    cells = cells_from_points(grid, points)
    within = inside(grid, cells)
    if not within.all():
        x, y = points[~within][0]
        raise refuse(keys, f"({x:g}, {y:g}) lies outside the world; move it inside")
    for pit in pits:
        local = np.abs(transform_points(pit.middle.inverse(), points))
        over = np.all(local <= np.array([pit.length, pit.width]) / 2, axis=1)
        if over.any():
            x, y = points[over][0]
            raise refuse(keys, f"({x:g}, {y:g}) lies over a pit; move it to the floor")
    solid = grid.cells[tuple(cells.T)] >= OCCUPIED_FROM
    if solid.any():
        x, y = points[solid][0]
        raise refuse(keys, f"({x:g}, {y:g}) lies in something solid; move it to free ground")
