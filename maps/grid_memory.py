"""What a lidar has seen so far, as a grid that grows with the way: the map of a chair that was given none."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from waychair.config import Settings, setting
from waychair.maps.grid import OCCUPIED_FROM
from waychair.maps.occupancy import OccupancySettings, beam_ends, fuse_scans, log_odds_of
from waychair.types import BoolArray, FloatArray, IntArray, Pose2, Scan


@dataclass(frozen=True, slots=True)
class GridMemorySettings(Settings):
    """Cells, and how sure a hit and a miss make; beams that saw nothing clear as far as they reach."""

    occupancy: OccupancySettings = field(
        default_factory=lambda: OccupancySettings(resolution=0.025, range_max=5.0, open_range=5.0)
    )
    grow: float = setting(2.0, "m", "added at least, where the beams come to reach beyond the grid", low=0.1, high=50.0)


class GridMemory:
    """Log-odds of the cells of one frame that does not jump, such as odom; unknown cells hold 0.

    Updated scan by scan as `occupancy.build_grid` would do it with all of them at once.
    """

    def __init__(self, at: Pose2, settings: GridMemorySettings | None = None) -> None:
        """The grid begins round `at`, a pose in that frame."""
        self._settings = settings or GridMemorySettings()
        s = self._settings.occupancy
        self._reach = math.ceil(s.range_max / s.resolution) + 1
        self._low = np.floor(np.array([at.x, at.y]) / s.resolution).astype(np.int64) - self._reach
        self._log_odds = np.zeros((2 * self._reach + 1,) * 2, np.float32)
        self._marks = np.empty(self._log_odds.shape, np.int32)
        probabilities = (s.prob_hit, s.prob_miss, s.prob_min, s.prob_max)
        self._updates = tuple(log_odds_of(probability) for probability in probabilities)

    @property
    def resolution(self) -> float:
        """Side of a cell [m]."""
        return self._settings.occupancy.resolution

    @property
    def corner(self) -> Pose2:
        """Pose of the lower-left corner of cell (0, 0); a new one when the grid has grown."""
        x, y = (self._low * self.resolution).tolist()
        return Pose2(x, y, 0.0)

    def occupied(self) -> BoolArray:
        """(H, W) cells that are surely occupied, as `grid.occupied` has it."""
        result: BoolArray = self._log_odds >= log_odds_of(OCCUPIED_FROM / 100.0)
        return result

    def include(self, at: Pose2) -> None:
        """Grow until the beams of a laser at this pose would all end inside."""
        cell = np.floor(np.array([at.x, at.y]) / self.resolution).astype(np.int64) - self._low
        size = np.array(self._log_odds.shape[::-1])
        below, above = self._reach - cell, cell + self._reach + 1 - size
        if max(below.max(), above.max()) <= 0:
            return
        spare = math.ceil(self._settings.grow / self.resolution)
        (left, down), (right, up) = (np.where(short > 0, short + spare, 0).tolist() for short in (below, above))
        self._log_odds = np.pad(self._log_odds, ((down, up), (left, right)))
        self._marks = np.empty(self._log_odds.shape, np.int32)
        self._low -= (left, down)

    def see(self, scan: Scan, at: Pose2, last: Pose2 | None = None) -> None:
        """Take in a scan from a laser at a pose; `last`: at its last beam, where it moved meanwhile."""
        self.include(at)
        first, final = at.array()[None], (last or at).array()[None]
        ends, kinds = beam_ends(first, final, (scan,), self._settings.occupancy)
        self._marks.fill(-1)
        origins = self._cells(0.5 * (first + final)[:, :2])
        beams = np.array([0, len(ends)])
        fuse_scans(self._log_odds, self._marks, origins, self._cells(ends), kinds, beams, *self._updates)

    def _cells(self, points: FloatArray) -> IntArray:
        """(N, 2) column and row of points (N, 2) [m]."""
        cells: IntArray = np.floor(points / self.resolution).astype(np.int64) - self._low
        return cells
