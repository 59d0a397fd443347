"""Cuts a world at one height into the segments that lidar and sonars see.

Stretches that no beam can reach, because another block touches or covers them, are left out. Glass hides nothing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numba import njit

from waychair.geometry import rectangle, transform_points
from waychair.simulation.scene.scene import MATERIALS, Block, Reflection, Slice
from waychair.types import BoolArray, FloatArray, IntArray

TOUCH = 1e-6
"""Distance [m] below which two blocks touch."""


def slice_at(blocks: Sequence[Block], height: float) -> Slice:
    """Return the outline of the blocks at `height` [m] above the floor, low <= height < high.

    Every block's sides run counter-clockwise, so that the outside is on the right. Stretches in or against another
    opaque block are removed; where two blocks end flush, both keep their sides.
    """
    standing = [block for block in blocks if block.low <= height < block.high]
    if not standing:
        return Slice(np.empty((0, 4)), np.empty(0, np.int64))
    boxes = np.array([(*b.middle.array(), b.length / 2, b.width / 2) for b in standing])
    reflections = np.array([MATERIALS[block.material].reflection for block in standing], np.int64)
    corners = np.stack(
        [transform_points(b.middle, rectangle(b.length / 2, b.length / 2, b.width / 2)) for b in standing]
    )
    sides = np.concatenate([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 4)
    segments, numbers = visible_stretches(sides, boxes, reflections != Reflection.GLASS)
    return Slice(segments, reflections[numbers // 4])


@njit(cache=True, nogil=True)
def visible_stretches(sides: FloatArray, boxes: FloatArray, opaque: BoolArray) -> tuple[FloatArray, IntArray]:
    """Return the stretches (K, 4) [m] of `sides` (4 M, 4) that are visible from outside, and their side's index (K,).

    Sides 4 i to 4 i + 3 belong to `boxes[i]` (x, y, theta, half length, half width); opaque (M,) boxes hide everything
    inside them. The union of the hidden intervals is removed from each side.
    """
    cosines, sines, reaches = np.cos(boxes[:, 2]), np.sin(boxes[:, 2]), np.hypot(boxes[:, 3], boxes[:, 4])
    stretches = [(0.0, 0.0, 0.0, 0.0) for _ in range(0)]
    numbers = [0 for _ in range(0)]
    hidden = np.empty((boxes.shape[0], 2))
    for i in range(sides.shape[0]):
        x0, y0, x1, y1 = sides[i]
        length = math.hypot(x1 - x0, y1 - y0)
        dx, dy = (x1 - x0) / length, (y1 - y0) / length
        count = 0
        for k in range(boxes.shape[0]):
            far = length / 2 + reaches[k] + TOUCH
            near = abs((x0 + x1) / 2 - boxes[k, 0]) < far and abs((y0 + y1) / 2 - boxes[k, 1]) < far
            if k != i // 4 and opaque[k] and near:
                # In the box's frame, slightly outside the side, where beams come from.
                px, py = x0 + TOUCH * dy - boxes[k, 0], y0 - TOUCH * dx - boxes[k, 1]
                c, s = cosines[k], sines[k]
                begin_x, end_x = _within(c * px + s * py, c * dx + s * dy, boxes[k, 3])
                begin_y, end_y = _within(c * py - s * px, c * dy - s * dx, boxes[k, 4])
                begin, end = max(begin_x, begin_y, 0.0), min(end_x, end_y, length)
                if end > begin:
                    hidden[count, 0], hidden[count, 1] = begin, end
                    count += 1
        seen = 0.0
        for k in np.append(np.argsort(hidden[:count, 0]), -1):
            begin = hidden[k, 0] if k >= 0 else length
            if begin - seen > TOUCH:
                stretches.append((x0 + seen * dx, y0 + seen * dy, x0 + begin * dx, y0 + begin * dy))
                numbers.append(i)
            if k >= 0:
                seen = max(seen, hidden[k, 1])
    return np.array(stretches).reshape(-1, 4), np.array(numbers)


@njit(cache=True, inline="always")
def _within(start: float, slope: float, half: float) -> tuple[float, float]:
    """Return the interval of t in which |start + slope t| < half; (inf, -inf) if it is empty."""
    if slope == 0.0:
        return (-math.inf, math.inf) if abs(start) < half else (math.inf, -math.inf)
    a, b = (-half - start) / slope, (half - start) / slope
    return min(a, b), max(a, b)
