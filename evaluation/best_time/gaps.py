"""Gaps between the chair's exact rectangle and boxes, with their derivatives by the chair's pose.

For two rectangles apart from each other, the shortest line ends at a corner of one of them. So the chair is free of a
box if every corner of either is outside the other, and one row for each corner near enough holds them apart also while
the chair turns. For rectangles that overlap, the row is that of the axis of least overlap (separating axis theorem).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from waychair.calibration.chair_body import ChairBody
from waychair.simulation.scene.boxes import Bins, bin_range, touch
from waychair.simulation.scene.contact import SolidBoxes
from waychair.types import FloatArray, IntArray


class BoxesRound(NamedTuple):
    """A chair's rectangle and the boxes round it.

    `boxes` (N, 6) and `bins` as in `simulation/scene/boxes.py`. `ahead` [m]: from the drive axle to the rectangle's
    middle; `half_length`, `half_width` [m].
    """

    boxes: FloatArray
    bins: Bins
    ahead: float
    half_length: float
    half_width: float


def surroundings(solid: SolidBoxes, body: ChairBody) -> BoxesRound:
    """Return a chair's whole outline with the solid boxes of a world."""
    return BoxesRound(solid.boxes, solid.bins, (body.front - body.rear) / 2, body.length / 2, body.width / 2)


_MOST_NEAR = 64
"""Boxes near one pose that are looked at; a pose has a handful, except on raised maps, where the walls are made of many."""

_OVERLAP = 1e-7
"""[m] Rectangles nearer than this are treated as overlapping, as the direction between them is undefined."""


@njit(cache=True, nogil=True)
def is_free(around: BoxesRound, x: float, y: float, theta: float) -> bool:
    """Return whether the chair at a pose [m, rad] touches no box."""
    box = _chair(around, x, y, theta)
    bins = around.bins
    reach_x = box[4] * abs(box[2]) + box[5] * abs(box[3])
    reach_y = box[4] * abs(box[3]) + box[5] * abs(box[2])
    first_col, last_col = bin_range(box[0] - bins.x, reach_x, bins.side, bins.cols)
    first_row, last_row = bin_range(box[1] - bins.y, reach_y, bins.side, bins.rows)
    for row in range(first_row, last_row + 1):
        for number in range(row * bins.cols + first_col, row * bins.cols + last_col + 1):
            for k in range(bins.starts[number], bins.starts[number + 1]):
                if touch(box, around.boxes[bins.items[k]]):
                    return False
    return True


@njit(cache=True, nogil=True)
def gaps(around: BoxesRound, poses: FloatArray, reach: float, most: int) -> FloatArray:
    """Return (R, 5) rows: index of the pose, gap [m] (negative: overlap), and its derivatives by x, y, theta.

    For each of the poses (N, 3) these are the at most `most` smallest gaps below `reach` [m].
    """
    found = np.empty((len(poses) * most, 5))
    count = 0
    rows = np.empty((_MOST_NEAR * 8, 4))
    near = np.empty(_MOST_NEAR, np.int64)
    for i in range(len(poses)):
        total = _rows_at(around, poses[i], reach, near, rows)
        order = np.argsort(rows[:total, 0])
        for k in range(min(most, total)):
            found[count, 0] = i
            found[count, 1:] = rows[order[k]]
            count += 1
    return found[:count].copy()


@njit(cache=True, nogil=True)
def _rows_at(around: BoxesRound, pose: FloatArray, reach: float, near: IntArray, rows: FloatArray) -> int:
    """Write the gaps of the chair at a pose (3,) within `reach` [m] into the rows (R, 4); return their number."""
    x, y = pose[0], pose[1]
    chair = _chair(around, x, y, pose[2])
    count = 0
    for k in range(_near(around, chair, reach, near)):
        count = _rows_of(chair, around.boxes[near[k]], x, y, reach, rows, count)
    return count


@njit(cache=True, nogil=True)
def overlaps(around: BoxesRound, poses: FloatArray, clear: float) -> float:
    """Return the sum over the poses (N, 3) of the length [m] by which the least gap falls short of `clear` [m]."""
    total = 0.0
    rows = np.empty((_MOST_NEAR * 8, 4))
    near = np.empty(_MOST_NEAR, np.int64)
    for i in range(len(poses)):
        count = _rows_at(around, poses[i], clear, near, rows)
        if count:
            total += clear - rows[:count, 0].min()
    return total


@njit(cache=True, nogil=True)
def _chair(around: BoxesRound, x: float, y: float, theta: float) -> FloatArray:
    """Return the chair's rectangle as a box (6,)."""
    c, s = math.cos(theta), math.sin(theta)
    return np.array([x + around.ahead * c, y + around.ahead * s, c, s, around.half_length, around.half_width])


