"""What a lidar has seen so far, as a grid that grows with the way: the map of a chair that was given none."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from waychair.config import Settings, setting
from waychair.maps.occupancy import EvidenceGrid, OccupancySettings
from waychair.types import BoolArray, Pose2, Scan


@dataclass(frozen=True, slots=True)
class GridMemorySettings(Settings):
    """Cells, and how sure a hit and a miss make; beams that saw nothing clear as far as they reach."""

    occupancy: OccupancySettings = field(
        default_factory=lambda: OccupancySettings(resolution=0.025, range_max=5.0, open_range=5.0)
    )
    grow: float = setting(2.0, "m", "added at least, where the beams come to reach beyond the grid", low=0.1, high=50.0)


class GridMemory:
    """The cells of one frame that does not jump, such as odom; a few looks outweigh whatever was seen before them."""

    def __init__(self, at: Pose2, settings: GridMemorySettings | None = None) -> None:
        """The grid begins round `at`, a pose in that frame."""
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
        """(H, W) cells that are surely occupied, as `grid.occupied` has it."""
        return self._evidence.occupied()

    def include(self, at: Pose2) -> None:
        """Grow until the beams of a laser at this pose would all end inside."""
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
        """Take in a scan from a laser at a pose; `last`: at its last beam, where it moved meanwhile."""
        self.include(at)
        self._evidence.add(at.array()[None], (last or at).array()[None], (scan,))
