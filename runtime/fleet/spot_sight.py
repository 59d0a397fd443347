"""What a chair's own lidar shows of the spots of its building: in which of them something stands that is on no map, and which
ones it sees free.

A spot counts as free as far as the lidar looks into it, if that is far enough: of a section its first metres at least.
"""

from __future__ import annotations

import math

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.geometry import arc_lengths, nearest_step, transform_points
from waychair.maps.grid.cells import cells_from_points, inside, occupied
from waychair.maps.grid.distance_field import distances
from waychair.planning.fleet.peers.alone import SEEN_AHEAD
from waychair.planning.fleet.ways import Ways
from waychair.runtime.fleet.alone_driving import Seen
from waychair.runtime.fleet.chain_geometry import SpotPlace, spot_places
from waychair.slam.scan.scan_points import beam_ends
from waychair.types import BoolArray, FloatArray, OccupancyGrid, Pose2, Scan

SEES = 14.0
"""m in which a scan counts: ten of single file have to be seen free, from where the chair waits before them."""

ON_MAP = 0.20
"""m; a point so near to a mapped thing is that thing: 1° of heading at 10 m."""

BESIDE = 0.10
"""m; a point so near to the edge of a section's clear width stands in nobody's way."""

AT_NODE = 0.50
"""m round a node or place in which nothing may stand. The rear of a chair that has gone aside into a room is 0.58 m from the node
before its door, where the others are to pass it.
"""

FEWEST = 3
"""Points of a scan that are a thing; two may be noise."""

LEAST_SEEN = 2.0
"""m of a section's way that have to be in sight."""

_STEP = 0.25  # m between the points of a way that are looked at
_SHORT = 0.3  # m by which a beam may be shorter than the way to a point that is in sight
_BEAMS = 2  # beams on each side


class SpotSight:
    """The spots of a building on a chair's map, and the chair's last scan of them."""

    def __init__(self, ways: Ways, grid: OccupancyGrid, body: ChairBody) -> None:
        self._ways, self._grid, self._body = ways, grid, body
        self._places = spot_places(ways)
        self._off_map = distances(occupied(grid), grid.resolution) > ON_MAP
        self._scan: Scan | None = None
        self._pose = Pose2()
        self._things: FloatArray = np.empty((0, 2))
        self._taken: frozenset[int] | None = frozenset()  # None: not looked for in the last scan

    def look(self, scan: Scan, map_from_base: Pose2) -> None:
        """Take the newest scan, without the beams that hit the chair itself, and the chair's pose at its time."""
        ends, valid = beam_ends(scan, self._body.base_from_laser, SEES)
        points = transform_points(map_from_base, ends[valid])
        cells = cells_from_points(self._grid, points)
        is_thing = inside(self._grid, cells)
        is_thing[is_thing] = self._off_map[tuple(cells[is_thing].T)]
        self._scan, self._pose, self._things, self._taken = scan, map_from_base, points[is_thing], None

    @property
    def taken(self) -> frozenset[int]:
        """The resources in which something stands that is on no map."""
        if self._taken is None:
            self._taken = self.taken_by(self._things)
        return self._taken

    def taken_by(self, things: FloatArray) -> frozenset[int]:
        """Return the resources in which enough points (M, 2) [m] in map lie."""
        found: set[int] = set()
        if len(things) < FEWEST:
            return frozenset()
        for spot, place in enumerate(self._places):
            resource = int(self._ways.resource[spot])
            if resource not in found and int(self._within(place, things).sum()) >= FEWEST:
                found.add(resource)
        return frozenset(found)

    def seen(self, map_from_base: Pose2) -> Seen:
        """Return what a chair has to know of the last scan to drive by its own eyes, at its pose now."""
        return Seen(map_from_base, self.taken, self._things, self._body.front)

    def is_free(self, spot: int) -> bool:
        """Return whether nothing is seen in a spot, and enough of it; false before the first scan."""
        if self._scan is None or int(self._ways.resource[spot]) in self.taken:
            return False
        place = self._places[spot]
        if place.section is None:
            return True
        length = min(place.length, SEEN_AHEAD)
        line = np.array([place.at(float(way))[0] for way in np.arange(0.0, length, _STEP)])
        seen = self._in_sight(self._scan, line)
        until = len(seen) if seen.all() else int(np.argmin(seen))
        return until * _STEP >= min(LEAST_SEEN, length - _STEP)

    def _within(self, place: SpotPlace, points: FloatArray) -> BoolArray:
        """Return which points (M, 2) lie in a spot; of a section with two lanes in the right one."""
        low, high = place.points.min(axis=0), place.points.max(axis=0)
        margin = AT_NODE if place.section is None else float(place.widths.max()) / 2
        near: BoolArray = ((points > low - margin) & (points < high + margin)).all(axis=1)
        if not near.any():
            return near
        if place.section is None:
            near[near] = np.hypot(*(points[near] - place.points[0]).T) < AT_NODE
            return near
        along = arc_lengths(place.points)
        two = self._ways.graph.section[place.section].lanes == 2
        for k in np.flatnonzero(near):
            step, share = nearest_step(place.points, points[k])
            way = float(along[step] + share * (along[step + 1] - along[step]))
            at, heading, width = place.at(way)
            left = float(np.array([-math.sin(heading), math.cos(heading)]) @ (points[k] - at))
            is_beside = math.dist(points[k], at) > width / 2 - BESIDE
            near[k] = 0.0 < way < along[-1] and not is_beside and not (two and left > 0.0)
        return near

    def _in_sight(self, scan: Scan, line: FloatArray) -> BoolArray:
        """Return which points (N, 2) of the map the lidar sees, or are beside the chair."""
        laser = self._pose @ self._body.base_from_laser
        off = line - (laser.x, laser.y)
        away = np.hypot(*off.T)
        bearing = np.arctan2(off[:, 1], off[:, 0]) - laser.theta - scan.angle_min
        beam = np.rint(np.mod(bearing, math.tau) / scan.angle_step).astype(np.int64)
        count = len(scan.ranges)
        whole = abs(count * scan.angle_step) > math.tau - 2 * abs(scan.angle_step)
        beams = beam[:, None] + np.arange(-_BEAMS, _BEAMS + 1)
        within = np.ones(beams.shape, np.bool_) if whole else (beams >= 0) & (beams < count)
        ranges = np.nan_to_num(scan.ranges[np.mod(beams, count)], nan=0.0, posinf=1e3)
        reach = np.where(within, ranges, 0.0).max(axis=1)  # a beam without a valid range shows nothing
        seen: BoolArray = (reach > away - _SHORT) | (away < AT_NODE)
        return seen
