"""The state of tracking from frame to frame, and the odometry that a frame brings along."""

from __future__ import annotations

from dataclasses import dataclass, field

from waychair.slam.mapping.carried import OpenTear
from waychair.types import Odometry, Pose2, SensorFrame, Twist


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
    slip: OpenTear | None = None  # that the latest match claims


def odometry_of(frame: SensorFrame) -> Odometry | None:
    """Return the latest odometry among the frame's readings, or None."""
    return next((reading for reading in reversed(frame.wheels) if isinstance(reading, Odometry)), None)


def twist_of(frame: SensorFrame) -> Twist | None:
    """Return the twist of the base by the frame's odometry, or None."""
    own = odometry_of(frame)
    return None if own is None else own.twist
