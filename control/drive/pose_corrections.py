"""Detection of jumps: corrections of the localised pose that are too large to drive on unchanged."""

from __future__ import annotations

import math
from collections import deque

from waychair.types import Pose2

JUMP_M, JUMP_RAD = 0.05, math.radians(2.0)
"""m, rad; a larger correction is a jump: the chair slows down and plans anew."""

WINDOW_S = 1.0
"""s; corrections within this time count as one."""


class Corrections:
    """The recent history of odom's pose in map."""

    def __init__(self) -> None:
        self._lately: deque[tuple[int, Pose2]] = deque()

    def jumping(self, now_ns: int, pose: Pose2, odom_from_map: Pose2) -> bool:
        """Return whether recent corrections moved a chair that is now at map_from_base by more than a jump."""
        self._lately.append((now_ns, odom_from_map))
        while now_ns - self._lately[0][0] > WINDOW_S * 1e9:
            self._lately.popleft()
        # the pose in map that the same point of odom had at the window's start
        before = self._lately[0][1].inverse() @ odom_from_map @ pose
        moved = before.inverse() @ pose
        return math.hypot(moved.x, moved.y) > JUMP_M or abs(moved.theta) > JUMP_RAD
