"""What the sensors have seen round the chair and the map does not know: marked when seen, cleared when seen through.

One layer a sensor, and for sensors that tell heights one for each of the body's (`BodyLayer`). A sensor clears only
what it has marked itself: a lidar looks through the glass that a sonar has heard, and under the table that a camera has
seen. What is neither seen nor seen through, because it is out of sight, is remembered for a while and then fades.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit

from waychair.calibration.chair import BodyLayer
from waychair.config import Settings, setting
from waychair.geometry import transform_points, wrap_angles
from waychair.maps.ground import BELOW, GROUND, MISSING, GroundView
from waychair.types import BoolArray, FloatArray, IntArray, Pose2, SonarReadings


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
    known = np.isfinite(view.ends[..., 0])
    base, ground = view.ends[known], view.kind[known] == GROUND
    lens = view.lens
    bottom, top = max(layer.bottom, floor), layer.top
    # the part of each beam between the two heights, as shares of its length
    rise = base[:, 2] - lens[2]
    level = np.abs(rise) < 1e-6
    with np.errstate(divide="ignore", invalid="ignore"):
        shares = np.sort((np.array([[bottom], [top]]) - lens[2]) / np.where(level, np.nan, rise), axis=0)
    within = bottom <= lens[2] <= top
    begin = np.where(level, 0.0 if within else np.inf, np.clip(shares[0], 0.0, None))
    end = np.where(level, 1.0 if within else -np.inf, np.clip(shares[1], None, 1.0))
    passes = end > begin
    away = (base - lens)[passes, :2]
    length = np.hypot(*away.T)
    hits = (end[passes] >= 1.0) & (base[passes, 2] >= bottom) & ~ground[passes]
    origin = transform_points(map_from_base, lens[None, :2])[0]
    bearings = wrap_angles(np.arctan2(away[:, 1], away[:, 0]) + map_from_base.theta)
    return Sight(view.stamp_ns, origin, bearings, begin[passes] * length, end[passes] * length, hits, view.half_angle)


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
    told = told & np.isfinite(view.foot)
    hits, far, (x, y) = met[told], view.foot[told], view.directions[told].T
    bearings = wrap_angles(np.arctan2(y, x) + map_from_base.theta)
    origin = transform_points(map_from_base, view.lens[None, :2])[0]
    around = np.where(hits, 0.0, _FLOOR_AROUND)
    return Sight(view.stamp_ns, origin, bearings, far - _FLOOR_AROUND, far + around, hits, view.half_angle)


_FLOOR_AROUND = 0.12
"""Floor that was met proves floor so far [m] before and behind."""


def widened(points: FloatArray, margin: float) -> FloatArray:
    """Points (N, 2) [m] and, for each, eight on a circle of `margin` [m] round it."""
    turns = np.linspace(0.0, math.tau, 8, endpoint=False)
    circle = margin * np.column_stack([np.cos(turns), np.sin(turns)])
    return np.concatenate([points, (points[:, None] + circle).reshape(-1, 2)])


def _seen_through(points: FloatArray, sight: Sight, settings: ObstacleSettings) -> BoolArray:
    """(N,) which points a beam has gone past while none that points at them was stopped before or at them."""
    if len(points) == 0 or len(sight.bearings) == 0:
        return np.zeros(len(points), np.bool_)
    order = np.argsort(sight.bearings)
    return passed(
        points - sight.origin,
        sight.bearings[order],
        sight.near[order],
        sight.far[order],
        sight.hits[order],
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
    """(N,) points (N, 2) [m] from the sensor, of a `radius` [m], that beams sorted by bearing have gone past.

    A beam counts for all points that any of its width touches.
    """
    result = np.zeros(len(points), np.bool_)
    count = len(bearings)
    for i in range(len(points)):
        distance = math.hypot(points[i, 0], points[i, 1])
        if distance <= radius:
            continue
        bearing = math.atan2(points[i, 1], points[i, 0])
        reach = half_angle + math.asin(radius / distance)
        first = np.searchsorted(bearings, bearing - reach)
        # also the beams on the other side of the seam at pi
        if bearing - reach < -math.pi:
            first = np.searchsorted(bearings, bearing - reach + 2 * math.pi) - count
        went, stopped = False, False
        beam = first
        while beam - first < count:
            index = beam % count
            if bearings[index] + (beam - index) // count * 2 * math.pi > bearing + reach:
                break
            if near[index] <= distance:
                if far[index] > distance + behind:
                    went = True
                elif hits[index]:
                    stopped = True
            beam += 1
        result[i] = went and not stopped
    return result