@njit(cache=True, nogil=True)
def _near(around: BoxesRound, chair: FloatArray, reach: float, near: IntArray) -> int:
    """Write the indices of the boxes within `reach` of the chair's bounding square to `near`; return their number."""
    bins = around.bins
    reach_x = chair[4] * abs(chair[2]) + chair[5] * abs(chair[3]) + reach
    reach_y = chair[4] * abs(chair[3]) + chair[5] * abs(chair[2]) + reach
    first_col, last_col = bin_range(chair[0] - bins.x, reach_x, bins.side, bins.cols)
    first_row, last_row = bin_range(chair[1] - bins.y, reach_y, bins.side, bins.rows)
    grown = chair.copy()
    grown[4] += reach
    grown[5] += reach
    count = 0
    for row in range(first_row, last_row + 1):
        for number in range(row * bins.cols + first_col, row * bins.cols + last_col + 1):
            for k in range(bins.starts[number], bins.starts[number + 1]):
                item = bins.items[k]
                known = False
                for j in range(count):
                    known = known or near[j] == item
                if not known and count < _MOST_NEAR and touch(grown, around.boxes[item]):
                    near[count] = item
                    count += 1
    return count


@njit(cache=True, nogil=True)
def _rows_of(chair: FloatArray, box: FloatArray, x: float, y: float, reach: float, rows: FloatArray, count: int) -> int:
    """Add the rows (gap, by x, by y, by theta) of one box to `rows` after the first `count`; return the new number."""
    overlap, nx, ny, px, py = _least_overlap(chair, box)
    if overlap <= _OVERLAP:
        return _add(rows, count, overlap, nx, ny, px - x, py - y)
    for corner in range(4):
        px, py = _corner(chair, corner)
        qx, qy = _clamped(box, px, py)
        gap = math.hypot(px - qx, py - qy)
        if _OVERLAP < gap < reach:
            count = _add(rows, count, gap, (px - qx) / gap, (py - qy) / gap, px - x, py - y)
        px, py = _corner(box, corner)
        qx, qy = _clamped(chair, px, py)
        gap = math.hypot(px - qx, py - qy)
        if _OVERLAP < gap < reach:
            count = _add(rows, count, gap, (qx - px) / gap, (qy - py) / gap, qx - x, qy - y)
    return count


@njit(cache=True, nogil=True)
def _add(rows: FloatArray, count: int, gap: float, nx: float, ny: float, rx: float, ry: float) -> int:
    """Add a row: n points from the box to the chair, r from the axle to the point of the chair that is nearest."""
    if count < len(rows):
        rows[count, 0], rows[count, 1], rows[count, 2], rows[count, 3] = gap, nx, ny, ny * rx - nx * ry
        count += 1
    return count


@njit(cache=True, nogil=True)
def _least_overlap(chair: FloatArray, box: FloatArray) -> tuple[float, float, float, float, float]:
    """Return the largest separation [m] by the four sides' axes, its direction, and the chair's point it holds for."""
    best, best_nx, best_ny, best_px, best_py = -math.inf, 1.0, 0.0, 0.0, 0.0
    for own in range(2):
        face, other = (chair, box) if own == 0 else (box, chair)
        for axis in range(2):
            nx, ny = (face[2], face[3]) if axis == 0 else (-face[3], face[2])
            along = (chair[0] - box[0]) * nx + (chair[1] - box[1]) * ny
            if along < 0.0:
                nx, ny, along = -nx, -ny, -along
            reach = face[4] if axis == 0 else face[5]
            u, v = other[2] * nx + other[3] * ny, other[2] * ny - other[3] * nx
            gap = along - reach - abs(u) * other[4] - abs(v) * other[5]
            if gap > best:
                best, best_nx, best_ny = gap, nx, ny
                # the corner of the other one that is nearest: against n on the chair, along n on the box
                sign = 1.0 if own == 0 else -1.0
                a = sign * math.copysign(other[4], u)
                b = sign * math.copysign(other[5], v)
                best_px = other[0] + a * other[2] - b * other[3]
                best_py = other[1] + a * other[3] + b * other[2]
                if own == 0:
                    best_px += gap * nx
                    best_py += gap * ny
    return best, best_nx, best_ny, best_px, best_py


@njit(cache=True, nogil=True)
def _corner(box: FloatArray, number: int) -> tuple[float, float]:
    along = box[4] if number & 1 else -box[4]
    across = box[5] if number & 2 else -box[5]
    return box[0] + along * box[2] - across * box[3], box[1] + along * box[3] + across * box[2]


@njit(cache=True, nogil=True)
def _clamped(box: FloatArray, x: float, y: float) -> tuple[float, float]:
    dx, dy = x - box[0], y - box[1]
    along = min(max(dx * box[2] + dy * box[3], -box[4]), box[4])
    across = min(max(dy * box[2] - dx * box[3], -box[5]), box[5])
    return box[0] + along * box[2] - across * box[3], box[1] + along * box[3] + across * box[2]
