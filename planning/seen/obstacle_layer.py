"""Obstacle layers: points that the sensors have seen and the map does not have, marked when seen, cleared when passed.

Each sensor has its own layer; sensors that measure heights have one per height layer of the body (`BodyLayer`). A
sensor clears only its own marks: a lidar looks through glass that a sonar detects, and under a table that a camera
sees. Points out of sight are remembered for a while and then forgotten.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numba import njit

from waychair.angles import wrapped
from waychair.calibration.chair_body import BodyLayer
from waychair.geometry import transform_points, wrap_angles
from waychair.maps.depth.ground import BELOW, GROUND, MISSING, GroundView
from waychair.types import BoolArray, Bytes, FloatArray, IntArray, Pose2, SonarReadings

_Beams: TypeAlias = tuple[FloatArray, FloatArray, FloatArray, BoolArray]
"""`bearings`, `near`, `far` and `hits` of a `Sight`."""


CELL, DROP_CELL = 0.025, 0.05
"""[m] Of the points of a layer in a square of this side one is kept; the second is for drop-offs and missing ground,
which cameras see as areas."""

FORGOTTEN_AFTER_S, DROP_FORGOTTEN_AFTER_S = 5.0, 600.0
"""[s] Points out of sight are forgotten after this time. Drop-offs stay where they are, so they are kept much
longer."""

PASSED_BY = 0.1
"""[m] A beam must go on this far past a point to clear it."""


@dataclass(frozen=True, slots=True)
class ObstacleLayer:
    """Points (N, 2) [m] in map, and when each was last seen, (N,) int64 [ns]."""

    points: FloatArray
    seen_ns: IntArray


EMPTY = ObstacleLayer(np.empty((0, 2)), np.empty(0, np.int64))


@dataclass(frozen=True, slots=True)
class Sight:
    """One observation of one sensor: beams from `origin` (2,) [m] in map.

    Beam i points along `bearings[i]` [rad] in map and extends `half_angle` [rad] to both sides. It was free from
    `near[i]` to `far[i]` [m]. If `hits[i]`, it ended there at an obstacle; otherwise nothing is known beyond.
    """

    stamp_ns: int
    origin: FloatArray
    bearings: FloatArray
    near: FloatArray
    far: FloatArray
    hits: BoolArray
    half_angle: float

    def points(self) -> FloatArray:
        """Return (M, 2) [m] in map the ends of the beams that hit an obstacle."""
        bearings, far = self.bearings[self.hits], self.far[self.hits]
        ends: FloatArray = self.origin + far[:, None] * np.stack([np.cos(bearings), np.sin(bearings)], axis=-1)
        return ends


def updated(
    layer: ObstacleLayer, sight: Sight, cell: float = CELL, forgotten_after_s: float = FORGOTTEN_AFTER_S
) -> ObstacleLayer:
    """Return the layer after one more observation of its sensor, thinned to one point per cell [m]."""
    if not len(layer.points) and not sight.hits.any():
        return layer
    seen = sight.points()
    cells = np.floor(np.concatenate([seen, layer.points]) / cell).astype(np.int64)
    # the latest point of each cell is kept, which comes first here
    _, first = np.unique((cells[:, 0] << 32) + cells[:, 1], return_index=True)
    old = first[first >= len(seen)] - len(seen)
    new = first[first < len(seen)]
    through = _seen_through(layer.points[old], sight, cell)
    expired = sight.stamp_ns - layer.seen_ns[old] > forgotten_after_s * 1e9
    old = old[~(through | expired)]
    return ObstacleLayer(
        np.concatenate([seen[new], layer.points[old]]),
        np.concatenate([np.full(len(new), sight.stamp_ns, np.int64), layer.seen_ns[old]]),
    )


def without(layer: ObstacleLayer, dropped: BoolArray) -> ObstacleLayer:
    """Return the layer without its points that are marked in (N,)."""
    return ObstacleLayer(layer.points[~dropped], layer.seen_ns[~dropped])


def sight_from_points(stamp_ns: int, origin: FloatArray, ends: FloatArray, hits: BoolArray, half_angle: float) -> Sight:
    """Return a planar sensor's observation from the ends (N, 2) [m] in map of its beams."""
    away = ends - origin
    far = np.hypot(*away.T)
    return Sight(
        stamp_ns=stamp_ns,
        origin=origin,
        bearings=np.arctan2(away[:, 1], away[:, 0]),
        near=np.zeros(len(far)),
        far=far,
        hits=hits,
        half_angle=half_angle,
    )


