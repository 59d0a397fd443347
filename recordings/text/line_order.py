"""The order of a text log's scans: doubled lines are left out, and a file that was sorted otherwise is put in order."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from waychair.types import SensorFrame

_LEAST = 10  # lines; of fewer the order tells nothing
_MANY = 0.3  # share of lines out of order from which the file was sorted in another way


def ordered_frames(frames: Sequence[SensorFrame]) -> tuple[list[SensorFrame], list[str]]:
    """Return the frames of a log without doubled lines, by stamp if most lines are elsewhere, and warnings.

    A few odd stamps, stamps that jitter, or that begin anew where the logger's clock was set back, are no such case: that order is kept.
    """
    warnings: list[str] = []
    if len(frames) < _LEAST:
        return list(frames), _stepping_back([frame.stamp_ns for frame in frames])
    kept = _without_doubles(frames)
    if len(kept) < len(frames):
        warnings.append(f"{len(frames) - len(kept)} scan lines are there twice: their copies are left out")
    stamps = [frame.stamp_ns for frame in kept]
    moved = len(stamps) - _longest_ascent(stamps)
    if moved < _MANY * len(stamps):
        return kept, warnings + _stepping_back(stamps)
    warnings.append(f"{moved} scan lines are not in the order of their stamps: they were sorted")
    return sorted(kept, key=lambda frame: frame.stamp_ns), warnings


def _stepping_back(stamps: Sequence[int]) -> list[str]:
    backwards = sum(b < a for a, b in pairwise(stamps))
    return (
        [f"stamps step backwards {backwards} times: the scans are kept in the order of the file"] if backwards else []
    )


def _without_doubles(frames: Sequence[SensorFrame]) -> list[SensorFrame]:
    seen: dict[int, list[SensorFrame]] = {}
    kept = []
    for frame in frames:
        same = seen.setdefault(frame.stamp_ns, [])
        if any(_equal(frame, other) for other in same):
            continue
        same.append(frame)
        kept.append(frame)
    return kept


def _equal(one: SensorFrame, other: SensorFrame) -> bool:
    if one.scan is None or other.scan is None:
        return False
    return np.array_equal(one.scan.ranges, other.scan.ranges, equal_nan=True) and one.wheels == other.wheels


def _longest_ascent(stamps: Sequence[int]) -> int:
    """Return the length of the longest subsequence that does not descend (patience sorting)."""
    piles: list[int] = []
    for stamp in stamps:
        at = bisect_right(piles, stamp)
        piles[at : at + 1] = [stamp]
    return len(piles)
