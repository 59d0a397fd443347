"""What the sensors have seen round the chair and the map does not know: marked when seen, cleared when seen through.

One layer a sensor, and for sensors that tell heights one for each of the body's (`BodyLayer`). A sensor clears only
what it has marked itself: a lidar looks through the glass that a sonar has heard, and under the table that a camera has
seen. What is neither seen nor seen through, because it is out of sight, is remembered for a while and then fades.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numba import njit

from waychair.angles import wrapped
from waychair.calibration.chair import BodyLayer
from waychair.config import Settings, setting
from waychair.geometry import transform_points, wrap_angles
from waychair.maps.ground import BELOW, GROUND, MISSING, GroundView
from waychair.types import BoolArray, Bytes, FloatArray, IntArray, Pose2, SonarReadings

_Beams: TypeAlias = tuple[FloatArray, FloatArray, FloatArray, BoolArray]
"""`bearings`, `near`, `far` and `hits` of a `Sight`."""


@dataclass(frozen=True, slots=True)
class ObstacleSettings(Settings):
    """How obstacles are remembered."""

    cell: float = setting(0.025, "m", "of points this near to each other one is kept", low=0.005, high=0.2)
    fade: float = setting(5.0, "s", "what is out of sight is forgotten after this long", low=0.1, high=600.0)
    behind: float = setting(
        0.10, "m", "a beam must go on this far past a point to have seen through it", low=0.01, high=1.0
    )


@dataclass(frozen=True, slots=True)
class ObstacleLayer:
    """Points (N, 2) [m] in map, and when each was last seen, (N,) int64 [ns]."""

    points: FloatArray
    seen_ns: IntArray


EMPTY = ObstacleLayer(np.empty((0, 2)), np.empty(0, np.int64))


@dataclass(frozen=True, slots=True)
class Sight:
    """What one sensor saw at one moment: beams from `origin` (2,) [m] in map.

    Beam i points along `bearings[i]` [rad] in map and is `half_angle` [rad] wide to both sides. It was free from
    `near[i]` to `far[i]` [m], and met something there where `hits[i]`; otherwise it only was not followed any farther.
    """

    stamp_ns: int
    origin: FloatArray
    bearings: FloatArray
    near: FloatArray
    far: FloatArray
    hits: BoolArray
    half_angle: float

    def points(self) -> FloatArray:
        """(M, 2) [m] in map where something was met."""
        bearings, far = self.bearings[self.hits], self.far[self.hits]
        ends: FloatArray = self.origin + far[:, None] * np.stack([np.cos(bearings), np.sin(bearings)], axis=-1)
        return ends


def updated(layer: ObstacleLayer, sight: Sight, settings: ObstacleSettings = ObstacleSettings()) -> ObstacleLayer:
    """The layer after one more look of its sensor."""
    if not len(layer.points) and not sight.hits.any():
        return layer
    seen = sight.points()
    cells = np.floor(np.concatenate([seen, layer.points]) / settings.cell).astype(np.int64)
    # of a cell's points the latest is kept, which is the first here
    _, first = np.unique((cells[:, 0] << 32) + cells[:, 1], return_index=True)
    old = first[first >= len(seen)] - len(seen)
    new = first[first < len(seen)]
    through = _seen_through(layer.points[old], sight, settings)
    faded = sight.stamp_ns - layer.seen_ns[old] > settings.fade * 1e9
    old = old[~(through | faded)]
    return ObstacleLayer(
        np.concatenate([seen[new], layer.points[old]]),
        np.concatenate([np.full(len(new), sight.stamp_ns, np.int64), layer.seen_ns[old]]),
    )


def without(layer: ObstacleLayer, dropped: BoolArray) -> ObstacleLayer:
    """The layer without some of its points, (N,)."""
    return ObstacleLayer(layer.points[~dropped], layer.seen_ns[~dropped])


def sight_from_points(stamp_ns: int, origin: FloatArray, ends: FloatArray, hits: BoolArray, half_angle: float) -> Sight:
    """A planar sensor's look by the ends (N, 2) [m] in map of its beams."""
    away = ends - origin
    far = np.hypot(*away.T)
    return Sight(stamp_ns, origin, np.arctan2(away[:, 1], away[:, 0]), np.zeros(len(far)), far, hits, half_angle)


