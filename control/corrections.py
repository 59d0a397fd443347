"""Detection of jumps: corrections of the localised pose that are too large to drive on unchanged."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

from waychair.config import Settings, setting
from waychair.types import Pose2


@dataclass(frozen=True, slots=True)
class CorrectionSettings(Settings):
    """Thresholds above which a correction is a jump."""

    distance: float = setting(0.05, "m", "a correction of the pose by more: slow down, plan anew", low=0.01, high=1.0)
    angle: float = setting(
        math.radians(2.0), "rad", "a correction of the heading by more: likewise", low=0.005, high=1.0
    )
    time: float = setting(1.0, "s", "corrections within this time count as one", low=0.1, high=10.0)


class Corrections:
    """The recent history of odom's pose in map."""

    def __init__(self, settings: CorrectionSettings) -> None:
        self._settings = settings
        self._lately: deque[tuple[int, Pose2]] = deque()

    def jumping(self, now_ns: int, pose: Pose2, odom_from_map: Pose2) -> bool:
        """Return whether recent corrections moved a chair that is now at map_from_base by more than the settings
        allow."""
        s = self._settings
        self._lately.append((now_ns, odom_from_map))
        while now_ns - self._lately[0][0] > s.time * 1e9:
            self._lately.popleft()
        # the pose in map that the same point of odom had at the window's start
        before = self._lately[0][1].inverse() @ odom_from_map @ pose
        moved = before.inverse() @ pose
        return math.hypot(moved.x, moved.y) > s.distance or abs(moved.theta) > s.angle
