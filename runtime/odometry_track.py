"""Where the odometry had the chair at a stamp, for whoever gets odometry and scans by different ways."""

from __future__ import annotations

from bisect import bisect_right
from collections import deque

from waychair.geometry import arc
from waychair.types import Odometry, Pose2, Twist

_CARRIED_NS = 100_000_000
"""The last speeds are taken to go on for so long."""

_KEPT_NS = 1_000_000_000


class OdometryTrack:
    """The odometry of the last second."""

    def __init__(self) -> None:
        self._track: deque[Odometry] = deque()

    @property
    def twist(self) -> Twist:
        """The latest."""
        return self._track[-1].twist if self._track else Twist()

    def take(self, odometry: Odometry) -> None:
        """A new one; one that is not later than the last begins anew: a clock was set back, or the base restarted."""
        if self._track and odometry.stamp_ns <= self._track[-1].stamp_ns:
            self._track.clear()
        self._track.append(odometry)
        while odometry.stamp_ns - self._track[0].stamp_ns > _KEPT_NS:
            self._track.popleft()

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
