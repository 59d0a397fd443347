"""One picture of the visual odometry, and its outcome."""

from __future__ import annotations

import enum
from dataclasses import dataclass, field

import numpy as np

from waychair.types import Bytes, Float32Array, FloatArray, IntArray, Pose3, RgbdFrame


@dataclass(frozen=True, slots=True)
class Picture:
    """A frame with its pyramid of grey pictures and its depth."""

    frame: RgbdFrame
    pyramid: tuple[Bytes, ...]
    depth: Float32Array

    def row_time(self, rows: FloatArray) -> FloatArray:
        """Return the exposure times (N,) [s] of rows (N,), relative to the frame's stamp."""
        time: FloatArray = (rows - 0.5 * self.depth.shape[0]) * self.frame.row_step
        return time


class PictureOutcome(enum.Enum):
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

    state: PictureOutcome
    camera_from_map: Pose3 | None = None
    landmarks: IntArray = field(default_factory=lambda: np.empty(0, np.int64))
    observed: FloatArray = field(default_factory=lambda: np.empty((0, 4)))
    key: int | None = None
    velocity: FloatArray = field(default_factory=lambda: np.zeros(6))
