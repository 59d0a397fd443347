"""Collision checks of the chair's footprint at a pose and along an arc, against a distance field; never a false "free".

The footprint's rectangle is halved repeatedly into a tree of smaller ones, each enclosed by a disc. Where the distance
field shows that a disc is free, everything below it in the tree is free. Only beside obstacles does the search reach
the leaves, whose discs overhang the rectangle by at most a fifth of a cell. The rectangle is not symmetric about the
drive axle: the usual contact at a door is the front swinging out in a turn.

Lengths inside the kernels are in cells. An obstacle may lie anywhere in its cell (0.71 cells from its centre), and the
interpolated distance may be 0.15 cells too large. The area swept between two poses `_STEP` apart reaches at most 0.14
cells outside both rectangles (`SWEPT`: 0.35 steps, a diagonal move). Together this is `SLACK`, one cell.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from waychair.calibration.chair_body import ChairBody
from waychair.geometry import compose
from waychair.maps.grid.distance_field import DistanceField, interpolated
from waychair.planning.body.clearance import EASE_STEP, EASE_STEPS
from waychair.types import BoolArray, Float32Array, FloatArray, Pose2

SLACK = 1.0
"""Distance [cells] to the nearest obstacle that a disc needs beyond its radius."""

SWEPT = 0.14
"""Part of the slack [cells] for the area swept between two poses `_STEP` apart."""

_STEP = 0.4
"""Largest displacement [cells] of any point of the body between two checked poses."""

_GLANCE = 3.0
"""The same beyond the time that must be certain: there an arc is rated, but not yet relied on."""


_EASES = tuple(EASE_STEP * step for step in range(EASE_STEPS))
"""Reductions [m] of the margin that are tried in turn in a tight spot; the first that is enough is taken."""


class DiscTree(NamedTuple):
    """The tree of discs of one rectangle, and the distance field that it is checked against; lengths in cells.

    discs (N, 4) float64, depth-first: x ahead and y left of the drive axle, radius of the disc around its part of the
    rectangle, radius of the disc inside it. skip (N,) int32: index of the next disc once this one is free; for a leaf
    that is the following one. metres: the field (H, W) float32 [m]; `cell` [m] is its resolution.
    """

    discs: FloatArray
    skip: NDArray[np.int32]
    metres: Float32Array
    cell: float


class Footprint(NamedTuple):
    """A body on a field: its whole outline, as in `DiscTree`, and those height layers that have a field of their own.

    The layers' discs (M, 4) and skips (M,) are concatenated; `layer_ends` (L,) is the index after each layer's last
    disc, `layer_metres` (L, H, W) [m] are their fields.
    """

    discs: FloatArray
    skip: NDArray[np.int32]
    metres: Float32Array
    cell: float
    layer_discs: FloatArray
    layer_skip: NDArray[np.int32]
    layer_ends: NDArray[np.int32]
    layer_metres: Float32Array


def footprint(body: ChairBody, margin: float, field: DistanceField) -> Footprint:
    """Return the body, grown by a margin [m] on all sides, on a distance field."""
    cell = field.resolution
    discs, skip = disc_tree(body.front, body.rear, body.width / 2, margin, cell)
    layers = [disc_tree(layer.front, layer.rear, layer.half_width, margin, cell) for layer, _ in field.layers]
    if not layers:
        return Footprint(discs, skip, field.metres, cell, *_NO_LAYERS)
    ends = np.cumsum([len(layer_skip) for _, layer_skip in layers]).astype(np.int32)
    layer_discs, layer_skip = (np.concatenate(parts) for parts in zip(*layers, strict=True))
    layer_metres = np.stack([metres for _, metres in field.layers])
    return Footprint(discs, skip, field.metres, cell, layer_discs, layer_skip, ends, layer_metres)


_NO_LAYERS = np.empty((0, 4)), np.empty(0, np.int32), np.empty(0, np.int32), np.empty((0, 1, 1), np.float32)


@njit(cache=True, inline="always")
def whole_outline(shape: Footprint) -> DiscTree:
    """Return the whole outline of a body."""
    return DiscTree(shape.discs, shape.skip, shape.metres, shape.cell)


@njit(cache=True, inline="always")
def layer_outline(shape: Footprint, k: int) -> DiscTree:
    """Return the outline of layer k of a body."""
    begin, end = shape.layer_ends[k - 1] if k > 0 else 0, shape.layer_ends[k]
    return DiscTree(shape.layer_discs[begin:end], shape.layer_skip[begin:end], shape.layer_metres[k], shape.cell)


def eased_footprint(body: ChairBody, margin: float, field: DistanceField, pose: Pose2) -> tuple[Footprint, float]:
    """Return the body with its margin [m], reduced where it stands too near to an obstacle, and the reduction [m].

    Noise of a scan or of the localisation can put an obstacle's cell inside the margin; then no arc would ever be
    admissible. With the smallest sufficient reduction, at most 5 cm, the chair can leave, but on no path with less
    clearance than here. The body itself is never shrunk by more than the cells may have enlarged an obstacle. Where
    no reduction is enough, the body keeps its full margin and the reduction is 0.
    """
    at = in_cells(field, pose)
    for ease in _EASES:
        if margin - ease < -SLACK * field.resolution:
            break
        shape = footprint(body, margin - ease, field)
        if room(shape, at[0], at[1], at[2], _STEP) >= 0.0:  # as finely as `free_time` checks
            return shape, ease
    return footprint(body, margin, field), 0.0


@lru_cache(maxsize=128)
def disc_tree(
    front: float, rear: float, half: float, margin: float, cell: float
) -> tuple[FloatArray, NDArray[np.int32]]:
    """Return `discs` (N, 4) and `skip` (N,) of an outline [m] as in `DiscTree`; cached, since every tick needs the same few.

    All parts of one level have one size, so the tree is built level by level. The first half of a part comes right
    after it, the second half after all parts below the first.
    """
    front, rear, half = (front + margin) / cell, (rear + margin) / cell, (half + margin) / cell
    sides = [((front + rear) / 2, half)]  # half sides of the parts, by level
    while math.hypot(*sides[-1]) > 0.5:  # a leaf's disc is no larger than a cell
        a, b = sides[-1]
        sides.append((a / 2, b) if a >= b else (a, b / 2))
    below = 2 ** len(sides) - 1  # the part itself and those below it
    discs, skip = np.empty((below, 4)), np.empty(below, np.int32)
    at, x, y = np.zeros(1, np.int64), np.array([(front - rear) / 2]), np.zeros(1)
    for a, b in sides:
        discs[at] = np.column_stack([x, y, np.full_like(x, math.hypot(a, b)), np.full_like(x, min(a, b))])
        skip[at] = at + below
        below //= 2
        along, across = (a / 2, 0.0) if a >= b else (0.0, -b / 2)  # the front first: it usually meets obstacles
        at = np.concatenate([at + 1, at + 1 + below])
        x, y = np.concatenate([x + along, x - along]), np.concatenate([y + across, y - across])
    return discs, skip


def in_cells(field: DistanceField, pose: Pose2) -> FloatArray:
    """Return a pose in map as (3,) column, row [cells], theta [rad] on the field's grid."""
    local = field.map_from_grid.inverse() @ pose
    return np.array([local.x / field.resolution, local.y / field.resolution, local.theta])


