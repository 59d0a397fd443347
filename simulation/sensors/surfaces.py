"""The flat faces of a world for the camera: blocks, ramps, pits, posters, tags, lamps, floor and ceiling.

A face has plane coordinates (u, v) [m]: the point (u, v) is `anchor + u * axes[0] + v * axes[1]`, and the normal
`axes[0] x axes[1]` points outwards. Patterns are drawn in these coordinates.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise, product
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from waychair.geometry import rectangle, transform_points
from waychair.maps.building.april_tags import PARTS, tag_parts
from waychair.simulation.plan.world import World
from waychair.simulation.scene.scene import Block, Pit, Poster, Slope, WallTag
from waychair.simulation.scene.seeds import seed_from_names
from waychair.types import FloatArray, IntArray, Pose2

TILE = 6.0
"""Side [m] of the squares of floor and ceiling; squares out of sight cost nothing."""

POSTER_GAP = 0.004
"""Gap [m] between a poster and its wall, enough for the depth buffer to separate them."""

LAMP_SIDE = 0.5
"""Side [m] of the bright square that shows a lamp."""

Seeds: TypeAlias = NDArray[np.uint32]
_UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, slots=True)
class Face:
    """One convex flat face: anchor (3,), axes (2, 3) [m, map], outline (4, 2) in (u, v) [m], the name of its look."""

    anchor: FloatArray
    axes: FloatArray
    outline: FloatArray
    look: str
    seed: int


@dataclass(frozen=True, slots=True)
class Surfaces:
    """F faces as arrays: anchors (F, 3), axes (F, 2, 3), outlines (F, 4, 2) [m], look numbers (F,), seeds (F,)."""

    anchors: FloatArray
    axes: FloatArray
    outlines: FloatArray
    looks: IntArray
    seeds: Seeds

    @property
    def normals(self) -> FloatArray:
        """Outward unit normals (F, 3)."""
        return np.cross(self.axes[:, 0], self.axes[:, 1])

    @property
    def corners(self) -> FloatArray:
        """Corners (F, 4, 3) [m, map]."""
        return self.anchors[:, None] + self.outlines @ self.axes


def surfaces_from_world(world: World, looks: Sequence[str]) -> Surfaces:
    """Return all visible faces of a world; a look's number is its index in `looks`."""
    faces = [*_floor_and_ceiling(world)]
    for block in world.blocks:
        faces += _block_faces(block, world.finish.height)
    for slope in world.slopes:
        faces += _slope_faces(slope)
    for pit in (*world.pits, *world.gaps):
        faces += _pit_faces(pit, world.finish.floor)
    faces += [_poster_face(poster) for poster in world.posters]
    faces += [face for tag in world.tags for face in _tag_faces(tag)]
    for lamp in world.lamps:
        faces.append(
            _level_face(
                middle=Pose2(lamp.x, lamp.y),
                length=LAMP_SIDE,
                width=LAMP_SIDE,
                height=lamp.z,
                look="lamp",
                seed=0,
                up=False,
            )
        )
    return Surfaces(
        np.array([face.anchor for face in faces]),
        np.array([face.axes for face in faces]),
        np.array([face.outline for face in faces]),
        np.array([looks.index(face.look) for face in faces]),
        np.array([face.seed & 0xFFFFFFFF for face in faces], np.uint32),
    )


def _block_faces(block: Block, ceiling: float) -> Iterator[Face]:
    """Yield four sides, and top and bottom unless they touch the ceiling or the floor."""
    sides = _side_faces(
        middle=block.middle,
        length=block.length,
        width=block.width,
        low=block.low,
        high=block.high,
        look=block.material,
        seed=block.seed,
    )
    yield from sides
    if block.high < ceiling - 0.01:
        yield _level_face(
            middle=block.middle,
            length=block.length,
            width=block.width,
            height=block.high,
            look=block.material,
            seed=_mixed(block.seed, 4),
        )
    if block.low > 0.01:
        seed = _mixed(block.seed, 5)
        yield _level_face(
            middle=block.middle,
            length=block.length,
            width=block.width,
            height=block.low,
            look=block.material,
            seed=seed,
            up=False,
        )


