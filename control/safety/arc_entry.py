"""Exact times at which points enter a rectangle that drives on an arc, for all points at once.

It needs numpy only, because the collision monitor's process must start fast and use little memory.
"""

from __future__ import annotations

import math

import numpy as np

from waychair.types import BoolArray, FloatArray, Twist


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
    if v == 0.0 and abs(omega) < _STRAIGHT:
        return times
    near = _come_by(x, y, v, omega, front, rear, half)
    x, y, front, rear, half = x[near], y[near], front[near], rear[near], half[near]
    best = np.full(len(x), math.inf)
    for level, upright in ((front, True), (-rear, True), (half, False), (-half, False)):
        for t in _crossings(x, y, v, omega, level, upright):
            px, py = _moved(x, y, v, omega, t)
            inside = np.abs(py) <= half if upright else (px <= front) & (px >= -rear)
            best = np.where((t >= 0.0) & inside & (t < best), t, best)
    times[near] = best
    return times


def _come_by(
    x: FloatArray, y: FloatArray, v: float, omega: float, front: FloatArray, rear: FloatArray, half: FloatArray
) -> BoolArray:
    """Return a mask (N,) of points whose circle or line meets the largest rectangle; no other point enters any."""
    side = float(half.max(initial=0.0))
    if abs(omega) < _STRAIGHT:
        straight: BoolArray = np.abs(y) <= side
        return straight
    ahead, behind, centre = float(front.max(initial=0.0)), float(rear.max(initial=0.0)), abs(v / omega)
    radius = np.hypot(x, y - v / omega)
    nearest, farthest = max(centre - side, 0.0), math.hypot(max(ahead, behind), centre + side)
    turning: BoolArray = (radius >= nearest - _STRAIGHT) & (radius <= farthest + _STRAIGHT)
    return turning


def _crossings(
    x: FloatArray, y: FloatArray, v: float, omega: float, level: FloatArray, upright: bool
) -> tuple[FloatArray, ...]:
    """Return the times (N,) [s] at which points cross the line x = level (`upright`) or y = level; nan if never."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        if abs(omega) < _STRAIGHT:
            return ((x - level) / v if upright else np.full(len(x), math.nan),)
        radius_y = y - v / omega
        reach, phase = np.hypot(x, radius_y), np.arctan2(radius_y, x)
        part = (level / reach) if upright else (level - v / omega) / reach
        turn = np.arccos(part) if upright else np.arcsin(part)
        angles = (turn, -turn) if upright else (turn, math.pi - turn)
        # the phase falls by omega t; the first time that is not in the past
        return tuple(np.mod((phase - angle) * math.copysign(1.0, omega), math.tau) / abs(omega) for angle in angles)


def _moved(x: FloatArray, y: FloatArray, v: float, omega: float, t: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the points' positions in the chair's frame after times t (N,) [s]."""
    if abs(omega) < _STRAIGHT:
        return x - v * t, y
    c, s = np.cos(omega * t), np.sin(omega * t)
    radius_y = y - v / omega
    return c * x + s * radius_y, c * radius_y - s * x + v / omega


_STRAIGHT = 1e-6
"""rad/s; an arc with a smaller turn rate counts as straight."""
