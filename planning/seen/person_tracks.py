"""Tracking of people: Kalman tracks of lidar points that the map does not explain.

Clusters of points (`person_sightings`) are assigned to tracks by global nearest neighbour within a gate. Each track is a
Kalman filter of constant velocity with white noise acceleration (Bar-Shalom, Li and Kirubarajan, Estimation with
Applications to Tracking and Navigation, 2001, sections 6.2 and 6.3). A track is confirmed after enough sightings, and
dropped when it has not been seen for a while.

Somebody walks who is faster than the uncertainty of the speed and has left the first place by a step; slower people are
recognised by the distance they have walked. Either way the scan has to show that the place was changed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.config import Settings, setting
from waychair.errors import ConfigError
from waychair.geometry import rotation, transform_points
from waychair.planning.seen.person_sightings import (
    PEOPLE,
    SMALL_ROBOTS,
    MoverModel,
    ScanAround,
    has_changed_place,
    sightings,
)
from waychair.types import FloatArray, Pose2

MODELS: Mapping[str, MoverModel] = MappingProxyType({"people": PEOPLE, "robots": SMALL_ROBOTS})


@dataclass(frozen=True, slots=True)
class TrackSettings(Settings):
    """The kind of moving things among which the chair drives."""

    movers: str = setting("people", "", "kind of moving things to track: people, or robots (small discs)")

    def __post_init__(self) -> None:
        Settings.__post_init__(self)
        if self.movers not in MODELS:
            raise ConfigError(f"movers = '{self.movers}' is unknown; choose {' or '.join(MODELS)}")

    @property
    def model(self) -> MoverModel:
        """Sizes and motion of the movers."""
        return MODELS[self.movers]


DISPLACED_FROM_S, DISPLACED_WITHIN_S, STILL_WALKING_FROM_S = 1.5, 10.0, 0.5
"""[s] Shortest and longest time of a displacement that shows walking, and the shortest for a track that has walked."""

START_SPEED = 1.0
"""[m/s] Standard deviation of a new track's speed."""

SUDDEN, SUDDEN_GATE = 6.0, 3.2
"""[m/s^2] Standard deviation of the acceleration when somebody turns round or stops, and the squared Mahalanobis
distance of the innovation that shows it (80 % of two degrees of freedom)."""

GATE = 9.21
"""Squared Mahalanobis distance within which a cluster may be a track's: 99 % of two degrees of freedom."""

CONFIRMED_AFTER = 4
"""Number of sightings after which a track is confirmed."""

DROPPED_AFTER_S, RECENTLY_S = 0.8, 5.0
"""[s] A track unseen for the first is dropped; if it was walking, it counts as possibly near for the second."""

PAUSE_S = 2.0
"""[s] A person who stands for less is still walking."""


