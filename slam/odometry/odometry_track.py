"""Odometry of the last second, to look up the pose at a scan's stamp where both come in separate messages."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections import deque

from waychair.geometry import arc
from waychair.types import Odometry, Pose2, Twist

_CARRIED_NS = 100_000_000
"""Greatest time of extrapolation by the last twist."""

_KEPT_NS = 1_000_000_000

_NEAR_START = 0.1  # m and rad


class OdometryTrack:
    """Keeps the odometry of the last second."""

    def __init__(self) -> None:
        self._track: deque[Odometry] = deque()
        self._first_from_odom = Pose2()
        self.continued = Pose2()
        """The chair by the latest reading, in the frame of the first: it is taken to have stood still over a restart."""

    @property
    def twist(self) -> Twist:
        """The latest twist."""
        return self._track[-1].twist if self._track else Twist()

    def take(self, odometry: Odometry) -> bool:
        """Add a reading; return whether the odometry has begun anew with it, as after a restart of its source.

        A reading that is not later than the last one means that the clock was set back: the older ones are dropped.
        """
        anew = bool(self._track) and self._begins(odometry)
        if anew or (self._track and odometry.stamp_ns <= self._track[-1].stamp_ns):
            self._track.clear()
        if anew:
            self._first_from_odom = self.continued @ odometry.odom_from_base.inverse()
        self.continued = self._first_from_odom @ odometry.odom_from_base
        self._track.append(odometry)
        while odometry.stamp_ns - self._track[0].stamp_ns > _KEPT_NS:
            self._track.popleft()
        return anew

    def _begins(self, odometry: Odometry) -> bool:
        """Whether a reading is near the origin after a silence, and the last one was not."""
        before, since_ns = self._track[-1], odometry.stamp_ns - self._track[-1].stamp_ns
        began = _is_near_start(odometry.odom_from_base) and not _is_near_start(before.odom_from_base)
        return began and not 0 < since_ns <= _CARRIED_NS

    def odom_from_base(self, stamp_ns: int) -> Pose2 | None:
        """Return the pose at a stamp, on the arc from the reading before it; None where no reading is near enough."""
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
