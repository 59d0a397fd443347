"""Poses of the key scans that the memory's nodes are attached to: which have moved, and which lie near a point.

The cost per frame depends only on the anchors that changed. While anchors are only added, the new array shares the old
array's memory (see `PoseGraph`), and old rows are not compared. After an optimisation all rows are compared once, and
the next radius query builds a new k-d tree if a row of the tree has moved.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from waychair.types import FloatArray, IntArray, Pose2

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

_MOVED = 1e-6  # [m], [rad]; an anchor that changed by less has not moved
_UNINDEXED = 256  # new anchors that are compared one by one before a new tree is built


class AnchorPoses:
    """Anchor poses (A, 3) [m, m, rad] in the map frame; nan for an anchor without a pose."""

    def __init__(self, poses: FloatArray | None = None) -> None:
        self.poses: FloatArray = np.empty((0, 3)) if poses is None else poses
        self._tree: cKDTree | None = None
        self._rows = np.empty(0, np.int64)  # anchor of each point of the tree
        self._known = 0  # rows that the tree was built from

    def __len__(self) -> int:
        return len(self.poses)

    def update(self, poses: FloatArray) -> IntArray:
        """Replace the poses by (B, 3), without a copy; return the rows that are new or have moved.

        The caller must not change rows of an array that it passed before.
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
        """Return the anchors within the radius [m], nearest first."""
        if self._tree is None or len(self.poses) - self._known > _UNINDEXED:
            self._build_tree()
        assert self._tree is not None
        inside = self._tree.query_ball_point((at.x, at.y), radius) if len(self._rows) else []
        rows = np.concatenate([self._rows[inside], np.arange(self._known, len(self.poses))]).astype(np.int64)
        away = np.hypot(*(self.poses[rows, :2] - (at.x, at.y)).T)
        order = np.lexsort((rows, away))
        nearest: IntArray = rows[order[away[order] <= radius]]
        return nearest

    def _build_tree(self) -> None:
        self._known = len(self.poses)
        self._rows = np.flatnonzero(np.isfinite(self.poses[:, :2]).all(axis=1))
        from scipy.spatial import cKDTree

        self._tree = cKDTree(self.poses[self._rows, :2]) if len(self._rows) else cKDTree(np.zeros((1, 2)))
