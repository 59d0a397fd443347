"""The surroundings of the chair as all sensors together tell them: obstacles by class, and the ground that was seen to be free.

A sensor's part is one or more fans of `Beams`: where it looked, how far it saw, and what it hit. `gather_views` lays
the parts of lidar, depth, sonars and people on small grids in odom, which move with the chair, and gives the view in
base. Free ground is forgotten after a while. An obstacle stays until its own sensor sees that it is gone: a lidar looks
through glass, under tables and over the edge of the floor. A map tells of obstacles only: free ground is seen, never
believed.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass, replace
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from waychair.calibration.chair_body import ChairBody
from waychair.control.behaviours.cell import Reading
from waychair.control.behaviours.doorway import OdometryPose
from waychair.control.behaviours.view.view_kernels import (
    CELL,
    KEPT,
    NEVER,
    SIDE,
    Stamps,
    add_fresh,
    explained,
    lay,
    places_of_bits,
    points_in_base,
    stand,
    standing,
    unseen_in_base,
    walls_of_map,
)
from waychair.geometry import interpolate, transform_points
from waychair.types import BoolArray, Bytes, Cells, Float32Array, FloatArray, IntArray, Pose2

SEEN_FOR_NS = 15_000_000_000
"""Time for which ground that was seen to be free counts as free: nobody looks behind the chair meanwhile."""

TOLD_NS = 500_000_000
"""Time since a sensor's last part after which the ground that it saw no longer counts as free."""

_HISTORY = 20
"""Poses of the odometry that are kept, a second of ticks, to place a measurement at its own time."""

_FASTEST, _LEAP = 3.0, 0.1
"""m/s and m; odometry that moves faster than this leaps, and all memory goes."""

_RECENTRED = 5
"""Cells by which the chair may stand off the grids' middle before they move with it."""

_SAME_THING, _SAME_WALL = 0.12, 0.15
"""m; an echo whose arc passes so near to a thing that lidar or depth show is that thing's; and so near to a hit of the
lidar a wall of the map is the one that it shows."""


class Thing(enum.IntEnum):
    """Classes of obstacles, by rising margin."""

    SOLID = 0
    DROP_OFF = 1
    PERSON = 2


MARGINS = {Thing.SOLID: 0.02, Thing.DROP_OFF: 0.15, Thing.PERSON: 0.20}
"""m; kept between the outline and a thing: noise of a range; the uncertain edge of a floor; a person who may step."""

HELD_FOR_NS = {Thing.SOLID: 60_000_000_000, Thing.DROP_OFF: 600_000_000_000, Thing.PERSON: 2_000_000_000}
"""Times for which a thing out of sight is kept: a drop-off stays where it is, a person does not."""

_MARGIN_TABLE = np.array([MARGINS[thing] for thing in Thing])
_HELD_TABLE = np.array([HELD_FOR_NS[thing] for thing in Thing], np.int64)


@dataclass(frozen=True, slots=True)
class Beams:
    """A sensor's part of the view in base at its stamp: origin (2,), ends (N, 2) [m], hits (N,), one class for all.

    `half_angle` [rad] is half the angle between two beams. A beam is free up to its end, or from `near` (N,) [m] on if
    that is given, unless the fan does not `clear` the ground that it crosses.
    """

    origin: FloatArray
    ends: Float32Array
    hits: BoolArray
    half_angle: float
    thing: int = int(Thing.SOLID)
    clears: bool = True
    near: FloatArray | None = None


@dataclass(frozen=True, slots=True)
class Fans:
    """A sensor's part: one fan for each origin, such as one for each sonar. A `whole` part replaces all parts before.

    `at_ns` is the time of the measurement; None: when it was told.
    """

    fans: tuple[Beams, ...]
    at_ns: int | None = None
    whole: bool = False


@dataclass(frozen=True, slots=True)
class MapPart:
    """The map round the chair: cells (H, W) int8 as in `OccupancyGrid`, resolution [m], the grid's pose in odom."""

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

    def unseen_places(self, within: float = math.inf) -> FloatArray:
        """Return the middles (M, 2) [m] of the cells that were not seen to be free, within a distance [m] of base."""
        places: FloatArray = places_of_bits(self.unseen, SIDE, within)
        return places


SOURCES = ("lidar", "depth", "drop-offs", "echoes", "people", "line", "own")
"""Sensors' parts, each with a layer of its own: `line` is the laser's, the last one the ground that the chair stood on."""

