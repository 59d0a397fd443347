"""Exact ray casting among the segments of a slice and circles.

A ray finds segments through the bins that it crosses in order (Amanatides and Woo, A Fast Voxel Traversal Algorithm for
Ray Tracing, 1987). Circles (K, 3), x, y, radius [m, map], are moving things: legs and bodies.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba import njit

from waychair.simulation.scene.boxes import Bins, bins_from_boxes, boxes_from_segments
from waychair.simulation.scene.moving import SlidingLeaf, boxes_of, sides_of
from waychair.simulation.scene.scene import MATERIALS, Block, Slice
from waychair.types import FloatArray, IntArray

NO_CIRCLES: FloatArray = np.zeros((0, 3))
"""No circles."""

_PAST_THE_END = 1e-9
"""Relative extension of each segment, so that no ray passes between two that meet."""


class Scenery(NamedTuple):
    """A slice prepared for rays: segments (N, 4) x0 y0 x1 y1 [m, map], `Reflection`s (N,) and the segments' bins."""

    segments: FloatArray
    reflections: IntArray
    bins: Bins


def scenery_from_slice(view: Slice, leaves: Sequence[SlidingLeaf] = ()) -> Scenery:
    """Return the slice with its bins, and last the sides of the closed leaves; made once per world."""
    segments = np.ascontiguousarray(view.segments, np.float64).reshape(-1, 4)
    reflections = np.ascontiguousarray(view.reflections, np.int64)
    boxes = boxes_from_segments(segments)
    if leaves:
        closed = [leaf.block(0.0) for leaf in leaves]
        kinds = [MATERIALS[leaf.material].reflection for leaf in leaves for _ in range(4)]
        segments = np.concatenate([segments, sides_of(closed)])
        reflections = np.concatenate([reflections, np.array(kinds, np.int64)])
        # a side is listed wherever its leaf may be
        boxes = np.concatenate([boxes, boxes_of(closed).repeat(4, axis=0)])
    return Scenery(segments, reflections, bins_from_boxes(boxes))


def slide_leaves(scenery: Scenery, leaves: Sequence[Block]) -> None:
    """Put the leaves of `scenery_from_slice` where these blocks are."""
    if leaves:
        scenery.segments[-4 * len(leaves) :] = sides_of(leaves)


@njit(cache=True, nogil=True)
def nearest_segment(
    scenery: Scenery, x: float, y: float, dx: float, dy: float, after: float, limit: float
) -> tuple[float, int]:
    """Return the distance [m] from (x, y) along the unit vector (dx, dy) to the first segment, and its index.

    Hits nearer than `after` are ignored; (+inf, -1) if there is none up to `limit` [m].
    """
    bins, segments = scenery.bins, scenery.segments
    per_x = 1.0 / dx if dx != 0.0 else math.inf
    per_y = 1.0 / dy if dy != 0.0 else math.inf
    left, low = x - bins.x, y - bins.y
    entry = max(_entry(left, per_x, bins.cols * bins.side), _entry(low, per_y, bins.rows * bins.side))
    best, hit = math.inf, -1
    if entry > limit or entry == math.inf:
        return best, hit
    col = min(max(math.floor((left + entry * dx) / bins.side), 0), bins.cols - 1)
    row = min(max(math.floor((low + entry * dy) / bins.side), 0), bins.rows - 1)
    step_x, step_y = (1 if dx > 0 else -1), (1 if dy > 0 else -1)
    ahead_x, ahead_y = (1 if dx > 0 else 0), (1 if dy > 0 else 0)
    while 0 <= col < bins.cols and 0 <= row < bins.rows:
        to_x = ((col + ahead_x) * bins.side - left) * per_x if dx != 0.0 else math.inf
        to_y = ((row + ahead_y) * bins.side - low) * per_y if dy != 0.0 else math.inf
        number = row * bins.cols + col
        for k in range(bins.starts[number], bins.starts[number + 1]):
            distance = _distance_to_segment(segments[bins.items[k]], x, y, dx, dy)
            if after <= distance < best:
                best, hit = distance, bins.items[k]
        # A hit beyond this bin must wait: the next bin may hold a nearer segment.
        if min(best, limit) <= min(to_x, to_y):
            break
        if to_x < to_y:
            col += step_x
        else:
            row += step_y
    return (best, hit) if best <= limit else (math.inf, -1)


@njit(cache=True, nogil=True)
def nearest_circle(
    begin: FloatArray, end: FloatArray, part: float, x: float, y: float, dx: float, dy: float, after: float
) -> float:
    """Return the distance [m] along a ray to the first circle, all at `part` (0 to 1) from `begin` to `end` (K, 3).

    0 from within a circle; hits nearer than `after` are ignored; +inf if there is none.
    """
    best = math.inf
    for i in range(begin.shape[0]):
        cx = begin[i, 0] + part * (end[i, 0] - begin[i, 0]) - x
        cy = begin[i, 1] + part * (end[i, 1] - begin[i, 1]) - y
        along, across = cx * dx + cy * dy, cy * dx - cx * dy
        half_chord = begin[i, 2] * begin[i, 2] - across * across
        if half_chord < 0.0:
            continue
        half_chord = math.sqrt(half_chord)
        if along + half_chord >= 0.0 and after <= max(along - half_chord, 0.0) < best:
            best = max(along - half_chord, 0.0)
    return best


@njit(cache=True, nogil=True)
def cosine_of_incidence(segment: FloatArray, dx: float, dy: float) -> float:
    """Return the cosine of the angle between a ray and a segment's normal: 1 straight on, 0 along the segment."""
    ex, ey = segment[2] - segment[0], segment[3] - segment[1]
    cosine: float = abs(dx * ey - dy * ex) / math.hypot(ex, ey)
    return cosine


@njit(cache=True, nogil=True)
def _distance_to_segment(segment: FloatArray, x: float, y: float, dx: float, dy: float) -> float:
    """Return the distance along the ray to the segment, negative behind its start; +inf if it misses or is parallel."""
    ax, ay = segment[0] - x, segment[1] - y
    ex, ey = segment[2] - segment[0], segment[3] - segment[1]
    cross = dx * ey - dy * ex
    if cross == 0.0:
        return math.inf
    part = (ax * dy - ay * dx) / cross
    if part < -_PAST_THE_END or part > 1.0 + _PAST_THE_END:
        return math.inf
    distance: float = (ax * ey - ay * ex) / cross
    return distance


@njit(cache=True, nogil=True)
def _entry(start: float, per: float, size: float) -> float:
    """Return the distance at which a coordinate enters [0, size]: 0 from within, +inf if it never does."""
    if 0.0 <= start <= size:
        return 0.0
    distance = -start * per if start < 0.0 else (size - start) * per
    return distance if distance >= 0.0 else math.inf
