"""What is round the chair now: the map's walls, its keep-out zones and what the sensors see, on one small fine grid."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial import cKDTree

from waychair.calibration.chair import BodyLayer, ChairBody, sonar_mounts
from waychair.config import Settings, setting
from waychair.maps.depth_scan import levelled_mount
from waychair.maps.distance_field import DistanceField, window_distances
from waychair.maps.grid import cells_from_points, cells_under, occupied
from waychair.maps.ground import GroundSettings, ground_view
from waychair.planning.drawn_map import DrawnMap
from waychair.planning.obstacle_layer import (
    EMPTY,
    ObstacleLayer,
    ObstacleSettings,
    Sight,
    any_nearer,
    sight_from_depth,
    sight_from_points,
    sight_of_drops,
    sight_of_missing_ground,
    sights_from_sonar,
    updated,
    widened,
    without,
)
from waychair.types import BoolArray, Float32Array, FloatArray, OccupancyGrid, Pose2, RgbdFrame, SonarReadings

_MOVED, _MUCH = 0.1, 0.2
"""What is this far [m] from where it was has moved; this part of what is in the way is much."""


@dataclass(frozen=True, slots=True)
class SurroundingsSettings(Settings):
    """How far and how finely the local planner sees."""

    reach: float = setting(4.0, "m", "half side of the window", low=2.0, high=20.0)
    resolution: float = setting(
        0.025, "m", "cells of the window, about: a map's are split or joined", low=0.01, high=0.1
    )
    known_within: float = setting(
        0.15,
        "m",
        "what the lidar sees this near to a wall of the map is that wall, and is where it is seen",
        low=0.0,
        high=1.0,
    )
    told_within: float = setting(
        0.08, "m", "as above for camera and sonars: what stands out farther is told by nothing else", low=0.0, high=1.0
    )
    told_share: float = setting(
        0.03, "", "... or, up to known_within, this part of its distance: depth errors grow with it", low=0.0, high=0.2
    )
    beam: float = setting(
        math.radians(0.25), "rad", "half the angle between two beams of the lidar", low=1e-4, high=0.1
    )
    floor: float = setting(0.06, "m", "what the camera sees lower than this is floor", low=0.0, high=0.5)
    sonar_range: float = setting(4.0, "m", "farthest echo of the sonars", low=0.1, high=20.0)
    sonar_half_cone: float = setting(math.radians(15.0), "rad", "from a sonar's axis to its edge", low=0.01, high=1.5)
    walker: float = setting(0.5, "m", "a point this near to the middle of who walks is of them", low=0.0, high=2.0)
    obstacles: ObstacleSettings = field(default_factory=ObstacleSettings)
    ground: GroundSettings = field(default_factory=GroundSettings)
    drop_margin: float = setting(0.15, "m", "kept free round where the floor ends", low=0.0, high=0.5)
    remembered_drops: ObstacleSettings = field(default_factory=lambda: ObstacleSettings(cell=0.05, fade=600.0))
    missing_ground: ObstacleSettings = field(default_factory=lambda: ObstacleSettings(cell=0.05))


class Surroundings:
    """Keeps the walls, the latest scan, and what each sensor has seen that the map does not explain."""

    def __init__(self, drawn: DrawnMap, body: ChairBody, settings: SurroundingsSettings) -> None:
        self._body, self._settings = body, settings
        self.redraw(drawn)
        self._scanned = self._room = self._walkers = self._edges = np.empty((0, 2))
        self._lidar = self._sonar = self._drops = self._missing = EMPTY
        self._depth: dict[BodyLayer, ObstacleLayer] = dict.fromkeys(body.height_layers(), EMPTY)
        self.hears = False
        """Whether there are sonars."""

    def redraw(self, drawn: DrawnMap) -> None:
        """The walls are those of this map from now on; what was seen stays known."""
        self._drawn, self._walls = drawn, occupied(drawn.grid)

    def see(self, now_ns: int, pose: Pose2, points: FloatArray, beyond: FloatArray | None = None) -> None:
        """A scan from map_from_base: where its beams ended, (N, 2) [m] in map, replaces the scan before.

        What the map does not explain stays remembered when it goes out of sight. `beyond` (M, 2) [m] in map is how far
        the beams that met nothing are known to be free.
        """
        self._scanned = points
        laser = pose @ self._body.base_from_laser
        ends = points if beyond is None else np.concatenate([points, beyond])
        hits = np.arange(len(ends)) < len(points)
        sight = sight_from_points(now_ns, np.array([laser.x, laser.y]), ends, hits, self._settings.beam)
        self._lidar = self._news(updated(self._lidar, sight, self._settings.obstacles), self._settings.known_within)

    def hear(self, readings: SonarReadings, pose: Pose2) -> None:
        """Readings of the sonars from map_from_base; glass is heard where it is not seen.

        An echo comes from somewhere on its arc. Where the map or the latest scan has something on that arc, it comes
        from there; else all of the arc counts.
        """
        s, self.hears = self._settings, True
        for sight in sights_from_sonar(readings, pose, sonar_mounts(self._body), s.sonar_range, s.sonar_half_cone):
            if sight.hits.any() and self._explained(sight):
                sight = replace(sight, hits=np.zeros(len(sight.hits), np.bool_))
            self._sonar = self._told(updated(self._sonar, sight, s.obstacles), sight.origin)

    def look(self, frame: RgbdFrame, pose: Pose2, level_from_base: FloatArray | None = None) -> None:
        """A depth image from map_from_base: table tops and what else is not at the lidar's height, and the floor's end.

        It is levelled by the chair's lean (3, 3), if that is known.

        An edge of the floor stays remembered when the camera, which looks ahead over it, has lost sight of it.
        """
        s, body = self._settings, self._body
        mount = (
            body.base_from_camera if level_from_base is None else levelled_mount(body.base_from_camera, level_from_base)
        )
        view = ground_view(frame, mount, body.front, s.ground)
        for layer, seen in self._depth.items():
            sight = sight_from_depth(view, pose, layer, s.floor)
            self._depth[layer] = self._told(updated(seen, sight, s.obstacles), sight.origin)
        self._drops = updated(self._drops, sight_of_drops(view, pose), s.remembered_drops)
        self._edges = widened(self._drops.points, s.drop_margin)
        missing = updated(self._missing, sight_of_missing_ground(view, pose), s.missing_ground)
        self._missing = self._news(missing, s.known_within)  # at the foot of a wall a camera is often wrong about floor

    def keep_clear_of(self, points: FloatArray, walkers: FloatArray | None = None) -> None:
        """Points (N, 2) [m] in map that count as seen until the next call: the room that people are left.

        `walkers` (K, 2) [m] in map are those of them who are on their way: see `lasting`.
        """
        self._room = points
        self._walkers = np.empty((0, 2)) if walkers is None else walkers

    def window(self, pose: Pose2) -> DistanceField:
        """Distances to walls and all that was seen, in a square round a pose; off the map only what was seen counts.

        What stands where the body is narrower than its whole outline has distances of its own.
        """
        grid, wanted = self._drawn.grid, self._settings.resolution
        finer, coarser = max(1, round(grid.resolution / wanted)), max(1, math.floor(wanted / grid.resolution + 1e-9))
        size = coarser * math.ceil(2 * self._settings.reach / (coarser * grid.resolution))
        row, col = (cells_from_points(grid, np.array([[pose.x, pose.y]]))[0] - size // 2).tolist()
        row, col = row - row % coarser, col - col % coarser  # the same cells of the map make one, wherever the chair is
        solid = np.zeros((size, size), np.bool_)
        top, left = max(row, 0), max(col, 0)
        part = self._walls[top : max(row + size, 0), left : max(col + size, 0)]
        solid[top - row : top - row + part.shape[0], left - col : left - col + part.shape[1]] = part
        solid = np.logical_or.reduce([solid[i::coarser, j::coarser] for i, j in np.ndindex(coarser, coarser)])
        solid = solid.repeat(finer, axis=0).repeat(finer, axis=1)
        corner = grid.map_from_grid @ Pose2(col * grid.resolution, row * grid.resolution, 0.0)
        local = OccupancyGrid(np.zeros(solid.shape, np.int8), grid.resolution * coarser / finer, corner)
        whole = np.concatenate([self._scanned, self.upright(), *self._widest()])

        def distances_to(solid: BoolArray, points: FloatArray) -> Float32Array:
            solid[tuple(cells_under(local, points).T)] = True
            return window_distances(solid, local.resolution)

        layers = tuple((layer, distances_to(np.zeros_like(solid), seen)) for layer, seen in self.narrower())
        return DistanceField(distances_to(solid, whole), local.resolution, corner, layers)

    def upright(self) -> FloatArray:
        """(N, 2) [m] in map: what was seen that the map does not explain, of unknown height: the whole outline counts."""
        return np.concatenate([self._lidar.points, self._sonar.points, self._no_ground(), self._room])

    def lasting(self) -> tuple[FloatArray, tuple[tuple[BodyLayer, FloatArray], ...]]:
        """`upright` and `layered` without those who walk: by the time the chair is there, they are elsewhere."""
        upright = np.concatenate([self._lidar.points, self._sonar.points, self._room])
        layered = ((layer, self._but_walkers(points)) for layer, points in self.layered())
        return np.concatenate([self._but_walkers(upright), self._no_ground()]), tuple(layered)

    def stands_near(self, points: FloatArray, gap: float) -> bool:
        """Whether anything that is `lasting` stands nearer than `gap` [m] to one of points (N, 2) [m] in map."""
        upright, layered = self.lasting()
        news = np.concatenate([upright, *(seen for _, seen in layered)])
        return any_nearer(np.ascontiguousarray(points), news, gap)

    def _but_walkers(self, points: FloatArray) -> FloatArray:
        """Those of points (N, 2) [m] that are not of somebody who walks."""
        gaps = np.hypot(*(points[:, None] - self._walkers[None]).transpose(2, 0, 1))
        others: FloatArray = points[gaps.min(axis=1, initial=math.inf) > self._settings.walker]
        return others

    def unscanned(self) -> FloatArray:
        """(N, 2) [m] in map: of what the map does not explain that which no scan shows: for the whole outline.

        Other sensors have seen it, or people need it.
        """
        return np.concatenate([self._room, self._no_ground(), self._sonar.points, *self._widest()])

    def _no_ground(self) -> FloatArray:
        """(N, 2) [m] in map: where the floor ends, with its margin, and where it ought to be seen and is not."""
        return np.concatenate([self._edges, self._missing.points])

    def strangers(self, points: FloatArray) -> FloatArray:
        """Those of points (N, 2) [m] in map that the map does not explain."""
        return points[~self._drawn.explains(points, self._settings.known_within)]

    def layered(self) -> tuple[tuple[BodyLayer, FloatArray], ...]:
        """(N, 2) [m] in map: what was seen that the map does not explain at the heights of each layer of the body."""
        return tuple((layer, seen.points) for layer, seen in self._depth.items())

    def narrower(self) -> tuple[tuple[BodyLayer, FloatArray], ...]:
        """That of `layered` which stands where the body's outline is not the whole one, as far as there is any."""
        return tuple((layer, seen) for layer, seen in self.layered() if len(seen) and not self._is_widest(layer))

    def _widest(self) -> list[FloatArray]:
        """That of `layered` which stands where the body's outline is the whole one."""
        return [seen for layer, seen in self.layered() if self._is_widest(layer)]

    def _is_widest(self, layer: BodyLayer) -> bool:
        """Whether a layer's outline is the whole one."""
        body = self._body
        return (layer.front, layer.rear, layer.half_width) == (body.front, body.rear, body.width / 2)

    def _news(self, seen: ObstacleLayer, within: float | FloatArray) -> ObstacleLayer:
        """Without what lies so near [m] to a wall of the map that it is that wall."""
        return without(seen, self._drawn.explains(seen.points, within)) if len(seen.points) else seen

    def _told(self, seen: ObstacleLayer, sensor: FloatArray) -> ObstacleLayer:
        """`_news` of a sensor at (2,) [m] in map that alone tells of what it sees: a shelf on a wall, a low step."""
        return self._news(seen, self._doubt(np.hypot(*(seen.points - sensor).T)))

    def _doubt(self, away: FloatArray) -> FloatArray:
        """(N,) within how much [m] of a wall what camera or sonars see so far `away` (N,) [m] is that wall."""
        s = self._settings
        return np.clip(s.told_share * away, s.told_within, max(s.told_within, s.known_within))

    def _explained(self, sight: Sight) -> bool:
        """Whether something that is known lies on the arc that an echo came from."""
        arc, doubt = sight.points(), self._doubt(sight.far[sight.hits])
        return bool(self._drawn.explains(arc, doubt).any()) or any_nearer(arc, self._scanned, float(doubt.max()))


def much_is_gone(before: FloatArray, now: FloatArray) -> bool:
    """Whether much of what was in the way, (N, 2) [m], is not there any more."""
    if not len(before) or not len(now):
        return bool(len(before))
    away, _ = cKDTree(now).query(before, distance_upper_bound=_MOVED)
    return bool(np.isinf(away).mean() > _MUCH)


def without_veils(points: FloatArray, laser: Pose2, gap: float) -> FloatArray:
    """The points (N, 2) [m] of a scan, in the order of its beams, without those of beams split by an edge.

    Half a beam on an edge and half beyond it read a range between, where nothing is: a point farther than `gap` [m] from
    those beside it, and farther from the laser than one of them. What is nearer than both is no veil but slim. The
    collision monitor, which takes no such chances, sees them all.
    """
    if len(points) < 2:
        return points
    steps, ranges = np.hypot(*np.diff(points, axis=0).T), np.hypot(*(points - (laser.x, laser.y)).T)
    alone = np.minimum(np.append(steps, np.inf), np.insert(steps, 0, np.inf)) >= gap
    slim = ranges <= np.minimum(np.append(ranges[1:], np.inf), np.insert(ranges[:-1], 0, np.inf))
    kept: FloatArray = points[~alone | slim]
    return kept
