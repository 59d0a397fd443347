"""The order of a text log's scans: doubled lines are left out, moved ones go back, and a file sorted otherwise is sorted."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from waychair.types import SensorFrame

_LEAST = 10  # lines; of fewer the order tells nothing
_FAR = 5  # lines by which a moved one is away from its place at least,
_FAR_NS = 3_000_000_000  # and by which its stamp is off the line before; less is jitter of a busy computer
_HOLE = 1.5  # times the usual time between two scans; the least gap that a moved line leaves
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
    moved = len(stamps) - len(_ascent(stamps))
    if moved < _MANY * len(stamps):
        ordered, away = _put_back(kept)
        if away:
            text = "scan lines are far from the place of their stamps, where lines are missing: they were put there"
            warnings.append(f"{away} {text}")
        return ordered, warnings + _stepping_back([frame.stamp_ns for frame in ordered])
    warnings.append(f"{moved} scan lines are not in the order of their stamps: they were sorted")
    return sorted(kept, key=lambda frame: frame.stamp_ns), warnings


def _put_back(frames: Sequence[SensorFrame]) -> tuple[list[SensorFrame], int]:
    """Return the frames with moved ones at the place of their stamps, where they have left a hole, and their number."""
    stamps = [frame.stamp_ns for frame in frames]
    rising = _ascent(stamps)
    inside = set(rising)
    rest = [stamps[k] for k in rising]
    usual = float(np.median(np.diff(rest))) if len(rest) > 1 else 0.0
    moved = []
    for k in range(len(stamps)):
        if k in inside:
            continue
        place, here = bisect_right(rest, stamps[k]), bisect_right(rising, k)
        between, off = 0 < place < len(rest), abs(stamps[k] - rest[max(here - 1, 0)])
        if abs(place - here) > _FAR and off > _FAR_NS and between and rest[place] - rest[place - 1] > _HOLE * usual:
            moved.append(k)
    gone = set(moved)
    ordered = [k for k in range(len(stamps)) if k not in gone]
    for k in moved:
        later = (at for at, other in enumerate(ordered) if other in inside and stamps[other] > stamps[k])
        before = next(later, len(ordered))
        ordered.insert(before, k)
        inside.add(k)
    return [frames[k] for k in ordered], len(moved)


def _stepping_back(stamps: Sequence[int]) -> list[str]:
    backwards = sum(b < a for a, b in pairwise(stamps))
    return (
        [f"stamps step backwards {backwards} times: the scans are kept in the order of the file"] if backwards else []
    )


def _without_doubles(frames: Sequence[SensorFrame]) -> list[SensorFrame]:
    """Return the frames without those whose stamp, ranges and odometry have come before; stamps alone may stand still."""
    seen: dict[tuple[int, bytes], list[SensorFrame]] = {}
    kept = []
    for frame in frames:
        if frame.scan is not None:
            same = seen.setdefault((frame.stamp_ns, frame.scan.ranges.tobytes()), [])
            if any(frame.wheels == other.wheels for other in same):
                continue
            same.append(frame)
        kept.append(frame)
    return kept


def _ascent(stamps: Sequence[int]) -> list[int]:
    """Return the indices of the longest subsequence that does not descend (patience sorting)."""
    piles: list[int] = []
    tops: list[int] = []
    before = [-1] * len(stamps)
    for k, stamp in enumerate(stamps):
        at = bisect_right(piles, stamp)
        before[k] = tops[at - 1] if at else -1
        piles[at : at + 1] = [stamp]
        tops[at : at + 1] = [k]
    found, k = [], tops[-1] if tops else -1
    while k >= 0:
        found.append(k)
        k = before[k]
    return found[::-1]
