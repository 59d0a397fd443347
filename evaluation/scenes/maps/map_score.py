"""Score how well a map's walls agree with the walls of its true building."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from waychair.geometry import transform_points
from waychair.maps.grid.cells import cells_from_points, inside, occupied, occupied_points, points_from_cells
from waychair.types import FloatArray, OccupancyGrid, Pose2

_SIDES = np.array([[0, 1], [0, -1], [1, 0], [-1, 0]])


@dataclass(frozen=True, slots=True)
class WallAgreement:
    """Shares in [0, 1]: occupied cells of the map that lie at a wall, and seen wall faces that the map shows."""

    true_cells: float
    found_faces: float
    cells: int
    faces: int


def wall_agreement(mapped: OccupancyGrid, truth: OccupancyGrid, true_from_map: Pose2, within: float) -> WallAgreement:
    """Compare a map's walls with those of the true grid, with a tolerance `within` [m].

    A mapped cell lies at a wall if its centre is within the tolerance of the nearest true occupied cell (distance 0
    inside). A face of a true wall was seen if the map holds free space before it. The map shows it if the face's centre
    is within the tolerance of an occupied cell.
    """
    cells = transform_points(true_from_map, occupied_points(mapped))
    at_wall = _outside(cells, occupied_points(truth), truth.resolution) <= within + 1e-9
    faces = _seen_faces(mapped, truth, true_from_map)
    in_map = transform_points(true_from_map.inverse(), faces)
    shown = _outside(in_map, occupied_points(mapped), mapped.resolution) <= within + 1e-9
    return WallAgreement(float(at_wall.mean()), float(shown.mean()), len(cells), len(faces))


def _outside(points: FloatArray, centres: FloatArray, side: float) -> FloatArray:
    """Return the distances (N,) [m] of points to the nearest square of side `side` round one of the centres."""
    _, nearest = cKDTree(centres).query(points, k=min(8, len(centres)))
    beyond = np.maximum(np.abs(points[:, None] - centres[nearest.reshape(len(points), -1)]) - side / 2, 0.0)
    result: FloatArray = np.hypot(beyond[..., 0], beyond[..., 1]).min(axis=1)
    return result


def _seen_faces(mapped: OccupancyGrid, truth: OccupancyGrid, true_from_map: Pose2) -> FloatArray:
    """Return centres (F, 2) [m] of the truth's faces between occupied and free cells that are free in the map."""
    solid = np.pad(occupied(truth), 1)
    free = np.pad((truth.cells >= 0) & ~occupied(truth), 1)
    known_free = (mapped.cells >= 0) & ~occupied(mapped)
    faces = []
    for side in _SIDES:
        walls = np.argwhere(solid & np.roll(free, -side, axis=(0, 1))) - 1
        before = transform_points(true_from_map.inverse(), points_from_cells(truth, walls + side))
        cells = cells_from_points(mapped, before)
        seen = inside(mapped, cells)
        seen[seen] = known_free[tuple(cells[seen].T)]
        faces.append(0.5 * (points_from_cells(truth, walls) + points_from_cells(truth, walls + side))[seen])
    return np.concatenate(faces)
