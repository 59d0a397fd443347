"""Beams that never measure anything, as where something covers the lidar: told, since the map then holds less."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from waychair.recordings.plausibility.findings import Finding
from waychair.types import Scan

_LEAST_SHARE = 0.5  # of the beams, side by side; the rider and the back of a chair cover fewer
_SEEN = 0.02  # share of the scans in which a blind beam measures something all the same
_LEAST_SCANS = 20


def blind_sector(topic: str, scans: Sequence[Scan]) -> list[Finding]:
    """Return a finding if half of the beams of a lidar or more, side by side, measure nothing in nearly all scans."""
    if len(scans) < _LEAST_SCANS or len({len(scan.ranges) for scan in scans}) != 1:
        return []
    table = np.array([scan.ranges for scan in scans])
    with np.errstate(invalid="ignore"):
        seen = (np.isfinite(table) & (table > 0.0)).mean(axis=0)
    blind = seen < _SEEN
    if blind.all():
        return []
    first, count = _longest_run(blind.tolist())
    if count < _LEAST_SHARE * len(blind):
        return []
    ends = [
        math.degrees(math.remainder(scans[0].angle_min + scans[0].angle_step * (k % len(blind)), math.tau))
        for k in (first, first + count - 1)
    ]
    text = (
        f"{count} of {len(blind)} beams, from {ends[0]:.0f} to {ends[1]:.0f} degrees, measure no distance in nearly all scans: "
        "the map holds only the things on the other side, and its places are less certain"
    )
    return [Finding("blind sector", topic, text, "does something cover the lidar?")]


def _longest_run(blind: list[bool]) -> tuple[int, int]:
    """Return the first beam and the length of the longest run, round the end of the scan as well."""
    best, run = (0, 0), 0
    for k, each in enumerate(blind * 2):
        run = run + 1 if each else 0
        if run > best[1]:
            best = (k + 1 - run, run)
    return best[0], min(best[1], len(blind))
