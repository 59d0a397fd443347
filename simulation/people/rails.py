"""The line that a person walks along: a path with rounded corners and a speed limit at each point.

A rail is (M, 5) float64: distance from its beginning [m], x, y [m, map], direction [rad, not wrapped, so that it can be
interpolated] and the speed limit there [m/s]. A person walks the same line back with the direction reversed.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from waychair.geometry import arc_lengths, limit_slope
from waychair.types import FloatArray

SPACING = 0.05
"""Greatest distance [m] between two points of a rail."""

CORNER_RADIUS = 0.4
"""Greatest radius [m] of a rounded corner; it is smaller where the path is too short or the corner too sharp."""

CORNER_CUT = 0.2
"""Largest distance [m] between a corner and its bend."""

ACCELERATION = 1.2
"""Acceleration [m/s^2] of a person when starting, stopping or in a bend: walking speed within one or two steps."""

SLOWEST = 0.05
"""Least speed limit [m/s] on a rail: with a limit of 0 a person would never start."""

_STRAIGHT = math.radians(0.1)
"""Turns by less than this angle [rad] are not corners."""


def rail_from_path(path: FloatArray, speed: float) -> FloatArray:
    """Return the rail (M, 5) along a path (N, 2) [m, map] for a person with the preferred `speed` [m/s].

    The speed limit allows a stop at either end and the corners with ACCELERATION; a path of one point gives one row.
    The two passes over the squared speed are those of time-optimal path following.
    """
    line = _rounded(_without_repeats(path))
    points, direction, radius = line[:, :2], line[:, 2], line[:, 3]
    along = arc_lengths(points)
    square = np.minimum(speed**2, ACCELERATION * radius)
    square[0] = square[-1] = 0.0
    gain = 2.0 * ACCELERATION * along
    square = limit_slope(square, gain)
    limit = np.maximum(np.sqrt(np.maximum(square, 0.0)), min(SLOWEST, speed))
    return np.column_stack([along, points, direction, limit])


@njit(cache=True)
def rail_at(rails: FloatArray, first: int, last: int, along: float) -> tuple[float, float, float, float]:
    """Return x, y, direction and speed limit at a distance [m] along the rail in rows `first:last` of `rails`."""
    low, high = first, last - 1
    while high - low > 1:
        middle = (low + high) // 2
        if rails[middle, 0] <= along:
            low = middle
        else:
            high = middle
    length = rails[high, 0] - rails[low, 0]
    part = min(max((along - rails[low, 0]) / length, 0.0), 1.0) if length > 0.0 else 0.0
    return (
        rails[low, 1] + part * (rails[high, 1] - rails[low, 1]),
        rails[low, 2] + part * (rails[high, 2] - rails[low, 2]),
        rails[low, 3] + part * (rails[high, 3] - rails[low, 3]),
        rails[low, 4] + part * (rails[high, 4] - rails[low, 4]),
    )


def _without_repeats(path: FloatArray) -> FloatArray:
    points = np.asarray(path, np.float64).reshape(-1, 2)
    steps = np.hypot(*np.diff(points, axis=0).T)
    kept: FloatArray = points[np.concatenate([[True], steps > 1e-6])]
    return kept


def _rounded(path: FloatArray) -> FloatArray:
    """Return x, y, direction and bend radius (+inf on straights) every SPACING along the path, (M, 4)."""
    if len(path) == 1:
        return np.array([[*path[0], 0.0, math.inf]])
    edges = np.diff(path, axis=0)
    lengths = np.hypot(*edges.T)
    units = edges / lengths[:, None]
    direction = math.atan2(units[0, 1], units[0, 0])
    pieces, begin = [], path[0]
    for i, corner in enumerate(path[1:-1]):
        sine = units[i, 0] * units[i + 1, 1] - units[i, 1] * units[i + 1, 0]
        turn = math.atan2(sine, float(units[i] @ units[i + 1]))
        if abs(turn) < _STRAIGHT:
            continue
        slope, cosine = math.tan(abs(turn) / 2), math.cos(turn / 2)
        radius = min(
            CORNER_RADIUS, CORNER_CUT * cosine / (1.0 - cosine), lengths[i] / 2 / slope, lengths[i + 1] / 2 / slope
        )
        cut = radius * slope
        end = corner - cut * units[i]
        pieces += [_straight(begin, end, direction), _arc(end, direction, turn, radius)]
        begin, direction = corner + cut * units[i + 1], direction + turn
    pieces += [_straight(begin, path[-1], direction), np.array([[*path[-1], direction, math.inf]])]
    return np.concatenate(pieces)


def _straight(begin: FloatArray, end: FloatArray, direction: float) -> FloatArray:
    """Return the rows from `begin` to `end`, without `end`."""
    count = math.ceil(math.dist(begin, end) / SPACING)
    points = np.linspace(begin, end, count, endpoint=False).reshape(-1, 2)
    return np.column_stack([points, np.full(count, direction), np.full(count, math.inf)])


def _arc(begin: FloatArray, direction: float, turn: float, radius: float) -> FloatArray:
    """Return the rows of a bend from a direction by `turn` [rad], left if positive; both ends included."""
    angles = np.linspace(0.0, abs(turn), math.ceil(radius * abs(turn) / SPACING) + 2)
    c, s = math.cos(direction), math.sin(direction)
    ahead, aside = radius * np.sin(angles), math.copysign(radius, turn) * (1.0 - np.cos(angles))
    return np.column_stack(
        [
            begin[0] + ahead * c - aside * s,
            begin[1] + ahead * s + aside * c,
            direction + math.copysign(1.0, turn) * angles,
            np.full(len(angles), radius),
        ]
    )
