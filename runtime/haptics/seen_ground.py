"""The ground without a map: what the lidar has shown since leading began, in odom. Unseen ground counts as free."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.maps.grid.growing_grid import GridMemory
from waychair.planning.grid.costmap import Costmap, costmap_from_grid
from waychair.slam.scan.scan_points import sweep_motion
from waychair.types import FloatArray, Pose2, Scan, Twist

COARSER = 2
"""Cells of the memory per cell of the steps' ground, in each direction."""


class SeenGround:
    """The ground of one way by odometry alone. `ask` is called where scans come in, its answer in any one thread."""

    def __init__(self, body: ChairBody) -> None:
        self._body = body
        self._memory: GridMemory | None = None

    @property
    def is_seen(self) -> bool:
        """Whether a scan has come: before the first one nothing is known to be free."""
        return self._memory is not None

    def see(self, scan: Scan, odom_from_base: Pose2, twist: Twist) -> None:
        """Take in a scan without the beams that hit the chair itself, with the chair's pose and motion at its first beam."""
        first = odom_from_base @ self._body.base_from_laser
        last = odom_from_base @ sweep_motion(scan, twist) @ self._body.base_from_laser
        if self._memory is None:
            self._memory = GridMemory(first)
        self._memory.see(scan, first, last)

    def walls(self, at: Pose2, within: float) -> FloatArray:
        """Return the occupied cells' middles (N, 2) [m] in odom, no farther than this from a pose along x and y."""
        return np.empty((0, 2)) if self._memory is None else self._memory.points_near(at, within)

    def ask(self, goal: Pose2) -> Callable[[], Costmap]:
        """Return the work of making the costmap as far as a goal in odom; it takes a while.

        Raises:
            RuntimeError: no scan has come yet.
        """
        if self._memory is None:
            raise RuntimeError("no scan has come yet")
        self._memory.include(goal)
        grid, body = self._memory.grid(COARSER), self._body
        return lambda: costmap_from_grid(grid, body)
