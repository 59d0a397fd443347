"""What is round the chair now: the map's walls and what the lidar sees, on one small fine grid."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from waychair.config import Settings, setting
from waychair.maps.distance_field import DistanceField, distances
from waychair.maps.grid import cells_from_points, inside, occupied
from waychair.types import FloatArray, OccupancyGrid, Pose2


@dataclass(frozen=True, slots=True)
class SurroundingsSettings(Settings):
    """How far and how finely the local planner sees."""

    reach: float = setting(4.0, "m", "half side of the window", low=2.0, high=20.0)
    resolution: float = setting(0.025, "m", "cells of the window: finer than a map's, for doors", low=0.01, high=0.1)
    known_within: float = setting(0.15, "m", "a point this near to a wall of the map is that wall", low=0.0, high=1.0)


class Surroundings:
    """Keeps the map's walls and the obstacle points of the latest scan."""

    def __init__(self, grid: OccupancyGrid, settings: SurroundingsSettings) -> None:
        self._grid = grid
        self._settings = settings
        self._walls = occupied(grid)
        self._from_walls = distances(self._walls, grid.resolution)
        self._points = np.empty((0, 2))

    def see(self, points: FloatArray) -> None:
        """The obstacle points (N, 2) [m] in map of a scan replace those of the one before."""
        self._points = points

    def window(self, pose: Pose2) -> DistanceField:
        """Distances to walls and seen points, in a square round a pose; nothing is known outside the map."""
        grid = self._grid
        finer = max(1, round(grid.resolution / self._settings.resolution))
        size = math.ceil(2 * self._settings.reach / grid.resolution)
        row, col = (cells_from_points(grid, np.array([[pose.x, pose.y]]))[0] - size // 2).tolist()
        solid = np.zeros((size, size), np.bool_)
        top, left = max(row, 0), max(col, 0)
        part = self._walls[top : max(row + size, 0), left : max(col + size, 0)]
        solid[top - row : top - row + part.shape[0], left - col : left - col + part.shape[1]] = part
        solid = solid.repeat(finer, axis=0).repeat(finer, axis=1)
        corner = grid.map_from_grid @ Pose2(col * grid.resolution, row * grid.resolution, 0.0)
        local = OccupancyGrid(np.zeros(solid.shape, np.int8), grid.resolution / finer, corner)
        cells = cells_from_points(local, self._points)
        rows, cols = cells[inside(local, cells)].T
        solid[rows, cols] = True
        return DistanceField(distances(solid, local.resolution), local.resolution, corner)

    def unexpected(self) -> FloatArray:
        """(N, 2) [m] seen points that the map does not explain."""
        cells = cells_from_points(self._grid, self._points)
        within = inside(self._grid, cells)
        rows, cols = cells[within].T
        news: FloatArray = self._points[within][self._from_walls[rows, cols] > self._settings.known_within]
        return news