def sights_from_sonar(
    readings: SonarReadings,
    map_from_base: Pose2,
    base_from_sonars: Sequence[Pose2],
    range_max: float,
    half_cone: float,
    spacing: float = math.radians(2.0),
) -> list[Sight]:
    """A look of each sonar: an echo may come from anywhere on its arc, so the whole arc counts as met.

    Each cone becomes beams `spacing` [rad] apart. REP-117: +inf is free up to `range_max` [m]; nan and -inf (something
    too close to be measured, which is not to be taken for free) say nothing.
    """
    parts = np.linspace(-half_cone, half_cone, max(math.ceil(2 * half_cone / spacing), 1) + 1)
    sights = []
    for mount, distance in zip(base_from_sonars, readings.ranges.tolist(), strict=True):
        if math.isnan(distance) or distance == -math.inf:
            continue
        sonar = map_from_base @ mount
        far = np.full(len(parts), min(distance, range_max))
        hits = np.full(len(parts), distance <= range_max)
        bearings = wrap_angles(parts + sonar.theta)
        origin = np.array([sonar.x, sonar.y])
        sights.append(Sight(readings.stamp_ns, origin, bearings, np.zeros(len(parts)), far, hits, spacing / 2))
    return sights


def sight_from_depth(view: GroundView, map_from_base: Pose2, layer: BodyLayer, floor: float) -> Sight:
    """A depth camera's look at the heights of one layer of the body.

    A beam is free where it passes the layer's heights (from `floor` [m] up), and met something where it ends between
    them, unless that is the ground, which may rise there.
    """
    bottom, theta = max(layer.bottom, floor), map_from_base.theta
    return _sight(view, map_from_base, between_heights(view.ends, view.kind, view.lens, bottom, layer.top, theta))


@njit(cache=True, nogil=True)
def between_heights(ends: FloatArray, kind: Bytes, lens: FloatArray, bottom: float, top: float, theta: float) -> _Beams:
    """The beams that pass two heights [m] on their way, by a view's ends (H, W, 3).

    theta [rad]: of the base in map.
    """
    height, width = kind.shape
    rows = np.empty((3, height * width))
    hits = np.empty(height * width, np.bool_)
    count = 0
    for row in range(height):
        for column in range(width):
            x, y = ends[row, column, 0] - lens[0], ends[row, column, 1] - lens[1]
            z = ends[row, column, 2]
            rise = z - lens[2]
            if math.isnan(x):
                continue
            begin, end = 0.0, 1.0  # the part of the beam between the two heights, as shares of its length
            if abs(rise) >= _LEVEL:
                first, second = (bottom - lens[2]) / rise, (top - lens[2]) / rise
                begin, end = max(min(first, second), 0.0), min(max(first, second), 1.0)
            elif not bottom <= lens[2] <= top:
                continue
            if not end > begin:
                continue
            length = math.hypot(x, y)
            bearing = math.atan2(y, x) + theta
            rows[0, count] = wrapped(bearing)
            rows[1, count], rows[2, count] = begin * length, end * length
            hits[count] = end >= 1.0 and z >= bottom and kind[row, column] != GROUND
            count += 1
    return rows[0, :count], rows[1, :count], rows[2, :count], hits[:count]


_LEVEL = 1e-6
"""A beam that rises or falls by less [m] stays at the height of the lens."""


def sight_of_drops(view: GroundView, map_from_base: Pose2) -> Sight:
    """A depth camera's look for where the ground ends: steps down, kerbs, pits.

    Met are the rim, and all of the mouth that is seen: where beams that end below cross the plane of the ground before
    it. A beam that meets the ground, and is no rim's, has seen that there is some.
    """
    below = view.kind == BELOW
    return _sight_of_ground(view, map_from_base, below | view.rim, below | (view.kind == GROUND))


def sight_of_missing_ground(view: GroundView, map_from_base: Pose2) -> Sight:
    """A depth camera's look for ground that ought to be seen and is not: it is met as if it were not there."""
    missing = view.kind == MISSING
    return _sight_of_ground(view, map_from_base, missing, missing | (view.kind == GROUND))


def _sight_of_ground(view: GroundView, map_from_base: Pose2, met: BoolArray, told: BoolArray) -> Sight:
    """Beams (H, W) that are `told` of at their feet, some of which `met` an end of the ground there."""
    return _sight(view, map_from_base, on_ground(view.directions, view.foot, met, told, map_from_base.theta))


def _sight(view: GroundView, map_from_base: Pose2, beams: _Beams) -> Sight:
    """Beams from the lens of a view's camera."""
    bearings, near, far, hits = beams
    origin = transform_points(map_from_base, view.lens[None, :2])[0]
    return Sight(view.stamp_ns, origin, bearings, near, far, hits, view.half_angle)


_FLOOR_AROUND = 0.12
"""Floor that was met proves floor so far [m] before and behind."""


