"""Tracks of people near the chair, kept for the planner and the drive: their personal space, forecasts and stays."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.control.drive.local_obstacles import Surroundings
from waychair.control.drive.recovery import BACKING_LENGTH
from waychair.geometry import transform_points
from waychair.planning.body.personal_space import (
    GIVE_WAY_S,
    LEAVING_PEOPLE,
    LINGERS_AFTER_S,
    SETTLED_AFTER_S,
    WAITED_FOR_WITHIN,
    PersonalSpaceSettings,
)
from waychair.planning.seen.forecast import ExpectedPeople
from waychair.planning.seen.person_sightings import MoverModel, ScanAround
from waychair.planning.seen.person_tracks import (
    Track,
    Tracker,
    distance_to_body,
    person_may_be_behind,
    personal_space_points,
    tracks_at,
    transformed_tracks,
)
from waychair.types import BoolArray, FloatArray, Pose2

_NOWHERE = 0.3
"""m; a chair displaced by no more than this has made no progress."""

_FOLLOWS = 0.03
"""Share of the gap by which the middle of a person's stay moves towards their position with every scan."""


@dataclass(frozen=True, slots=True)
class _Stay:
    """A person's stay near a chair that makes no progress: its start and its middle (2,) [m] in odom."""

    since_ns: int
    middle: FloatArray


