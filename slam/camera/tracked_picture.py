"""The outcome of the visual odometry for one picture."""

from __future__ import annotations

import enum
from dataclasses import dataclass, field

import numpy as np

from waychair.types import FloatArray, IntArray, Pose3


class TrackingState(enum.Enum):
    """The outcome of a picture."""

    STARTED = "the first of a map"
    FOLLOWED = "followed"
    FOUND = "found again by its features"
    BLIND = "nothing to be seen in it (dark, overexposed or blank)"
    NO_DEPTH = "without depth, and no map yet"
    LOST = "its place is not known"


@dataclass(frozen=True, slots=True)
class TrackedPicture:
    """The result for one picture: outcome, camera_from_map (None: unknown), landmarks (K,), observations (K, 4), key
    frame made of it or None."""

    state: TrackingState
    camera_from_map: Pose3 | None = None
    landmarks: IntArray = field(default_factory=lambda: np.empty(0, np.int64))
    observed: FloatArray = field(default_factory=lambda: np.empty((0, 4)))
    key: int | None = None
    velocity: FloatArray = field(default_factory=lambda: np.zeros(6))