def poses_in_cells(field: DistanceField, poses: FloatArray) -> FloatArray:
    """Return poses (N, 3) in map as (N, 3) columns, rows [cells], theta [rad]; see `in_cells`."""
    local = compose(field.map_from_grid.inverse().array(), poses)
    local[:, :2] /= field.resolution
    return local


def fits(body: ChairBody, margin: float, field: DistanceField, pose: Pose2) -> bool:
    """Return whether the body, grown by a margin [m], is certainly free of obstacles at a pose in map."""
    at = in_cells(field, pose)
    return bool(room(footprint(body, margin, field), at[0], at[1], at[2], 0.0) >= 0.0)


def fits_each(body: ChairBody, margin: float, field: DistanceField, poses: FloatArray) -> BoolArray:
    """Return (N,) `fits` for each of many poses (N, 3) in map."""
    return _rooms(footprint(body, margin, field), poses_in_cells(field, poses)) >= 0.0


@njit(cache=True, inline="always")
def _distance(outline: DiscTree, column: float, row: float) -> float:
    """Return the distance [cells] to the nearest obstacle centre or to the field's border, beyond which is unknown."""
    height, width = outline.metres.shape
    border = min(min(column, width - column), min(row, height - row))
    return float(min(interpolated(outline.metres, column, row) / outline.cell, border))


