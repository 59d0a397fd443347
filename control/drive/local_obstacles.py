"""The local obstacles round the chair on one small fine grid: walls, keep-out zones and the sensors' obstacles."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from waychair.calibration.chair_body import BodyLayer, ChairBody, sonar_mounts
from waychair.config import Settings, setting
from waychair.maps.depth.depth_scan import levelled_mount
from waychair.maps.depth.ground import GroundView, ground_view
from waychair.maps.grid.cells import cells_from_points, cells_under, occupied
from waychair.maps.grid.distance_field import DistanceField, window_distances
from waychair.planning.body.clearance import DROP_OFF
from waychair.planning.body.personal_space import PERSON_POINTS
from waychair.planning.grid.drawn_map import DrawnMap
from waychair.planning.seen.obstacle_layer import (
    CELL,
    DROP_CELL,
    DROP_FORGOTTEN_AFTER_S,
    EMPTY,
    ObstacleLayer,
    Sight,
    any_nearer,
    sight_from_depth,
    sight_from_points,
    sight_of_drops,
    sight_of_missing_ground,
    sights_from_sonar,
    updated,
    with_circles,
    without,
)
from waychair.types import BoolArray, Float32Array, FloatArray, OccupancyGrid, Pose2, RgbdFrame, SonarReadings

_MOVED, _MUCH = 0.1, 0.2
"""m: a point without another so near has moved; share of the obstacles: if more have moved, a plan is obsolete."""


MIXED_PIXEL_GAP = 0.1
"""m; a scan's point so far from both neighbours may be a mixed pixel."""

WINDOW_REACH, WINDOW_CELL = 4.0, 0.025
"""m; half side of the local window and the side of its cells; a map's cells are split or joined to about that."""

WALL_WITHIN = 0.15
"""m; a lidar point so near to a mapped wall belongs to that wall."""

WALL_WITHIN_OTHERS, WALL_WITHIN_SHARE = 0.08, 0.03
"""m, share; the same for points of camera and sonars, whose obstacles no other sensor sees. Depth errors grow with the
distance, so this share of it counts up to `WALL_WITHIN`."""

STOOD_WITHIN_S = 20.0
"""s; what stood beside the chair so short a time ago still stands there for the guard, until the lidar sees that it is gone: a rider
who goes to and fro in a narrow place has it out of sight for so long."""

BEAM_HALF_ANGLE = math.radians(0.25)
"""rad; half the angle between two beams of the lidar."""

FLOOR_HEIGHT = 0.06
"""m; the camera's points below this are floor."""


@dataclass(frozen=True, slots=True)
class SurroundingsSettings(Settings):
    """The sonars' range and cone."""

    sonar_range: float = setting(
        4.0, "m", "range within which sonar echoes are obstacles; larger: farther echoes count", low=0.1, high=20.0
    )
    sonar_half_cone: float = setting(
        math.radians(15.0),
        "rad",
        "angle from a sonar's axis to the edge of its cone; larger: wider obstacles",
        low=0.01,
        high=1.5,
    )


