"""What the lamps give to every surface, found once for a world: a picture with a small window for each face.

Light falls straight from each lamp where no block is in its way, and a part of it comes from all around, as if thrown
back by the room. Since lamps are fixed in the world, so is this light: it does not change with the viewpoint.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit

from waychair.geometry import transform_points
from waychair.simulation.scene import MATERIALS, Block, Finish, Lamp, Reflection
from waychair.simulation.surfaces import Surfaces
from waychair.simulation.world import World
from waychair.types import BoolArray, Float32Array, FloatArray, IntArray

SPACING = 0.3
"""Distance [m] between points of a face whose light is found; between them it changes evenly."""

REACH = 6.5
"""Lamps farther [m] than this from a point do not light it."""

HALF_LIGHT = 1.5
"""Distance [m] at which a lamp, which is no point, gives half of what it gives at none."""

SCATTERED = 0.25
"""Part of a lamp's light that comes from all around."""

GLOW = 1.6
"""How bright the faces of lamps are."""

LAMP_SPACING = 4.0
MOST_LAMPS = 400
"""Lamps of a world that says nothing of its light are so far [m] apart, or farther, lest they be more than this."""

ATLAS_WIDTH = 1024
"""Texels in a row."""

_NEAR = 0.01
"""Light is found so far [m] before a face, and within its rim, to be clear of what touches it."""


@dataclass(frozen=True, slots=True)
class LightMap:
    """Texels (R, C, 3) of light, and where in them, (F, 4, 2) from 0 to 1 across and down, each face's corners are."""

    texels: Float32Array
    coordinates: Float32Array


def light_map(
    surfaces: Surfaces, glowing: BoolArray, blocks: Sequence[Block], lamps: Sequence[Lamp], finish: Finish
) -> LightMap:
    """Light of every face; those that are `glowing` (F,) shine themselves."""
    low, high = surfaces.outlines.min(axis=1), surfaces.outlines.max(axis=1)
    extents = np.maximum(high - low, 1e-6)
    nodes = np.clip(np.ceil(extents / SPACING).astype(np.int64) + 1, 2, ATLAS_WIDTH)
    origins, rows = _packed(nodes)
    texels = np.full((rows, ATLAS_WIDTH, 3), finish.ambient)
    opaque = [block for block in blocks if MATERIALS[block.material].reflection is not Reflection.GLASS]
    boxes = _boxes(opaque)
    lamp_rows = np.array([(v.x, v.y, v.z, *(v.power * c for c in v.colour)) for v in lamps]).reshape(-1, 6)
    starts, near = _within_reach(boxes, lamp_rows)
    middles = surfaces.corners.mean(axis=1)
    radii = np.linalg.norm(surfaces.corners - middles[:, None], axis=2).max(axis=1)
    half_diagonals = np.hypot(boxes[:, 4], boxes[:, 5])
    for i in range(len(nodes)):
        columns, lines = nodes[i]
        window = texels[origins[i, 1] : origins[i, 1] + lines, origins[i, 0] : origins[i, 0] + columns]
        if glowing[i]:
            window[:] = GLOW
            continue
        inset = np.minimum(_NEAR, extents[i] / 4)
        u, v = (np.linspace(low[i, k] + inset[k], high[i, k] - inset[k], nodes[i, k]) for k in (0, 1))
        touching = boxes[np.hypot(*(boxes[:, :2] - middles[i, :2]).T) < radii[i] + half_diagonals + 2 * _NEAR]
        light_face(window, surfaces.anchors[i], surfaces.axes[i], u, v, lamp_rows, boxes, starts, near, touching)
    size = np.array([ATLAS_WIDTH, rows])
    part = (surfaces.outlines - low[:, None]) / extents[:, None]
    coordinates = (origins[:, None] + 0.5 + part * (nodes[:, None] - 1)) / size
    return LightMap(texels.astype(np.float32), coordinates.astype(np.float32))


def default_lamps(world: World) -> tuple[Lamp, ...]:
    """Lamps under the whole ceiling, for a world that says nothing of its light."""
    grid = world.grid
    size = np.array(grid.cells.shape[::-1]) * grid.resolution
    counts = np.maximum(np.rint(size / max(LAMP_SPACING, math.sqrt(size.prod() / MOST_LAMPS))), 1).astype(int)
    across, up = (size[i] * (np.arange(counts[i]) + 0.5) / counts[i] for i in (0, 1))
    places = transform_points(grid.map_from_grid, np.stack(np.meshgrid(across, up), axis=-1).reshape(-1, 2))
    return tuple(Lamp(float(x), float(y), world.finish.height - 0.05) for x, y in places)


def _packed(nodes: IntArray) -> tuple[IntArray, int]:
    """Upper left corners (F, 2) of windows of `nodes` (F, 2) columns and rows, on shelves; and how many rows in all."""
    origins = np.zeros_like(nodes)
    column, row, tallest = 0, 0, 0
    for i in np.argsort(-nodes[:, 1], kind="stable"):
        if column + nodes[i, 0] > ATLAS_WIDTH:
            column, row, tallest = 0, row + tallest, 0
        origins[i] = column, row
        column += nodes[i, 0]
        tallest = max(tallest, nodes[i, 1])
    return origins, row + tallest