@njit(cache=True, nogil=True)
def on_ground(directions: FloatArray, foot: FloatArray, met: BoolArray, told: BoolArray, theta: float) -> _Beams:
    """The beams (H, W) that are `told` of; theta [rad]: of the base in map."""
    height, width = foot.shape
    rows = np.empty((3, height * width))
    hits = np.empty(height * width, np.bool_)
    count = 0
    for row in range(height):
        for column in range(width):
            at = foot[row, column]
            if not told[row, column] or math.isnan(at):
                continue
            bearing = math.atan2(directions[row, column, 1], directions[row, column, 0]) + theta
            hits[count] = met[row, column]
            rows[0, count] = wrapped(bearing)
            rows[1, count], rows[2, count] = at - _FLOOR_AROUND, at if hits[count] else at + _FLOOR_AROUND
            count += 1
    return rows[0, :count], rows[1, :count], rows[2, :count], hits[:count]


def widened(points: FloatArray, margin: float) -> FloatArray:
    """Points (N, 2) [m] and, for each, eight on a circle of `margin` [m] round it."""
    turns = np.linspace(0.0, math.tau, 8, endpoint=False)
    circle = margin * np.column_stack([np.cos(turns), np.sin(turns)])
    return np.concatenate([points, (points[:, None] + circle).reshape(-1, 2)])


def _seen_through(points: FloatArray, sight: Sight, settings: ObstacleSettings) -> BoolArray:
    """(N,) which points a beam has gone past while none that points at them was stopped before or at them."""
    if len(points) == 0 or len(sight.bearings) == 0:
        return np.zeros(len(points), np.bool_)
    return passed(
        points - sight.origin,
        sight.bearings,
        sight.near,
        sight.far,
        sight.hits,
        sight.half_angle,
        settings.cell / 2,
        settings.behind,
    )


@njit(cache=True, nogil=True)
def passed(
    points: FloatArray,
    bearings: FloatArray,
    near: FloatArray,
    far: FloatArray,
    hits: BoolArray,
    half_angle: float,
    radius: float,
    behind: float,
) -> BoolArray:
    """(N,) points (N, 2) [m] from the sensor, of a `radius` [m], that beams have gone past.

    Bearings [rad] in [-pi, pi], in any order. A beam counts for all points that any of its width touches.
    """
    starts, order = _by_sector(bearings)
    result = np.zeros(len(points), np.bool_)
    for i in range(len(points)):
        distance = math.hypot(points[i, 0], points[i, 1])
        if distance <= radius:
            continue
        bearing = math.atan2(points[i, 1], points[i, 0])
        reach = half_angle + math.asin(radius / distance)
        low, high = bearing - reach, bearing + reach
        first = math.floor((low + math.pi) / _SECTOR) - 1  # one more to both sides: sectors are cut by rounded numbers
        sectors = min(math.floor((high + math.pi) / _SECTOR) + 2 - first, _SECTORS)
        went, stopped = False, False
        for k in range(sectors):
            sector = (first + k) % _SECTORS
            for place in range(starts[sector], starts[sector + 1]):
                beam = order[place]
                at = bearings[beam]
                # also from the other side of the seam at pi
                touches = low <= at <= high or at - math.tau >= low or at + math.tau <= high
                if touches and near[beam] <= distance:
                    if far[beam] > distance + behind:
                        went = True
                    elif hits[beam]:
                        stopped = True
                        break
            if stopped:
                break
        result[i] = went and not stopped
    return result


_SECTORS = 720
_SECTOR = math.tau / _SECTORS


@njit(cache=True, nogil=True)
def _by_sector(bearings: FloatArray) -> tuple[IntArray, IntArray]:
    """Indices of bearings [rad] by the sector of the full circle that they lie in, and where each sector's begin."""
    sectors = np.empty(len(bearings), np.int64)
    starts = np.zeros(_SECTORS + 1, np.int64)
    for i in range(len(bearings)):
        sectors[i] = min(max(math.floor((bearings[i] + math.pi) / _SECTOR), 0), _SECTORS - 1)
        starts[sectors[i] + 1] += 1
    for sector in range(_SECTORS):
        starts[sector + 1] += starts[sector]
    places, order = starts[:-1].copy(), np.empty(len(bearings), np.int64)
    for i in range(len(bearings)):
        order[places[sectors[i]]] = i
        places[sectors[i]] += 1
    return starts, order


@njit(cache=True, nogil=True)
def any_nearer(points: FloatArray, others: FloatArray, gap: float) -> bool:
    """Whether any of points (N, 2) [m] is nearer than `gap` [m] to one of others (M, 2)."""
    if not len(points):
        return False
    left, right = points[:, 0].min() - gap, points[:, 0].max() + gap
    low, high = points[:, 1].min() - gap, points[:, 1].max() + gap
    for j in range(len(others)):
        x, y = others[j, 0], others[j, 1]
        if not (left < x < right and low < y < high):
            continue
        for i in range(len(points)):
            if (points[i, 0] - x) ** 2 + (points[i, 1] - y) ** 2 < gap**2:
                return True
    return False