_LIDAR, _ECHOES, _LINE = SOURCES.index("lidar"), SOURCES.index("echoes"), SOURCES.index("line")
_LOOKS = slice(0, SOURCES.index("people"))
"""Sources that see the ground: without any of them nothing was looked at."""


@dataclass(frozen=True, slots=True)
class Layer:
    """One sensor's grids (SIDE, SIDE): `seen` and `hit` stamps [ms], the places of hits kept in their cell [mm], their class.

    `taken_ns` is the stamp of the last part; None: there was none yet. `points` (N, 2) [m] in odom are the obstacles that
    it left, with their classes and stamps (N,) [ms].
    """

    seen: Stamps
    hit: Stamps
    offset: Bytes
    thing: Bytes
    points: FloatArray
    classes: Bytes
    stamps: Stamps
    taken_ns: int | None = None


@dataclass(frozen=True, slots=True)
class ViewMemory:
    """Dynamic data: a layer for each source, the cell of the grids' corner in odom, and poses of the odometry.

    Without layers nothing was seen yet. Stamps in the layers count from `epoch_ns`. Measurements before `leapt_ns` are of
    before a leap of the pose.
    """

    layers: tuple[Layer, ...] = ()
    column: int = 0
    row: int = 0
    history: tuple[tuple[int, Pose2], ...] = ()
    epoch_ns: int = 0
    leapt_ns: int | None = None

    def clock(self, stamp_ns: int) -> int:
        """Return a stamp as the layers count it [ms]."""
        return (stamp_ns - self.epoch_ns) // 1_000_000


def _empty() -> Layer:
    return Layer(
        np.full((SIDE, SIDE), NEVER, np.int32),
        np.full((SIDE, SIDE), NEVER, np.int32),
        np.zeros((SIDE, SIDE, 2 * KEPT), np.uint8),
        np.zeros((SIDE, SIDE), np.uint8),
        np.empty((0, 2)),
        np.empty(0, np.uint8),
        np.empty(0, np.int32),
    )


def gather_views(
    odometry: Reading[OdometryPose],
    lidar: Reading[Fans] | None,
    depth: Reading[Fans] | None,
    drop_offs: Reading[Fans] | None,
    echoes: Reading[Fans] | None,
    people: Reading[Fans] | None,
    line: Reading[Fans] | None,
    surroundings: MapPart | None,
    constants: ChairBody,
    dynamic: ViewMemory,
    now_ns: int,
) -> tuple[LocalView | None, ViewMemory]:
    """Return the view of now. Each part is taken in once, at the pose of its own stamp.

    Without odometry there is no view: nothing tells how the things seen lie to the chair. There is none either while no
    sensor tells of the ground.
    """
    pose = odometry.value.pose()
    if not np.isfinite(pose.array()).all():
        return None, ViewMemory(leapt_ns=odometry.stamp_ns)
    memory = dynamic
    leapt = leaps(memory.history[-1:], odometry.stamp_ns, pose)
    if not memory.layers or leapt:
        since_ns = odometry.stamp_ns
        memory = ViewMemory(tuple(_empty() for _ in SOURCES), epoch_ns=since_ns, leapt_ns=since_ns if leapt else None)
    history = (*memory.history[-_HISTORY:], (odometry.stamp_ns, pose))
    memory = _moved(replace(memory, history=history), pose)
    layers = list(memory.layers)
    for k, part in enumerate((lidar, depth, drop_offs, echoes, people, line)):
        if part is None:
            continue
        stamp_ns = part.stamp_ns if part.value.at_ns is None else part.value.at_ns
        taken_ns = layers[k].taken_ns
        if (taken_ns is not None and stamp_ns <= taken_ns) or (
            memory.leapt_ns is not None and stamp_ns < memory.leapt_ns
        ):
            continue
        rows, at = _rows(part.value.fans), _pose_at(history, stamp_ns)
        if k == _ECHOES and len(rows.ends):
            rows = _unexplained(rows, layers, at)
        if part.value.whole:
            layers[k] = _replaced(layers[k], rows, memory, at, stamp_ns)
        else:
            layers[k] = _with_rows(layers[k], rows, memory, at, stamp_ns)
    own = layers[-1].seen.copy()
    corner_x, corner_y = memory.column * CELL, memory.row * CELL
    outline = constants.front, constants.rear, constants.width / 2
    stand(own, pose.x - corner_x, pose.y - corner_y, pose.theta, *outline, memory.clock(odometry.stamp_ns))
    layers[-1] = replace(layers[-1], seen=own, taken_ns=now_ns)
    memory = replace(memory, layers=tuple(layers))
    if not any(_is_told(layer, now_ns) for layer in layers[_LOOKS]):
        return None, memory
    return _view(memory, pose, surroundings, constants, now_ns), memory


