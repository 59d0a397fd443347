"""What is known round the chair, whatever told of it: obstacles by class, and the ground that was seen to be free.

A sensor's part is one or more fans of `Beams`: where it looked, how far it saw, and what it hit. `gather_views` lays
the parts of lidar, depth, sonars and people on small grids in odom, which move with the chair, and gives the view in
base. Free ground is forgotten after a while. An obstacle stays until its own sensor sees that it is gone: a lidar looks
through glass, under tables and over the edge of the floor.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TypeVar

import numpy as np
from numba import njit
from numpy.typing import NDArray

from waychair.calibration.chair_body import ChairBody
from waychair.control.behaviours.cell import Reading
from waychair.control.behaviours.doorway import OdometryPose
from waychair.geometry import interpolate
from waychair.types import BoolArray, Bytes, Cells, FloatArray, IntArray, Pose2

CELL, SIDE = 0.05, 100
"""m and cells; the grid reaches 2.5 m to each side, beyond the longest orientation."""

SEEN_FOR_NS = 15_000_000_000
"""Time for which ground that was seen to be free counts as free: nobody looks behind the chair meanwhile."""

TOLD_NS = 500_000_000
"""Time since a sensor's last part after which the ground that it saw no longer counts as free."""

HELD_FOR_NS = 60_000_000_000
"""Time for which an obstacle out of sight is kept."""

_HISTORY = 20
"""Poses of the odometry that are kept, a second of ticks, to place a measurement at its own time."""

_FASTEST, _LEAP = 3.0, 0.1
"""m/s and m; odometry that moves faster than this leaps, and all memory goes."""

_NEVER = -(1 << 62)


class Thing(enum.IntEnum):
    """Classes of obstacles, by rising margin."""

    SOLID = 0
    DROP_OFF = 1
    PERSON = 2


MARGINS = {Thing.SOLID: 0.02, Thing.DROP_OFF: 0.15, Thing.PERSON: 0.20}
"""m; kept between the outline and a thing: noise of a range; the uncertain edge of a floor; a person who may step."""


@dataclass(frozen=True, slots=True)
class Beams:
    """A sensor's part of the view in base at its stamp: origin (2,), ends (N, 2) [m], hits (N,), one class for all.

    `half_angle` [rad] is half the angle between two beams. A beam is free up to its end, unless the fan does not `clear`
    the ground that it crosses.
    """

    origin: FloatArray
    ends: FloatArray
    hits: BoolArray
    half_angle: float
    thing: int = int(Thing.SOLID)
    clears: bool = True


@dataclass(frozen=True, slots=True)
class Fans:
    """A sensor's whole part: one fan for each origin, such as one for each sonar."""

    fans: tuple[Beams, ...]


@dataclass(frozen=True, slots=True)
class MapPart:
    """The map round the chair: cells (H, W) int8 as in `OccupancyGrid`, resolution [m], the grid's pose in base."""

    cells: Cells
    resolution: float
    x: float
    y: float
    theta: float


@dataclass(frozen=True, slots=True)
class LocalView:
    """What is known, in base: points (N, 2) int16 [mm], classes (N,) uint8, and the unseen ground as packed bits.

    The bits are those of a grid of `SIDE` cells of `CELL` [m] centred on base, row by row; 1: not seen to be free.
    """

    points: NDArray[np.int16]
    classes: Bytes
    unseen: Bytes

    def metres(self) -> FloatArray:
        """Return the points (N, 2) [m]."""
        metres: FloatArray = self.points.astype(np.float64) * 1e-3
        return metres

    def margins(self) -> FloatArray:
        """Return the margin (N,) [m] of each point."""
        margins: FloatArray = _MARGIN_TABLE[self.classes]
        return margins

    def unseen_places(self) -> FloatArray:
        """Return the middles (M, 2) [m] of the cells that were not seen to be free."""
        bits = np.unpackbits(self.unseen, count=SIDE * SIDE).reshape(SIDE, SIDE)
        rows, cols = np.nonzero(bits)
        places: FloatArray = CELL * (np.column_stack([cols, rows]).astype(np.float64) + 0.5 - SIDE / 2)
        return places


_MARGIN_TABLE = np.array([MARGINS[thing] for thing in Thing])


