"""Those who walk about near the chair, or have: seen, left room, and told of to whatever plans or drives among them."""

from __future__ import annotations

import numpy as np

from waychair.calibration.chair import ChairBody
from waychair.control.recovery import RecoverySettings
from waychair.control.surroundings import Surroundings
from waychair.geometry import transform_points
from waychair.planning.forecast import People
from waychair.planning.tracks import Track, Tracker, TrackSettings, gap, may_be_behind, room_round, seen_from
from waychair.types import FloatArray, Pose2

_ROOM_TO_LEAVE = 0.03
"""Left between the chair and the room of people [m], on cells of the window, so that it can go away from them."""


class Bystanders:
    """Keeps their tracks, in odom, where nothing jumps."""

    def __init__(self, body: ChairBody, settings: TrackSettings, recovery: RecoverySettings, margin: float) -> None:
        """`margin` [m] is what the local planner keeps free round the body."""
        self._body, self._settings, self._recovery, self._margin = body, settings, recovery, margin
        self._tracker = Tracker(settings)
        self.tracks: tuple[Track, ...] = ()

    @property
    def positions(self) -> FloatArray:
        """(K, 2) [m] in odom: where those are who walk about, or have."""
        return np.array([track.position for track in self.tracks]).reshape(-1, 2)

    def see(
        self,
        now_ns: int,
        pose: Pose2,
        obstacles: FloatArray,
        odom_from_map: Pose2,
        surroundings: Surroundings,
        stood_s: float,
    ) -> None:
        """A scan from map_from_base, points (N, 2) [m] in map: who goes their way, or went it before they stood.

        Room is left round them in the surroundings, less when the chair has stood [s] for them to pass.
        """
        strangers = transform_points(odom_from_map, surroundings.strangers(obstacles))
        self.tracks = tuple(track for track in self._tracker.update(now_ns, strangers) if track.walked)
        spare = self._margin + _ROOM_TO_LEAVE
        s = self._settings
        wide = s.room_after if stood_s > s.room_after_s else s.room
        room = room_round(self.tracks, wide, odom_from_map @ pose, self._body, spare)
        walking = (*(each for each in self.tracks if each.walks(s)), *self._tracker.lost)
        walkers = np.array([each.position for each in walking]).reshape(-1, 2)
        map_from_odom = odom_from_map.inverse()
        surroundings.keep_clear_of(transform_points(map_from_odom, room), transform_points(map_from_odom, walkers))

    def under_way(self, map_from_odom: Pose2) -> People:
        """Those who are on their way, in map, as a planner foresees them."""
        walkers = (track for track in self.tracks if track.walks(self._settings))
        return People(seen_from(map_from_odom, walkers), self._body.width / 2 + self._settings.room)

    def foreseen(self, odom_from_base: Pose2) -> tuple[Track, ...]:
        """Those whose way is foreseen; who is nearer than a forecast is good for is an obstacle, where they stand."""
        return tuple(track for track in self.tracks if self._gap(track, odom_from_base) > track.radius)

    def about(self, odom_from_base: Pose2) -> bool:
        """Whether there are people near who go on by themselves."""
        return any(
            track.walks(self._settings) and self._gap(track, odom_from_base) < self._recovery.about
            for track in self.tracks
        )

    def behind(self, now_ns: int, odom_from_base: Pose2) -> bool:
        """Whether people may be where the chair would back out to."""
        everybody = (*self.tracks, *self._tracker.lost)
        return may_be_behind(everybody, now_ns, odom_from_base, self._body, self._recovery.way)

    def _gap(self, track: Track, odom_from_base: Pose2) -> float:
        """Distance [m] from the chair's outline with its margin to the middle of a person."""
        return gap(track.position, odom_from_base, self._body) - self._margin
