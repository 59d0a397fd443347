"""Rehearsal: consecutive similar views are merged into one node of greater weight (RTAB-Map 0.23.8, Memory::rehearsal).

A node's weight counts how often the view did not change, and so how long the chair stayed. RTAB-Map can also compare
global descriptors; waychair computes none, so visual words always decide.
"""

from __future__ import annotations

import enum

import numpy as np

from waychair.slam.memory.nodes import MemoryNode, WordIds
from waychair.types import Pose2

SIMILARITY = 0.6
"""Least share of common words of two views of one place (RTAB-Map's Mem/RehearsalSimilarity)."""

LINEAR_UPDATE, ANGULAR_UPDATE = 0.1, 0.1
"""The chair stands below this motion [m], [rad] on each axis (RTAB-Map's RGBD/LinearUpdate, RGBD/AngularUpdate)."""


class RehearsalResult(enum.Enum):
    """How a new node and the one before it are treated."""

    DIFFERENT = "the views differ"
    ADD_WEIGHT = "the chair moves: only the weight is transferred"
    MERGE = "the chair stands, and no node is between them: they are merged"
    INTERMEDIATE = "the chair stands, but other nodes are between them: one becomes intermediate"


def similarity(a: WordIds, b: WordIds) -> float:
    """Return the share of the larger view's words that both views contain; 0 if a view has no words."""
    a, b = a[a > 0], b[b > 0]
    if not len(a) or not len(b):
        return 0.0
    words_a, counts_a = np.unique(a, return_counts=True)
    words_b, counts_b = np.unique(b, return_counts=True)
    _, in_a, in_b = np.intersect1d(words_a, words_b, assume_unique=True, return_indices=True)
    return float(np.minimum(counts_a[in_a], counts_b[in_b]).sum() / max(len(a), len(b)))


def is_moving(motion: Pose2) -> bool:
    """Return whether any axis of the motion exceeds its limit (per axis, not by length)."""
    return abs(motion.x) > LINEAR_UPDATE or abs(motion.y) > LINEAR_UPDATE or abs(motion.theta) > ANGULAR_UPDATE


def rehearse(new: MemoryNode, old: MemoryNode, motion: Pose2 | None, linked: bool) -> RehearsalResult:
    """Compare a new node with `old`, the latest earlier node of the STM that is not intermediate.

    Args:
        motion: the new node's pose relative to its neighbour in time; None without a neighbour: the motion is unknown.
        linked: whether that neighbour is `old`.
    """
    if new.is_bad or similarity(new.words, old.words) < SIMILARITY:
        return RehearsalResult.DIFFERENT
    if motion is None or is_moving(motion):
        return RehearsalResult.ADD_WEIGHT
    return RehearsalResult.MERGE if linked else RehearsalResult.INTERMEDIATE
