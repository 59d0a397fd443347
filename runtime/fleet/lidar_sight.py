"""Whether a chair's own lidar sees a spot of its building free: nothing stands in it that is not on the map.

A spot counts as free as far as the lidar looks into it, if that is far enough: of a section its first metres at least.
"""

from __future__ import annotations

import math

import numpy as np

from waychair.geometry import transform_points
from waychair.maps.grid.cells import cells_from_points, inside, occupied
from waychair.maps.grid.distance_field import distances
from waychair.planning.fleet.peers.alone import SEEN_AHEAD
from waychair.planning.fleet.ways import Ways
from waychair.runtime.fleet.chain_geometry import SpotPlace, spot_places
from waychair.slam.scan.scan_points import beam_ends
from waychair.types import BoolArray, FloatArray, OccupancyGrid, Pose2, Scan

OFF_WALLS = 0.15
"""m; a point nearer to something on the map is that thing, by the lidar's noise and the pose's error."""

NODE_RADIUS = 0.7
"""m around a node or place in which nothing may stand: a chair's turning circle."""

LEAST_SEEN = 2.0
"""m of a section's way that have to be in sight."""

FEWEST = 3
"""Points that make a thing."""

_STEP = 0.25  # m between the points of a way that are looked at
_SHORT = 0.3  # m by which a beam may be shorter than the way to a point that is in sight
_BEAMS = 2  # beams on each side


class LidarSight:
    """A chair's sight of the spots of its building; `grid` is its map."""

    def __init__(self, ways: Ways, grid: OccupancyGrid, base_from_laser: Pose2) -> None:
        self._places: tuple[SpotPlace, ...] = spot_places(ways)
        self._grid = grid
        self._walls = distances(occupied(grid), grid.resolution)
        self._mount = base_from_laser
        self._scan: Scan | None = None
        self._pose = Pose2()
        self._points = np.zeros((0, 2))

    def look(self, scan: Scan, map_from_base: Pose2) -> None:
        """Take the newest scan, with the chair's pose at its time."""
        ends, valid = beam_ends(scan, self._mount, math.inf)
        points = transform_points(map_from_base, ends[valid])
        self._scan, self._pose = scan, map_from_base
        self._points = points[self._off_walls(points)]

    def is_free(self, spot: int) -> bool:
        """Return whether nothing is seen in a spot, and enough of it; false before the first scan."""
        if self._scan is None:
            return False
        place = self._places[spot]
        if place.section is None:
            return self._things_near(place.points[:1], np.array([NODE_RADIUS])) < FEWEST
        length = min(place.length, SEEN_AHEAD)
        steps = np.arange(0.0, length, _STEP)
        at = [place.at(float(way)) for way in steps]
        line = np.array([each[0] for each in at])
        seen = self._in_sight(line)
        until = len(seen) if seen.all() else int(np.argmin(seen))
        if until * _STEP < min(LEAST_SEEN, length - _STEP):
            return False
        half = np.array([each[2] / 2 for each in at])
        return self._things_near(line[:until], half[:until]) < FEWEST

    def _things_near(self, line: FloatArray, half: FloatArray) -> int:
        """Return the number of points off the map's walls within a distance (N,) [m] of points (N, 2)."""
        if not len(self._points) or not len(line):
            return 0
        near = np.hypot(*(self._points[:, None] - line).transpose(2, 0, 1)) < half
        return int(near.any(axis=1).sum())

    def _in_sight(self, line: FloatArray) -> BoolArray:
        """Return which points (N, 2) of the map the lidar sees, or are beside the chair."""
        assert self._scan is not None
        scan = self._scan
        laser = self._pose @ self._mount
        off = line - (laser.x, laser.y)
        away = np.hypot(*off.T)
        bearing = np.arctan2(off[:, 1], off[:, 0]) - laser.theta - scan.angle_min
        beam = np.rint(np.mod(bearing, math.tau) / scan.angle_step).astype(np.int64)
        count = len(scan.ranges)
        whole = abs(count * scan.angle_step) > math.tau - 2 * abs(scan.angle_step)
        beams = beam[:, None] + np.arange(-_BEAMS, _BEAMS + 1)
        inside = np.ones(beams.shape, np.bool_) if whole else (beams >= 0) & (beams < count)
        ranges = np.nan_to_num(scan.ranges[np.mod(beams, count)], nan=0.0, posinf=1e3)
        reach = np.where(inside, ranges, 0.0).max(axis=1)  # a beam without a valid range shows nothing
        seen: BoolArray = (reach > away - _SHORT) | (away < NODE_RADIUS)
        return seen

    def _off_walls(self, points: FloatArray) -> BoolArray:
        """Return which points (N, 2) of the map are off everything on it."""
        cells = cells_from_points(self._grid, points)
        found = inside(self._grid, cells)
        found[found] = self._walls[tuple(cells[found].T)] > OFF_WALLS
        return found