def _is_told(layer: Layer, now_ns: int) -> bool:
    """Return whether a sensor has told of its surroundings lately; free ground by a blind or silent one does not count."""
    return layer.taken_ns is not None and now_ns - layer.taken_ns <= TOLD_NS


class _Rows(NamedTuple):
    """All beams of a part, row by row; see `view_kernels.lay`."""

    origins: FloatArray
    starts: IntArray
    ends: FloatArray
    near: FloatArray
    hits: BoolArray
    half_angles: FloatArray
    things: IntArray
    clears: BoolArray


def _rows(fans: tuple[Beams, ...]) -> _Rows:
    if len(fans) == 1:
        (fan,) = fans
        near_one = np.zeros(len(fan.ends)) if fan.near is None else fan.near
        about = np.array([fan.half_angle]), np.array([fan.thing]), np.array([fan.clears])
        ends = fan.ends.astype(np.float64)
        return _Rows(fan.origin[None], np.array([0, len(ends)]), ends, near_one, fan.hits, *about)
    counts = [len(fan.ends) for fan in fans]
    near = [np.zeros(len(fan.ends)) if fan.near is None else fan.near for fan in fans]
    return _Rows(
        np.array([fan.origin for fan in fans], np.float64).reshape(-1, 2),
        np.cumsum([0, *counts]),
        np.concatenate([np.zeros((0, 2)), *(fan.ends for fan in fans)]),
        np.concatenate([np.zeros(0), *near]),
        np.concatenate([np.zeros(0, np.bool_), *(fan.hits for fan in fans)]),
        np.array([fan.half_angle for fan in fans], np.float64),
        np.array([fan.thing for fan in fans], np.int64),
        np.array([fan.clears for fan in fans], np.bool_),
    )


def _unexplained(rows: _Rows, layers: list[Layer], odom_from_base: Pose2) -> _Rows:
    """Return the echoes, without the hits of those whose arc passes a thing that another sensor shows."""
    shown = np.concatenate([layer.points for layer in layers[:2]])
    same = explained(rows.starts, rows.ends, rows.hits, shown, odom_from_base.array(), _SAME_THING)
    return rows._replace(hits=rows.hits & ~np.repeat(same, np.diff(rows.starts)))


def _with_rows(layer: Layer, rows: _Rows, memory: ViewMemory, odom_from_base: Pose2, stamp_ns: int) -> Layer:
    """Return a layer with a part laid on copies of its grids, and the points that nothing has seen to be gone."""
    seen, hit, offset, thing = layer.seen.copy(), layer.hit.copy(), layer.offset.copy(), layer.thing.copy()
    x, y = odom_from_base.x - memory.column * CELL, odom_from_base.y - memory.row * CELL
    c, s = math.cos(odom_from_base.theta), math.sin(odom_from_base.theta)
    lay(seen, hit, offset, thing, *rows, x, y, c, s, memory.clock(stamp_ns))
    points, classes, stamps = standing(seen, hit, offset, thing, memory.column, memory.row)
    return Layer(seen, hit, offset, thing, points, classes, stamps, stamp_ns)


def _replaced(layer: Layer, rows: _Rows, memory: ViewMemory, odom_from_base: Pose2, stamp_ns: int) -> Layer:
    """Return a layer whose points are those of a whole part; its grids stay empty."""
    points = transform_points(odom_from_base, rows.ends[rows.hits])
    classes = np.repeat(rows.things, np.diff(rows.starts))[rows.hits].astype(np.uint8)
    stamps = np.full(len(points), memory.clock(stamp_ns), np.int32)
    return replace(layer, points=points, classes=classes, stamps=stamps, taken_ns=stamp_ns)


