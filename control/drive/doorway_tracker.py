"""Doorways followed over a drive: found without a map in the views of the last metres, each kept under one identity.

A gap becomes a candidate. Each further view measures it again. It is offered when range bears it out
(`planning/seen/doorways.py`), keeps its number while the chair passes it and comes back, and is forgotten when views
from near refute it.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field

import numpy as np

from waychair.geometry import transform_points, wrap_angle
from waychair.planning.seen.door_leaf import Leaf, find_leaf
from waychair.planning.seen.doorway_gaps import FARTHEST, JambSight, find_gaps, measure_gap
from waychair.planning.seen.doorways import NARROWEST, NO_EVIDENCE, DoorState, Doorway, Evidence, judge
from waychair.planning.seen.range_views import RangeView
from waychair.planning.seen.swing_space import CELL, NO_SPACE, free_width, looked_at
from waychair.planning.seen.wall_lines import straight_stretches
from waychair.types import Cells, FloatArray, Pose2

WINDOW, MOST_VIEWS = 4.0, 24
"""m of path, and number of views, in which gaps are looked for: over longer paths odometry blurs them."""

STEP, TURN = 0.12, math.radians(12.0)
"""m, rad; a view counts if the sensor has moved or turned this far since the last: others tell nothing new."""

SEARCH_STEP, SEARCH_VIEWS = 0.3, 4
"""m, views; gaps are looked for again after this path, or after this many views."""

SAME, SAME_TURN = 0.40, math.radians(25.0)
"""m, rad; a gap this near to a doorway is the same, seen again or from the other side of its wall."""

RIVAL = 0.6
"""m; two openings one behind the other, nearer than this, are one passage: nobody builds two doors so close."""

CLOSE = 3.0
"""m; views from within this distance refute."""

REFUTING, OF_LAST = 6, 8
"""A doorway is forgotten when so many of its last views from near show none there."""

MOST_CANDIDATES = 60
"""Candidates kept at a time; the ones seen longest ago go first."""

STATE_VIEWS, STATE_BEAMS = 3, 3
"""The newest views tell the state: the middle one of three, each with at least three beams to the opening."""

SHUT = 0.7
"""Share of the beams to the opening that end in it when it is closed."""

SPACE_TURN = math.radians(2.5)
"""rad; a doorway's direction that changes by more moves the cells at its leaf's edge by about one."""

GLASS_ECHO = 0.20
"""m; an echo this near to the line, within the opening, is of a leaf or of glass."""


@dataclass
class _Track:
    """One gap that is followed: `pose` in odom, its evidence, and whether it was ever believed."""

    number: int
    pose: Pose2
    width: float
    error: float = math.inf
    strength: int = 0
    evidence: Evidence = NO_EVIDENCE
    offered: bool = False
    seen_at: float = 0.0
    refuted: deque[bool] = field(default_factory=lambda: deque(maxlen=OF_LAST))
    stopped: deque[float] = field(default_factory=lambda: deque(maxlen=STATE_VIEWS))
    leaf: Leaf | None = None
    glass: bool = False
    space: Cells = field(default_factory=NO_SPACE.copy)
    space_at: Pose2 | None = None


class DoorwayTracker:
    """The doorways near a drive. All views and poses are in one frame: odom, or a map."""

    def __init__(self) -> None:
        self._views: deque[tuple[float, RangeView, FloatArray]] = deque()
        self._tracks: list[_Track] = []
        self._path, self._searched, self._waiting = 0.0, -math.inf, 0
        self._pose: Pose2 | None = None
        self._count = 0

    @property
    def doorways(self) -> tuple[Doorway, ...]:
        """The doorways that range bears out, by their numbers."""
        return tuple(_doorway(track) for track in self._tracks if track.offered)

    def see(self, view: RangeView, sensor: Pose2) -> None:
        """Take in one view from the sensor's pose; views from where the last one was taken tell the state only."""
        for track in self._tracks:
            if math.hypot(track.pose.x - sensor.x, track.pose.y - sensor.y) < FARTHEST:
                _watch(track, view)
                at = track.pose.inverse() @ sensor
                if abs(at.x) < GLASS_ECHO and abs(at.y) < track.width / 2:
                    track.glass = False
        if self._pose is not None:
            moved = math.hypot(sensor.x - self._pose.x, sensor.y - self._pose.y)
            if moved < STEP and abs(wrap_angle(sensor.theta - self._pose.theta)) < TURN:
                return
            self._path += moved
        self._pose = sensor
        self._views.append((self._path, view, straight_stretches(view, FARTHEST)))
        while self._views[0][0] < self._path - WINDOW or len(self._views) > MOST_VIEWS:
            self._views.popleft()
        for track in self._tracks:
            if math.hypot(track.pose.x - sensor.x, track.pose.y - sensor.y) < FARTHEST:
                _measure(track, view)
        if any(sum(track.refuted) >= REFUTING for track in self._tracks):
            self._tracks = [track for track in self._tracks if sum(track.refuted) < REFUTING]
            while len(self._views) > OF_LAST:  # older views still show it
                self._views.popleft()
        self._waiting += 1
        if len(self._views) > 1 and (self._path >= self._searched + SEARCH_STEP or self._waiting >= SEARCH_VIEWS):
            self._searched, self._waiting = self._path, 0
            self._search()

    def hear(self, points: FloatArray) -> None:
        """Take in echoes of obstacles (N, 2) [m] from sonars: a lidar looks through glass, an echo within an opening
        says that something stands there. It counts until the chair itself has gone through."""
        for track in self._tracks:
            local = transform_points(track.pose.inverse(), points)
            inside = (np.abs(local[:, 0]) < GLASS_ECHO) & (np.abs(local[:, 1]) < track.width / 2 - GLASS_ECHO / 2)
            track.glass = track.glass or bool(inside.any())

    def _search(self) -> None:
        """Look for gaps in the window and judge the tracks that have one."""
        views = [view for _, view, _ in self._views]
        touched = []
        for gap in find_gaps(views, np.concatenate([stretches for _, _, stretches in self._views])):
            track = self._nearest(gap.pose)
            if track is None:
                track = _Track(self._count, gap.pose, gap.width)
                self._count += 1
                self._tracks.append(track)
                for view in views:
                    _measure(track, view)
            track.evidence = track.evidence.with_gap(gap)
            track.seen_at = self._path
            if track not in touched:
                touched.append(track)
        for track in touched:
            judged = judge(track.evidence, track.pose)
            track.pose, track.width, track.error = judged.pose, judged.width, judged.error
            track.strength, track.offered = judged.strength, not judged.doubt
        self._settle_rivals()
        candidates = sorted((t for t in self._tracks if not t.offered), key=lambda t: t.seen_at)
        for track in candidates[: max(0, len(candidates) - MOST_CANDIDATES)]:
            self._tracks.remove(track)

    def _settle_rivals(self) -> None:
        """Withdraw each doorway that shares its passage with a stronger one: a second line close behind, or askew."""
        offered = sorted((t for t in self._tracks if t.offered), key=lambda t: (-t.strength, t.number))
        kept: list[_Track] = []
        for track in offered:
            track.offered = not any(_same_passage(track, other) for other in kept)
            if track.offered:
                kept.append(track)

    def _nearest(self, pose: Pose2) -> _Track | None:
        best, least = None, SAME
        for track in self._tracks:
            apart = math.hypot(track.pose.x - pose.x, track.pose.y - pose.y)
            if apart < least and abs(math.remainder(track.pose.theta - pose.theta, math.pi)) < SAME_TURN:
                best, least = track, apart
        return best