def _boxes(blocks: Sequence[Block]) -> FloatArray:
    """(B, 8): x, y of the middle, cosine and sine of its direction, half length, half width, low, high."""
    rows = []
    for b in blocks:
        c, s = math.cos(b.middle.theta), math.sin(b.middle.theta)
        rows.append((b.middle.x, b.middle.y, c, s, b.length / 2, b.width / 2, b.low, b.high))
    return np.array(rows, np.float64).reshape(-1, 8)


def _within_reach(boxes: FloatArray, lamps: FloatArray) -> tuple[IntArray, IntArray]:
    """Indices of the boxes near each lamp, in one row; lamp k's are those from `starts[k]` to `starts[k + 1]`."""
    reach = REACH + np.hypot(boxes[:, 4], boxes[:, 5])
    near = [np.flatnonzero(np.hypot(*(boxes[:, :2] - lamp[:2]).T) < reach) for lamp in lamps]
    starts = np.cumsum([0, *(len(indices) for indices in near)])
    return starts, np.concatenate([np.zeros(0, np.int64), *near])


@njit(cache=True, nogil=True)
def light_face(
    window: FloatArray,
    anchor: FloatArray,
    axes: FloatArray,
    u: FloatArray,
    v: FloatArray,
    lamps: FloatArray,
    boxes: FloatArray,
    starts: IntArray,
    near: IntArray,
    touching: FloatArray,
) -> None:
    """Adds the lamps' light to `window` (rows of v, columns of u, 3) of one face.

    Lamps (L, 6) are x, y, z and their light; `boxes` (B, 8) those of `_boxes`, of which the ones that may hide lamp k
    are `near[starts[k] : starts[k + 1]]`, and those that may reach to the face are `touching`.
    A point inside a block, where another thing stands against the face, takes the light of the free points beside it.
    """
    rows, columns = v.shape[0], u.shape[0]
    normal = np.cross(axes[0], axes[1])
    buried = np.zeros((rows, columns), np.bool_)
    for row in range(rows):
        for column in range(columns):
            point = anchor + u[column] * axes[0] + v[row] * axes[1] + _NEAR * normal
            buried[row, column] = _is_inside(point, touching)
            if not buried[row, column]:
                _add_light(window[row, column], point, normal, lamps, boxes, starts, near)
    left = buried.sum()
    while 0 < left < rows * columns:
        left = _spread(window, buried)


@njit(cache=True, nogil=True)
def _add_light(
    light: FloatArray,
    point: FloatArray,
    normal: FloatArray,
    lamps: FloatArray,
    boxes: FloatArray,
    starts: IntArray,
    near: IntArray,
) -> None:
    for k in range(lamps.shape[0]):
        x, y, z = lamps[k, 0] - point[0], lamps[k, 1] - point[1], lamps[k, 2] - point[2]
        square = x * x + y * y + z * z
        if square >= REACH * REACH:
            continue
        hidden = False
        for i in range(starts[k], starts[k + 1]):
            if _is_between(point, x, y, z, boxes[near[i]]):
                hidden = True
                break
        if hidden:
            continue
        cosine = max((normal[0] * x + normal[1] * y + normal[2] * z) / math.sqrt(square), 0.0)
        fade = 1.0 - square / (REACH * REACH)
        strength = (SCATTERED + (1.0 - SCATTERED) * cosine) * fade * fade / (1.0 + square / (HALF_LIGHT * HALF_LIGHT))
        for channel in range(3):
            light[channel] += strength * lamps[k, 3 + channel]


@njit(cache=True, nogil=True)
def _is_between(point: FloatArray, x: float, y: float, z: float, box: FloatArray) -> bool:
    """Whether the way from the point by (x, y, z) leads through the box (slabs of Kay and Kajiya, 1986)."""
    px, py = point[0] - box[0], point[1] - box[1]
    enter, leave = 0.0, 1.0
    for axis in range(3):
        if axis == 0:
            start, step, low, high = box[2] * px + box[3] * py, box[2] * x + box[3] * y, -box[4], box[4]
        elif axis == 1:
            start, step, low, high = box[2] * py - box[3] * px, box[2] * y - box[3] * x, -box[5], box[5]
        else:
            start, step, low, high = point[2], z, box[6], box[7]
        if abs(step) < 1e-12:
            if start < low or start > high:
                return False
            continue
        first, last = (low - start) / step, (high - start) / step
        enter, leave = max(enter, min(first, last)), min(leave, max(first, last))
        if enter >= leave:
            return False
    return True


@njit(cache=True, nogil=True)
def _is_inside(point: FloatArray, boxes: FloatArray) -> bool:
    for i in range(boxes.shape[0]):
        box = boxes[i]
        x, y = point[0] - box[0], point[1] - box[1]
        if (
            abs(box[2] * x + box[3] * y) < box[4]
            and abs(box[2] * y - box[3] * x) < box[5]
            and box[6] < point[2] < box[7]
        ):
            return True
    return False


@njit(cache=True, nogil=True)
def _spread(window: FloatArray, buried: BoolArray) -> int:
    """Gives buried points the mean light of their free neighbours, which frees them; returns how many are left."""
    rows, columns = buried.shape
    before = buried.copy()
    left = 0
    for row in range(rows):
        for column in range(columns):
            if not before[row, column]:
                continue
            total, count = np.zeros(3), 0
            for down, across in ((-1, 0), (1, 0), (0, -1), (0, 1)):
                r, c = row + down, column + across
                if 0 <= r < rows and 0 <= c < columns and not before[r, c]:
                    total += window[r, c]
                    count += 1
            if count:
                window[row, column] = total / count
                buried[row, column] = False
            else:
                left += 1
    return left