def _slope_faces(slope: Slope) -> Iterator[Face]:
    """Yield the inclined top, two sides up to the slope, and the ends that are above the floor."""
    run, rise = slope.length, slope.high - slope.low
    long, cross = _directions(slope.middle.theta)
    along = np.array([*(long[:2] * run), rise]) / math.hypot(run, rise)
    middle = np.array([slope.middle.x, slope.middle.y, (slope.low + slope.high) / 2])
    half_run, half_width = math.hypot(run, rise) / 2, slope.width / 2
    outline = rectangle(half_run, half_run, half_width)
    yield Face(middle, np.stack([along, cross]), outline, slope.material, _mixed(slope.seed, 4))
    for sign, number in ((1.0, 0), (-1.0, 1)):
        anchor = np.array([slope.middle.x, slope.middle.y, 0.0]) + sign * half_width * cross
        ends = np.array([[-run / 2, 0.0], [run / 2, 0.0], [run / 2, slope.high], [-run / 2, slope.low]])
        ends[:, 0] *= -sign
        yield Face(anchor, np.stack([-sign * long, _UP]), ends, slope.material, _mixed(slope.seed, number))
    for sign, top, number in ((1.0, slope.high, 2), (-1.0, slope.low, 3)):
        if top > 0.0:
            anchor = np.array([slope.middle.x, slope.middle.y, 0.0]) + sign * run / 2 * long
            outline = _upright(slope.width, 0.0, top)
            yield Face(anchor, np.stack([sign * cross, _UP]), outline, slope.material, _mixed(slope.seed, number))


def _pit_faces(pit: Pit, floor: str) -> Iterator[Face]:
    """Yield a pit's four walls, facing inwards, and its bottom."""
    seed = seed_from_names("pit", f"{pit.middle.x:.3f}", f"{pit.middle.y:.3f}")
    for face in _side_faces(
        middle=pit.middle, length=pit.length, width=pit.width, low=-pit.depth, high=0.0, look="concrete", seed=seed
    ):
        yield Face(face.anchor, face.axes * [[-1.0], [1.0]], face.outline, face.look, face.seed)
    yield _level_face(
        middle=pit.middle, length=pit.length, width=pit.width, height=-pit.depth, look=floor, seed=_mixed(seed, 4)
    )


def _poster_face(poster: Poster) -> Face:
    out, left = _directions(poster.middle.theta)
    anchor = np.array([poster.middle.x, poster.middle.y, poster.height]) + POSTER_GAP * out
    outline = _upright(poster.length, -poster.width / 2, poster.width / 2)
    return Face(anchor, np.stack([left, _UP]), outline, "poster", _mixed(poster.seed, 0))


def _tag_faces(tag: WallTag) -> Iterator[Face]:
    """Yield a tag's parts: one rectangle for each run of equal ones in a row."""
    out, left = _directions(tag.middle.theta)
    anchor = np.array([tag.middle.x, tag.middle.y, tag.height]) + POSTER_GAP * out
    black, part = tag_parts(tag.number), tag.side / PARTS
    for row in range(PARTS):
        ends = np.flatnonzero(np.diff(black[row], prepend=~black[row, :1], append=~black[row, -1:]))
        high = tag.side / 2 - row * part
        for begin, end in pairwise(ends.tolist()):
            # seen from in front, the first part of a row is on the left, which is where u is least
            u, w = begin * part - tag.side / 2, end * part - tag.side / 2
            outline = np.array([[u, high - part], [w, high - part], [w, high], [u, high]])
            yield Face(anchor, np.stack([left, _UP]), outline, "ink" if black[row, begin] else "paper", 0)


def _side_faces(
    middle: Pose2, length: float, width: float, low: float, high: float, look: str, seed: int
) -> Iterator[Face]:
    long, cross = _directions(middle.theta)
    origin = np.array([middle.x, middle.y, 0.0])
    sides = [(long, cross, length, width), (cross, -long, width, length)]
    sides += [(-out, -right, reach, across) for out, right, reach, across in sides]
    for number, (out, right, reach, across) in enumerate(sides):
        outline = _upright(across, low, high)
        yield Face(origin + reach / 2 * out, np.stack([right, _UP]), outline, look, _mixed(seed, number))


