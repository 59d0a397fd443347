"""Tracking of people: Kalman tracks of lidar points that the map does not explain.

Points that touch form a cluster, and slim clusters close together are the legs of one person. Clusters are assigned to
tracks by global nearest neighbour within a gate. Each track is a Kalman filter of constant velocity with white noise
acceleration (Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, sections
6.2 and 6.3). A track is confirmed after enough sightings, and dropped when it has not been seen for a while. People too
slow for the uncertainty of their speed are recognised by the distance they have walked.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np
from numba import njit
from scipy.optimize import linear_sum_assignment

from waychair.calibration.chair import ChairBody
from waychair.config import Settings, setting
from waychair.geometry import rotation, transform_points
from waychair.types import FloatArray, IntArray, Pose2


@dataclass(frozen=True, slots=True)
class TrackSettings(Settings):
    """Sizes of people, how they move, and when a track is confirmed."""

    touch: float = setting(0.15, "m", "points nearer than this are of one thing", low=0.02, high=2.0)
    leg: float = setting(0.22, "m", "a thing no wider than this may be one leg of two", low=0.02, high=1.0)
    link: float = setting(0.55, "m", "legs nearer than this are of one person", low=0.05, high=2.0)
    apart: float = setting(0.6, "m", "nothing new is born nearer to a track than this", low=0.05, high=2.0)
    least_points: int = setting(3, "", "of a cluster", low=1, high=1000)
    largest: float = setting(1.2, "m", "wider things are no person", low=0.2, high=10.0)
    radius: float = setting(0.3, "m", "of a person", low=0.05, high=1.0)
    room: float = setting(
        0.4, "m", "kept free round a person's middle, shoulders reach beyond legs", low=0.05, high=1.0
    )
    walking: float = setting(0.2, "m/s", "what has moved faster, beyond doubt, is a person", low=0.01, high=2.0)
    way: float = setting(0.3, "m", "what has made so much way, too, and still goes on", low=0.05, high=5.0)
    way_from: float = setting(1.5, "s", "... in no less than this", low=0.1, high=60.0)
    way_within: float = setting(10.0, "s", "... and no more", low=0.5, high=600.0)
    onwards: float = setting(0.15, "m", "way by which who is known to walk is still under way", low=0.02, high=5.0)
    onwards_from: float = setting(0.5, "s", "... in no less than this", low=0.1, high=60.0)
    acceleration: float = setting(1.0, "m/s^2", "of people, one sigma", low=0.01, high=10.0)
    sigma: float = setting(0.08, "m", "of a cluster's middle about the person's, legs swing", low=0.001, high=1.0)
    start_speed: float = setting(1.0, "m/s", "of one never seen before, one sigma", low=0.01, high=10.0)
    sudden: float = setting(6.0, "m/s^2", "of who turns round or stops, one sigma", low=0.01, high=10.0)
    surprise: float = setting(
        3.2, "", "squared Mahalanobis distance from which who walks has done so: 80 %", low=0.5, high=100.0
    )
    gate: float = setting(9.21, "", "squared Mahalanobis distance: 99 % of two degrees of freedom", low=1.0, high=100.0)
    believed_after: int = setting(4, "", "sightings", low=1, high=100)
    forgotten_after: float = setting(0.8, "s", "without being seen", low=0.05, high=60.0)
    pause: float = setting(2.0, "s", "who stands for less is still on the way", low=0.0, high=60.0)
    linger: float = setting(
        2.0, "s", "who goes to and fro for longer near a chair that gets nowhere waits for it", low=0.0, high=600.0
    )
    settles: float = setting(15.0, "s", "who stands for longer stays", low=0.0, high=600.0)
    lately: float = setting(5.0, "s", "who walked out of sight no longer ago may still be about", low=0.0, high=60.0)
    room_after: float = setting(
        0.3, "m", "as room, once the chair has stood for people to pass, and they have not", low=0.05, high=1.0
    )
    room_after_s: float = setting(1.5, "s", "... for so long; a chair's is its collision monitor's", low=0.0, high=20.0)


@dataclass(frozen=True, slots=True)
class Track:
    """A tracked person: position (2,) [m], velocity (2,) [m/s], and the covariance (4, 4) of x, y, vx, vy.

    `seen` counts the sightings, the last at `seen_ns`; the state is of `stamp_ns`. radius [m]. `moved_ns`: when it last
    certainly moved by itself, so that it is no furniture; None for never. `mark` (2,) [m] is its position at `mark_ns`,
    from which its displacement is measured.
    """

    number: int
    stamp_ns: int
    seen_ns: int
    seen: int
    position: FloatArray
    velocity: FloatArray
    covariance: FloatArray
    radius: float
    moved_ns: int | None = None
    mark: FloatArray = field(default_factory=lambda: np.zeros(2))
    mark_ns: int = 0

    @property
    def walked(self) -> bool:
        """Whether it has ever certainly moved by itself."""
        return self.moved_ns is not None

    def walks(self, settings: TrackSettings) -> bool:
        """Return whether it is walking, short pauses included."""
        return self.moved_within(settings.pause)

    def moved_within(self, seconds: float) -> bool:
        """Return whether it has moved by itself in the last so many seconds."""
        return self.moved_ns is not None and self.stamp_ns - self.moved_ns <= seconds * 1e9

    @property
    def speed(self) -> float:
        """Its speed [m/s]."""
        return float(np.hypot(*self.velocity))

    @property
    def speed_sigma(self) -> float:
        """Standard deviation of its speed [m/s]."""
        return math.sqrt(max(float(np.trace(self.covariance[2:, 2:])) / 2, 0.0))

    def after(self, seconds: FloatArray) -> FloatArray:
        """Return its predicted positions (T, 2) [m] after so many seconds (T,)."""
        return self.position + seconds[:, None] * self.velocity

    def row(self, seconds: float) -> FloatArray:
        """Return (6,): x, y [m] after so many seconds, vx, vy [m/s], radius [m] and its growth [m/s], one sigma."""
        return np.array([*(self.position + seconds * self.velocity), *self.velocity, self.radius, self.speed_sigma])


def moved_on(tracks: Iterable[Track], now_ns: int) -> tuple[Track, ...]:
    """Return tracks of an older scan predicted to now: a beam is up to a tenth of a second old when it is used."""
    return tuple(
        replace(track, position=track.after(np.array([(now_ns - track.stamp_ns) * 1e-9]))[0], stamp_ns=now_ns)
        for track in tracks
    )


def seen_from(frame_from_map: Pose2, tracks: Iterable[Track]) -> tuple[Track, ...]:
    """Return tracks transformed to another frame."""
    turn = rotation(frame_from_map.theta)
    both = np.kron(np.eye(2), turn)
    return tuple(
        replace(
            track,
            position=transform_points(frame_from_map, track.position[None])[0],
            velocity=turn @ track.velocity,
            covariance=both @ track.covariance @ both.T,
            mark=transform_points(frame_from_map, track.mark[None])[0],
        )
        for track in tracks
    )


class Tracker:
    """The tracks, updated from scan to scan in a frame without jumps."""

    def __init__(self, settings: TrackSettings | None = None) -> None:
        self._settings = settings or TrackSettings()
        self._tracks: tuple[Track, ...] = ()
        self._lost: tuple[Track, ...] = ()
        self._next = 1

    @property
    def lost(self) -> tuple[Track, ...]:
        """People who walked and recently went out of sight, as last predicted."""
        return self._lost

    def update(self, stamp_ns: int, points: FloatArray) -> tuple[Track, ...]:
        """Return the confirmed tracks after a scan with unexplained points (N, 2) [m]."""
        s = self._settings
        expected = tuple(predicted(track, stamp_ns, s) for track in self._tracks)
        middles = clusters(points, s)
        taken = associate(expected, middles, s)
        kept = [
            _corrected(_turned(self._tracks[i], track, middles[taken[i]], s), middles[taken[i]], s)
            if i in taken
            else track
            for i, track in enumerate(expected)
            if i in taken or stamp_ns - track.seen_ns <= s.forgotten_after * 1e9
        ]
        for k in sorted(set(range(len(middles))) - set(taken.values())):
            # A cluster as near to a person as one leg to the other is no second person.
            if all(math.dist(track.position, middles[k]) > s.apart for track in kept):
                kept.append(_born(self._next, stamp_ns, middles[k], s))
                self._next += 1
        gone = {track.number for track in self._tracks} - {track.number for track in kept}
        lost = (*self._lost, *(track for track in self._tracks if track.number in gone and track.walks(s)))
        self._lost = tuple(track for track in lost if stamp_ns - track.seen_ns <= s.lately * 1e9)
        self._tracks = tuple(kept)
        return tuple(track for track in kept if track.seen >= s.believed_after)


def room_round(tracks: Iterable[Track], room: float, pose: Pose2, body: ChairBody, spare: float) -> FloatArray:
    """Return (N, 2) points on circles of `room` [m] around people who move or have moved, as obstacles.

    Where a circle would reach a chair at `pose`, it is reduced to the distance between them less `spare` [m], so that
    the chair can leave but come no nearer.
    """
    turns = np.linspace(0.0, math.tau, _ROUND, endpoint=False)
    circle = np.column_stack([np.cos(turns), np.sin(turns)])
    circles = [np.empty((0, 2))]
    for track in tracks:
        radius = min(room, gap(track.position, pose, body) - spare)
        if track.walked and radius > 0.0:
            circles.append(track.position + radius * circle)
    return np.concatenate(circles)


def gap(point: FloatArray, pose: Pose2, body: ChairBody) -> float:
    """Return the distance [m] from a point (2,) to the outline of a chair, 0 within."""
    x, y = transform_points(pose.inverse(), point[None])[0]
    return math.hypot(max(x - body.front, -body.rear - x, 0.0), max(abs(y) - body.width / 2, 0.0))


def may_be_behind(tracks: Iterable[Track], now_ns: int, pose: Pose2, body: ChairBody, way: float) -> bool:
    """Return whether somebody may be behind a chair at `pose` within a distance [m], moving on as fast as last seen."""
    for track in tracks:
        if track.walked:
            unseen_s = (now_ns - track.seen_ns) * 1e-9
            reach = track.radius + min(max(track.speed, _SLOWEST) * unseen_s, _FARTHEST)
            x, y = transform_points(pose.inverse(), track.position[None])[0]
            beyond = max(x + body.rear, -body.rear - way - x, 0.0)
            if math.hypot(beyond, max(abs(y) - body.width / 2, 0.0)) < reach and x < 0.0:
                return True
    return False


_SLOWEST, _FARTHEST = 0.1, 1.0
"""Least speed [m/s] assumed for a person out of sight, and the farthest [m] that person may have got."""

_ROUND = 48
"""Points of a circle of personal space, 5 cm apart."""


def clusters(points: FloatArray, settings: TrackSettings) -> FloatArray:
    """Return (K, 2) middles [m] of the clusters or pairs of legs among points (N, 2) [m] that may be a person."""
    if len(points) == 0:
        return np.empty((0, 2))
    things = _linked(points, settings.touch)
    slim = np.array([np.hypot(*np.ptp(thing, axis=0)) <= settings.leg for thing in things])
    legs = [thing for thing, leg in zip(things, slim, strict=True) if leg]
    bodies = [thing for thing, leg in zip(things, slim, strict=True) if not leg]
    if legs:
        bodies += _linked(np.concatenate(legs), settings.link)
    middles = []
    for group in bodies:
        low, high = group.min(axis=0), group.max(axis=0)
        if len(group) >= settings.least_points and np.hypot(*(high - low)) <= settings.largest:
            middles.append((low + high) / 2)
    return np.array(middles).reshape(-1, 2)


def _linked(points: FloatArray, link: float) -> list[FloatArray]:
    """Return points (N, 2) [m] split into groups connected by steps of at most a link [m]."""
    labels = linked_groups(points, link)
    return [points[labels == label] for label in range(labels.max() + 1)]


@njit(cache=True)
def linked_groups(points: FloatArray, link: float) -> IntArray:
    """Return (N,) the group of each of points (N, 2) [m]; steps of at most a link [m] connect the points of a group.

    Groups are numbered in the order of their first points. All pairs are tested: a scan has few unexplained points.
    """
    labels = np.full(len(points), -1, np.int64)
    waiting = np.empty(len(points), np.int64)
    groups = 0
    for first in range(len(points)):
        if labels[first] >= 0:
            continue
        labels[first], waiting[0], count = groups, first, 1
        while count:
            count -= 1
            i = waiting[count]
            for j in range(len(points)):
                if labels[j] < 0:
                    dx, dy = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1]
                    if dx * dx + dy * dy <= link * link:
                        labels[j], waiting[count] = groups, j
                        count += 1
        groups += 1
    return labels


def predicted(track: Track, stamp_ns: int, settings: TrackSettings) -> Track:
    """Return the track predicted to a later time."""
    from filterpy.kalman import predict

    dt = (stamp_ns - track.stamp_ns) * 1e-9
    move = np.eye(4)
    move[0, 2] = move[1, 3] = dt
    push = np.array([[dt**2 / 2, 0.0], [0.0, dt**2 / 2], [dt, 0.0], [0.0, dt]])
    state, covariance = predict(_state(track), track.covariance, move, settings.acceleration**2 * push @ push.T)
    return _with_state(track, stamp_ns, track.seen_ns, track.seen, state, covariance)


def associate(tracks: tuple[Track, ...], middles: FloatArray, settings: TrackSettings) -> dict[int, int]:
    """Return the index of the cluster (K, 2) of each track: the least sum of Mahalanobis distances, within the gate."""
    if not tracks or not len(middles):
        return {}
    distances = np.empty((len(tracks), len(middles)))
    for i, track in enumerate(tracks):
        spread = np.linalg.inv(track.covariance[:2, :2] + settings.sigma**2 * np.eye(2))
        off = middles - track.position
        distances[i] = np.einsum("ki,ij,kj->k", off, spread, off)
    # An assignment outside the gate costs more than any sum within.
    outside = distances > settings.gate
    rows, cols = linear_sum_assignment(np.where(outside, settings.gate * (min(distances.shape) + 1), distances))
    return {int(i): int(k) for i, k in zip(rows, cols, strict=True) if not outside[i, k]}


def _turned(before: Track, expected: Track, middle: FloatArray, settings: TrackSettings) -> Track:
    """Return the prediction; if the innovation shows that the person turned or stopped, with more acceleration noise.

    The filter of constant velocity alone would take half a second to follow.
    """
    off = middle - expected.position
    spread = expected.covariance[:2, :2] + settings.sigma**2 * np.eye(2)
    if not before.walked or off @ np.linalg.solve(spread, off) < settings.surprise:
        return expected
    return predicted(before, expected.stamp_ns, replace(settings, acceleration=settings.sudden))


def _corrected(track: Track, middle: FloatArray, settings: TrackSettings) -> Track:
    from filterpy.kalman import update

    noise, sees = settings.sigma**2 * np.eye(2), np.eye(2, 4)
    state, covariance = update(_state(track), track.covariance, middle, noise, sees)
    seen = _with_state(track, track.stamp_ns, track.stamp_ns, track.seen + 1, state, covariance)
    if seen.seen < settings.believed_after:
        return replace(seen, mark=seen.position, mark_ns=seen.stamp_ns)
    # a person known to walk needs no further proof
    doubt = 0.0 if track.walked else 2.0 * seen.speed_sigma
    made_way = _made_way(seen, settings)
    if made_way or seen.stamp_ns - seen.mark_ns > settings.way_within * 1e9:
        seen = replace(seen, mark=seen.position, mark_ns=seen.stamp_ns)
    moves = made_way or seen.speed > max(settings.walking, doubt)
    return replace(seen, moved_ns=seen.stamp_ns if moves else track.moved_ns)


def _made_way(track: Track, settings: TrackSettings) -> bool:
    """Return whether it has truly left its mark, and not only shows another side or part of itself."""
    gone = track.position - track.mark
    way = float(np.hypot(*gone))
    seconds = (track.stamp_ns - track.mark_ns) * 1e-9
    least, since = (settings.onwards, settings.onwards_from) if track.walked else (settings.way, settings.way_from)
    if way <= least or seconds < since:
        return False
    return float(track.velocity @ gone) / way > 0.3 * way / seconds


def _born(number: int, stamp_ns: int, middle: FloatArray, settings: TrackSettings) -> Track:
    covariance = np.diag([settings.sigma**2] * 2 + [settings.start_speed**2] * 2)
    return Track(number, stamp_ns, stamp_ns, 1, middle, np.zeros(2), covariance, settings.radius)


def _state(track: Track) -> FloatArray:
    return np.concatenate([track.position, track.velocity])


def _with_state(
    track: Track, stamp_ns: int, seen_ns: int, seen: int, state: FloatArray, covariance: FloatArray
) -> Track:
    return replace(
        track,
        stamp_ns=stamp_ns,
        seen_ns=seen_ns,
        seen=seen,
        position=state[:2],
        velocity=state[2:],
        covariance=covariance,
    )
