"""The state of tracking from frame to frame, and the odometry that a frame brings along."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from waychair.slam.mapping.carried import OpenTear
from waychair.types import Odometry, Pose2, SensorFrame, Twist

_TRACKED_FRAMES = 50  # latest frames that may turn out to lie beyond a tear; a chair may stand for hours


@dataclass(frozen=True, slots=True)
class TrackedFrame:
    """Share of a scan's points on known surfaces, and the frame's pose by odometry alone relative to the current key scan."""

    inliers: float
    by_odometry: Pose2


@dataclass(slots=True)
class TrackingState:
    """State of the frame-to-frame tracking; poses are relative to the current key scan."""

    odometry: Pose2 | None = None  # odom_from_base at the latest frame
    motion: Pose2 = field(default_factory=Pose2)  # between the last two frames
    last_match: Pose2 = field(default_factory=Pose2)  # pose at the last full match
    by_odometry: Pose2 = field(default_factory=Pose2)  # the same pose continued by odometry alone
    unmatched: int = 0  # frames since the latest matched scan
    doubted: int = 0  # latest scans in a row that contradict those before
    inliers: float = 1.0  # of the latest scan
    unseen: int = 0  # latest scans in a row, without odometry, that do not show the motion along the walls
    slip: OpenTear | None = None  # that the latest match claims
    # the frame of the last full match, and those after it
    since_match: deque[TrackedFrame] = field(default_factory=lambda: deque(maxlen=_TRACKED_FRAMES))

    def frames_beyond(self) -> tuple[Pose2, ...]:
        """Return the poses, relative to the latest frame by odometry, of those before it that lie beyond a tear or slip, too.

        The scans in doubt show it. It lies where the share of inliers drops most: the frames before and after it differ most
        if they are split there, which is the split of least variance within both.
        """
        frames = self.since_match
        inliers, last = np.array([frame.inliers for frame in frames]), max(len(frames) - max(self.doubted, 1), 1)
        within = [
            split * inliers[:split].var() + (len(inliers) - split) * inliers[split:].var()
            for split in range(1, last + 1)
        ]
        first, here_from_key = 1 + int(np.argmin(within)), frames[-1].by_odometry.inverse()
        return tuple(here_from_key @ frames[k].by_odometry for k in range(first, len(frames) - 1))


def odometry_of(frame: SensorFrame) -> Odometry | None:
    """Return the latest odometry among the frame's readings, or None."""
    return next((reading for reading in reversed(frame.wheels) if isinstance(reading, Odometry)), None)


def twist_of(frame: SensorFrame) -> Twist | None:
    """Return the twist of the base by the frame's odometry, or None."""
    own = odometry_of(frame)
    return None if own is None else own.twist
