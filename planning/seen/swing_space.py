"""The floor before and behind a doorway on which a leaf swings, cell by cell: seen free, seen occupied, or not seen.

A leaf half open may stand edge-on to the sensor or hide behind the wall. Only the floor that beams have crossed is free.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from waychair.planning.seen.range_views import RangeView
from waychair.types import BoolArray, Cells, FloatArray, Pose2

CELL = 0.05
"""m; side of a cell."""

ROWS, COLUMNS = 40, 32
"""Cells along x (through the doorway) and along y: 1 m before and behind it, and 0.8 m to either side."""

FREE, UNSEEN, TAKEN = 1, 0, -1
"""What is known of a cell; the newest view that tells counts."""

MOST_UNSEEN = 0.15
"""Share of a strip through the doorway that may be unseen: beams leave small holes between them."""

AT_JAMBS = 0.12
"""m; strips so near to the jambs together may be taken by their frames: the opening's width is measured better."""

NO_SPACE: Cells = np.zeros((ROWS, COLUMNS), np.int8)


def looked_at(space: Cells, view: RangeView, doorway: Pose2) -> Cells:
    """Return the space (ROWS, COLUMNS) after one view more; the doorway's x leads through it."""
    return _looked_at(space.copy(), view.origin, view.ends, view.met, doorway.x, doorway.y, doorway.theta)


def free_width(space: Cells, width: float) -> float:
    """Return how much [m] of an opening of `width` [m] is seen free for somebody who goes straight through.

    Each strip along x counts as far as a leaf of that width reaches, on both sides.
    """
    reach = min(ROWS // 2, math.ceil(width / CELL))
    strips = space[ROWS // 2 - reach : ROWS // 2 + reach]
    y = (np.arange(COLUMNS) + 0.5 - COLUMNS / 2) * CELL
    good = (strips != TAKEN).all(axis=0) & ((strips == UNSEEN).mean(axis=0) <= MOST_UNSEEN) & (np.abs(y) < width / 2)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], good, [False]]).astype(np.int8)))
    longest = float((edges[1::2] - edges[::2]).max(initial=0)) * CELL
    return width if longest >= width - AT_JAMBS else longest


@njit(cache=True, nogil=True)
def _looked_at(
    space: Cells, origin: FloatArray, ends: FloatArray, met: BoolArray, x: float, y: float, theta: float
) -> Cells:
    c, s = math.cos(theta), math.sin(theta)
    ox, oy = c * (origin[0] - x) + s * (origin[1] - y), c * (origin[1] - y) - s * (origin[0] - x)
    half_x, half_y = ROWS * CELL / 2, COLUMNS * CELL / 2
    new = np.zeros_like(space)
    for i in range(len(ends)):
        if not math.isfinite(ends[i, 0]):
            continue
        ex, ey = c * (ends[i, 0] - x) + s * (ends[i, 1] - y), c * (ends[i, 1] - y) - s * (ends[i, 0] - x)
        length = math.hypot(ex - ox, ey - oy)
        if length < CELL:
            continue
        dx, dy = (ex - ox) / length, (ey - oy) / length
        near, far = 0.0, length
        for at, d, half in ((ox, dx, half_x), (oy, dy, half_y)):  # the part of the beam within the box
            if abs(d) < 1e-9:
                if abs(at) >= half:
                    far = -1.0
                continue
            one, other = (-half - at) / d, (half - at) / d
            near, far = max(near, min(one, other)), min(far, max(one, other))
        for k in range(int((far - near) / (0.4 * CELL))):
            t = near + (k + 0.5) * 0.4 * CELL
            row, column = int((ox + t * dx + half_x) / CELL), int((oy + t * dy + half_y) / CELL)
            if 0 <= row < ROWS and 0 <= column < COLUMNS and new[row, column] == UNSEEN:
                new[row, column] = FREE
        if met[i] and abs(ex) < half_x and abs(ey) < half_y:
            new[int((ex + half_x) / CELL), int((ey + half_y) / CELL)] = TAKEN
    for row in range(ROWS):
        for column in range(COLUMNS):
            if new[row, column] != UNSEEN:
                space[row, column] = new[row, column]
    return space
