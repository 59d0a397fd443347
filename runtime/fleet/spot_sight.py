"""Which spots of a traffic graph a chair sees taken: by things in its scan that are on no map."""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial import KDTree

from waychair.geometry import arc_lengths, nearest_step
from waychair.maps.grid.cells import occupied_points
from waychair.planning.fleet.ways import Ways
from waychair.runtime.fleet.chain_geometry import SpotPlace, spot_places
from waychair.types import BoolArray, FloatArray, OccupancyGrid

ON_MAP = 0.20
"""m; a point so near to a mapped thing is that thing: 1° of heading at 10 m."""

BESIDE = 0.10
"""m; a point so near to the edge of a section's clear width stands in nobody's way."""

AT_NODE = 0.60
"""m round a node: the turning circle of a chair."""

FEWEST = 3
"""Points of a scan that are a thing; two may be noise."""


class SpotSight:
    """The spots of a building on its map, to be asked with the points of a scan."""

    def __init__(self, ways: Ways, grid: OccupancyGrid) -> None:
        self._ways = ways
        self._places = spot_places(ways)
        self._known = KDTree(occupied_points(grid))

    def things(self, points: FloatArray) -> FloatArray:
        """Return the points (M, 2) [m] in map of a scan's points (N, 2) that are on no map."""
        points = points[np.isfinite(points).all(axis=1)]
        if not len(points):
            return points
        found: FloatArray = points[self._known.query(points, distance_upper_bound=ON_MAP)[0] == math.inf]
        return found

    def taken(self, things: FloatArray) -> frozenset[int]:
        """Return the resources in which enough points (M, 2) [m] lie."""
        found: set[int] = set()
        if len(things) < FEWEST:
            return frozenset()
        for spot, place in enumerate(self._places):
            resource = int(self._ways.resource[spot])
            if resource not in found and int(self._within(place, things).sum()) >= FEWEST:
                found.add(resource)
        return frozenset(found)

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
            way = along[step] + share * (along[step + 1] - along[step])
            at, heading, width = place.at(float(way))
            left = float(np.array([-math.sin(heading), math.cos(heading)]) @ (points[k] - at))
            is_beside = abs(left) > width / 2 - BESIDE
            near[k] = 0.0 < share < 1.0 and not is_beside and not (two and left > 0.0)
        return near
