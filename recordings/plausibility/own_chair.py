"""Beams that see the chair or its rider: near, and always at the same distance while everything else changes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from waychair.recordings.plausibility.findings import Finding
from waychair.types import BoolArray, Scan

_NEAREST_M = 0.6  # farther things are not the chair's
_SPREAD_M = 0.04  # around the usual distance, by noise and by a rider who moves a little
_SHARE = 0.85  # of the scans in which a beam sees it
_LEAST_SCANS = 20
_CHANGED_M = 0.5  # standard deviation of the other beams over a drive that shows what stays


def without_own_chair(topic: str, scans: Sequence[Scan]) -> tuple[list[Scan], list[Finding]]:
    """Return the scans with nan in place of ranges to the chair itself, and a finding if there are any.

    Nothing is changed where scans have several sizes, or where the view hardly changes: there a wall may be as near.
    """
    counts = {len(scan.ranges) for scan in scans}
    if len(scans) < _LEAST_SCANS or len(counts) != 1:
        return list(scans), []
    table = np.array([scan.ranges for scan in scans], np.float64)
    table[~np.isfinite(table)] = np.nan
    own = _own_beams(table)
    if not own.any() or own.all():
        return list(scans), []
    usual = np.array([np.nanmedian(column) for column in table[:, own].T])
    cleared = []
    for scan, row in zip(scans, table, strict=True):
        gone = own.copy()
        with np.errstate(invalid="ignore"):
            gone[own] = np.abs(row[own] - usual) <= 2.0 * _SPREAD_M
        cleared.append(replace(scan, ranges=np.where(gone, np.float32(np.nan), scan.ranges)))
    text = (
        f"{int(own.sum())} beams {_directions(own, scans[0])} see the same thing {usual.min():.2f} m away in nearly all "
        "scans: it is taken for the chair itself and left out"
    )
    return cleared, [Finding("own chair", topic, text, "calibrate the mask of the lidar (waychair calibrate mask)")]


def _own_beams(table: np.ndarray) -> BoolArray:
    """Return which beams (N,) of ranges (scans, N) see the chair."""
    seen = np.isfinite(table).mean(axis=0) >= _SHARE
    usual, spread = np.full(table.shape[1], np.inf), np.full(table.shape[1], 0.0)
    usual[seen] = np.nanmedian(table[:, seen], axis=0)
    spread[seen] = np.nanstd(table[:, seen], axis=0)
    near = seen & (usual <= _NEAREST_M)
    same = np.zeros(table.shape[1], np.bool_)
    with np.errstate(invalid="ignore"):
        same[near] = (np.abs(table[:, near] - usual[near]) <= _SPREAD_M).mean(axis=0) >= _SHARE
    others = spread[seen & ~same]
    changes = len(others) > 0 and float(np.median(others)) >= _CHANGED_M
    return same if changes else np.zeros(table.shape[1], np.bool_)


def _directions(own: BoolArray, scan: Scan) -> str:
    """Return the directions of the first and the last of the longest run of such beams."""
    angles = np.degrees(scan.angle_min + scan.angle_step * np.flatnonzero(own))
    wrapped = [math.degrees(math.remainder(math.radians(angle), math.tau)) for angle in (angles[0], angles[-1])]
    return f"(from {wrapped[0]:.0f} to {wrapped[1]:.0f} degrees)"
