"""A growing grid of the obstacles that a lidar has seen: the map of a chair that drives without a saved one."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from waychair.config import Settings, setting
from waychair.maps.occupancy import EvidenceGrid, OccupancySettings
from waychair.types import BoolArray, Pose2, Scan


@dataclass(frozen=True, slots=True)
class GridMemorySettings(Settings):
    """The cells and ranges of the grid; beams that meet nothing clear up to their range."""

    occupancy: OccupancySettings = field(
        default_factory=lambda: OccupancySettings(resolution=0.025, range_max=5.0, open_range=5.0)
    )
    grow: float = setting(2.0, "m", "added at least, where the beams come to reach beyond the grid", low=0.1, high=50.0)


class GridMemory:
    """A grid in a frame that does not jump, such as odom; a few scans outweigh all earlier ones."""

    def __init__(self, at: Pose2, settings: GridMemorySettings | None = None) -> None:
        """Begin the grid round `at`, a pose in that frame."""
        self._settings = settings or GridMemorySettings()
        self._evidence = EvidenceGrid(self._settings.occupancy, forgets=True)
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

    def include(self, at: Pose2) -> None:
        """Grow until all beams of a laser at this pose end inside."""
        here, reach = np.array([at.x, at.y]), self._settings.occupancy.range_max
        low, high = self._evidence.area
        left_down, right_up = here - reach, here + reach
        if (low == high).any():
            self._evidence.include(left_down - self.resolution, right_up + self.resolution)
        elif (left_down < low).any() or (right_up > high).any():
            grow = self._settings.grow
            left_down = np.where(left_down < low, left_down - grow, left_down)
            right_up = np.where(right_up > high, right_up + grow, right_up)
            self._evidence.include(left_down, right_up)

    def see(self, scan: Scan, at: Pose2, last: Pose2 | None = None) -> None:
        """Add a scan from a laser at a pose; `last` is its pose at the last beam if it moved meanwhile."""
        self.include(at)
        self._evidence.add(at.array()[None], (last or at).array()[None], (scan,))
