"""Distance fields finer than the map, in a square around one place where centimetres decide whether a chair fits."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from waychair.calibration.chair_body import BodyLayer
from waychair.geometry import transform_points
from waychair.maps.grid.cells import cells_from_points, cells_under, occupied, points_from_cells
from waychair.maps.grid.distance_field import DistanceField, near_distances, window_distances
from waychair.types import BoolArray, FloatArray, IntArray, OccupancyGrid, Pose2

FINEST = 0.0125
"""Largest side [m] of a fine cell: the footprint's check adds one cell for safety."""

_DEEP, _JAMB = 0.4, 0.06
"""A door's opening is cleared this far [m] before and behind its middle; its jambs are this wide and deep [m]."""


def fine_cell(grid: OccupancyGrid) -> float:
    """Return the side [m] of a fine cell: a whole part of the map's cell, at most `FINEST`."""
    return grid.resolution / max(1, math.ceil(grid.resolution / FINEST - 1e-9))


def fine_field(
    grid: OccupancyGrid,
    centre: Pose2,
    reach: float,
    points: FloatArray | None = None,
    opening: tuple[Pose2, float] | None = None,
    known_within: float = 0.0,
    layered: Sequence[tuple[BodyLayer, FloatArray]] = (),
) -> DistanceField:
    """Return distances to the grid's occupied cells and to `points` (N, 2) [m] in map, within `reach` [m] of a place.

    A map cell is divided into whole parts of at most `FINEST`. `opening` is a door's measured pose (x leads through it)
    and width [m]: it counts as free with a jamb on either side, whatever the map says. Points within `known_within` [m]
    of these obstacles are taken for them and left out. Everything beyond the map or the square is unknown, and nothing
    fits there. `layered` points exist only at the heights of one layer of the body.
    """
    side = grid.resolution
    cell = fine_cell(grid)
    parts = round(side / cell)
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
    fine = OccupancyGrid(np.zeros(solid.shape, np.int8), cell, part.map_from_grid)
    if opening is not None:
        _open(solid, fine, *opening)
    known = near_distances(solid, fine.resolution, known_within + fine.resolution) if known_within > 0.0 else None

    def news(points: FloatArray) -> IntArray:
        cells = cells_under(fine, points)
        return cells if known is None else cells[known[cells[:, 0], cells[:, 1]] > known_within]

    layers = []
    for layer, seen in layered:
        if len(cells := news(seen)):
            stands = np.zeros_like(solid)
            stands[cells[:, 0], cells[:, 1]] = True
            layers.append((layer, window_distances(stands, fine.resolution)))
    if points is not None and len(points):
        cells = news(points)
        solid[cells[:, 0], cells[:, 1]] = True
    metres = window_distances(solid, fine.resolution)
    return DistanceField(metres, fine.resolution, fine.map_from_grid, tuple(layers))


def _open(solid: BoolArray, fine: OccupancyGrid, map_from_door: Pose2, width: float) -> None:
    """Clear a door's opening, and put a jamb on either side."""
    reach = math.ceil(math.hypot(_DEEP, width / 2 + _JAMB) / fine.resolution) + 1  # cells farther off do not change
    row, column = cells_from_points(fine, np.array([[map_from_door.x, map_from_door.y]]))[0]
    top, left = max(int(row) - reach, 0), max(int(column) - reach, 0)
    part = solid[top : max(int(row) + reach + 1, 0), left : max(int(column) + reach + 1, 0)]
    cells = np.indices(part.shape).reshape(2, -1).T + np.array([top, left])
    x, y = np.abs(transform_points(map_from_door.inverse(), points_from_cells(fine, cells))).T.reshape(2, *part.shape)
    part[(x < _DEEP) & (y < width / 2)] = False
    part[(x < _JAMB) & (y >= width / 2) & (y < width / 2 + _JAMB)] = True