def _level_face(
    middle: Pose2, length: float, width: float, height: float, look: str, seed: int, *, up: bool = True
) -> Face:
    """Return a level rectangle that faces up or down."""
    long, cross = _directions(middle.theta)
    axes = np.stack([long, cross if up else -cross])
    outline = rectangle(length / 2, length / 2, width / 2)
    return Face(np.array([middle.x, middle.y, height]), axes, outline, look, seed)


def _floor_and_ceiling(world: World) -> Iterator[Face]:
    """Yield squares over the grid's extent in map coordinates; the floor has holes for the pits."""
    grid, finish = world.grid, world.finish
    size = np.array(grid.cells.shape[::-1]) * grid.resolution
    low, high = (f(transform_points(grid.map_from_grid, _box(*size)), axis=0) for f in (np.min, np.max))
    columns, rows = (np.linspace(low[i], high[i], math.ceil((high[i] - low[i]) / TILE) + 1) for i in (0, 1))
    seed = seed_from_names(world.name, world.level)
    floor_axes, ceiling_axes = np.eye(3)[:2], np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    for i, j in product(range(len(columns) - 1), range(len(rows) - 1)):
        tile = np.array([columns[i], rows[j]]) + _box(columns[i + 1] - columns[i], rows[j + 1] - rows[j])
        for outline in _without_pits(tile, (*world.pits, *world.gaps)):
            yield Face(np.zeros(3), floor_axes, outline, finish.floor, _mixed(seed, 0))
        mirrored = tile[::-1] * [1.0, -1.0]
        yield Face(np.array([0.0, 0.0, finish.height]), ceiling_axes, mirrored, finish.ceiling, _mixed(seed, 1))


def _without_pits(tile: FloatArray, pits: Sequence[Pit]) -> Iterator[FloatArray]:
    """Yield the convex pieces (4, 2) of a convex polygon outside all pits; a triangle repeats its last corner."""
    pieces = [tile]
    for pit in pits:
        hole = transform_points(pit.middle, rectangle(pit.length / 2, pit.length / 2, pit.width / 2))
        pieces = [rest for piece in pieces for rest in _without(piece, hole)]
    for piece in pieces:
        for k in range(1, len(piece) - 1, 2):
            yield piece[[0, k, k + 1, min(k + 2, len(piece) - 1)]]


def _without(polygon: FloatArray, hole: FloatArray) -> Iterator[FloatArray]:
    """Yield a polygon's parts outside a convex hole: beyond its first edge, then beyond the second only, ..."""
    for begin, end in zip(hole, np.roll(hole, -1, axis=0), strict=True):
        outwards = np.array([end[1] - begin[1], begin[0] - end[0]])
        beyond = _clipped(polygon, begin, outwards)
        if len(beyond) > 2:
            yield beyond
        polygon = _clipped(polygon, begin, -outwards)
        if len(polygon) < 3:
            return


def _clipped(polygon: FloatArray, point: FloatArray, direction: FloatArray) -> FloatArray:
    """Return the part of a convex polygon (N, 2) on the `direction` side of a line (Sutherland, Hodgman)."""
    side = (polygon - point) @ direction
    corners = []
    for i in range(len(polygon)):
        a, b = side[i - 1], side[i]
        if (a > 0.0) != (b > 0.0):
            corners.append(polygon[i - 1] + a / (a - b) * (polygon[i] - polygon[i - 1]))
        if b > 0.0:
            corners.append(polygon[i])
    return np.array(corners).reshape(-1, 2)


def _directions(theta: float) -> tuple[FloatArray, FloatArray]:
    """Return the unit vectors ahead and to the left, (3,) each."""
    c, s = math.cos(theta), math.sin(theta)
    return np.array([c, s, 0.0]), np.array([-s, c, 0.0])


def _upright(across: float, low: float, high: float) -> FloatArray:
    half = across / 2
    return np.array([[-half, low], [half, low], [half, high], [-half, high]])


def _box(length: float, width: float) -> FloatArray:
    return np.array([[0.0, 0.0], [length, 0.0], [length, width], [0.0, width]])


def _mixed(seed: int, number: int) -> int:
    """Return the seed of one of eight faces; they differ in the last three bits (Knuth's multiplicative hash)."""
    return (seed * 2654435761 & 0xFFFFFFF8) | number
