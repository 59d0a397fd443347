"""Kernels of the dynamic window: candidate arcs measured against the path, the obstacles and people."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from waychair.angles import wrapped
from waychair.geometry import arc_lengths, nearest_step
from waychair.planning.body.arc_fan import FINE, fill_table, free_times
from waychair.planning.body.footprint import Footprint, along_arc, free_time, room, side_clearance
from waychair.planning.body.personal_space import PREDICTED_GROWTH
from waychair.types import BoolArray, FloatArray

SPACING = 0.05
"""Distance [m] of the points of a section of path."""

_LOOKS = 10
"""Number of poses of an arc that are compared with the path."""

_BEHIND, _AHEAD = 5, 25
"""Search window for the path's nearest point from one such pose to the next: it begins so many points before the last
one and has so many points. An arc runs along the path."""


def local_section(poses: FloatArray, at: FloatArray, length: float) -> tuple[FloatArray, float]:
    """Return the path from its point nearest to a pose on, and the distance [m] left.

    The section has (M, 3) points every 0.05 m with the path's direction there, and ends after `length` [m] or at the
    path's end. poses (N, 3) and at (3,) are [m, m, rad] in map. The distance left is to the end of the whole path, and
    includes the distance from the pose to the section.
    """
    points = poses[:, :2]
    if len(points) == 1:
        return poses[:1].copy(), float(np.hypot(*(points[0] - at[:2])))
    along = arc_lengths(points)
    leg, share = nearest_step(points, at[:2])
    near = points[leg] + share * (points[leg + 1] - points[leg])
    begin = along[leg] + share * (along[leg + 1] - along[leg])
    end = min(begin + length, along[-1])
    stations = np.linspace(begin, end, int((end - begin) / SPACING) + 2)
    x, y = np.interp(stations, along, points[:, 0]), np.interp(stations, along, points[:, 1])
    legs = np.clip(np.searchsorted(along, stations, side="right") - 1, 0, len(points) - 2)
    steps = points[legs + 1] - points[legs]
    direction = np.arctan2(steps[:, 1], steps[:, 0])
    return np.column_stack([x, y, direction]), float(along[-1] - begin + math.dist(near, at[:2]))


_EVERY = 8
"""Fine steps between two checks against people."""


@njit(cache=True, nogil=True)
def measure(
    shape: Footprint,
    start: FloatArray,
    candidates: FloatArray,
    section: FloatArray,
    needed: FloatArray,
    horizon: float,
) -> FloatArray:
    """Return (N, 6): free_time, clearance, path_error, heading_error, progress, target_distance (see `Features`).

    start (3,) and section (M, 3) are on the field's grid [cells, cells, rad]. An arc that is free for less than its
    needed (N,) time [s] is inadmissible; its row is 0 except for the free time. horizon [s]: duration of the arcs.
    """
    # A point near the front end of the long axis: guided along the path, it lines the chair up with doors early.
    nose = shape.discs[0, 0] + shape.discs[0, 3]
    first_x, first_y = start[0] + nose * math.cos(start[2]), start[1] + nose * math.sin(start[2])
    first, _ = _nearest(section, 0, len(section), first_x, first_y)
    table = np.empty((FINE + 1, 4))
    tabled = math.nan
    rows = np.zeros((len(candidates), 6))
    free = free_times(shape, start, candidates, needed, horizon)
    for i in range(len(candidates)):
        rows[i, 0] = free[i]
        if rows[i, 0] < needed[i]:
            continue
        v, omega = candidates[i, 0] / shape.cell, candidates[i, 1]
        if omega != tabled:
            fill_table(table, start[2], omega, horizon / FINE)
            tabled = omega
        last = round(rows[i, 0] / horizon * FINE)
        _follow(shape, start, table, v, last, nose, section, first, rows[i])
        rows[i, 3] = abs(wrapped(start[2] + omega * rows[i, 0] - rows[i, 3]))
    return rows


@njit(cache=True)
def _follow(
    shape: Footprint,
    start: FloatArray,
    table: FloatArray,
    v: float,
    last: int,
    nose: float,
    section: FloatArray,
    first: int,
    row: FloatArray,
) -> None:
    """Fill a row along an arc up to step `last`; column 3 gets the path's direction at the arc's end."""
    end = len(section) - 1
    near, front, path_error = 0, first, 0.0
    clearance, target = math.inf, math.inf
    x, y = start[0], start[1]
    for look in range(1, _LOOKS + 1):
        k = (last * look + _LOOKS // 2) // _LOOKS
        c, s = table[k, 0], table[k, 1]
        x, y = start[0] + v * table[k, 2], start[1] + v * table[k, 3]
        clearance = min(clearance, side_clearance(shape, x, y, c, s))
        nose_x, nose_y = x + nose * c, y + nose * s
        near, away = _nearest(section, near - _BEHIND, _AHEAD, x, y)
        front, front_away = _nearest(section, front - _BEHIND, _AHEAD, nose_x, nose_y)
        front_away = min(front_away, _beyond(section[end], nose_x, nose_y))
        path_error += (math.sqrt(away) + math.sqrt(front_away)) / (2 * _LOOKS)
        target = min(target, math.hypot(section[end, 0] - x, section[end, 1] - y))
    spacing = math.hypot(section[1, 0] - section[0, 0], section[1, 1] - section[0, 1]) if end > 0 else 0.0
    row[1] = clearance
    row[2] = path_error * shape.cell
    row[3] = section[near, 2]
    row[4] = spacing * near * shape.cell
    row[5] = target * shape.cell


@njit(cache=True, inline="always")
def _nearest(section: FloatArray, begin: int, count: int, x: float, y: float) -> tuple[int, float]:
    """Return which of `count` points from `begin` on is nearest to (x, y), and the square of its distance."""
    best, least = max(begin, 0), math.inf
    for j in range(max(begin, 0), min(begin + count, len(section))):
        square = (section[j, 0] - x) ** 2 + (section[j, 1] - y) ** 2
        if square < least:
            best, least = j, square
    return best, least


@njit(cache=True, inline="always")
def _beyond(end: FloatArray, x: float, y: float) -> float:
    """Return the squared distance [cells^2] from the path extended straight past its end; infinite before the end.

    The front of a chair that stops at the end lies beyond it, which is no error.
    """
    c, s = math.cos(end[2]), math.sin(end[2])
    if (x - end[0]) * c + (y - end[1]) * s < 0.0:
        return math.inf
    return float(((y - end[1]) * c - (x - end[0]) * s) ** 2)


@njit(cache=True, nogil=True)
def meetings_with_people(
    shape: Footprint, start: FloatArray, candidates: FloatArray, people: FloatArray, horizon: float
) -> FloatArray:
    """Return (N, 2): when [s] an arc first meets a person, +inf if never, and the least gap [m] before that.

    people (P, 6): x, y [cells], velocity [cells/s], radius [m] and its growth [m/s], in total at most
    `PREDICTED_GROWTH`. The body is its rectangle with the margin; every `_EVERY`-th fine step is checked.
    """
    length, half = _half_sides(shape)
    table = np.empty((FINE + 1, 4))
    tabled = math.nan
    rows = np.full((len(candidates), 2), math.inf)
    for i in range(len(candidates)):
        v, omega = candidates[i, 0] / shape.cell, candidates[i, 1]
        if omega != tabled:
            fill_table(table, start[2], omega, horizon / FINE)
            tabled = omega
        for k in range(0, FINE + 1, _EVERY):
            t, c, s = k * horizon / FINE, table[k, 0], table[k, 1]
            x = start[0] + v * table[k, 2] + c * shape.discs[0, 0]
            y = start[1] + v * table[k, 3] + s * shape.discs[0, 0]
            for p in range(len(people)):
                dx, dy = people[p, 0] + t * people[p, 2] - x, people[p, 1] + t * people[p, 3] - y
                beyond = max(abs(c * dx + s * dy) - length, 0.0)
                beside = max(abs(c * dy - s * dx) - half, 0.0)
                radius = people[p, 4] + min(t * people[p, 5], PREDICTED_GROWTH)
                gap = math.hypot(beyond, beside) * shape.cell - radius
                rows[i, 1] = min(rows[i, 1], max(gap, 0.0))
                if gap <= 0.0:
                    rows[i, 0] = min(rows[i, 0], t)
            if rows[i, 0] < math.inf:
                break
    return rows


@njit(cache=True, inline="always")
def _half_sides(shape: Footprint) -> tuple[float, float]:
    """Return half the length and half the width [cells] of the body with its margin."""
    half = shape.discs[0, 3]
    return math.sqrt(shape.discs[0, 2] ** 2 - half**2), half


@njit(cache=True, nogil=True)
def fits_after(shape: Footprint, start: FloatArray, candidates: FloatArray, times: FloatArray) -> BoolArray:
    """Return (N,) whether the body fits where each candidate ends after its time; standing still always fits.

    start (3,) [cells, cells, rad]; candidates (N, 2) [m/s, rad/s]; times (N,) [s].
    """
    fits = np.zeros(len(candidates), np.bool_)
    for i in range(len(candidates)):
        v, omega = candidates[i, 0] / shape.cell, candidates[i, 1]
        x, y, theta = along_arc(start[0], start[1], start[2], v, omega, times[i])
        fits[i] = (v == 0.0 and omega == 0.0) or room(shape, x, y, theta, 0.0) >= 0.0
    return fits


@njit(cache=True, nogil=True)
def first_free(shape: Footprint, start: FloatArray, twists: FloatArray, times: FloatArray) -> int:
    """Return the first of the twists (N, 2) [m/s, rad/s] that can be driven for its time (N,) [s]; N if there is none.

    start (3,) [cells, cells, rad]. Equal twists are tried once: most candidates share their first period.
    """
    tried = np.empty((len(twists), 2))
    count = 0
    for i in range(len(twists)):
        v, omega = twists[i, 0], twists[i, 1]
        known = False
        for k in range(count):
            known = known or (tried[k, 0] == v and tried[k, 1] == omega)
        if known:
            continue
        if free_time(shape, start, v / shape.cell, omega, times[i], times[i]) >= times[i]:
            return i
        tried[count, 0], tried[count, 1] = v, omega
        count += 1
    return len(twists)
