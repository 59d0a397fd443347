"""The arithmetic inside the dynamic window: arcs against the path and the obstacles."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from waychair.planning.footprint import Footprint, along_arc, beside, free_time
from waychair.types import FloatArray

SPACING = 0.05
"""Distance [m] of the points of a section of path."""

_LOOKS = 10
"""Poses of an arc that are compared with the path."""


def local_section(poses: FloatArray, at: FloatArray, length: float) -> tuple[FloatArray, float]:
    """The path from its point nearest to a pose on: (M, 3) points every 0.05 m with the path's direction there.

    poses (N, 3) and at (3,) [m, m, rad] in map; the section ends after `length` [m] or at the path's end. Also the way
    [m] that remains to the end of the whole path, the distance from the pose to the section included.
    """
    points = poses[:, :2]
    if len(points) == 1:
        return poses[:1].copy(), float(np.hypot(*(points[0] - at[:2])))
    steps = np.diff(points, axis=0)
    lengths = np.hypot(steps[:, 0], steps[:, 1])
    along = np.concatenate([[0.0], np.cumsum(lengths)])
    # The nearest point of each leg, then the nearest of those.
    share = np.clip(((at[:2] - points[:-1]) * steps).sum(axis=1) / np.maximum(lengths**2, 1e-12), 0.0, 1.0)
    away = np.hypot(*(points[:-1] + share[:, None] * steps - at[:2]).T)
    leg = int(np.argmin(away))
    begin = along[leg] + share[leg] * lengths[leg]
    end = min(begin + length, along[-1])
    stations = np.linspace(begin, end, int((end - begin) / SPACING) + 2)
    x, y = np.interp(stations, along, points[:, 0]), np.interp(stations, along, points[:, 1])
    legs = np.clip(np.searchsorted(along, stations, side="right") - 1, 0, len(steps) - 1)
    direction = np.arctan2(steps[legs, 1], steps[legs, 0])
    return np.column_stack([x, y, direction]), float(along[-1] - begin + away[leg])


@njit(cache=True, nogil=True)
def measure(
    shape: Footprint,
    start_cells: FloatArray,
    start: FloatArray,
    candidates: FloatArray,
    section: FloatArray,
    certain: FloatArray,
    horizon: float,
) -> FloatArray:
    """(N, 7): free_time, clearance, path_error, heading_error, bearing, progress, target_distance (see `Features`).

    start_cells (3,) and start (3,) are the same pose on the field's grid and in map; section (M, 3) in map. certain (N,)
    [s]: how long each arc must be known for sure, `horizon` [s]: how long it is.
    """
    # A point near the front end of the long axis; led along the path, it lines the chair up with doors early.
    nose = (shape.discs[0, 0] + shape.discs[0, 3]) * shape.cell
    rows = np.empty((len(candidates), 7))
    for i in range(len(candidates)):
        v, omega = candidates[i, 0], candidates[i, 1]
        free = free_time(shape, start_cells, v / shape.cell, omega, certain[i], horizon)
        rows[i, 0] = free
        rows[i, 1] = _clearance(shape, start_cells, v / shape.cell, omega, free)
        _compare(start, v, omega, free, nose, section, rows[i])
    return rows


@njit(cache=True)
def _clearance(shape: Footprint, start: FloatArray, v: float, omega: float, free: float) -> float:
    """Least distance [m] beside the body along an arc as far as it is free."""
    least = math.inf
    for look in range(1, _LOOKS + 1):
        x, y, theta = along_arc(start[0], start[1], start[2], v, omega, free * look / _LOOKS)
        least = min(least, beside(shape, x, y, theta))
    return least


@njit(cache=True)
def _compare(
    start: FloatArray, v: float, omega: float, free: float, nose: float, section: FloatArray, row: FloatArray
) -> None:
    """Fill path_error, heading_error, bearing, progress and target_distance of an arc as far as it is free."""
    last = len(section) - 1
    path_error, target = 0.0, math.inf
    x, y, theta = start[0], start[1], start[2]
    nearest = 0
    for look in range(1, _LOOKS + 1):
        x, y, theta = along_arc(start[0], start[1], start[2], v, omega, free * look / _LOOKS)
        front_x, front_y = x + nose * math.cos(theta), y + nose * math.sin(theta)
        least, front = math.inf, math.inf
        for j in range(last + 1):
            square = (section[j, 0] - x) ** 2 + (section[j, 1] - y) ** 2
            if square < least:
                least = square
                nearest = j
            front = min(front, (section[j, 0] - front_x) ** 2 + (section[j, 1] - front_y) ** 2)
        front = min(front, _beyond(section[last], front_x, front_y))
        path_error += (math.sqrt(least) + math.sqrt(front)) / (2 * _LOOKS)
        target = min(target, math.hypot(section[last, 0] - x, section[last, 1] - y))
    row[2] = path_error
    row[3] = abs(_wrapped(theta - section[nearest, 2]))
    row[4] = abs(_wrapped(math.atan2(section[last, 1] - y, section[last, 0] - x) - theta))
    row[5] = math.hypot(section[1, 0] - section[0, 0], section[1, 1] - section[0, 1]) * nearest if last > 0 else 0.0
    row[6] = target


@njit(cache=True, inline="always")
def _beyond(end: FloatArray, x: float, y: float) -> float:
    """Square of the distance [m^2] from the path prolonged straight past its end; infinite before the end.

    The front of a chair that stops at the end lies beyond it, which is no error.
    """
    c, s = math.cos(end[2]), math.sin(end[2])
    if (x - end[0]) * c + (y - end[1]) * s < 0.0:
        return math.inf
    return float(((y - end[1]) * c - (x - end[0]) * s) ** 2)


@njit(cache=True, inline="always")
def _wrapped(angle: float) -> float:
    return angle - math.tau * math.floor(angle / math.tau + 0.5)
