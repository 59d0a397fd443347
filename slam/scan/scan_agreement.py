"""Agreement of scans seen from several poses: each must see the surfaces of the others where its beams pass.

Matching rates the ends of the beams only, so a scan of another place may match poorly or well by chance. A beam that
passes through a surface that another scan saw contradicts it, in both directions: the new scan looks through an old
wall, or an old scan looked through a new one. On recorded drives through seven buildings, scans that belong together
contradict each other in less than a tenth of the shared surfaces. Scans of two places laid over each other do so in a
fifth to nine tenths. People and open doors contradict little, since they hide surfaces.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit

from waychair.geometry import transform_points
from waychair.slam.scan.scan_points import ScanPoints
from waychair.types import FloatArray, Pose2

DEPTH = 0.3
"""A beam contradicts a surface that lies at least so far [m] before its end."""

_GAP = 0.05  # [rad]; between two beams farther apart nothing is known
_FEW_POINTS = 30  # views with fewer points say too little


@dataclass(frozen=True, slots=True)
class View:
    """A scan by bearing: `bearing` (N,) [rad] ascending, `ranges` (N,) [m], and the same points (N, 2) [m], from the lidar."""

    bearing: FloatArray
    ranges: FloatArray
    points: FloatArray


@dataclass(frozen=True, slots=True)
class Agreement:
    """Number of surface points of some views that beams of others pass through, and that others see as well."""

    contradicted: int = 0
    confirmed: int = 0

    def __add__(self, other: Agreement) -> Agreement:
        """Return the points of both."""
        return Agreement(self.contradicted + other.contradicted, self.confirmed + other.confirmed)

    @property
    def shared(self) -> int:
        """Number of the surface points about which both views know something."""
        return self.contradicted + self.confirmed

    @property
    def contradiction(self) -> float:
        """Contradicted share of the shared surfaces; 0 without any."""
        return self.contradicted / max(1, self.shared)


def view_of(scan: ScanPoints, base_from_laser: Pose2) -> View:
    """Return a scan as seen from the lidar."""
    beams = transform_points(base_from_laser.inverse(), scan.points)
    bearing = np.arctan2(beams[:, 1], beams[:, 0])
    order = np.argsort(bearing)
    beams = np.ascontiguousarray(beams[order])
    return View(bearing[order], np.hypot(beams[:, 0], beams[:, 1]), beams)


def agreement(earlier: Sequence[tuple[View, Pose2]], later: Sequence[tuple[View, Pose2]]) -> Agreement:
    """Return how far views agree with earlier ones; each comes with the pose of its lidar in the map."""
    contradicted = confirmed = 0
    for old, map_from_old in earlier:
        for new, map_from_new in later:
            if min(len(old.bearing), len(new.bearing)) < _FEW_POINTS:
                continue
            old_from_new = map_from_old.inverse() @ map_from_new
            for seen, by, pose in ((new, old, old_from_new), (old, new, old_from_new.inverse())):
                through, at = _compared(by.bearing, by.ranges, seen.points, pose.x, pose.y, pose.theta)
                contradicted += through
                confirmed += at
    return Agreement(contradicted, confirmed)


@njit(cache=True)
def _compared(
    bearing: FloatArray, ranges: FloatArray, points: FloatArray, x: float, y: float, theta: float
) -> tuple[int, int]:
    """Return the number of points, moved by a pose, that the beams pass through, and that lie at their ends."""
    c, s = math.cos(theta), math.sin(theta)
    through, at = 0, 0
    for k in range(len(points)):
        px, py = x + c * points[k, 0] - s * points[k, 1], y + s * points[k, 0] + c * points[k, 1]
        towards, away = math.atan2(py, px), math.hypot(px, py)
        above = np.searchsorted(bearing, towards)
        if above == 0 or above == len(bearing) or bearing[above] - bearing[above - 1] >= _GAP:
            continue
        nearer, farther = min(ranges[above - 1], ranges[above]), max(ranges[above - 1], ranges[above])
        if away < nearer - DEPTH:
            through += 1
        elif away <= farther + DEPTH:
            at += 1
    return through, at
