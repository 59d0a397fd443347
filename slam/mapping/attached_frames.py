"""Poses of all frames, each relative to a key scan, in 40 bytes a frame.

As Python objects, ten hours of scans at 10 Hz would be 80 MB for the garbage collector to traverse.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from waychair.geometry import pose_from_array
from waychair.types import FloatArray, IntArray, Pose2


@dataclass(frozen=True, slots=True)
class AttachedFrame:
    """A frame that moves with a key scan: its stamp, the key scan, and its pose relative to it."""

    stamp_ns: int
    key: int
    key_from_base: Pose2


class AttachedFrames:
    """A list of such frames, stored as arrays."""

    def __init__(self) -> None:
        self._count = 0
        self._on = np.zeros((64, 2), np.int64)  # stamp and key scan; rows beyond the count are spare
        self._poses = np.zeros((64, 3))

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, number: int) -> AttachedFrame:
        row = self._row(number)
        stamp_ns, key = self._on[row].tolist()
        return AttachedFrame(stamp_ns, key, pose_from_array(self._poses[row]))

    def __setitem__(self, number: int, frame: AttachedFrame) -> None:
        row = self._row(number)
        self._on[row] = frame.stamp_ns, frame.key
        self._poses[row] = frame.key_from_base.array()

    def append(self, frame: AttachedFrame) -> None:
        """Append a frame."""
        if self._count == len(self._on):
            self._on = np.concatenate([self._on, np.zeros_like(self._on)])
            self._poses = np.concatenate([self._poses, np.zeros_like(self._poses)])
        self._count += 1
        self[-1] = frame

    def take(self, numbers: Sequence[int]) -> AttachedFrames:
        """Return a copy of the frames with these numbers."""
        taken, rows = AttachedFrames(), np.array(numbers, np.int64)
        if len(rows):
            taken._count, taken._on, taken._poses = len(rows), self._on[rows], self._poses[rows]
        return taken

    @property
    def stamps_ns(self) -> IntArray:
        """Stamps (N,), a copy."""
        return self._on[: self._count, 0].copy()

    @property
    def keys(self) -> IntArray:
        """Key scan of each frame (N,), a copy."""
        return self._on[: self._count, 1].copy()

    @property
    def poses(self) -> FloatArray:
        """Pose of each frame relative to its key scan (N, 3) [m, m, rad], a copy."""
        return self._poses[: self._count].copy()

    def _row(self, number: int) -> int:
        row = number + self._count if number < 0 else number
        if not 0 <= row < self._count:
            raise IndexError(f"there is no frame {number} among {self._count}")
        return row
