"""The spots in which a chair is, from its pose alone: for a chair that was switched on, pushed, or driven by its rider."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.geometry import arc_lengths, transform_points
from waychair.planning.fleet.ways import Ways
from waychair.runtime.fleet.chain_geometry import SpotPlace, node_rooms, spot_places, ways_along
from waychair.types import FloatArray, Place, Pose2

IN_PLACE = 0.8
"""m; a chair so near to a refuge's pose is in it."""

BESIDE = 0.3
"""m beside a way's clear width in which a chair is still taken to be on it."""


class SpotsOfPose:
    """Finds the spots of poses; `places` are the poses of the refuges by their names."""

    def __init__(self, ways: Ways, body: ChairBody, places: Mapping[str, Place]) -> None:
        self._ways, self._body = ways, body
        self._refuges = {name: places[name].pose for name in ways.slots if name in places}
        self._spots: tuple[SpotPlace, ...] = spot_places(ways)
        self._rooms = node_rooms(ways.graph)

    def at(self, pose: Pose2, entered: Sequence[int] = ()) -> tuple[int, ...]:
        """Return the spots in which a chair at `map_from_base` is, from its rear to its front; none off all ways.

        Of a refuge's slots it is in the one that it has `entered`, by default in the first.
        """
        near = [(math.dist((pose.x, pose.y), (each.x, each.y)), name) for name, each in self._refuges.items()]
        if near and min(near)[0] <= IN_PLACE:
            slots = self._ways.slots[min(near)[1]]
            return (next((slot for slot in slots if slot in entered), slots[0]),)
        sections = [
            (off, spot)
            for spot, place in enumerate(self._spots)
            if place.section is not None and (off := self._off(place, pose)) is not None
        ]
        if not sections:
            return ()
        spot = min(sections)[1]
        place = self._spots[spot]
        ways = _reach(place.points, transform_points(pose, self._body.outline()))
        begin, end = self._node_at(place, 0), self._node_at(place, -1)
        assert place.section is not None
        found = [spot]
        if ways.min() < self._rooms[self._ways.names[begin], place.section]:
            found.insert(0, begin)
        if ways.max() > place.length - self._rooms[self._ways.names[end], place.section]:
            found.append(end)
        return tuple(found)

    def _off(self, place: SpotPlace, pose: Pose2) -> float | None:
        """Return how far [m] a chair is from the middle of a section's way in its direction; None off it, or the other way."""
        point = np.array([[pose.x, pose.y]])
        way = float(_reach(place.points, point)[0])
        if not 0.0 <= way <= place.length:
            return None
        at, heading, width = place.at(way)
        off = float(np.hypot(*(at - point[0])))
        ahead = math.cos(pose.theta - heading) > 0.0 or self._is_one_way(place)
        return off if ahead and off <= width / 2 + BESIDE else None

    def _is_one_way(self, place: SpotPlace) -> bool:
        return self._ways.graph.section[place.section or ""].one_way

    def _node_at(self, place: SpotPlace, end: int) -> int:
        """Return the first spot of the node at the start (0) or end (-1) of a section's way."""
        return next(
            spot
            for spot, other in enumerate(self._spots)
            if other.node is not None and np.hypot(*(other.points[0] - place.points[end])) < 1e-6
        )


def _reach(line: FloatArray, points: FloatArray) -> FloatArray:
    """Return the way (M,) [m] of points (M, 2) along a polyline (N, 2)."""
    return ways_along(line, arc_lengths(line)[:-1], points)