SOURCES = ("lidar", "depth", "drop-offs", "echoes", "people", "own")
"""Sensors' parts, each with a layer of its own; the last one is the ground that the chair has stood on."""


@dataclass(frozen=True, slots=True)
class Layer:
    """One sensor's grids (SIDE, SIDE): `seen` and `hit` stamps [ns], the place of the last hit in its cell [m], its class.

    `taken_ns` is the stamp of the last part. `points` (N, 2) [m] in odom are the obstacles that it left, with their
    classes and stamps (N,).
    """

    seen: IntArray
    hit: IntArray
    offset: FloatArray
    thing: Bytes
    points: FloatArray
    classes: Bytes
    stamps: IntArray
    taken_ns: int = _NEVER


@dataclass(frozen=True, slots=True)
class ViewMemory:
    """Dynamic data: a layer for each source, the cell of the grids' corner in odom, and poses of the odometry.

    Without layers nothing was seen yet.
    """

    layers: tuple[Layer, ...] = ()
    column: int = 0
    row: int = 0
    history: tuple[tuple[int, Pose2], ...] = ()


def _empty() -> Layer:
    return Layer(
        np.full((SIDE, SIDE), _NEVER, np.int64),
        np.full((SIDE, SIDE), _NEVER, np.int64),
        np.zeros((SIDE, SIDE, 2)),
        np.zeros((SIDE, SIDE), np.uint8),
        np.empty((0, 2)),
        np.empty(0, np.uint8),
        np.empty(0, np.int64),
    )


def gather_views(
    odometry: Reading[OdometryPose],
    lidar: Reading[Fans] | None,
    depth: Reading[Fans] | None,
    drop_offs: Reading[Fans] | None,
    echoes: Reading[Fans] | None,
    people: Reading[Fans] | None,
    surroundings: MapPart | None,
    constants: ChairBody,
    dynamic: ViewMemory,
    now_ns: int,
) -> tuple[LocalView | None, ViewMemory]:
    """Return the view of now. Each part is taken in once, at the pose of its own stamp.

    Without odometry there is no view: nothing tells how the things seen lie to the chair. There is none either while no
    sensor and no map tells of the ground.
    """
    pose = odometry.value.pose()
    memory = dynamic
    if not memory.layers or _leaps(memory.history, odometry.stamp_ns, pose):
        memory = ViewMemory(tuple(_empty() for _ in SOURCES))
    history = (*memory.history[-_HISTORY:], (odometry.stamp_ns, pose))
    memory = _moved(replace(memory, history=history), pose)
    layers = list(memory.layers)
    for k, part in enumerate((lidar, depth, drop_offs, echoes, people)):
        if part is None or not part.stamp_ns > layers[k].taken_ns:
            continue
        at = _pose_at(history, part.stamp_ns)
        fans = part.value.fans if k != SOURCES.index("echoes") else _unexplained(part.value.fans, layers, memory, at)
        layers[k] = _with_part(layers[k], fans, memory, at, part.stamp_ns)
    layers[-1] = replace(layers[-1], seen=layers[-1].seen.copy(), taken_ns=now_ns)
    _stand(
        layers[-1].seen,
        pose.x - memory.column * CELL,
        pose.y - memory.row * CELL,
        pose.theta,
        constants.front,
        constants.rear,
        constants.width / 2,
        odometry.stamp_ns,
    )
    memory = replace(memory, layers=tuple(layers))
    if surroundings is None and not any(_is_told(layer, now_ns) for layer in layers[:-1]):
        return None, memory
    return _view(memory, pose, surroundings, constants, now_ns), memory


def _is_told(layer: Layer, now_ns: int) -> bool:
    """Return whether a sensor has told of its surroundings lately; free ground by a blind or silent one does not count."""
    return layer.taken_ns > _NEVER and now_ns - layer.taken_ns <= TOLD_NS


_SAME_THING = 0.12
"""m; an echo whose arc passes so near to a thing that lidar or depth show is that thing's."""