@dataclass(frozen=True, slots=True)
class Track:
    """A tracked person: position (2,) [m], velocity (2,) [m/s], and the covariance (4, 4) of x, y, vx, vy.

    `seen` counts the sightings, the last at `seen_ns`; the state is of `stamp_ns`. radius [m]. `moved_ns`: when it last
    certainly moved by itself, so that it is no furniture; None for never. `mark` (2,) [m] is its position at `mark_ns`,
    from which its displacement is measured, and `marked` the scan then, in the tracker's frame. `waits`: it stands where people
    wait, so that it counts as a person although nobody has seen it walk.
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
    marked: ScanAround | None = None
    waits: bool = False

    @property
    def is_person(self) -> bool:
        """Whether it counts as a person."""
        return self.has_walked or self.waits

    @property
    def has_walked(self) -> bool:
        """Whether it has ever certainly moved by itself."""
        return self.moved_ns is not None

    @property
    def is_walking(self) -> bool:
        """Whether it is walking, short pauses included."""
        return self.moved_within(PAUSE_S)

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


def tracks_at(tracks: Iterable[Track], now_ns: int) -> tuple[Track, ...]:
    """Return tracks of an older scan predicted to now: a beam is up to a tenth of a second old when it is used."""
    return tuple(
        replace(track, position=track.after(np.array([(now_ns - track.stamp_ns) * 1e-9]))[0], stamp_ns=now_ns)
        for track in tracks
    )


def transformed_tracks(frame_from_map: Pose2, tracks: Iterable[Track]) -> tuple[Track, ...]:
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

    def __init__(self, model: MoverModel = PEOPLE) -> None:
        import scipy.optimize  # noqa: F401 (loaded here, since loading takes longer than a tick)

        self._model = model
        self._tracks: tuple[Track, ...] = ()
        self._lost: tuple[Track, ...] = ()
        self._next = 1

    @property
    def recently_lost(self) -> tuple[Track, ...]:
        """People who walked and recently went out of sight, as last predicted."""
        return self._lost

    def update(self, stamp_ns: int, points: FloatArray, scan: ScanAround | None = None) -> tuple[Track, ...]:
        """Return the confirmed tracks after a scan with unexplained points (N, 2) [m]; without the scan nothing hides them."""
        model = self._model
        expected = tuple(predicted(track, stamp_ns, model.acceleration) for track in self._tracks)
        middles, shown = sightings(points, model, scan)
        taken = associate(expected, middles, model.sigma)
        kept: list[Track] = []
        for i, track in enumerate(expected):
            if i not in taken:
                if stamp_ns - track.seen_ns <= DROPPED_AFTER_S * 1e9:
                    kept.append(track)
                continue
            middle = middles[taken[i]]
            if shown[taken[i]] or track.has_walked:
                kept.append(_corrected(_after_turn(self._tracks[i], track, middle, model.sigma), middle, model, scan))
            else:  # its motion is to be shown from here on
                kept.append(_new_track(track.number, stamp_ns, middle, model, scan))
        for k in sorted(set(range(len(middles))) - set(taken.values())):
            # A cluster as near to a person as one leg to the other is no second person.
            if all(math.dist(track.position, middles[k]) > model.apart for track in kept):
                kept.append(_new_track(self._next, stamp_ns, middles[k], model, scan))
                self._next += 1
        gone = {track.number for track in self._tracks} - {track.number for track in kept}
        lost = (*self._lost, *(track for track in self._tracks if track.number in gone and track.is_walking))
        self._lost = tuple(track for track in lost if stamp_ns - track.seen_ns <= RECENTLY_S * 1e9)
        self._tracks = tuple(kept)
        return tuple(track for track in kept if track.seen >= CONFIRMED_AFTER)


def personal_space_points(
    tracks: Iterable[Track], room: Callable[[Track], float], pose: Pose2, body: ChairBody, spare: float
) -> FloatArray:
    """Return (N, 2) points on circles of `room` [m] around people, as obstacles.

    Where a circle would reach a chair at `pose`, it is reduced to the distance between them less `spare` [m], so that
    the chair can leave but come no nearer.
    """
    turns = np.linspace(0.0, math.tau, _ROUND, endpoint=False)
    circle = np.column_stack([np.cos(turns), np.sin(turns)])
    circles = [np.empty((0, 2))]
    for track in tracks:
        radius = min(room(track), distance_to_body(track.position, pose, body) - spare)
        if track.is_person and radius > 0.0:
            circles.append(track.position + radius * circle)
    return np.concatenate(circles)


def distance_to_body(point: FloatArray, pose: Pose2, body: ChairBody) -> float:
    """Return the distance [m] from a point (2,) to the outline of a chair, 0 within."""
    x, y = transform_points(pose.inverse(), point[None])[0]
    return math.hypot(max(x - body.front, -body.rear - x, 0.0), max(abs(y) - body.width / 2, 0.0))


def person_may_be_behind(tracks: Iterable[Track], now_ns: int, pose: Pose2, body: ChairBody, way: float) -> bool:
    """Return whether somebody may be behind a chair at `pose` within a distance [m], moving on as fast as last seen."""
    for track in tracks:
        if track.is_person:
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


def predicted(track: Track, stamp_ns: int, acceleration: float) -> Track:
    """Return the track predicted to a later time, with an acceleration [m/s^2] as white noise, one sigma."""
    from filterpy.kalman import predict

    dt = (stamp_ns - track.stamp_ns) * 1e-9
    move = np.eye(4)
    move[0, 2] = move[1, 3] = dt
    push = np.array([[dt**2 / 2, 0.0], [0.0, dt**2 / 2], [dt, 0.0], [0.0, dt]])
    state, covariance = predict(_state(track), track.covariance, move, acceleration**2 * push @ push.T)
    return _with_state(
        track=track, stamp_ns=stamp_ns, seen_ns=track.seen_ns, seen=track.seen, state=state, covariance=covariance
    )


def associate(tracks: tuple[Track, ...], middles: FloatArray, sigma: float) -> dict[int, int]:
    """Return the index of the cluster (K, 2) of each track: the least sum of Mahalanobis distances, within the gate."""
    from scipy.optimize import linear_sum_assignment

    if not tracks or not len(middles):
        return {}
    distances = np.empty((len(tracks), len(middles)))
    for i, track in enumerate(tracks):
        spread = np.linalg.inv(track.covariance[:2, :2] + sigma**2 * np.eye(2))
        off = middles - track.position
        distances[i] = np.einsum("ki,ij,kj->k", off, spread, off)
    # An assignment outside the gate costs more than any sum within.
    outside = distances > GATE
    rows, cols = linear_sum_assignment(np.where(outside, GATE * (min(distances.shape) + 1), distances))
    return {int(i): int(k) for i, k in zip(rows, cols, strict=True) if not outside[i, k]}


def _after_turn(before: Track, expected: Track, middle: FloatArray, sigma: float) -> Track:
    """Return the prediction; if the innovation shows that the person turned or stopped, with more acceleration noise.

    The filter of constant velocity alone would take half a second to follow.
    """
    off = middle - expected.position
    spread = expected.covariance[:2, :2] + sigma**2 * np.eye(2)
    if not before.has_walked or off @ np.linalg.solve(spread, off) < SUDDEN_GATE:
        return expected
    return predicted(before, expected.stamp_ns, SUDDEN)


def _corrected(track: Track, middle: FloatArray, model: MoverModel, scan: ScanAround | None) -> Track:
    from filterpy.kalman import update

    noise, sees = model.sigma**2 * np.eye(2), np.eye(2, 4)
    state, covariance = update(_state(track), track.covariance, middle, noise, sees)
    seen = _with_state(
        track=track,
        stamp_ns=track.stamp_ns,
        seen_ns=track.stamp_ns,
        seen=track.seen + 1,
        state=state,
        covariance=covariance,
    )
    if seen.seen < CONFIRMED_AFTER:
        return seen
    displaced = _is_displaced(seen, model)
    if track.has_walked:  # a person known to walk needs no further proof
        moves = displaced or seen.speed > model.walking
    else:
        displaced = (displaced or _is_fast(seen, model)) and _has_changed_place(seen, middle, scan)
        moves = displaced
    if displaced or seen.stamp_ns - seen.mark_ns > DISPLACED_WITHIN_S * 1e9:
        seen = replace(seen, mark=seen.position, mark_ns=seen.stamp_ns, marked=scan)
    return replace(seen, moved_ns=seen.stamp_ns if moves else track.moved_ns)


def _is_fast(track: Track, model: MoverModel) -> bool:
    """Return whether its speed is beyond doubt and it has left its mark; the middle of a thing may leap once by less."""
    return (
        track.speed > max(model.walking, 2.0 * track.speed_sigma)
        and math.dist(track.position, track.mark) > model.displacement
    )


def _has_changed_place(track: Track, middle: FloatArray, scan: ScanAround | None) -> bool:
    """Return whether the scans at its mark and now, at (2,) [m], show it at two places; without scans assume so."""
    if scan is None or track.marked is None:
        return True
    return has_changed_place(track.marked, track.mark, scan, middle)


def _is_displaced(track: Track, model: MoverModel) -> bool:
    """Return whether it has left its mark for longer than a leap of its middle lasts."""
    gone = track.position - track.mark
    distance = float(np.hypot(*gone))
    seconds = (track.stamp_ns - track.mark_ns) * 1e-9
    least, since = (
        (model.still_walking, STILL_WALKING_FROM_S) if track.has_walked else (model.displacement, DISPLACED_FROM_S)
    )
    if distance <= least or seconds < since:
        return False
    return float(track.velocity @ gone) / distance > 0.3 * distance / seconds


def _new_track(number: int, stamp_ns: int, middle: FloatArray, model: MoverModel, scan: ScanAround | None) -> Track:
    covariance = np.diag([model.sigma**2] * 2 + [START_SPEED**2] * 2)
    return Track(
        number=number,
        stamp_ns=stamp_ns,
        seen_ns=stamp_ns,
        seen=1,
        position=middle,
        velocity=np.zeros(2),
        covariance=covariance,
        radius=model.radius,
        mark=middle,
        mark_ns=stamp_ns,
        marked=scan,
    )


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