def leaps(before: tuple[tuple[int, Pose2], ...], stamp_ns: int, pose: Pose2) -> bool:
    """Return whether odometry has moved faster than a chair can since the last one of (stamp [ns], pose); none: false."""
    if not before:
        return False
    before_ns, last = before[-1]
    seconds = max(stamp_ns - before_ns, 0) * 1e-9
    return not math.hypot(pose.x - last.x, pose.y - last.y) <= _FASTEST * seconds + _LEAP


def _pose_at(history: tuple[tuple[int, Pose2], ...], stamp_ns: int) -> Pose2:
    """Return odom_from_base at a stamp, between the poses that are kept."""
    later = next((k for k, (each, _) in enumerate(history) if each >= stamp_ns), len(history) - 1)
    if later == 0 or history[later][0] <= stamp_ns:
        return history[later][1]
    (before_ns, before), (after_ns, after) = history[later - 1], history[later]
    return interpolate(before, after, (stamp_ns - before_ns) / (after_ns - before_ns))


def _moved(memory: ViewMemory, pose: Pose2) -> ViewMemory:
    """Return the memory with its grids centred on the chair once it stands off their middle; cells that come in are new."""
    column, row = math.floor(pose.x / CELL) - SIDE // 2, math.floor(pose.y / CELL) - SIDE // 2
    right, up = column - memory.column, row - memory.row
    if max(abs(right), abs(up)) <= _RECENTRED:
        return memory
    layers = tuple(_layer_moved(layer, up, right) for layer in memory.layers)
    return replace(memory, layers=layers, column=column, row=row)


def _layer_moved(layer: Layer, up: int, right: int) -> Layer:
    if layer.taken_ns is None:  # nothing was laid on it yet
        return layer
    seen = _shifted(layer.seen, up, right, NEVER)
    if not len(layer.points):
        return replace(layer, seen=seen, hit=np.full_like(layer.hit, NEVER))
    return replace(
        layer,
        seen=seen,
        hit=_shifted(layer.hit, up, right, NEVER),
        offset=_shifted(layer.offset, up, right, 0),
        thing=_shifted(layer.thing, up, right, 0),
    )


_Grid = TypeVar("_Grid", Stamps, Bytes)


def _shifted(grid: _Grid, up: int, right: int, fill: int) -> _Grid:
    new = np.full_like(grid, fill)
    if abs(up) < SIDE and abs(right) < SIDE:
        rows, cols = slice(max(-up, 0), SIDE - max(up, 0)), slice(max(-right, 0), SIDE - max(right, 0))
        old_rows, old_cols = slice(max(up, 0), SIDE - max(-up, 0)), slice(max(right, 0), SIDE - max(-right, 0))
        new[rows, cols] = grid[old_rows, old_cols]
    return new


def _view(memory: ViewMemory, pose: Pose2, surroundings: MapPart | None, body: ChairBody, now_ns: int) -> LocalView:
    """Return the memory as it lies to the chair now, with the walls that only the map shows."""
    layers = [layer for layer in memory.layers if layer.taken_ns is not None]
    fresh = np.zeros((SIDE, SIDE), np.bool_)
    for k, layer in enumerate(memory.layers):
        if k != _LINE and _is_told(layer, now_ns):  # the line sees one height only, and no ground
            add_fresh(fresh, layer.seen, max(memory.clock(now_ns - SEEN_FOR_NS), NEVER + 1))
    points, classes, stamps = ([getattr(layer, name) for layer in layers] for name in ("points", "classes", "stamps"))
    if surroundings is not None:
        grid = np.array([surroundings.x, surroundings.y, surroundings.theta])
        lidar, cells, corner = memory.layers[_LIDAR], surroundings.cells, (memory.column, memory.row)
        walls = walls_of_map(cells, surroundings.resolution, grid, lidar.seen, lidar.hit, *corner, _SAME_WALL)
        points.append(walls)
        classes.append(np.full(len(walls), int(Thing.SOLID), np.uint8))
        stamps.append(np.full(len(walls), memory.clock(now_ns), np.int32))
    near, kinds = points_in_base(
        np.concatenate(points),
        np.concatenate(classes),
        np.concatenate(stamps),
        pose.array(),
        memory.clock(now_ns) - _HELD_TABLE // 1_000_000,
        SIDE * CELL,  # those that the grid has left behind go
    )
    x, y = pose.x - memory.column * CELL, pose.y - memory.row * CELL
    unseen = unseen_in_base(fresh, x, y, pose.theta, body.front, body.rear, body.width / 2)
    return LocalView(near, kinds, unseen)