def _unexplained(
    fans: tuple[Beams, ...], layers: list[Layer], memory: ViewMemory, odom_from_base: Pose2
) -> tuple[Beams, ...]:
    """Return the echoes, without the hits of those whose arc passes a thing that another sensor shows."""
    shown = np.concatenate([layer.points for layer in layers[:2]])
    away = shown - (odom_from_base.x, odom_from_base.y)
    c, s = math.cos(odom_from_base.theta), math.sin(odom_from_base.theta)
    in_base = away @ np.array([[c, -s], [s, c]])

    def kept(fan: Beams) -> Beams:
        arc = fan.ends[fan.hits]
        if not len(arc) or not len(in_base):
            return fan
        low, high = arc.min(axis=0) - _SAME_THING, arc.max(axis=0) + _SAME_THING
        near = in_base[((in_base >= low) & (in_base <= high)).all(axis=1)]
        gaps = ((arc[:, None] - near[None]) ** 2).sum(axis=2)
        explained = gaps.min(initial=math.inf) <= _SAME_THING**2
        return replace(fan, hits=np.zeros(len(fan.hits), np.bool_)) if explained else fan

    return tuple(kept(fan) for fan in fans)


def _with_points(layer: Layer, memory: ViewMemory) -> Layer:
    """Return a layer with the points of its grids: the hits that nothing has seen to be gone."""
    rows, cols = np.nonzero((layer.hit >= layer.seen) & (layer.hit > _NEVER))
    corner = np.array([memory.column, memory.row])
    points = (np.column_stack([cols, rows]) + corner) * CELL + layer.offset[rows, cols]
    return replace(layer, points=points, classes=layer.thing[rows, cols], stamps=layer.hit[rows, cols])


def _leaps(history: tuple[tuple[int, Pose2], ...], stamp_ns: int, pose: Pose2) -> bool:
    if not history:
        return False
    before_ns, before = history[-1]
    seconds = max(stamp_ns - before_ns, 0) * 1e-9
    return math.hypot(pose.x - before.x, pose.y - before.y) > _FASTEST * seconds + _LEAP


def _pose_at(history: tuple[tuple[int, Pose2], ...], stamp_ns: int) -> Pose2:
    """Return odom_from_base at a stamp, between the poses that are kept."""
    later = next((k for k, (each, _) in enumerate(history) if each >= stamp_ns), len(history) - 1)
    if later == 0 or history[later][0] <= stamp_ns:
        return history[later][1]
    (before_ns, before), (after_ns, after) = history[later - 1], history[later]
    return interpolate(before, after, (stamp_ns - before_ns) / (after_ns - before_ns))


def _moved(memory: ViewMemory, pose: Pose2) -> ViewMemory:
    """Return the memory with its grids centred on the chair; cells that come in are new."""
    column, row = math.floor(pose.x / CELL) - SIDE // 2, math.floor(pose.y / CELL) - SIDE // 2
    right, up = column - memory.column, row - memory.row
    if right == up == 0:
        return memory
    layers = tuple(_layer_moved(layer, up, right) for layer in memory.layers)
    return replace(memory, layers=layers, column=column, row=row)


def _layer_moved(layer: Layer, up: int, right: int) -> Layer:
    if layer.taken_ns == _NEVER:  # nothing was laid on it yet
        return layer
    seen = _shifted(layer.seen, up, right, _NEVER)
    if not len(layer.points):
        return replace(layer, seen=seen, hit=np.full_like(layer.hit, _NEVER))
    return replace(
        layer,
        seen=seen,
        hit=_shifted(layer.hit, up, right, _NEVER),
        offset=_shifted(layer.offset, up, right, 0),
        thing=_shifted(layer.thing, up, right, 0),
    )


_Grid = TypeVar("_Grid", FloatArray, IntArray, Bytes)


def _shifted(grid: _Grid, up: int, right: int, fill: int) -> _Grid:
    new = np.full_like(grid, fill)
    if abs(up) < SIDE and abs(right) < SIDE:
        rows, cols = slice(max(-up, 0), SIDE - max(up, 0)), slice(max(-right, 0), SIDE - max(right, 0))
        old_rows, old_cols = slice(max(up, 0), SIDE - max(-up, 0)), slice(max(right, 0), SIDE - max(-right, 0))
        new[rows, cols] = grid[old_rows, old_cols]
    return new


