"""Where the anchors of the memory stand: which of them have moved, and which are near a point.

A frame costs what has changed. Anchors that were only added share their array with those before (see `PoseGraph`), so
nothing else is looked at; those that an optimisation has bent are compared once, and found again by a new tree when
somebody next asks for those near by.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from waychair.types import FloatArray, IntArray, Pose2

_MOVED = 1e-6  # [m], [rad] by which an anchor stands elsewhere
_TAIL = 256  # anchors that are looked at one by one before they are put into a new tree


class Anchors:
    """Rows (A, 3) [m, m, rad] in map; nan for one that has no pose."""

    def __init__(self, poses: FloatArray | None = None) -> None:
        self.poses: FloatArray = np.empty((0, 3)) if poses is None else poses
        self._tree: cKDTree | None = None
        self._rows = np.empty(0, np.int64)  # of the tree's points
        self._known = 0  # rows that the tree was made of

    def __len__(self) -> int:
        return len(self.poses)

    def stand(self, poses: FloatArray) -> IntArray:
        """The anchors stand at (B, 3) now, an array that is kept; returns the rows that are new or elsewhere.

        Rows of an array that was given before do not change in it.
        """
        before, self.poses = self.poses, poses
        known = min(len(before), len(poses))
        if known and np.may_share_memory(before, poses):
            return np.arange(known, len(poses))
        with np.errstate(invalid="ignore"):
            still = (np.abs(poses[:known] - before[:known]) <= _MOVED).all(axis=1)
        moved: IntArray = np.concatenate([np.flatnonzero(~still), np.arange(known, len(poses))])
        if len(poses) < self._known or (len(moved) and moved[0] < self._known):
            self._tree = None
        return moved

    def near(self, at: Pose2, radius: float) -> IntArray:
        """Rows within the radius [m], nearest first."""
        if self._tree is None or len(self.poses) - self._known > _TAIL:
            self._plant()
        assert self._tree is not None
        inside = self._tree.query_ball_point((at.x, at.y), radius) if len(self._rows) else []
        rows = np.concatenate([self._rows[inside], np.arange(self._known, len(self.poses))]).astype(np.int64)
        away = np.hypot(*(self.poses[rows, :2] - (at.x, at.y)).T)
        order = np.lexsort((rows, away))
        nearest: IntArray = rows[order[away[order] <= radius]]
        return nearest

    def _plant(self) -> None:
        self._known = len(self.poses)
        self._rows = np.flatnonzero(np.isfinite(self.poses[:, :2]).all(axis=1))
        self._tree = cKDTree(self.poses[self._rows, :2]) if len(self._rows) else cKDTree(np.zeros((1, 2)))
