"""Distances on cells finer than a map's, in a square round one place: where centimetres decide whether a chair fits."""

from __future__ import annotations

import math

import numpy as np

from waychair.maps.distance_field import DistanceField, distances
from waychair.maps.grid import cells_from_points, inside, occupied
from waychair.types import FloatArray, OccupancyGrid, Pose2

FINEST = 0.0125
"""Side [m] from which on cells are fine enough: what the body's check adds for safety is one cell."""


def fine_field(
    grid: OccupancyGrid, centre: Pose2, reach: float, points: FloatArray | None = None, resolution: float = FINEST
) -> DistanceField:
    """Distances to the grid's occupied cells and to `points` (N, 2) [m] in map, within `reach` [m] of a place.

    A cell of the map stays the square it is, cut into whole parts of at most `resolution` [m]. What lies beyond the
    map or the square is not known, and nothing fits there.
    """
    side = grid.resolution
    parts = max(1, math.ceil(side / resolution - 1e-9))
    row, column = cells_from_points(grid, np.array([[centre.x, centre.y]]))[0]
    span = math.ceil(reach / side)
    height, width = grid.cells.shape
    top, left = max(int(row) - span, 0), max(int(column) - span, 0)
    bottom, right = min(int(row) + span + 1, height), min(int(column) + span + 1, width)
    part = OccupancyGrid(
        grid.cells[top : max(bottom, top + 1), left : max(right, left + 1)],
        side,
        grid.map_from_grid @ Pose2(left * side, top * side, 0.0),
    )
    solid = occupied(part).repeat(parts, axis=0).repeat(parts, axis=1)
    fine = OccupancyGrid(np.zeros(solid.shape, np.int8), side / parts, part.map_from_grid)
    if points is not None and len(points):
        cells = cells_from_points(fine, points)
        rows, columns = cells[inside(fine, cells)].T
        solid[rows, columns] = True
    return DistanceField(distances(solid, fine.resolution), fine.resolution, fine.map_from_grid)
