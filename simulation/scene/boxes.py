"""Upright boxes seen from above, and the bins by which contact, lidar and sonars find the boxes near a place.

Boxes are (N, 6) float64: x, y of the middle [m, map], cosine and sine of the heading, half length and half width [m].
A wall's face is a box of no width, so that the same bins serve contact and rays.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from waychair.types import FloatArray, IntArray

SMALLEST_BIN = 0.25
"""Least side of a bin [m]: smaller bins would cost more time to cross than they save."""

REACH_OVER = 1e-6
"""A box is listed in every bin within this distance [m], so that rounding at a bin's border loses no box."""


class Bins(NamedTuple):
    """The boxes that reach into each square bin, stored row by row; nothing lies outside the bins.

    Bin (row, col) begins at (x + col side, y + row side) [m] and holds `items[starts[k]:starts[k + 1]]`, the indices of
    its boxes, for k = row cols + col.
    """

    x: float
    y: float
    side: float
    rows: int
    cols: int
    starts: IntArray
    items: IntArray


def bins_from_boxes(boxes: FloatArray) -> Bins:
    """Return the bins of boxes (N, 6), about four bins for every box."""
    if not len(boxes):
        return Bins(x=0.0, y=0.0, side=1.0, rows=1, cols=1, starts=np.zeros(2, np.int64), items=np.zeros(0, np.int64))
    c, s = np.abs(boxes[:, 2:4].T)
    reach = np.stack([boxes[:, 4] * c + boxes[:, 5] * s, boxes[:, 4] * s + boxes[:, 5] * c], axis=1)
    low = (boxes[:, :2] - reach).min(axis=0) - REACH_OVER
    size = (boxes[:, :2] + reach).max(axis=0) + REACH_OVER - low
    side = float(max(SMALLEST_BIN, math.sqrt(size[0] * size[1] / len(boxes)) / 2, size.max() / 1000.0))
    cols, rows = (int(count) for count in np.floor(size / side) + 1)
    empty = Bins(
        x=float(low[0]),
        y=float(low[1]),
        side=side,
        rows=rows,
        cols=cols,
        starts=np.zeros(0, np.int64),
        items=np.zeros(0, np.int64),
    )
    starts, items = _filled(boxes, empty)
    return empty._replace(starts=starts, items=items)


def boxes_from_segments(segments: FloatArray) -> FloatArray:
    """Return boxes (N, 6) of no width along segments (N, 4), x0 y0 x1 y1 [m, map]."""
    ends = np.asarray(segments, np.float64).reshape(-1, 4)
    along = ends[:, 2:] - ends[:, :2]
    theta = np.arctan2(along[:, 1], along[:, 0])
    half = np.hypot(along[:, 0], along[:, 1]) / 2
    return np.column_stack([(ends[:, :2] + ends[:, 2:]) / 2, np.cos(theta), np.sin(theta), half, np.zeros(len(ends))])


@njit(cache=True)
def touch(a: FloatArray, b: FloatArray) -> bool:
    """Return whether two boxes (6,) share a point: no side of either separates them (separating axis theorem)."""
    dx, dy = b[0] - a[0], b[1] - a[1]
    c, s = abs(a[2] * b[2] + a[3] * b[3]), abs(a[2] * b[3] - a[3] * b[2])  # of the angle between them
    return bool(
        abs(dx * a[2] + dy * a[3]) <= a[4] + b[4] * c + b[5] * s
        and abs(dy * a[2] - dx * a[3]) <= a[5] + b[4] * s + b[5] * c
        and abs(dx * b[2] + dy * b[3]) <= b[4] + a[4] * c + a[5] * s
        and abs(dy * b[2] - dx * b[3]) <= b[5] + a[4] * s + a[5] * c
    )


@njit(cache=True)
def nearest_points(a: FloatArray, b: FloatArray) -> tuple[float, float, float]:
    """Return the distance [m] of two boxes (6,) that do not touch, and the point (x, y) [m, map] of `b` nearest to `a`.

    At least one end of the shortest line between two convex polygons is a corner.
    """
    best, x, y = math.inf, 0.0, 0.0
    for corner in range(4):
        px, py = _corner(b, corner)
        qx, qy = _clamped(a, px, py)
        distance = math.hypot(px - qx, py - qy)
        if distance < best:
            best, x, y = distance, px, py
        px, py = _corner(a, corner)
        qx, qy = _clamped(b, px, py)
        distance = math.hypot(px - qx, py - qy)
        if distance < best:
            best, x, y = distance, qx, qy
    return best, x, y


@njit(cache=True)
def _corner(box: FloatArray, number: int) -> tuple[float, float]:
    along = box[4] if number & 1 else -box[4]
    across = box[5] if number & 2 else -box[5]
    return box[0] + along * box[2] - across * box[3], box[1] + along * box[3] + across * box[2]


@njit(cache=True)
def _clamped(box: FloatArray, x: float, y: float) -> tuple[float, float]:
    """Return the point of the box that is nearest to (x, y)."""
    dx, dy = x - box[0], y - box[1]
    along = min(max(dx * box[2] + dy * box[3], -box[4]), box[4])
    across = min(max(dy * box[2] - dx * box[3], -box[5]), box[5])
    return box[0] + along * box[2] - across * box[3], box[1] + along * box[3] + across * box[2]


@njit(cache=True)
def _filled(boxes: FloatArray, bins: Bins) -> tuple[IntArray, IntArray]:
    """Return `starts` and `items` of the bins: count the boxes of each bin, then fill in their indices."""
    starts = np.zeros(bins.rows * bins.cols + 1, np.int64)
    for i in range(boxes.shape[0]):
        for row, col in _bins_reached(boxes[i], bins):
            starts[row * bins.cols + col + 1] += 1
    starts = np.cumsum(starts)
    items = np.empty(starts[-1], np.int64)
    filled = starts[:-1].copy()
    for i in range(boxes.shape[0]):
        for row, col in _bins_reached(boxes[i], bins):
            items[filled[row * bins.cols + col]] = i
            filled[row * bins.cols + col] += 1
    return starts, items


@njit(cache=True)
def _bins_reached(box: FloatArray, bins: Bins) -> list[tuple[int, int]]:
    """Return row and column of the bins within REACH_OVER of the box."""
    reach_x = box[4] * abs(box[2]) + box[5] * abs(box[3]) + REACH_OVER
    reach_y = box[4] * abs(box[3]) + box[5] * abs(box[2]) + REACH_OVER
    first_col, last_col = bin_range(box[0] - bins.x, reach_x, bins.side, bins.cols)
    first_row, last_row = bin_range(box[1] - bins.y, reach_y, bins.side, bins.rows)
    half = bins.side / 2 + REACH_OVER
    reached = [(0, 0) for _ in range(0)]
    for row in range(first_row, last_row + 1):
        for col in range(first_col, last_col + 1):
            square = np.array(
                [bins.x + (col + 0.5) * bins.side, bins.y + (row + 0.5) * bins.side, 1.0, 0.0, half, half]
            )
            if touch(box, square):
                reached.append((row, col))
    return reached


@njit(cache=True)
def bin_range(middle: float, reach: float, side: float, count: int) -> tuple[int, int]:
    """Return the first and last of `count` bins that overlap [middle - reach, middle + reach]; last < first if none."""
    return max(0, math.floor((middle - reach) / side)), min(count - 1, math.floor((middle + reach) / side))