def _with_part(
    layer: Layer, fans: tuple[Beams, ...], memory: ViewMemory, odom_from_base: Pose2, stamp_ns: int
) -> Layer:
    """Return a layer with a part laid on copies of its grids."""
    new = replace(
        layer,
        seen=layer.seen.copy(),
        hit=layer.hit.copy(),
        offset=layer.offset.copy(),
        thing=layer.thing.copy(),
        taken_ns=stamp_ns,
    )
    c, s = math.cos(odom_from_base.theta), math.sin(odom_from_base.theta)
    turn = np.array([[c, -s], [s, c]])
    place = np.array([odom_from_base.x, odom_from_base.y]) - np.array([memory.column, memory.row]) * CELL
    for beams in fans:
        good = np.isfinite(beams.ends).all(axis=1)
        ends, origin = beams.ends[good] @ turn.T + place, turn @ beams.origin + place
        _lay(
            new.seen,
            new.hit,
            new.offset,
            new.thing,
            origin,
            ends,
            beams.hits[good],
            beams.half_angle,
            beams.thing,
            beams.clears,
            stamp_ns,
        )
    return _with_points(new, memory)


_SPREAD = 1.5
"""Half widths of a beam in which a cell's middle must lie for the beam to tell of it."""


@njit(cache=True, nogil=True)
def _lay(
    seen: IntArray,
    hit: IntArray,
    offset: FloatArray,
    thing: Bytes,
    origin: FloatArray,
    ends: FloatArray,
    hits: BoolArray,
    half_angle: float,
    kind: int,
    clears: bool,
    stamp_ns: int,
) -> None:
    """Mark cells whose middle all neighbouring beams pass as seen, then the cells of hits.

    `origin` (2,) and `ends` (N, 2) are in metres from the grid's corner.
    """
    bins = 1440
    far = np.full(bins, -1.0)
    width = math.tau / bins
    for i in range(len(ends)):
        dx, dy = ends[i, 0] - origin[0], ends[i, 1] - origin[1]
        distance = math.hypot(dx, dy)
        angle = math.atan2(dy, dx)
        first = math.floor((angle - _SPREAD * half_angle) / width)
        last = math.floor((angle + _SPREAD * half_angle) / width)
        for k in range(first, last + 1):
            place = k % bins
            if far[place] < 0.0 or distance < far[place]:
                far[place] = distance
    size = seen.shape[0]
    low_x = high_x = origin[0]
    low_y = high_y = origin[1]
    for i in range(len(ends)):
        low_x, high_x = min(low_x, ends[i, 0]), max(high_x, ends[i, 0])
        low_y, high_y = min(low_y, ends[i, 1]), max(high_y, ends[i, 1])
    first_row, last_row = max(math.floor(low_y / CELL), 0), min(math.floor(high_y / CELL) + 1, size)
    first_col, last_col = max(math.floor(low_x / CELL), 0), min(math.floor(high_x / CELL) + 1, size)
    for row in range(first_row, last_row if clears else first_row):
        for col in range(first_col, last_col):
            dx, dy = (col + 0.5) * CELL - origin[0], (row + 0.5) * CELL - origin[1]
            place = math.floor(math.atan2(dy, dx) / width) % bins
            if math.hypot(dx, dy) < far[place] and stamp_ns > seen[row, col]:
                seen[row, col] = stamp_ns
    for i in range(len(ends)):
        if hits[i]:
            col, row = math.floor(ends[i, 0] / CELL), math.floor(ends[i, 1] / CELL)
            if 0 <= col < size and 0 <= row < size and stamp_ns >= hit[row, col]:
                hit[row, col] = stamp_ns
                offset[row, col, 0], offset[row, col, 1] = ends[i, 0] - col * CELL, ends[i, 1] - row * CELL
                thing[row, col] = kind


@njit(cache=True, nogil=True)
def _stand(
    seen: IntArray, x: float, y: float, theta: float, front: float, rear: float, half: float, stamp_ns: int
) -> None:
    """Mark the cells whose middle lies under the outline of a chair at a pose from the grid's corner [m]."""
    c, s = math.cos(theta), math.sin(theta)
    for row in range(seen.shape[0]):
        for col in range(seen.shape[1]):
            dx, dy = (col + 0.5) * CELL - x, (row + 0.5) * CELL - y
            if -rear <= c * dx + s * dy <= front and abs(c * dy - s * dx) <= half:
                seen[row, col] = stamp_ns


