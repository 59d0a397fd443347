"""Detection of the chair's own parts in the lidar's view: footrests, the rider's legs, a bag, without a self-mask.

Two signs prove an own part. Points well within the footprint can be nothing else, if they last. Points just outside
it that keep their beams and ranges while the chair drives or turns move with the chair; a wall along which it drives
does the same, so only a narrow object that stands free counts. Until the chair has moved, such an object may be a
stranger's: the rider is told both causes, and the drive waits.
"""

from __future__ import annotations

import math

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.calibration.fits.self_mask import BEYOND, outline_reach
from waychair.control.safety.stops import Halt, halt
from waychair.recordings.scans import without_overflow_codes
from waychair.types import BoolArray, FloatArray, IntArray, Pose2, Scan

DEEP, DEEP_FREE = 0.05, 0.02
"""m; points so far within the footprint are no noise at its edge; the second is for a narrow object that stands free, since
a wall that the chair touches may seem to be within a footprint measured too large."""

LASTS_S = 1.5
"""s; points count as a part of the chair, or as somebody that stands there, only after so long."""

OFTEN = 0.8
"""Share of the scans in which a beam must see the part."""

STEADY = 0.04
"""m; a part's range stays within this."""

MOVED_M, TURNED_RAD = 0.25, 0.35
"""m, rad; a part that is still there after the chair has moved so far moves with it."""

STAYS_S = 15.0
"""s; a drive that has stood for so long beside something so near ends: somebody would have stepped aside."""

_BEAMS = 3
"""Fewest neighbouring beams on a part; fewer are noise."""

_APART = 0.15
"""m; beside a part that stands free, beams end at least so much farther off."""

_LONGEST_GAP_NS = 1_000_000_000