@njit(cache=True, nogil=True)
def room(shape: Footprint, x: float, y: float, theta: float, wanted: float) -> float:
    """Return a lower bound [cells] on how far every point of the body may move and stay free; negative on contact.

    The search stops refining once it has found the room wanted.
    """
    least = _room_of(whole_outline(shape), x, y, theta, wanted)
    for k in range(len(shape.layer_ends)):
        if least >= 0.0:
            least = min(least, _room_of(layer_outline(shape, k), x, y, theta, wanted))
    return least


@njit(cache=True, nogil=True)
def _room_of(outline: DiscTree, x: float, y: float, theta: float, wanted: float) -> float:
    discs, skip = outline.discs, outline.skip
    c, s = math.cos(theta), math.sin(theta)
    least = math.inf
    i = 0
    while i < len(skip):
        u, v = discs[i, 0], discs[i, 1]
        distance = _distance(outline, x + c * u - s * v, y + s * u + c * v)
        spare = distance - discs[i, 2] - SLACK
        leaf = skip[i] == i + 1
        if spare >= wanted or (leaf and spare >= 0.0):
            least = min(least, spare)
            i = skip[i]
        elif leaf or distance < discs[i, 3] - SLACK:
            return -1.0
        else:
            i += 1
    return least


@njit(cache=True, nogil=True)
def _rooms(shape: Footprint, poses: FloatArray) -> FloatArray:
    rooms = np.empty(len(poses))
    for i in range(len(poses)):
        rooms[i] = room(shape, poses[i, 0], poses[i, 1], poses[i, 2], 0.0)
    return rooms


@njit(cache=True, inline="always")
def along_arc(x: float, y: float, theta: float, v: float, omega: float, t: float) -> tuple[float, float, float]:
    """Return the pose after t seconds at constant v [lengths/s] and omega [rad/s]; theta is not wrapped."""
    turned = omega * t
    if abs(turned) < 1e-6:
        middle = theta + 0.5 * turned
        return x + v * t * math.cos(middle), y + v * t * math.sin(middle), theta + turned
    radius = v / omega
    return (
        x + radius * (math.sin(theta + turned) - math.sin(theta)),
        y - radius * (math.cos(theta + turned) - math.cos(theta)),
        theta + turned,
    )


@njit(cache=True, nogil=True)
def free_time(shape: Footprint, start: FloatArray, v: float, omega: float, certain: float, horizon: float) -> float:
    """Return how long [s] the body can follow an arc from a pose, at most the horizon; 0 where it does not fit at all.

    `start` (3,) is in cells, v in cells/s. Steps are as long as the room found allows (conservative advancement), so
    no obstacle is skipped up to the time `certain` [s]; after it, steps are at least `_GLANCE`.
    """
    # The root's disc reaches farther than any point of the body.
    reach = math.hypot(shape.discs[0, 0], shape.discs[0, 1]) + shape.discs[0, 2]
    fastest = max(abs(v) + abs(omega) * reach, 1e-9)
    before, t = 0.0, 0.0
    while True:
        x, y, theta = along_arc(start[0], start[1], start[2], v, omega, t)
        spare = room(shape, x, y, theta, _STEP if t < certain else 0.0)
        if spare < 0.0:
            return before
        if t >= horizon:
            return horizon
        before = t
        if t < certain:
            t = min(t + max(spare, _STEP) / fastest, max(certain, t + spare / fastest), horizon)
        else:
            t = min(t + max(spare, _GLANCE) / fastest, horizon)


@njit(cache=True)
def side_clearance(shape: Footprint, x: float, y: float, c: float, s: float) -> float:
    """Return the distance [m] from the body's sides to the nearest obstacle centre, from three points on its long axis.

    The body is at (x, y) [cells] with a heading of cosine c and sine s. This smooth measure compares poses that fit;
    `room` decides whether a pose fits.
    """
    least = _beside(whole_outline(shape), x, y, c, s)
    for k in range(len(shape.layer_ends)):
        least = min(least, _beside(layer_outline(shape, k), x, y, c, s))
    return least


@njit(cache=True)
def _beside(outline: DiscTree, x: float, y: float, c: float, s: float) -> float:
    middle, half = outline.discs[0, 0], outline.discs[0, 3]
    length = math.sqrt(outline.discs[0, 2] ** 2 - half**2)
    least = math.inf
    for share in (-1.0, 0.0, 1.0):
        along = middle + share * max(length - half, 0.0)
        least = min(least, _distance(outline, x + along * c, y + along * s))
    return float(max(least - half, 0.0) * outline.cell)
