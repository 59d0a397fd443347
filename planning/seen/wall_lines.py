"""Straight stretches of wall in the views of a range sensor, and the lines on which several of them lie.

Each view is split where its points leave a straight line (iterative end point fit; Duda and Hart, Pattern Classification
and Scene Analysis, 1973, section 9.2).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numba import njit

from waychair.planning.seen.range_views import RangeView
from waychair.types import BoolArray, FloatArray, IntArray, Pose2

SHORTEST = 0.25
"""m; a shorter straight stretch of one view gives no direction."""

OFF_LINE = 0.04
"""m; largest distance of a point from its stretch: noise and plaster."""

ONE_LINE = 0.06
"""m; stretches of several views within this of a line belong to it: noise and error of the poses."""

TURNED = math.radians(6.0)
"""rad; largest angle between a stretch of at least half a metre and the line that it belongs to."""

HOLE, HOLE_SHARE = 0.12, 0.12
"""m, share of the range; neighbouring points farther apart than both together are on two surfaces."""

LOST_BEAMS = 3
"""Beams that may say nothing within one surface."""

REACH = 1.45
"""m; a stretch farther than this from a wall along its line belongs to another wall: the widest doorway lies between."""

TOUCHING = 0.1
"""m; stretches this near to each other along a line are one."""


@dataclass(frozen=True, slots=True)
class WallLine:
    """A straight wall: a point on it and its direction (x along it) in `pose`, and its stretches (K, 2) [m] along x."""

    pose: Pose2
    stretches: FloatArray

    @property
    def length(self) -> float:
        """Length of wall seen [m]."""
        return float((self.stretches[:, 1] - self.stretches[:, 0]).sum())


def straight_stretches(view: RangeView, farthest: float) -> FloatArray:
    """Return (K, 4) [m] the ends x, y, x, y of a view's straight stretches within `farthest` [m] of its origin."""
    index = np.flatnonzero(view.met & (np.hypot(*(view.ends - view.origin).T) <= farthest))
    if len(index) < 3:
        return np.zeros((0, 4))
    return _stretches(view.ends[index], view.origin, index)


def wall_lines(stretches: FloatArray, shortest: float) -> Iterator[WallLine]:
    """Yield the lines on which stretches (K, 4) of views in one frame lie, with at least `shortest` [m] of wall.

    The longest stretch that is left over gathers all those that continue it, again and again.
    """
    left = np.ones(len(stretches), np.bool_)
    length = np.hypot(*(stretches[:, 2:] - stretches[:, :2]).T)
    for seed in np.argsort(-length):
        if not left[seed]:
            continue
        mine, pose = _gathered(stretches, length, left, int(seed))
        left &= ~mine
        if length[mine].sum() < shortest:
            continue
        line = WallLine(Pose2(*pose), _along(stretches[mine], pose))
        if line.length >= shortest:
            yield line


@njit(cache=True, nogil=True)
def _stretches(points: FloatArray, origin: FloatArray, index: IntArray) -> FloatArray:
    """Return (K, 4) the stretches of points (N, 2) in the order of their beams; `index` (N,) counts the beams."""
    count = len(points)
    found = np.empty((count, 4))
    kept, first = 0, 0
    todo = np.empty((count + 2, 2), np.int64)
    for i in range(1, count + 1):
        if i < count:
            step = math.hypot(points[i, 0] - points[i - 1, 0], points[i, 1] - points[i - 1, 1])
            away = math.hypot(points[i, 0] - origin[0], points[i, 1] - origin[1])
            if index[i] - index[i - 1] <= LOST_BEAMS and step <= HOLE + HOLE_SHARE * away:
                continue
        todo[0, 0], todo[0, 1] = first, i - 1
        waiting, first = 1, i
        while waiting > 0:
            waiting -= 1
            a, b = todo[waiting, 0], todo[waiting, 1]
            length = math.hypot(points[b, 0] - points[a, 0], points[b, 1] - points[a, 1])
            if b - a < 3 or length < 1e-6:
                continue
            at, worst = _farthest_off(points, a, b)
            if worst > OFF_LINE:
                todo[waiting, 0], todo[waiting, 1] = at, b
                todo[waiting + 1, 0], todo[waiting + 1, 1] = a, at
                waiting += 2
            elif length >= SHORTEST:
                found[kept, :2], found[kept, 2:] = points[a], points[b]
                kept += 1
    return found[:kept]