def _view(memory: ViewMemory, pose: Pose2, surroundings: MapPart | None, body: ChairBody, now_ns: int) -> LocalView:
    """Return the memory as it lies to the chair now, with what the map tells."""
    c, s = math.cos(pose.theta), math.sin(pose.theta)
    all_points, all_classes = [], []
    fresh = np.zeros((SIDE, SIDE), np.bool_)
    for layer in memory.layers:
        if layer.taken_ns == _NEVER:
            continue
        young = now_ns - layer.stamps <= HELD_FOR_NS
        all_points.append(layer.points[young])
        all_classes.append(layer.classes[young])
        if _is_told(layer, now_ns):
            fresh |= (now_ns - layer.seen <= SEEN_FOR_NS) & (layer.seen > _NEVER)
    in_odom = np.concatenate(all_points) if all_points else np.empty((0, 2))
    points = (in_odom - (pose.x, pose.y)) @ np.array([[c, -s], [s, c]])
    classes = np.concatenate(all_classes) if all_classes else np.empty(0, np.uint8)
    free = _free_in_base(fresh, memory.column, memory.row, pose.x, pose.y, c, s)
    if surroundings is not None:
        mapped, mapped_free = _map_in_base(surroundings)
        points, classes = np.concatenate([points, mapped]), np.concatenate([classes, np.zeros(len(mapped), np.uint8)])
        free |= mapped_free
    free |= _own(body)
    inside = np.abs(points).max(axis=1, initial=0.0) < SIDE * CELL  # those that the grid has left behind go
    return LocalView(np.rint(1000.0 * points[inside]).astype(np.int16), classes[inside], np.packbits(~free.reshape(-1)))


@njit(cache=True, nogil=True)
def _free_in_base(fresh: BoolArray, column: int, row: int, x: float, y: float, c: float, s: float) -> BoolArray:
    """Return the free cells of the grid centred on base: those whose middle lies in a fresh cell in odom."""
    size = fresh.shape[0]
    free = np.zeros((size, size), np.bool_)
    for r in range(size):
        for k in range(size):
            u, v = (k + 0.5 - size / 2) * CELL, (r + 0.5 - size / 2) * CELL
            col = math.floor((x + c * u - s * v) / CELL) - column
            line = math.floor((y + s * u + c * v) / CELL) - row
            free[r, k] = 0 <= col < size and 0 <= line < size and fresh[line, col]
    return free


@lru_cache(maxsize=8)
def _own(body: ChairBody) -> BoolArray:
    """Return the cells under the chair itself, which are free for it."""
    middles = (np.arange(SIDE) + 0.5 - SIDE / 2) * CELL
    along = (middles >= -body.rear - CELL / 2) & (middles <= body.front + CELL / 2)
    aside = np.abs(middles) <= body.width / 2 + CELL / 2
    own: BoolArray = aside[:, None] & along[None, :]
    return own


def _map_in_base(part: MapPart) -> tuple[FloatArray, BoolArray]:
    """Return a map's occupied cells (N, 2) [m], and its free ground on the grid centred on base."""
    cells = part.cells
    c, s = math.cos(part.theta), math.sin(part.theta)
    rows, cols = np.nonzero(cells >= 65)
    at = (np.column_stack([cols, rows]) + 0.5) * part.resolution
    points = at @ np.array([[c, s], [-s, c]]) + (part.x, part.y)
    middles = (np.arange(SIDE) + 0.5 - SIDE / 2) * CELL
    away = np.stack(np.meshgrid(middles, middles), axis=-1).reshape(-1, 2) - (part.x, part.y)
    inside = np.floor(away @ np.array([[c, -s], [s, c]]) / part.resolution).astype(np.int64)
    known = (inside >= 0).all(axis=1) & (inside[:, 0] < cells.shape[1]) & (inside[:, 1] < cells.shape[0])
    free = np.zeros(len(away), np.bool_)
    free[known] = (cells[inside[known, 1], inside[known, 0]] >= 0) & (cells[inside[known, 1], inside[known, 0]] < 25)
    return points[np.hypot(points[:, 0], points[:, 1]) < SIDE * CELL], free.reshape(SIDE, SIDE)
