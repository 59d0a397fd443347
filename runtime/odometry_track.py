"""Where the odometry had the chair at a stamp, for whoever gets odometry and scans by different ways."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections import deque

from waychair.geometry import arc
from waychair.types import Odometry, Pose2, Twist

_CARRIED_NS = 100_000_000
"""The last speeds are taken to go on for so long."""

_KEPT_NS = 1_000_000_000

_NEAR_START = 0.1  # m and rad


class OdometryTrack:
    """The odometry of the last second."""

    def __init__(self) -> None:
        self._track: deque[Odometry] = deque()

    @property
    def twist(self) -> Twist:
        """The latest."""
        return self._track[-1].twist if self._track else Twist()

    def take(self, odometry: Odometry) -> bool:
        """A new one; whether the odometry begins anew by it, as when what reckons it was started again.

        One that is not later than the last comes from a clock that was set back: what came before is forgotten.
        """
        anew = bool(self._track) and self._begins(odometry)
        if anew or (self._track and odometry.stamp_ns <= self._track[-1].stamp_ns):
            self._track.clear()
        self._track.append(odometry)
        while odometry.stamp_ns - self._track[0].stamp_ns > _KEPT_NS:
            self._track.popleft()
        return anew

    def _begins(self, odometry: Odometry) -> bool:
        """Whether it is where every odometry begins, after a silence, and was elsewhere before."""
        before, since_ns = self._track[-1], odometry.stamp_ns - self._track[-1].stamp_ns
        began = _is_near_start(odometry.odom_from_base) and not _is_near_start(before.odom_from_base)
        return began and not 0 < since_ns <= _CARRIED_NS

    def odom_from_base(self, stamp_ns: int) -> Pose2 | None:
        """The pose at a stamp, on the arc from the odometry before it; None where nothing near enough is known."""
        index = bisect_right(self._track, stamp_ns, key=lambda odometry: odometry.stamp_ns) - 1
        if not self._track or stamp_ns < self._track[0].stamp_ns - _CARRIED_NS:
            return None
        last = self._track[max(index, 0)]
        since_ns = stamp_ns - last.stamp_ns
        if since_ns > _CARRIED_NS:
            return None
        return last.odom_from_base @ arc(last.twist.v * since_ns * 1e-9, last.twist.omega * since_ns * 1e-9)


def _is_near_start(pose: Pose2) -> bool:
    return math.hypot(pose.x, pose.y) < _NEAR_START and abs(pose.theta) < _NEAR_START
