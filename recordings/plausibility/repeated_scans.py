"""Scans that a recorder wrote twice, and scans of a lidar that sticks: equal to the last bit, which noise never is."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from waychair.recordings.plausibility.findings import Finding, seconds_after
from waychair.recordings.plausibility.told_scans import ToldScan
from waychair.types import Odometry

_LEAST_STUCK = 3  # equal scans in a row
_MOVED_M, _TURNED_RAD = 0.1, 0.1  # by odometry meanwhile; a simulated lidar without noise repeats itself at rest


def without_repeated(
    topic: str, told: Sequence[ToldScan], odometry: Sequence[Odometry], findings: list[Finding]
) -> list[ToldScan]:
    """Return the scans without copies of the one before, and without those of a lidar that stuck while the chair drove."""
    if not told:
        return []
    equal = [False] + [
        after.shape == before.shape and np.array_equal(after.ranges, before.ranges, equal_nan=True)
        for before, after in pairwise(told)
    ]
    copies = [
        same and scan.stamp_ns == told[k - 1].stamp_ns for k, (same, scan) in enumerate(zip(equal, told, strict=True))
    ]
    _note(topic, "scans that are written twice are left out", "", told, copies, findings)
    kept = [k for k, copy in enumerate(copies) if not copy]
    stuck = _stuck(told, kept, equal, odometry)
    if stuck.count(True) < len(kept) - 1:
        text = "the ranges stay the same to the last bit while the wheels turn, as of a lidar that sticks: these scans are left out"
        _note(topic, text, "check the lidar and its cable", told, stuck, findings)
        kept = [k for k in kept if not stuck[k]]
    return [told[k] for k in kept]


def _stuck(
    told: Sequence[ToldScan], kept: Sequence[int], equal: Sequence[bool], odometry: Sequence[Odometry]
) -> list[bool]:
    stuck = [False] * len(told)
    stamps = np.array([reading.stamp_ns for reading in odometry], np.int64)
    k = 0
    while k < len(kept):
        end = k + 1
        while end < len(kept) and equal[kept[end]]:
            end += 1
        if end - k >= _LEAST_STUCK and len(odometry) > 1 and np.isfinite(told[kept[k]].ranges).any():
            first, last = np.clip(
                np.searchsorted(stamps, (told[kept[k]].stamp_ns, told[kept[end - 1]].stamp_ns)), 0, len(odometry) - 1
            )
            before, after = odometry[first].odom_from_base, odometry[last].odom_from_base
            moved = math.hypot(after.x - before.x, after.y - before.y) > _MOVED_M
            turned = abs(math.remainder(after.theta - before.theta, math.tau)) > _TURNED_RAD
            for other in kept[k + 1 : end] if moved or turned else ():
                stuck[other] = True
        k = end
    return stuck


def _note(
    topic: str, text: str, remedy: str, told: Sequence[ToldScan], gone: Sequence[bool], findings: list[Finding]
) -> None:
    if any(gone):
        first = gone.index(True)
        at = seconds_after([scan.stamp_ns for scan in told], first)
        findings.append(Finding("repeated scans", topic, text, remedy, sum(gone), at))