class OwnParts:
    """The beams that see something at or within the footprint, how long they have, and how far the chair has moved."""

    def __init__(self, body: ChairBody) -> None:
        self._body = body
        self._angles: FloatArray = np.empty(0)
        self._reach: FloatArray = np.empty((3, 0))  # to the outline less DEEP, less DEEP_FREE, and BEYOND it
        self._seen: FloatArray = np.empty((6, 0))  # by beam: range, first stamp, looks, hits, distance and turn then
        self._last: tuple[int, Pose2] | None = None
        self._moved = np.zeros(2)  # m, rad; motion so far
        self._waits_since_ns: int | None = None
        self._inside, self._with_chair, self._near = (np.zeros(0, np.bool_) for _ in range(3))

    def see(self, raw: Scan, odom_from_base: Pose2) -> None:
        """Take in a scan without the beams that the self-mask hides, and the odometry at it."""
        scan = without_overflow_codes(raw)
        self._advance(scan, odom_from_base)
        ranges = scan.ranges.astype(np.float64)
        known = np.isfinite(ranges) & (ranges >= max(scan.range_min, 0.0)) & (ranges > 0.0)
        deep = known & (ranges < self._reach[0])
        near = known & (ranges <= self._reach[2])
        free = near & _standing_free(ranges, known, near)
        self._track(scan.stamp_ns, ranges, deep | free)
        self._judge(scan.stamp_ns, free)

    def halts(self, now_ns: int, waits: bool) -> tuple[Halt, ...]:
        """Return the halt of own parts or, if the drive `waits`, of things so near that they may be the chair's own."""
        if not (waits and self._near.any()):
            self._waits_since_ns = None
        elif self._waits_since_ns is None:
            self._waits_since_ns = now_ns
        if (parts := self._inside | self._with_chair).any():
            return (halt("own_parts", self._where(parts)),)
        if self._waits_since_ns is None:
            return ()
        stays = now_ns - self._waits_since_ns >= STAYS_S * 1e9
        return (halt("near_parts_stay" if stays else "near_parts", self._where(self._near)),)

    def _advance(self, scan: Scan, odom_from_base: Pose2) -> None:
        """Add up the chair's motion; start anew with another lidar or after a gap."""
        angles = scan.angles()
        gap_ns = math.inf if self._last is None else scan.stamp_ns - self._last[0]
        if not 0 < gap_ns <= _LONGEST_GAP_NS or not np.array_equal(angles, self._angles):
            self._angles = angles
            reaches = (outline_reach(angles, self._body, beyond) for beyond in (-DEEP, -DEEP_FREE, BEYOND))
            self._reach = np.array(list(reaches))
            self._seen = np.zeros((6, len(angles)))
        elif self._last is not None:
            step = self._last[1].inverse() @ odom_from_base
            self._moved += np.array([math.hypot(step.x, step.y), abs(step.theta)])
        self._last = scan.stamp_ns, odom_from_base

    def _track(self, stamp_ns: int, ranges: FloatArray, sees: BoolArray) -> None:
        """Count the looks and hits of every beam; a beam that has missed too often begins anew."""
        at, since, looks, hits, way, turn = self._seen
        steady = sees & (np.abs(np.where(sees, ranges, 0.0) - at) <= STEADY)
        looks[at > 0.0] += 1.0
        hits[steady & (at > 0.0)] += 1.0
        begins = ((at == 0.0) & sees) | ((at > 0.0) & (hits < OFTEN * looks - 2.0))
        at[begins] = np.where(sees, ranges, 0.0)[begins]
        since[begins], looks[begins], hits[begins] = stamp_ns * 1e-9, 1.0, sees[begins]
        way[begins], turn[begins] = self._moved

    def _judge(self, stamp_ns: int, free: BoolArray) -> None:
        """Find the beams on something that lasts: within the footprint, moving with the chair, or just near it."""
        at, since, looks, hits, way, turn = self._seen
        lasts = (at > 0.0) & (stamp_ns * 1e-9 - since >= LASTS_S) & (hits >= OFTEN * looks)
        came_along = (self._moved[0] - way >= MOVED_M) | (self._moved[1] - turn >= TURNED_RAD)
        self._inside = _runs(lasts & (at < np.where(free, self._reach[1], self._reach[0])))
        self._with_chair = _runs(lasts & came_along)
        self._near = _runs(lasts)

    def _where(self, beams: BoolArray) -> str:
        """Return where the lidar sees the parts: directions and the least range."""
        sides = np.degrees(self._angles[beams])
        names = [name for name, so in (("left", (sides > 0.0).any()), ("right", (sides <= 0.0).any())) if so]
        return f"{self._seen[0][beams].min():.2f} m from the lidar, on the {' and the '.join(names)}"


def _standing_free(ranges: FloatArray, known: BoolArray, near: BoolArray) -> BoolArray:
    """Return a mask (N,) of the runs of near beams beside which, on both sides, beams end much farther off.

    One end may be that of the lidar's view.
    """
    ends: FloatArray = np.where(known, ranges, np.where(np.isnan(ranges), np.nan, math.inf))
    free = np.zeros(len(near), np.bool_)
    for first, after in _spans(near):
        steps = []
        if first > 0:
            steps.append(_last_known(ends[:first]) - ranges[first])
        if after < len(near):
            steps.append(_last_known(ends[after:][::-1]) - ranges[after - 1])
        free[first:after] = bool(steps) and min(steps) > _APART
    return free


def _last_known(ends: FloatArray) -> float:
    """Return the last range that is a number; +inf without one."""
    told = np.flatnonzero(~np.isnan(ends))
    return float(ends[told[-1]]) if len(told) else math.inf


def _runs(beams: BoolArray) -> BoolArray:
    """Return the beams (N,) that have enough neighbours."""
    kept = np.zeros(len(beams), np.bool_)
    for first, after in _spans(beams):
        kept[first:after] = after - first >= _BEAMS
    return kept


def _spans(beams: BoolArray) -> IntArray:
    """Return the first index of each run of beams and the one after its last, (K, 2)."""
    edges = np.diff(np.concatenate([[False], beams, [False]]).astype(np.int8))
    return np.flatnonzero(edges).reshape(-1, 2)
