"""The source paper's rubber band: a path as an elastic line in a harmonic potential (section IV, Eq 2).

Each point moves towards the place where the tension of its two neighbours and the force of the potential balance best. A
baseline: the band that the chair drives along knows its outline, see `planning.route.flowing_line`.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from waychair.planning.harmonic.harmonic_field import LogField
from waychair.types import FloatArray


def paper_band(found: LogField, points: FloatArray, delta: float = 0.2, passes: int = 200) -> FloatArray:
    """Return the source paper's band of points (N, 2), columns and rows [cells], over a field; the ends stay.

    Among a point and its eight neighbours one cell away, the point steps by delta [cells] towards the best balance of
    forces, in each of so many passes; the paper gives neither number.
    The potential's force against a step is F = 1/v there - 1/v here, in units of 1/v here: v falls so fast with the
    distance from the goal that a force in fixed units would vanish near the goal and explode far from it.
    """
    return _paper_relaxed(found.logs, points, delta, passes)


def polyline_length(points: FloatArray) -> float:
    """Return the length of a polyline (N, 2), in the points' unit."""
    return float(np.hypot(*np.diff(points, axis=0).T).sum())


@njit(cache=True, nogil=True)
def _paper_relaxed(logs: FloatArray, points: FloatArray, delta: float, passes: int) -> FloatArray:
    line = points.copy()
    for _ in range(passes):
        for k in range(1, len(line) - 1):
            x, y = line[k, 0], line[k, 1]
            here = log_between(logs, x, y)
            # tension at a point moved by (dx, dy): (sum of the neighbours - 2 * point) - 2 * (dx, dy)
            pull_x = line[k - 1, 0] + line[k + 1, 0] - 2 * x
            pull_y = line[k - 1, 1] + line[k + 1, 1] - 2 * y
            best, to_x, to_y = pull_x * pull_x + pull_y * pull_y, 0.0, 0.0
            for i in range(9):
                dx, dy = float(i % 3 - 1), float(i // 3 - 1)
                there = log_between(logs, x + delta * dx, y + delta * dy)
                if there == -np.inf or (dx == 0.0 and dy == 0.0):
                    continue
                force = math.exp(min(here - there, 50.0)) - 1.0  # F, against the step
                size = math.sqrt(dx * dx + dy * dy)
                rest_x = pull_x - 2 * delta * dx - force * dx / size
                rest_y = pull_y - 2 * delta * dy - force * dy / size
                if rest_x * rest_x + rest_y * rest_y < best - 1e-12:
                    best, to_x, to_y = rest_x * rest_x + rest_y * rest_y, dx, dy
            line[k, 0], line[k, 1] = x + delta * to_x, y + delta * to_y
    return line


@njit(cache=True, inline="always")
def log_between(logs: FloatArray, x: float, y: float) -> float:
    """Return log v at a point [cells], v interpolated between the middles of the four nearest cells; -inf in a wall."""
    if not (0 <= x < logs.shape[1] and 0 <= y < logs.shape[0]) or logs[int(y), int(x)] == -np.inf:
        return -np.inf
    left, above = math.floor(x - 0.5), math.floor(y - 0.5)
    top, total = logs[int(y), int(x)], 0.0
    for i in range(above, above + 2):
        for j in range(left, left + 2):
            if 0 <= i < logs.shape[0] and 0 <= j < logs.shape[1]:
                share = (1.0 - abs(x - 0.5 - j)) * (1.0 - abs(y - 0.5 - i))
                total += share * math.exp(logs[i, j] - top)
    return float(top + math.log(max(total, 1e-300)))
