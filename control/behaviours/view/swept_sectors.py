"""Orientations that this chair can take and drive off in: its outline swept by a turn on the spot and a straight drive.

The chair turns about the middle of its drive axle, on the shorter way or on the other, and then drives ahead; straight
back it may also reverse. An orientation is free if nothing known lies in the swept area and all of it was seen.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from waychair.calibration.chair_body import ChairBody
from waychair.types import BoolArray, FloatArray

AHEAD = 0.8
"""m; distance that must be free along an orientation: a second at the speed of a rider who feels the way."""

_HEADINGS = 360
_STEP = math.tau / _HEADINGS

_EASE = 0.005
"""m; a thing nearer than its margin where the chair stands may come nearer by this: noise, not motion."""


def free_orientations(
    points: FloatArray, margins: FloatArray, unseen: FloatArray, body: ChairBody, count: int, ahead: float = AHEAD
) -> BoolArray:
    """Return (count,) whether each orientation is free, from straight ahead to the left.

    points (N, 2) [m] in base are obstacles, each with its margin (N,) [m]; unseen (M, 2) [m] are places that no sensor
    saw. Points and places within the outline are the chair's own.
    """
    outline = body.front, body.rear, body.width / 2
    room = _eased(points, margins, *outline)
    things, margins = _near(points, room, unseen, sweep_reach(body, ahead))
    return _free(things, margins, *outline, count, ahead)


def sweep_reach(body: ChairBody, ahead: float = AHEAD) -> float:
    """Return the distance [m] from base within which things and unseen places matter."""
    return math.hypot(max(body.front, body.rear) + ahead, body.width / 2)


@njit(cache=True, nogil=True)
def _eased(points: FloatArray, margins: FloatArray, front: float, rear: float, half: float) -> FloatArray:
    """Return the margins, each kind reduced where the chair already stands nearer to such a thing: it may leave."""
    eased = margins.copy()
    outside = np.empty(len(points))
    for i in range(len(points)):
        outside[i] = _outside(points[i, 0], points[i, 1], front, rear, half)
    done = np.zeros(len(points), np.bool_)
    for i in range(len(points)):
        if done[i]:
            continue
        nearest = math.inf
        for j in range(i, len(points)):
            if margins[j] == margins[i] and 0.0 < outside[j] < nearest:
                nearest = outside[j]
        for j in range(i, len(points)):
            if margins[j] == margins[i]:
                eased[j], done[j] = min(margins[i], max(nearest - _EASE, 0.0)), True
    return eased


@njit(cache=True, nogil=True)
def _near(points: FloatArray, room: FloatArray, unseen: FloatArray, reach: float) -> tuple[FloatArray, FloatArray]:
    """Return points and unseen places that the sweep may come to, in one, with their margins; unseen ones have none."""
    things, margins = np.empty((len(points) + len(unseen), 2)), np.zeros(len(points) + len(unseen))
    count = 0
    for i in range(len(things)):
        seen = i < len(points)
        x, y = (points[i, 0], points[i, 1]) if seen else (unseen[i - len(points), 0], unseen[i - len(points), 1])
        margin = room[i] if seen else 0.0
        if math.hypot(x, y) <= reach + margin:
            things[count, 0], things[count, 1], margins[count] = x, y, margin
            count += 1
    return things[:count], margins[:count]


@njit(cache=True, nogil=True)
def _free(
    things: FloatArray, room: FloatArray, front: float, rear: float, half: float, count: int, ahead: float
) -> BoolArray:
    cosines, sines = np.empty(_HEADINGS), np.empty(_HEADINGS)
    for k in range(_HEADINGS):
        cosines[k], sines[k] = math.cos(k * _STEP), math.sin(k * _STEP)
    drive_cosines, drive_sines = np.empty(count), np.empty(count)
    for k in range(count):
        drive_cosines[k], drive_sines[k] = math.cos(k * math.tau / count), math.sin(k * math.tau / count)
    left = right = _HEADINGS - 1  # headings that a turn to either side reaches
    blocked_drive = np.zeros(count, np.bool_)
    blocked_reverse = False
    for i in range(len(things)):
        x, y, margin = things[i, 0], things[i, 1], room[i]
        if _outside(x, y, front, rear, half) <= 0.0:
            continue
        distance = math.hypot(x, y)
        # Between two headings half a step apart a point moves by this relative to the outline.
        turning = margin + 0.5 * _STEP * distance
        if distance <= math.hypot(max(front, rear), half) + turning:
            for k in range(1, left + 1):
                c, s = cosines[k], sines[k]
                if _outside(c * x + s * y, c * y - s * x, front, rear, half) < turning:
                    left = k - 1
                    break
            for k in range(1, right + 1):
                c, s = cosines[k], -sines[k]
                if _outside(c * x + s * y, c * y - s * x, front, rear, half) < turning:
                    right = k - 1
                    break
        for k in range(count):
            if not blocked_drive[k]:
                c, s = drive_cosines[k], drive_sines[k]
                along, aside = c * x + s * y, c * y - s * x
                if along > 0.0 and _outside(along, aside, front + ahead, rear, half) <= margin:
                    blocked_drive[k] = True
        if x < 0.0 and _outside(x, y, front, rear + ahead, half) <= margin:
            blocked_reverse = True
    free = np.zeros(count, np.bool_)
    for k in range(count):
        turn = k * _HEADINGS / count
        reached = turn <= left or _HEADINGS - turn <= right or k == 0
        free[k] = reached and not blocked_drive[k]
    if count % 2 == 0 and not blocked_reverse:
        free[count // 2] = True
    return free


@njit(cache=True, inline="always")
def _outside(x: float, y: float, front: float, rear: float, half: float) -> float:
    """Return the distance of a point from a rectangle; 0 within it."""
    dx = max(x - front, -rear - x, 0.0)
    dy = max(abs(y) - half, 0.0)
    return math.sqrt(dx * dx + dy * dy)