@njit(cache=True, nogil=True)
def _farthest_off(points: FloatArray, a: int, b: int) -> tuple[int, float]:
    """Return the point between points a and b that is farthest off the line through both, and its distance [m]."""
    dx, dy = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1]
    length = math.hypot(dx, dy)
    worst, at = 0.0, a
    for k in range(a + 1, b):
        off = abs(dx * (points[k, 1] - points[a, 1]) - dy * (points[k, 0] - points[a, 0])) / length
        if off > worst:
            worst, at = off, k
    return at, worst


@njit(cache=True, nogil=True)
def _gathered(
    stretches: FloatArray, length: FloatArray, left: BoolArray, seed: int
) -> tuple[BoolArray, tuple[float, float, float]]:
    """Return which stretches (K,) among `left` continue the seed, and the line's pose: gather, fit, gather again."""
    mine = np.zeros(len(stretches), np.bool_)
    mine[seed] = True
    pose = _fitted(stretches, length, mine)
    for _ in range(3):
        mine[:] = False
        mine[seed] = True
        low, high = -length[seed] / 2, length[seed] / 2
        c, s = math.cos(pose[2]), math.sin(pose[2])
        grown = True
        while grown:
            grown = False
            for i in range(len(stretches)):
                if mine[i] or not left[i]:
                    continue
                ax, ay = stretches[i, 0] - pose[0], stretches[i, 1] - pose[1]
                bx, by = stretches[i, 2] - pose[0], stretches[i, 3] - pose[1]
                a_off, b_off = c * ay - s * ax, c * by - s * bx
                if max(abs(a_off), abs(b_off)) > ONE_LINE:
                    continue
                if abs(b_off - a_off) > math.sin(TURNED) * max(length[i], 0.5):
                    continue
                a, b = c * ax + s * ay, c * bx + s * by
                if min(a, b) > high + REACH or max(a, b) < low - REACH:
                    continue
                mine[i], grown = True, True
                low, high = min(low, a, b), max(high, a, b)
        pose = _fitted(stretches, length, mine)
    return mine, pose


@njit(cache=True, nogil=True)
def _fitted(stretches: FloatArray, length: FloatArray, mine: BoolArray) -> tuple[float, float, float]:
    """Return x, y, theta of the line through the ends of `mine`, by least squares with the lengths as weights."""
    total, x, y = 0.0, 0.0, 0.0
    for i in range(len(mine)):
        if mine[i]:
            total += length[i]
            x += length[i] * (stretches[i, 0] + stretches[i, 2]) / 2
            y += length[i] * (stretches[i, 1] + stretches[i, 3]) / 2
    x, y = x / total, y / total
    xx, xy, yy = 0.0, 0.0, 0.0
    for i in range(len(mine)):
        if mine[i]:
            for k in (0, 2):
                px, py = stretches[i, k] - x, stretches[i, k + 1] - y
                xx += length[i] * px * px
                xy += length[i] * px * py
                yy += length[i] * py * py
    return x, y, 0.5 * math.atan2(2.0 * xy, xx - yy)


def _along(stretches: FloatArray, pose: tuple[float, float, float]) -> FloatArray:
    """Return the intervals (K, 2) [m] of stretches (N, 4) along a line, sorted; those that touch are joined."""
    axis = np.array([math.cos(pose[2]), math.sin(pose[2])])
    both = np.sort(((stretches.reshape(-1, 2) - pose[:2]) @ axis).reshape(-1, 2), axis=1)
    both = both[np.argsort(both[:, 0])]
    reached = np.maximum.accumulate(both[:, 1])
    first = np.flatnonzero(np.concatenate([[True], both[1:, 0] > reached[:-1] + TOUCHING]))
    last = np.concatenate([first[1:], [len(both)]]) - 1
    return np.stack([both[first, 0], reached[last]], axis=1)