class Surroundings:
    """The map's walls, the latest scan, and each sensor's obstacles that the map does not explain."""

    def __init__(self, drawn: DrawnMap, body: ChairBody, settings: SurroundingsSettings) -> None:
        self._body, self._settings = body, settings
        self.redraw(drawn)
        self._scanned = self._personal_space = self._walkers = self._drop_off_zone = np.empty((0, 2))
        self._lidar = self._sonar = self._drop_offs = self._missing = EMPTY
        self._depth: dict[BodyLayer, ObstacleLayer] = dict.fromkeys(body.height_layers(), EMPTY)
        self.has_sonars = False
        """Whether the chair has sonars."""

    def redraw(self, drawn: DrawnMap) -> None:
        """Take the walls from another drawing of the map, or another map; what stood out of sight is forgotten, other obstacles stay."""
        self._drawn, self._walls, self._stood = drawn, occupied(drawn.grid), EMPTY

    def see(self, now_ns: int, pose: Pose2, points: FloatArray, beyond: FloatArray | None = None) -> None:
        """Take in a scan from map_from_base: its beams' end points (N, 2) [m] in map replace the scan before.

        Obstacles that the map does not explain are remembered out of sight. `beyond` (M, 2) [m] in map are the ends of
        free space on the beams without an echo.
        """
        self._scanned = points
        laser = pose @ self._body.base_from_laser
        ends = points if beyond is None else np.concatenate([points, beyond])
        hits = np.arange(len(ends)) < len(points)
        sight = sight_from_points(now_ns, np.array([laser.x, laser.y]), ends, hits, BEAM_HALF_ANGLE)
        self._lidar = self._without_walls(updated(self._lidar, sight), WALL_WITHIN)
        standing = replace(sight, hits=hits & ~self._is_of_walkers(ends))
        self._stood = self._without_walls(updated(self._stood, standing, CELL, STOOD_WITHIN_S), WALL_WITHIN)

    def hear(self, readings: SonarReadings, pose: Pose2) -> None:
        """Take in the sonars' readings from map_from_base; they detect glass, which the lidar does not see.

        An echo comes from somewhere on its arc. If the map or the latest scan has an obstacle on that arc, the echo is
        attributed to it; otherwise the whole arc counts as an obstacle.
        """
        s, self.has_sonars = self._settings, True
        for sight in sights_from_sonar(readings, pose, sonar_mounts(self._body), s.sonar_range, s.sonar_half_cone):
            if sight.hits.any() and self._is_explained(sight):
                sight = replace(sight, hits=np.zeros(len(sight.hits), np.bool_))
            self._sonar = self._without_near_walls(updated(self._sonar, sight), sight.origin)

    def look(self, frame: RgbdFrame, pose: Pose2, level_from_base: FloatArray | None = None) -> GroundView:
        """Take in a depth image from map_from_base: obstacles off the lidar's height, such as table tops, and
        drop-offs. Return the ground in it.

        The image is levelled by the chair's lean (3, 3), if that is known. A drop-off is remembered when it is so near
        that the camera looks over it.
        """
        view = levelled_ground_view(frame, self._body, level_from_base)
        for layer, seen in self._depth.items():
            sight = sight_from_depth(view, pose, layer, FLOOR_HEIGHT)
            self._depth[layer] = self._without_near_walls(updated(seen, sight), sight.origin)
        self._drop_offs = updated(self._drop_offs, sight_of_drops(view, pose), DROP_CELL, DROP_FORGOTTEN_AFTER_S)
        self._drop_off_zone = with_circles(self._drop_offs.points, DROP_OFF)
        missing = updated(self._missing, sight_of_missing_ground(view, pose), DROP_CELL)
        self._missing = self._without_walls(
            missing, WALL_WITHIN
        )  # depth of the floor at the foot of a wall is often wrong
        return view

    def set_personal_space(self, points: FloatArray, walkers: FloatArray | None = None) -> None:
        """Take points (N, 2) [m] in map of people's personal space, which are obstacles until the next call.

        `walkers` (K, 2) [m] in map are the people that walk: see `stationary`.
        """
        self._personal_space = points
        self._walkers = np.empty((0, 2)) if walkers is None else walkers

    def window(self, pose: Pose2) -> DistanceField:
        """Return distances to walls and sensor obstacles in a square round a pose; off the map only the latter count.

        Obstacles at the heights of a narrower layer of the body have a distance field of their own.
        """
        grid, wanted = self._drawn.grid, WINDOW_CELL
        finer, coarser = max(1, round(grid.resolution / wanted)), max(1, math.floor(wanted / grid.resolution + 1e-9))
        size = coarser * math.ceil(2 * WINDOW_REACH / (coarser * grid.resolution))
        row, col = (cells_from_points(grid, np.array([[pose.x, pose.y]]))[0] - size // 2).tolist()
        row, col = row - row % coarser, col - col % coarser  # the grouping of map cells must not depend on the pose
        solid = np.zeros((size, size), np.bool_)
        top, left = max(row, 0), max(col, 0)
        part = self._walls[top : max(row + size, 0), left : max(col + size, 0)]
        solid[top - row : top - row + part.shape[0], left - col : left - col + part.shape[1]] = part
        solid = np.logical_or.reduce([solid[i::coarser, j::coarser] for i, j in np.ndindex(coarser, coarser)])
        solid = solid.repeat(finer, axis=0).repeat(finer, axis=1)
        corner = grid.map_from_grid @ Pose2(col * grid.resolution, row * grid.resolution, 0.0)
        local = OccupancyGrid(np.zeros(solid.shape, np.int8), grid.resolution * coarser / finer, corner)
        whole = np.concatenate([self._scanned, self.full_height(), *self._in_full_layers()])

        def distances_to(solid: BoolArray, points: FloatArray) -> Float32Array:
            solid[tuple(cells_under(local, points).T)] = True
            return window_distances(solid, local.resolution)

        layers = tuple((layer, distances_to(np.zeros_like(solid), seen)) for layer, seen in self.in_narrow_layers())
        return DistanceField(distances_to(solid, whole), local.resolution, corner, layers)

    def full_height(self) -> FloatArray:
        """Return unmapped obstacles (N, 2) [m] in map of unknown height, which the whole footprint must avoid."""
        return np.concatenate([self._lidar.points, self._sonar.points, self.missing_floor(), self._personal_space])

    def stationary(self) -> tuple[FloatArray, tuple[tuple[BodyLayer, FloatArray], ...]]:
        """Return `full_height` and `layered` without walking people, who will be elsewhere when the chair gets
        there."""
        upright = np.concatenate([self._lidar.points, self._sonar.points, self._personal_space])
        layered = ((layer, self._without_walkers(points)) for layer, points in self.layered())
        return np.concatenate([self._without_walkers(upright), self.missing_floor()]), tuple(layered)

    def stands_near(self, points: FloatArray, gap: float) -> bool:
        """Return whether a `stationary` obstacle is nearer than `gap` [m] to one of points (N, 2) [m] in map."""
        upright, layered = self.stationary()
        news = np.concatenate([upright, *(seen for _, seen in layered)])
        return any_nearer(np.ascontiguousarray(points), news, gap)

    def _without_walkers(self, points: FloatArray) -> FloatArray:
        """Return the points (N, 2) [m] that do not belong to a walking person."""
        others: FloatArray = points[~self._is_of_walkers(points)]
        return others

    def _is_of_walkers(self, points: FloatArray) -> BoolArray:
        """Return a mask (N,) of the points (N, 2) [m] that may belong to a walking person."""
        gaps = np.hypot(*(points[:, None] - self._walkers[None]).transpose(2, 0, 1))
        near: BoolArray = gaps.min(axis=1, initial=math.inf) <= PERSON_POINTS
        return near

    def unscanned(self) -> FloatArray:
        """Return unmapped obstacles (N, 2) [m] in map that no scan shows, for the whole footprint.

        They come from other sensors and from people's personal space.
        """
        return np.concatenate([self._personal_space, self.missing_floor(), self._sonar.points, *self._in_full_layers()])

    def things_unscanned(self) -> FloatArray:
        """Return unmapped things (N, 2) [m] in map that only sonars and depth camera show, for the whole footprint."""
        return np.concatenate([self._sonar.points, *self._in_full_layers()])

    def stood(self) -> FloatArray:
        """Return unmapped obstacles (N, 2) [m] in map that the lidar has seen to stand within `STOOD_WITHIN_S`."""
        return self._stood.points

    def missing_floor(self) -> FloatArray:
        """Return drop-offs with their margin, and places of missing floor, (N, 2) [m] in map."""
        return np.concatenate([self._drop_off_zone, self._missing.points])

    def is_unmapped(self, points: FloatArray) -> BoolArray:
        """Return a mask (N,) of points (N, 2) [m] in map that the map does not explain."""
        return ~self._drawn.is_explained(points, WALL_WITHIN)

    def layered(self) -> tuple[tuple[BodyLayer, FloatArray], ...]:
        """Return unmapped obstacles (N, 2) [m] in map at the heights of each layer of the body."""
        return tuple((layer, seen.points) for layer, seen in self._depth.items())

    def in_narrow_layers(self) -> tuple[tuple[BodyLayer, FloatArray], ...]:
        """Return the non-empty part of `layered` for layers narrower than the whole footprint."""
        return tuple((layer, seen) for layer, seen in self.layered() if len(seen) and not self._is_full_outline(layer))

    def _in_full_layers(self) -> list[FloatArray]:
        """Return the points of `layered` for layers as wide as the whole footprint."""
        return [seen for layer, seen in self.layered() if self._is_full_outline(layer)]

    def _is_full_outline(self, layer: BodyLayer) -> bool:
        """Return whether a layer's outline is the whole footprint."""
        body = self._body
        return (layer.front, layer.rear, layer.half_width) == (body.front, body.rear, body.width / 2)

    def _without_walls(self, seen: ObstacleLayer, within: float | FloatArray) -> ObstacleLayer:
        """Return the layer without points within `within` [m] of a mapped wall, which belong to that wall."""
        return without(seen, self._drawn.is_explained(seen.points, within)) if len(seen.points) else seen

    def _without_near_walls(self, seen: ObstacleLayer, sensor: FloatArray) -> ObstacleLayer:
        """Return `_without_walls` for a sensor at (2,) [m] in map whose obstacles no other sensor sees: a shelf, a low
        step."""
        return self._without_walls(seen, self._wall_tolerance(np.hypot(*(seen.points - sensor).T)))

    def _wall_tolerance(self, away: FloatArray) -> FloatArray:
        """Return the distances (N,) [m] from a wall within which points `away` (N,) [m] from the sensor are that
        wall."""
        return np.clip(WALL_WITHIN_SHARE * away, WALL_WITHIN_OTHERS, max(WALL_WITHIN_OTHERS, WALL_WITHIN))

    def _is_explained(self, sight: Sight) -> bool:
        """Return whether the map or the latest scan has an obstacle on the arc of an echo."""
        arc, doubt = sight.points(), self._wall_tolerance(sight.far[sight.hits])
        return bool(self._drawn.is_explained(arc, doubt).any()) or any_nearer(arc, self._scanned, float(doubt.max()))


def levelled_ground_view(frame: RgbdFrame, body: ChairBody, level_from_base: FloatArray | None) -> GroundView:
    """Return the ground in a depth image, levelled by the chair's lean (3, 3) if that is known."""
    mount = body.base_from_camera if level_from_base is None else levelled_mount(body.base_from_camera, level_from_base)
    return ground_view(frame, mount, body.front)


def have_mostly_moved(before: FloatArray, now: FloatArray) -> bool:
    """Return whether a large share of the earlier obstacles (N, 2) [m] is gone."""
    if not len(before) or not len(now):
        return bool(len(before))
    away, _ = cKDTree(now).query(before, distance_upper_bound=_MOVED)
    return bool(np.isinf(away).mean() > _MUCH)


def without_mixed_pixels(points: FloatArray, laser: Pose2, gap: float = MIXED_PIXEL_GAP) -> FloatArray:
    """Return a scan's points (N, 2) [m], in the order of its beams, without mixed pixels.

    A beam that falls half on an edge reads a range between the two surfaces, where nothing is. Such a point is farther
    than `gap` [m] from both neighbours and farther from the laser than one of them. A point nearer than both is a slim
    object and stays. The collision monitor takes no such risk and uses all points.
    """
    if len(points) < 2:
        return points
    steps, ranges = np.hypot(*np.diff(points, axis=0).T), np.hypot(*(points - (laser.x, laser.y)).T)
    alone = np.minimum(np.append(steps, np.inf), np.insert(steps, 0, np.inf)) >= gap
    slim = ranges <= np.minimum(np.append(ranges[1:], np.inf), np.insert(ranges[:-1], 0, np.inf))
    kept: FloatArray = points[~alone | slim]
    return kept
