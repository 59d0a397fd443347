"""Those who walk about near the chair, or have: seen, left room, and told of to whatever plans or drives among them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from waychair.calibration.chair import ChairBody
from waychair.control.recovery import RecoverySettings
from waychair.control.surroundings import Surroundings
from waychair.geometry import transform_points
from waychair.planning.forecast import People
from waychair.planning.tracks import (
    Track,
    Tracker,
    TrackSettings,
    gap,
    may_be_behind,
    moved_on,
    room_round,
    seen_from,
)
from waychair.types import FloatArray, Pose2

_ROOM_TO_LEAVE = 0.03
"""Left between the chair and the room of people [m], on cells of the window, so that it can go away from them."""

_NOWHERE = 0.3
"""A chair that has gone no farther than this [m] has got nowhere."""

_FOLLOWS = 0.03
"""Part by which the middle of where somebody has been comes nearer to where they are, with every scan."""


@dataclass(frozen=True, slots=True)
class _Stay:
    """Since when somebody has been near a chair that gets nowhere, and about which middle (2,) [m] in odom."""

    since_ns: int
    middle: FloatArray


class Bystanders:
    """Keeps their tracks, in odom, where nothing jumps."""

    def __init__(self, body: ChairBody, settings: TrackSettings, recovery: RecoverySettings, margin: float) -> None:
        """`margin` [m] is what the local planner keeps free round the body."""
        self._body, self._settings, self._recovery, self._margin = body, settings, recovery, margin
        self._tracker = Tracker(settings)
        self.tracks: tuple[Track, ...] = ()
        self._room = settings.room
        self._stands_at = Pose2()
        self._stays_near: dict[int, _Stay] = {}

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
        seen_ns: int,
    ) -> None:
        """A scan of `seen_ns` from map_from_base, points (N, 2) [m] in map: who goes their way, or went it and stands.

        Room is left round them in the surroundings, less when the chair has stood [s] for them to pass.
        """
        strangers = transform_points(odom_from_map, surroundings.strangers(obstacles))
        tracks = self._tracker.update(seen_ns, strangers)
        self.tracks = moved_on((track for track in tracks if track.walked), now_ns)
        self._note_who_is_near(now_ns, odom_from_map @ pose)
        s = self._settings
        self._room = s.room_after if stood_s > s.room_after_s else s.room
        room = room_round(self.tracks, self._room, odom_from_map @ pose, self._body, self._margin + _ROOM_TO_LEAVE)
        may_go = (*(track for track in self.tracks if not self._has_settled(track)), *self._tracker.lost)
        places = np.array([track.position for track in may_go]).reshape(-1, 2)
        map_from_odom = odom_from_map.inverse()
        surroundings.keep_clear_of(transform_points(map_from_odom, room), transform_points(map_from_odom, places))

    def under_way(self, map_from_odom: Pose2) -> People:
        """Those who are on their way, or may soon be, in map, as a planner expects them."""
        expected = (self._expected(track) for track in self.tracks if not self._has_settled(track))
        return People(seen_from(map_from_odom, expected), self._body.width / 2 + self._room)

    def linger_near(self, points: FloatArray, gap: float) -> bool:
        """Whether anybody who lingers is nearer than `gap` [m] to one of points (N, 2) [m] in odom."""
        lingering = (self._expected(track) for track in self.tracks if self._lingers(track))
        return any(np.hypot(*(points - track.position).T).min(initial=math.inf) < gap for track in lingering)

    def foreseen(self, now_ns: int, odom_from_base: Pose2) -> tuple[Track, ...]:
        """Those whose way is foreseen from where they are now, of who stands that they stand.

        Who is nearer than a forecast is good for is an obstacle, where they stand.
        """
        return tuple(
            track if track.walks(self._settings) else _standing_at(track.position, track)
            for track in moved_on(self.tracks, now_ns)
            if self._gap(track, odom_from_base) > track.radius
        )

    def about(self, odom_from_base: Pose2) -> bool:
        """Whether there are people near who move."""
        return any(track.walks(self._settings) for track in self._near(odom_from_base))

    def passing(self, odom_from_base: Pose2) -> bool:
        """Whether there are people near who go on by themselves: who lingers waits for the chair."""
        near = self._near(odom_from_base)
        return any(track.walks(self._settings) and not self._lingers(track) for track in near)

    def behind(self, now_ns: int, odom_from_base: Pose2) -> bool:
        """Whether people may be where the chair would back out to."""
        everybody = (*self.tracks, *self._tracker.lost)
        return may_be_behind(everybody, now_ns, odom_from_base, self._body, self._recovery.way)

    def _near(self, odom_from_base: Pose2) -> list[Track]:
        return [track for track in self.tracks if self._gap(track, odom_from_base) < self._recovery.about]

    def _has_settled(self, track: Track) -> bool:
        """Whether somebody has stood for so long that they are as good as furniture."""
        return not track.moved_within(self._settings.settles)

    def _lingers(self, track: Track) -> bool:
        """Whether somebody stands, or goes to and fro before a chair that gets nowhere: they may soon go, or not."""
        if self._has_settled(track):
            return False
        if not track.walks(self._settings):
            return True
        stay = self._stays_near.get(track.number)
        return stay is not None and track.stamp_ns - stay.since_ns > self._settings.linger * 1e9

    def _expected(self, track: Track) -> Track:
        """The track; of one who lingers, as standing in the middle of where they have been.

        That middle stays while they go to and fro, and with it the side on which there is a way past them.
        """
        if not self._lingers(track):
            return track
        stay = self._stays_near.get(track.number)
        middle = track.position if stay is None else stay.middle
        return _standing_at(middle, track)

    def _note_who_is_near(self, now_ns: int, odom_from_base: Pose2) -> None:
        if math.dist((self._stands_at.x, self._stands_at.y), (odom_from_base.x, odom_from_base.y)) > _NOWHERE:
            self._stands_at, self._stays_near = odom_from_base, {}
        before, self._stays_near = self._stays_near, {}
        for track in self._near(odom_from_base):
            stay = before.get(track.number, _Stay(now_ns, track.position))
            middle = stay.middle + _FOLLOWS * (track.position - stay.middle)
            self._stays_near[track.number] = replace(stay, middle=middle)

    def _gap(self, track: Track, odom_from_base: Pose2) -> float:
        """Distance [m] from the chair's outline with its margin to the middle of a person."""
        return gap(track.position, odom_from_base, self._body) - self._margin


def _standing_at(position: FloatArray, track: Track) -> Track:
    """The track as of one who beyond doubt stands at a position (2,) [m]."""
    return replace(track, position=position, velocity=np.zeros(2), covariance=np.zeros((4, 4)))
