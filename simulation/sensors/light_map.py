"""The light map: the lamps' light on every face, computed once for a world and stored as one texture.

Each lamp lights a point directly if no block is between them. A part of its light has no direction, as if the room
scattered it. Lamps are fixed in the world, so the light does not depend on the viewpoint.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit

from waychair.geometry import transform_points
from waychair.simulation.plan.world import World
from waychair.simulation.scene.scene import MATERIALS, Block, Finish, Lamp, Reflection
from waychair.simulation.sensors.surfaces import Surfaces
from waychair.types import BoolArray, Float32Array, FloatArray, IntArray

SPACING = 0.3
"""Spacing [m] of the points of a face at which light is computed; between them it is interpolated."""

REACH = 6.5
"""Largest distance [m] at which a lamp lights a point."""

HALF_LIGHT = 1.5
"""Distance [m] at which a lamp, which is not a point source, gives half of its light at distance 0."""

SCATTERED = 0.25
"""Part of a lamp's light that has no direction."""

GLOW = 1.6
"""Brightness of the faces of lamps."""

LAMP_SPACING = 4.0
MOST_LAMPS = 400
"""Least spacing [m] and greatest number of lamps in a world that defines no lamps."""

ATLAS_WIDTH = 1024
"""Texels in a row."""

_NEAR = 0.01
"""Light is computed this far [m] off a face and inside its rim, clear of blocks that touch the face."""


@dataclass(frozen=True, slots=True)
class LightMap:
    """Texels (R, C, 3) of light, and texture coordinates (F, 4, 2) of each face's corners, 0 to 1 across and down."""

    texels: Float32Array
    coordinates: Float32Array


def light_map(
    surfaces: Surfaces, glowing: BoolArray, blocks: Sequence[Block], lamps: Sequence[Lamp], finish: Finish
) -> LightMap:
    """Return the light of every face; faces that are `glowing` (F,) are lamps."""
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
        light_face(
            window=window,
            anchor=surfaces.anchors[i],
            axes=surfaces.axes[i],
            u=u,
            v=v,
            lamps=lamp_rows,
            boxes=boxes,
            starts=starts,
            near=near,
            touching=touching,
        )
    size = np.array([ATLAS_WIDTH, rows])
    part = (surfaces.outlines - low[:, None]) / extents[:, None]
    coordinates = (origins[:, None] + 0.5 + part * (nodes[:, None] - 1)) / size
    return LightMap(texels.astype(np.float32), coordinates.astype(np.float32))


def default_lamps(world: World) -> tuple[Lamp, ...]:
    """Return a lattice of lamps under the ceiling, for a world that defines no lamps."""
    grid = world.grid
    size = np.array(grid.cells.shape[::-1]) * grid.resolution
    counts = np.maximum(np.rint(size / max(LAMP_SPACING, math.sqrt(size.prod() / MOST_LAMPS))), 1).astype(int)
    across, up = (size[i] * (np.arange(counts[i]) + 0.5) / counts[i] for i in (0, 1))
    places = transform_points(grid.map_from_grid, np.stack(np.meshgrid(across, up), axis=-1).reshape(-1, 2))
    return tuple(Lamp(float(x), float(y), world.finish.height - 0.05) for x, y in places)


def _packed(nodes: IntArray) -> tuple[IntArray, int]:
    """Return upper left corners (F, 2) of windows of `nodes` (F, 2) columns and rows packed on shelves, and all rows."""
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
    """Return (B, 8): x, y of the middle, cosine and sine of its direction, half length, half width, low, high."""
    rows = []
    for b in blocks:
        c, s = math.cos(b.middle.theta), math.sin(b.middle.theta)
        rows.append((b.middle.x, b.middle.y, c, s, b.length / 2, b.width / 2, b.low, b.high))
    return np.array(rows, np.float64).reshape(-1, 8)


def _within_reach(boxes: FloatArray, lamps: FloatArray) -> tuple[IntArray, IntArray]:
    """Return `starts` and the concatenated indices of boxes near each lamp; lamp k has `starts[k]:starts[k + 1]`."""
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
    """Add the lamps' light to `window` (rows of v, columns of u, 3) of one face.

    Lamps (L, 6) are x, y, z and colour; `boxes` (B, 8) come from `_boxes`. The boxes `near[starts[k] : starts[k + 1]]`
    may hide lamp k, and `touching` may reach the face. A point inside a block, where the block touches the face, takes
    the light of the free points beside it.
    """
    rows, columns = v.shape[0], u.shape[0]
    normal = np.cross(axes[0], axes[1])
    buried = np.zeros((rows, columns), np.bool_)
    for row in range(rows):
        for column in range(columns):
            point = anchor + u[column] * axes[0] + v[row] * axes[1] + _NEAR * normal
            buried[row, column] = _is_inside(point, touching)
            if not buried[row, column]:
                _add_light(
                    light=window[row, column],
                    point=point,
                    normal=normal,
                    lamps=lamps,
                    boxes=boxes,
                    starts=starts,
                    near=near,
                )
    left = buried.sum()
    while 0 < left < rows * columns:
        left = _fill_from_neighbours(window, buried)


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
    """Return whether the segment from the point by (x, y, z) crosses the box (slabs of Kay and Kajiya, 1986)."""
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
def _fill_from_neighbours(window: FloatArray, buried: BoolArray) -> int:
    """Give buried points the mean light of their free neighbours and mark them free; return how many stay buried."""
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
