"""Exact times at which points enter a rectangle that drives on an arc, for all points at once.

It needs numpy only, because the collision monitor's process must start fast and use little memory.
"""

from __future__ import annotations

import math

import numpy as np

from waychair.types import BoolArray, FloatArray, Twist


def may_enter(
    points: FloatArray, command: Twist, front: float, rear: float, half: float, within_s: float = math.inf
) -> BoolArray:
    """Return a mask (N,) of points (N, 2) [m] in base that a rectangle may meet on an arc of so many seconds; no other does.

    The rectangle reaches front, rear and half [m] from the axle's middle ahead, back and to either side.
    """
    x, y = points.T
    v, omega = command.v, command.omega
    way = abs(v) * within_s if v else 0.0
    if abs(omega) < _STRAIGHT:
        ahead, behind = (front + way, rear) if v > 0.0 else (front, rear + way)
        strip: BoolArray = (np.abs(y) <= half) & (x <= ahead) & (x >= -behind)
        return strip
    longest, centre = max(front, rear), abs(v / omega)
    radius = np.hypot(x, y - v / omega)
    nearest, farthest = max(centre - half, 0.0), math.hypot(longest, centre + half)
    ring: BoolArray = (radius >= nearest - _STRAIGHT) & (radius <= farthest + _STRAIGHT)
    near: BoolArray = ring & (np.hypot(x, y) <= math.hypot(longest, half) + way)
    return near


def entry_times(
    x: FloatArray, y: FloatArray, command: Twist, front: FloatArray, rear: FloatArray, half: FloatArray
) -> FloatArray:
    """Return the times (N,) [s] at which points enter their rectangles while the chair drives an arc; +inf if never.

    x, y (N,) [m] are points in base, outside their rectangles. Each point has its own rectangle, which reaches front,
    rear and half (N,) [m] from the axle's middle ahead, back and to either side. In the chair's frame a fixed point
    turns by -omega about the centre of the arc (0, v / omega), or moves straight back. It enters at its first crossing
    of a side's line between the two neighbouring sides.
    """
    v, omega = command.v, command.omega
    times = np.full(len(x), math.inf)
    if abs(omega) >= _STRAIGHT:
        return _turning(x, y - v / omega, v / omega, omega, front, rear, half)
    if v == 0.0:
        return times
    within = np.abs(y) <= half
    for level in (front, -rear):
        t = (x - level) / v
        times = np.where(within & (t >= 0.0) & (t < times), t, times)
    return times


def _turning(
    x: FloatArray, y: FloatArray, centre: float, omega: float, front: FloatArray, rear: FloatArray, half: FloatArray
) -> FloatArray:
    """Return the times (N,) [s] for points at x, y (N,) [m] from the centre of the arc, which lies beside the axle."""
    times = np.full(len(x), math.inf)
    levels = np.stack([front, -rear, half - centre, -half - centre])  # of the sides: two upright, two level
    left = x * x + y * y - levels * levels
    along = np.sqrt(np.maximum(left, 0.0))
    along = np.stack([along, -along])  # (2, 4, N): where the circle crosses a side's line
    upright, flat = along[:, :2], along[:, 2:]
    inside = np.concatenate([np.abs(upright + centre) <= half, (flat <= front) & (flat >= -rear)], axis=1)
    sense, side, point = np.nonzero(inside & (left >= 0.0))  # the angle is needed of the few crossings only
    level, other = levels[side, point], along[sense, side, point]
    angle = np.where(side < 2, np.arctan2(other, level), np.arctan2(level, other))
    phase = np.arctan2(y[point], x[point])  # it falls by omega t
    soonest = np.mod((phase - angle) * math.copysign(1.0, omega), math.tau) / abs(omega)
    np.minimum.at(times, point, soonest)
    return times


_STRAIGHT = 1e-6
"""rad/s; an arc with a smaller turn rate counts as straight."""