class Bystanders:
    """The tracks of people near the chair, kept in odom because odom never jumps."""

    def __init__(
        self,
        body: ChairBody,
        model: MoverModel,
        space: PersonalSpaceSettings,
        margin: float,
    ) -> None:
        """`margin` [m] is the clearance that the local planner keeps round the body."""
        self._body, self._space, self._margin = body, space, margin
        self._tracker = Tracker(model)
        self.tracks: tuple[Track, ...] = ()
        self.waiting: tuple[tuple[float, float, float], ...] = ()
        """Circles x, y, radius [m] in map in which people stand and wait: anything there that may be a person is one."""
        self._room = space.radius
        self._stands_at = Pose2()
        self._stays_near: dict[int, _Stay] = {}

    @property
    def positions(self) -> FloatArray:
        """Positions (K, 2) [m] in odom of people: they walk, have walked, or stand where people wait."""
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
        beyond: FloatArray | None = None,
    ) -> None:
        """Track people in a scan taken at `seen_ns` from map_from_base, with points (N, 2) [m] in map, beam by beam.

        `beyond` (M, 2) [m] in map are the ends of free space on the scan's other beams.
        The surroundings are given the people's personal space, a smaller one once the chair has stood for `stood_s` [s]
        to let them pass.
        """
        scan = ScanAround(
            points=transform_points(odom_from_map, obstacles),
            strangers=np.flatnonzero(surroundings.is_unmapped(obstacles)),
            laser=(odom_from_map @ pose @ self._body.base_from_laser).array()[:2],
            free=None if beyond is None else transform_points(odom_from_map, beyond),
        )
        tracks = self._tracker.update(seen_ns, scan.points[scan.strangers], scan)
        waits = self._where_people_wait(tracks, odom_from_map)
        known = (replace(track, waits=bool(here)) for track, here in zip(tracks, waits, strict=True))
        self.tracks = tracks_at((track for track in known if track.is_person), now_ns)
        self._note_stays(now_ns, odom_from_map @ pose)
        self._room = self._space.squeezed if stood_s > GIVE_WAY_S else self._space.radius
        room = personal_space_points(
            self.tracks, lambda _: self._room, odom_from_map @ pose, self._body, self._margin + LEAVING_PEOPLE
        )
        may_go = (*(track for track in self.tracks if not self._has_settled(track)), *self._tracker.recently_lost)
        places = np.array([track.position for track in may_go]).reshape(-1, 2)
        map_from_odom = odom_from_map.inverse()
        surroundings.set_personal_space(transform_points(map_from_odom, room), transform_points(map_from_odom, places))

    def expected_people(self, map_from_odom: Pose2) -> ExpectedPeople:
        """Return the people that walk, or may soon walk, in map, as a planner expects them."""
        expected = (self._expected(track) for track in self.tracks if not self._has_settled(track))
        return ExpectedPeople(transformed_tracks(map_from_odom, expected), self._body.width / 2 + self._room)

    def someone_lingers_near(self, points: FloatArray, gap: float) -> bool:
        """Return whether a lingering person is nearer than `distance_to_body` [m] to one of points (N, 2) [m] in odom."""
        lingering = (self._expected(track) for track in self.tracks if self._lingers(track))
        return any(np.hypot(*(points - track.position).T).min(initial=math.inf) < gap for track in lingering)

    def predicted(self, now_ns: int, odom_from_base: Pose2) -> tuple[Track, ...]:
        """Return the tracks to predict from their positions now; a standing person is predicted to stand.

        A person too near for a forecast is left out: the scan's points are then the obstacle.
        """
        return tuple(
            track if track.is_walking else _standing_at(track.position, track)
            for track in tracks_at(self.tracks, now_ns)
            if self._gap(track, odom_from_base) > track.radius
        )

    def in_reach(self, odom_from_base: Pose2) -> FloatArray:
        """Return points (N, 2) [m] in odom round the places that walking people can reach while the chair stops.

        Nobody can tell whether somebody who walks turns about: they come so far in any direction. A chair that they can
        reach already comes no nearer, not even in small steps.
        """
        walking = (track for track in self.tracks if track.is_walking)
        return personal_space_points(walking, _reach, odom_from_base, self._body, _BESIDE_CHAIR)

    def someone_walks_near(self, odom_from_base: Pose2) -> bool:
        """Return whether somebody near the chair walks."""
        return any(track.is_walking for track in self._near(odom_from_base))

    def someone_passes_near(self, odom_from_base: Pose2) -> bool:
        """Return whether somebody near walks and does not linger; a lingering person waits for the chair."""
        near = self._near(odom_from_base)
        return any(track.is_walking and not self._lingers(track) for track in near)

    def someone_behind(self, now_ns: int, odom_from_base: Pose2) -> bool:
        """Return whether people may be in the area that backing out would use."""
        everybody = (*self.tracks, *self._tracker.recently_lost)
        return person_may_be_behind(everybody, now_ns, odom_from_base, self._body, BACKING_LENGTH)

    def _where_people_wait(self, tracks: Sequence[Track], odom_from_map: Pose2) -> BoolArray:
        """Return (K,) whether tracks in odom are where people stand and wait."""
        areas = np.array(self.waiting).reshape(-1, 3)
        middles = transform_points(odom_from_map, areas[:, :2])
        at = np.array([track.position for track in tracks]).reshape(-1, 2)
        within = np.hypot(*(at[:, None] - middles[None]).transpose(2, 0, 1)) < areas[:, 2]
        waits: BoolArray = within.any(axis=1)
        return waits

    def _near(self, odom_from_base: Pose2) -> list[Track]:
        return [track for track in self.tracks if self._gap(track, odom_from_base) < WAITED_FOR_WITHIN]

    def _has_settled(self, track: Track) -> bool:
        """Return whether a person has stood for so long that they count as furniture."""
        return not track.moved_within(SETTLED_AFTER_S)

    def _lingers(self, track: Track) -> bool:
        """Return whether a person stands, or moves to and fro before a chair that makes no progress."""
        if self._has_settled(track):
            return False
        if not track.is_walking:
            return True
        stay = self._stays_near.get(track.number)
        return stay is not None and track.stamp_ns - stay.since_ns > LINGERS_AFTER_S * 1e9

    def _expected(self, track: Track) -> Track:
        """Return the track, or for a lingering person one that stands in the middle of their stay.

        The middle stays put while the person moves to and fro, so that the side with space to pass does not change.
        """
        if not self._lingers(track):
            return track
        stay = self._stays_near.get(track.number)
        middle = track.position if stay is None else stay.middle
        return _standing_at(middle, track)

    def _note_stays(self, now_ns: int, odom_from_base: Pose2) -> None:
        if math.dist((self._stands_at.x, self._stands_at.y), (odom_from_base.x, odom_from_base.y)) > _NOWHERE:
            self._stands_at, self._stays_near = odom_from_base, {}
        before, self._stays_near = self._stays_near, {}
        for track in self._near(odom_from_base):
            stay = before.get(track.number, _Stay(now_ns, track.position))
            middle = stay.middle + _FOLLOWS * (track.position - stay.middle)
            self._stays_near[track.number] = replace(stay, middle=middle)

    def _gap(self, track: Track, odom_from_base: Pose2) -> float:
        """Return the distance [m] from the chair's footprint, grown by its margin, to the middle of a person."""
        return distance_to_body(track.position, odom_from_base, self._body) - self._margin


def _reach(track: Track) -> float:
    """Return how far [m] from its middle a person's body comes while the chair stops."""
    return track.radius + min(track.speed, _FASTEST) * _STOPPED_AFTER_S


_FASTEST = 1.5
"""m/s; people near a chair walk no faster, whatever a short track says."""

_BESIDE_CHAIR = 0.01
"""m from the outline to the reach of people that would cover the chair: too little for any way towards them, enough to leave."""

_STOPPED_AFTER_S = 0.6
"""s from somebody's turn until a chair that a hand drives at 0.3 m/s stands (measured: 0.55 s of it braking)."""


def _standing_at(position: FloatArray, track: Track) -> Track:
    """Return the track of a person that stands at a position (2,) [m], without uncertainty."""
    return replace(track, position=position, velocity=np.zeros(2), covariance=np.zeros((4, 4)))