def sights_from_sonar(
    readings: SonarReadings,
    map_from_base: Pose2,
    base_from_sonars: Sequence[Pose2],
    range_max: float,
    half_cone: float,
    spacing: float = math.radians(2.0),
) -> list[Sight]:
    """Return an observation per sonar: an echo may come from anywhere on its arc, so the whole arc counts as hit.

    Each cone becomes beams `spacing` [rad] apart. REP-117: +inf is free up to `range_max` [m]; nan and -inf (an
    obstacle too close to measure, which is not free space) are ignored.
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
        sights.append(
            Sight(
                stamp_ns=readings.stamp_ns,
                origin=origin,
                bearings=bearings,
                near=np.zeros(len(parts)),
                far=far,
                hits=hits,
                half_angle=spacing / 2,
            )
        )
    return sights


def sight_from_depth(view: GroundView, map_from_base: Pose2, layer: BodyLayer, floor: float) -> Sight:
    """Return a depth camera's observation at the heights of one layer of the body.

    A beam is free where it passes the layer's heights (from `floor` [m] up). It hit an obstacle if it ends between
    them, unless that is the ground, which may rise there.
    """
    bottom, theta = max(layer.bottom, floor), map_from_base.theta
    return _sight(view, map_from_base, between_heights(view.ends, view.kind, view.lens, bottom, layer.top, theta))


@njit(cache=True, nogil=True)
def between_heights(ends: FloatArray, kind: Bytes, lens: FloatArray, bottom: float, top: float, theta: float) -> _Beams:
    """Return the beams that pass between two heights [m], from a view's ends (H, W, 3).

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
"""A beam that rises or falls by less [m] is level."""


def sight_of_drops(view: GroundView, map_from_base: Pose2) -> Sight:
    """Return a depth camera's observation of drop-offs: steps down, kerbs, pits.

    Hits are the rim and the visible part of the hole: the points where beams that end below the ground cross its plane.
    A beam that meets the ground away from a rim is evidence of floor.
    """
    below = view.kind == BELOW
    return _sight_of_ground(view, map_from_base, below | view.rim, below | (view.kind == GROUND))


def sight_of_missing_ground(view: GroundView, map_from_base: Pose2) -> Sight:
    """Return a depth camera's observation of expected but unseen ground, which counts as a drop-off."""
    missing = view.kind == MISSING
    return _sight_of_ground(view, map_from_base, missing, missing | (view.kind == GROUND))


def _sight_of_ground(view: GroundView, map_from_base: Pose2, met: BoolArray, told: BoolArray) -> Sight:
    """Return the beams (H, W) that are valid (`told`) on the ground, hits where they `met` a drop-off."""
    return _sight(view, map_from_base, on_ground(view.directions, view.foot, met, told, map_from_base.theta))


def _sight(view: GroundView, map_from_base: Pose2, beams: _Beams) -> Sight:
    """Return beams from the lens of a view's camera as an observation."""
    bearings, near, far, hits = beams
    origin = transform_points(map_from_base, view.lens[None, :2])[0]
    return Sight(
        stamp_ns=view.stamp_ns,
        origin=origin,
        bearings=bearings,
        near=near,
        far=far,
        hits=hits,
        half_angle=view.half_angle,
    )


_FLOOR_AROUND = 0.12
"""Observed floor is evidence of floor this far [m] before and behind it."""


@njit(cache=True, nogil=True)
def on_ground(directions: FloatArray, foot: FloatArray, met: BoolArray, told: BoolArray, theta: float) -> _Beams:
    """Return the beams (H, W) that are valid (`told`); theta [rad]: of the base in map."""
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


def with_circles(points: FloatArray, margin: float) -> FloatArray:
    """Return points (N, 2) [m] and, for each, eight more on a circle of `margin` [m] around it."""
    turns = np.linspace(0.0, math.tau, 8, endpoint=False)
    circle = margin * np.column_stack([np.cos(turns), np.sin(turns)])
    return np.concatenate([points, (points[:, None] + circle).reshape(-1, 2)])


def _seen_through(points: FloatArray, sight: Sight, cell: float) -> BoolArray:
    """Return (N,) which points some beam has passed, while no beam through them was stopped before or at them."""
    if len(points) == 0 or len(sight.bearings) == 0:
        return np.zeros(len(points), np.bool_)
    return passed_points(
        points - sight.origin,
        sight.bearings,
        sight.near,
        sight.far,
        sight.hits,
        sight.half_angle,
        cell / 2,
        PASSED_BY,
    )


@njit(cache=True, nogil=True)
def passed_points(
    points: FloatArray,
    bearings: FloatArray,
    near: FloatArray,
    far: FloatArray,
    hits: BoolArray,
    half_angle: float,
    radius: float,
    behind: float,
) -> BoolArray:
    """Return (N,) which points (N, 2) [m], relative to the sensor and of a `radius` [m], beams have passed.

    Bearings [rad] are in [-pi, pi], in any order. A beam counts for every point that its width touches.
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
        first = math.floor((low + math.pi) / _SECTOR) - 1  # one more on both sides, for rounding at sector borders
        sectors = min(math.floor((high + math.pi) / _SECTOR) + 2 - first, _SECTORS)
        went, stopped = False, False
        for k in range(sectors):
            sector = (first + k) % _SECTORS
            for place in range(starts[sector], starts[sector + 1]):
                beam = order[place]
                at = bearings[beam]
                # also across the seam at pi
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
    """Return where each sector's bearings begin, and the indices of bearings [rad] sorted by sector of the circle."""
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
    """Return whether any of points (N, 2) [m] is nearer than `gap` [m] to one of others (M, 2)."""
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
