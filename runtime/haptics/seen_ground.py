"""The ground without a map, in odom: what the lidar has shown since leading began, or on a chair without one the laser's line.

Unseen ground counts as free.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.geometry import transform_points
from waychair.maps.grid.growing_grid import GridMemory
from waychair.planning.grid.costmap import Costmap, costmap_from_grid
from waychair.planning.seen.laser_sight import LaserSight
from waychair.slam.scan.scan_points import sweep_motion
from waychair.types import FloatArray, Pose2, Scan, Twist

COARSER = 2
"""Cells of the memory per cell of the steps' ground, in each direction."""

SURE = 0.05
"""m, one sigma; a point of the laser's line whose range is known less well is no wall: it would narrow a doorway."""

_BEAM, _HALF_VIEW = math.radians(0.25), math.radians(30.0)
"""rad; step between the beams of a look, and half of what the camera sees."""


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
        self._add(scan, first, odom_from_base @ sweep_motion(scan, twist) @ self._body.base_from_laser)

    def _add(self, scan: Scan, first: Pose2, last: Pose2 | None = None) -> None:
        """Add a scan from a sensor that moves from one pose to another meanwhile."""
        if self._memory is None:
            self._memory = GridMemory(first)
        self._memory.see(scan, first, last)

    def look(self, sight: LaserSight, odom_from_base: Pose2, stamp_ns: int) -> None:
        """Take in a look by the laser's line, with the chair's pose at it."""
        self._add(_scan_of(sight, stamp_ns), odom_from_base @ sight.camera)

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


def _scan_of(sight: LaserSight, stamp_ns: int) -> Scan:
    """Return the sure points of a look as a scan from the camera; its other beams say nothing."""
    points = transform_points(sight.camera.inverse(), sight.points[sight.errors <= SURE, :2])
    ranges = np.full(2 * round(_HALF_VIEW / _BEAM) + 1, np.inf)
    beams = np.rint((np.arctan2(points[:, 1], points[:, 0]) + _HALF_VIEW) / _BEAM).astype(np.int64)
    inside = (beams >= 0) & (beams < len(ranges))
    np.minimum.at(ranges, beams[inside], np.hypot(points[inside, 0], points[inside, 1]))
    ranges[~np.isfinite(ranges)] = np.nan
    return Scan(stamp_ns, ranges.astype(np.float32), -_HALF_VIEW, _BEAM)
