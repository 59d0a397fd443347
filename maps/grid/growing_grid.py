"""A growing grid of the obstacles that a lidar has seen: the map of a chair that drives without a saved one."""

from __future__ import annotations

import numpy as np

from waychair.maps.grid.cells import coarser
from waychair.maps.grid.occupancy import EvidenceGrid, OccupancySettings
from waychair.types import BoolArray, FloatArray, OccupancyGrid, Pose2, Scan

FINE_CELLS = OccupancySettings(resolution=0.025, range_max=5.0, open_range=5.0)
"""Small cells for driving close to obstacles; beams without an echo clear as far as obstacles are seen."""

_GROW = 2.0
"""Least growth [m] of the grid, so that it does not grow with every scan."""


class GridMemory:
    """A grid in a frame that does not jump, such as odom; a few scans outweigh all earlier ones."""

    def __init__(self, at: Pose2, settings: OccupancySettings = FINE_CELLS) -> None:
        """Begin the grid round `at`, a pose in that frame."""
        self._evidence = EvidenceGrid(settings, forgets=True)
        self.include(at)

    @property
    def resolution(self) -> float:
        """Side of a cell [m]."""
        return self._evidence.settings.resolution

    @property
    def corner(self) -> Pose2:
        """Pose of the lower-left corner of cell (0, 0); a new one when the grid has grown."""
        x, y = self._evidence.area[0].tolist()
        return Pose2(x, y, 0.0)

    def occupied(self) -> BoolArray:
        """Return which cells (H, W) are occupied, by the limit of `grid.occupied`."""
        return self._evidence.occupied()

    def points_near(self, at: Pose2, within: float) -> FloatArray:
        """Return the middles (N, 2) [m] of the occupied cells that are no farther than this from a pose along x and y."""
        cell, low = self.resolution, self._evidence.area[0]
        here = np.array([at.x, at.y]) - low
        first, after = (np.maximum(np.rint((here + way) / cell).astype(int), 0) for way in (-within, within))
        near = self.occupied()[first[1] : after[1], first[0] : after[0]]
        points: FloatArray = low + (first + np.argwhere(near)[:, ::-1] + 0.5) * cell
        return points

    def grid(self, times: int) -> OccupancyGrid:
        """Return a grid whose cells are `times` as wide: occupied if any of their parts is, and else free."""
        fine = self.occupied()
        whole = np.pad(fine, [(0, -size % times) for size in fine.shape])  # beyond its edges nothing is known to stand
        return coarser(OccupancyGrid(np.where(whole, np.int8(100), np.int8(0)), self.resolution, self.corner), times)

    def include(self, at: Pose2) -> None:
        """Grow until all beams of a laser at this pose end inside."""
        here, reach = np.array([at.x, at.y]), self._evidence.settings.range_max
        low, high = self._evidence.area
        left_down, right_up = here - reach, here + reach
        if (low == high).any():
            self._evidence.include(left_down - self.resolution, right_up + self.resolution)
        elif (left_down < low).any() or (right_up > high).any():
            left_down = np.where(left_down < low, left_down - _GROW, left_down)
            right_up = np.where(right_up > high, right_up + _GROW, right_up)
            self._evidence.include(left_down, right_up)

    def see(self, scan: Scan, at: Pose2, last: Pose2 | None = None) -> None:
        """Add a scan from a laser at a pose; `last` is its pose at the last beam if it moved meanwhile."""
        self.include(at)
        self._evidence.add(at.array()[None], (last or at).array()[None], (scan,))