def _same_passage(track: _Track, other: _Track) -> bool:
    """Return whether a doorway lies within, or closely before or behind, the opening of another."""
    at = other.pose.inverse() @ track.pose
    return abs(at.x) < RIVAL and abs(at.y) < (track.width + other.width) / 4


def _measure(track: _Track, view: RangeView) -> None:
    """Add one view's measurement to a track, and whether it refutes the track."""
    sight = measure_gap(view, track.pose, track.width)
    if sight is None:
        return
    track.evidence = track.evidence.with_sight(sight, track.pose)
    if math.hypot(*sight.seat) < CLOSE and abs(sight.seat[0]) > abs(sight.seat[1]):
        track.refuted.append(
            sight.through >= STATE_BEAMS and not math.isfinite(min(sight.right_doubt, sight.left_doubt))
        )


def _moved(first: Pose2, second: Pose2) -> bool:
    """Return whether a pose has changed by so much that cells seen from it no longer fit."""
    turned = abs(math.remainder(second.theta - first.theta, math.tau))
    return math.hypot(second.x - first.x, second.y - first.y) > CELL or turned > SPACE_TURN


def _watch(track: _Track, view: RangeView) -> None:
    """Note how far a track is open now: the share of beams that end in the opening, and its leaf."""
    if not track.offered:
        return
    sight: JambSight | None = measure_gap(view, track.pose, track.width)
    if sight is None or sight.through + sight.stopped < STATE_BEAMS:
        return
    track.stopped.append(sight.stopped / (sight.through + sight.stopped))
    if math.hypot(*sight.seat) > CLOSE:
        return
    if track.space_at is None or _moved(track.space_at, track.pose):
        track.space, track.space_at = NO_SPACE, track.pose
    track.space = looked_at(track.space, view, track.space_at)
    local = transform_points(track.pose.inverse(), view.ends[view.met])
    near = local[np.hypot(local[:, 0], local[:, 1]) < 2.0 * track.width]
    track.leaf = find_leaf(near, track.width)


def _doorway(track: _Track) -> Doorway:
    clear = free_width(track.space, track.width)
    state = DoorState.OPEN
    if track.glass or (track.stopped and float(np.median(track.stopped)) > SHUT):
        state, clear = DoorState.CLOSED, 0.0
    elif track.leaf is not None:
        clear = min(clear, track.leaf.clear(track.width))
        state = DoorState.AJAR if track.leaf.clear(track.width) < NARROWEST else DoorState.OPEN
    return Doorway(
        number=track.number,
        pose=track.pose,
        width=track.width,
        clear=clear,
        error=track.error,
        state=state,
        leaf=track.leaf,
        sights=len(track.evidence.sights),
    )
