"""Doorways followed over a drive: found without a map in the views of the last metres, each kept under one identity.

A gap in a wall becomes a candidate. Each further view measures it again. It is validated when range bears it out
(`planning/seen/doorways.py`), keeps its number while the chair passes it and comes back, and is forgotten when views
from near refute it.

One update does a bounded share of the work, so that the tracker fits into a control tick: a search for gaps goes on over
several updates.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from waychair.geometry import transform_points, wrap_angle
from waychair.maps.depth.depth_scan import DepthScan
from waychair.planning.seen.door_leaf import Leaf, find_leaf
from waychair.planning.seen.doorway_gaps import FARTHEST, Gap, beams_at_gap, find_gaps, measure_gap
from waychair.planning.seen.doorways import NARROWEST, NO_EVIDENCE, DoorState, Doorway, GapEvidence, judge
from waychair.planning.seen.range_views import RangeView, view_from_depth, view_from_points, view_from_scan
from waychair.planning.seen.swing_space import CELL, NO_SPACE, free_width, looked_at
from waychair.planning.seen.wall_lines import straight_stretches
from waychair.types import Cells, FloatArray, Pose2, Scan

WINDOW, MOST_VIEWS = 4.0, 24
"""m of path, and number of views, in which gaps are looked for: over longer paths odometry blurs them."""

SEARCHED = 12
"""Views of the window that are searched, spread over it: more tell little and cost time."""

STEP, TURN = 0.12, math.radians(12.0)
"""m, rad; a view counts if the sensor has moved or turned this far since the last: others tell nothing new."""

SEARCH_STEP, SEARCH_VIEWS = 0.3, 4
"""m, views; gaps are looked for again after this path, or after this many views."""

SLICE = 6
"""Wall lines searched, or tracks judged, in one update."""

LEAP = 0.3
"""m; after a step this long between two updates the views are key scans and not a live sensor's: work in hand is done
at once."""

SAME, SAME_TURN = 0.40, math.radians(25.0)
"""m, rad; a gap this near to a doorway is the same, seen again or from the other side of its wall."""

RIVAL = 0.6
"""m; two openings one behind the other, nearer than this, are one passage: nobody builds two doors so close."""

OTHER_JAMB = 0.20
"""m; a gap with a jamb this far from those of a track is followed beside it: the one that more views measure wins."""

CLOSE = 3.0
"""m; views from within this distance refute."""

REFUTING, OF_LAST = 6, 8
"""A doorway is forgotten when so many of its last views from near show none there."""

MOST_CANDIDATES = 60
"""Candidates kept at a time; the ones seen longest ago go first."""

LASTING = 8.0
"""m of path after which a candidate that no view shows any more is not offered."""

STATE_VIEWS, STATE_BEAMS = 3, 3
"""The newest views tell the state: the middle one of three, each with at least three beams to the opening."""

SHUT = 0.7
"""Share of the beams to the opening that end in it when it is closed."""

SPACE_TURN = math.radians(2.5)
"""rad; a doorway's direction that changes by more moves the cells at its leaf's edge by about one."""

GLASS_ECHO = 0.25
"""m; an echo this near to the line, within the opening, is of a leaf or of glass."""

HEARD_WITHIN, HEARD_ASLANT = 1.1, math.radians(40.0)
"""m, rad; a sonar tells of a doorway this near and this straight before it: farther away its cone meets the jambs, and
glass farther aslant sends no echo back."""

ECHOES, OF_ECHOES = 2, 3
"""Of so many newest readings so many decide: another sonar's ping is heard now and then."""


@dataclass(eq=False)
class _Track:
    """One gap that is followed: `pose` in odom, its evidence, and the verdict on it.

    It is plausible if nothing speaks against it, and offered if no stronger one shares its passage. `number` is its
    identity, None before it is first offered.
    """

    pose: Pose2
    width: float
    number: int | None = None
    error: float = math.inf
    strength: int = 0
    evidence: GapEvidence = NO_EVIDENCE
    plausible: bool = False
    validated: bool = False
    offered: bool = False
    seen_at: float = 0.0
    seen_ns: int = 0
    refuted: deque[bool] = field(default_factory=lambda: deque(maxlen=OF_LAST))
    opening: _Opening = field(default_factory=lambda: _Opening())


@dataclass
class _Opening:
    """How far a track is open: the share of beams stopped in the newest views, whether the newest sonar readings tell of
    something in it, its leaf, and the floor seen free before and behind it from the pose `space_at`."""

    stopped: deque[float] = field(default_factory=lambda: deque(maxlen=STATE_VIEWS))
    leaf: Leaf | None = None
    echoes: deque[bool] = field(default_factory=lambda: deque(maxlen=OF_ECHOES))
    space: Cells = field(default_factory=NO_SPACE.copy)
    space_at: Pose2 | None = None


@dataclass(frozen=True, slots=True)
class _LastView:
    """Of one sensor: the pose of its last view, of the last one taken into the window, and the path [m] until there."""

    here: Pose2
    taken: Pose2
    path: float


class DoorwayTracker:
    """The doorways near a drive. All poses are in one frame: odom, or a map."""

    def __init__(self) -> None:
        self._views: deque[tuple[float, RangeView, FloatArray]] = deque()
        self._tracks: list[_Track] = []
        self._path, self._searched, self._waiting = 0.0, -math.inf, 0
        self._last: dict[str, _LastView] = {}
        self._work: Iterator[None] | None = None
        self._turn, self._hears = 0, False
        self._count = 0

    @property
    def doorways(self) -> tuple[Doorway, ...]:
        """The doorways and candidates that are offered, by their numbers."""
        offered = [track for track in self._tracks if track.offered and self._is_current(track)]
        return tuple(sorted((_doorway(track, self._hears) for track in offered), key=lambda door: door.number))

    def update(
        self, seen: Scan | DepthScan | FloatArray, sensor: Pose2, stamp_ns: int, source: str = "lidar"
    ) -> tuple[Doorway, ...]:
        """Return the doorways after one view more.

        Args:
            seen: a lidar's scan, a depth image's scan (its origin and points are in the frame of `sensor`), or the
                points (N, 2) [m] of surfaces in the frame of `sensor`, as a laser line gives them.
            sensor: the pose of the lidar, of the base, or of the points' frame, in odom or in a map.
            stamp_ns: the view's stamp.
            source: the sensor's name; each sensor's own steps count.
        """
        if isinstance(seen, Scan):
            view = view_from_scan(seen, sensor)
        else:
            view = view_from_depth(seen, sensor) if isinstance(seen, DepthScan) else view_from_points(seen, sensor)
        self.see(view, sensor, stamp_ns, source)
        return self.doorways

    def see(self, view: RangeView, sensor: Pose2, stamp_ns: int = 0, source: str = "lidar") -> None:
        """Take in one view from the sensor's pose; views from where its last one was taken tell the state only."""
        last = self._last.get(source)
        leapt = last is not None and math.hypot(sensor.x - last.here.x, sensor.y - last.here.y) > LEAP
        if leapt:
            self._finish()
        near = [track for track in self._tracks if _away(track, sensor) < FARTHEST]
        self._watch(near, view, sensor, stamp_ns)
        moved = math.inf if last is None else math.hypot(sensor.x - last.taken.x, sensor.y - last.taken.y)
        turned = 0.0 if last is None else abs(wrap_angle(sensor.theta - last.taken.theta))
        if last is not None and moved < STEP and turned < TURN:
            self._last[source] = _LastView(sensor, last.taken, last.path)
            self.work()
            return
        path = self._path if last is None else last.path + moved
        self._last[source] = _LastView(sensor, sensor, path)
        self._path = max(self._path, path)
        self._take(view, near, stamp_ns)
        if leapt:
            self._finish()
        else:
            self.work()

    def hear(self, sonars: FloatArray, ranges: FloatArray) -> None:
        """Take in ranges (K,) [m] of sonars at poses (K, 3) in the frame of the views; +inf where there was no echo.

        A lidar looks through glass. On a chair with sonars a doorway is open only after a sonar that faces it has heard
        nothing in it, and closed when one has.
        """
        self._hears = True
        for track in self._tracks:
            away = np.hypot(sonars[:, 0] - track.pose.x, sonars[:, 1] - track.pose.y)
            near = away <= HEARD_WITHIN + track.width / 2  # the others tell nothing
            for pose, heard in zip(sonars[near], ranges[near].astype(np.float64), strict=True):
                word = _heard(track, Pose2(*pose), float(heard))
                if word is not None:
                    track.opening.echoes.append(word)

    def _is_current(self, track: _Track) -> bool:
        return track.validated or self._path - track.seen_at < LASTING

    def _watch(self, near: list[_Track], view: RangeView, sensor: Pose2, stamp_ns: int) -> None:
        """Note the state of the validated tracks within reach; the space and the leaf of one of them, in turn."""
        shown = [track for track in near if track.validated and _note_stopped(track, view)]
        for track in shown:
            track.seen_ns = stamp_ns
        for track in near:
            at = track.pose.inverse() @ sensor
            if abs(at.x) < GLASS_ECHO and abs(at.y) < track.width / 2:
                track.opening.echoes.clear()
                track.opening.echoes.extend([False] * ECHOES)  # the chair itself went through
        close = [track for track in shown if _away(track, sensor) < CLOSE]
        if close:
            self._turn += 1
            turn = close[self._turn % len(close)]
            _note_space(turn, view)
            _note_leaf(turn, view)

    def _take(self, view: RangeView, near: list[_Track], stamp_ns: int) -> None:
        """Add a view to the window, measure the tracks near it, and begin a search when one is due."""
        self._views.append((self._path, view, straight_stretches(view, FARTHEST)))
        while self._views[0][0] < self._path - WINDOW or len(self._views) > MOST_VIEWS:
            self._views.popleft()
        for track in near:
            if _measure(track, view):
                track.seen_ns = stamp_ns
        if any(sum(track.refuted) >= REFUTING for track in near):
            self._tracks = [track for track in self._tracks if sum(track.refuted) < REFUTING]
            self._work = None
            while len(self._views) > OF_LAST:  # older views still show it
                self._views.popleft()
        self._waiting += 1
        due = self._path >= self._searched + SEARCH_STEP or self._waiting >= SEARCH_VIEWS
        if due and self._work is None and len(self._views) > 1:
            self._searched, self._waiting = self._path, 0
            self._work = self._search(stamp_ns)

    def work(self) -> None:
        """Do one tick's share of the search in hand; an update does it too, a tick without a view may call it."""
        for _ in range(SLICE):
            if self._work is not None and next(self._work, self) is self:
                self._work = None

    def _finish(self) -> None:
        while self._work is not None:
            self.work()

    def _search(self, stamp_ns: int) -> Iterator[None]:
        """Look for gaps in the window, line by line, and judge the tracks that have one, one by one."""
        window = list(self._views)
        views = [view for _, view, _ in window]
        chosen = np.unique(np.linspace(0, len(window) - 1, min(SEARCHED, len(window))).round().astype(np.int64))
        touched: list[_Track] = []
        found = find_gaps([views[k] for k in chosen], np.concatenate([window[k][2] for k in chosen]))
        for gaps in found:
            for gap in gaps:
                track = self._nearest(gap)
                if track is None:
                    track = _Track(gap.pose, gap.width)
                    self._tracks.append(track)
                    for view in views:
                        _measure(track, view)
                track.evidence = track.evidence.with_gap(gap)
                track.seen_at, track.seen_ns = self._path, stamp_ns
                if track not in touched:
                    touched.append(track)
            yield
        for track in touched:
            judged = judge(track.evidence, track.pose)
            track.pose, track.width, track.error = judged.pose, judged.width, judged.error
            track.strength, track.plausible = judged.strength, not judged.against
            track.offered = track.offered and track.plausible
            before, track.validated = track.validated, track.plausible and (track.validated or not judged.missing)
            if track.validated and not before:
                shown = [view for view in views[-STATE_VIEWS:] if _note_stopped(track, view)]
                for view in shown:
                    _note_space(track, view)
                for view in shown[-1:]:
                    _note_leaf(track, view)
            yield
        self._settle_rivals()
        candidates = sorted((t for t in self._tracks if not t.validated), key=lambda t: t.seen_at)
        for track in candidates[: max(0, len(candidates) - MOST_CANDIDATES)]:
            self._tracks.remove(track)

    def _settle_rivals(self) -> None:
        """Offer of the plausible tracks that share one passage the strongest only: others are a second line close behind,
        or jambs found wrongly at a slant. The passage keeps its number."""
        plausible = sorted((t for t in self._tracks if t.plausible), key=lambda t: (-t.validated, -t.strength))
        kept: list[_Track] = []
        for track in plausible:
            track.offered = not any(_same_passage(track, other) for other in kept)
            if track.offered:
                kept.append(track)
        for track in kept:
            same = [t for t in self._tracks if t.number is not None and not t.offered and _same_passage(t, track)]
            numbers = [t.number for t in (track, *same) if t.number is not None]
            for other in same:
                other.number = None
            track.number = min(numbers, default=self._count)
            self._count = max(self._count, track.number + 1)

    def _nearest(self, gap: Gap) -> _Track | None:
        """Return the track that a gap shows, None if it is new."""
        best, least = None, SAME
        for track in self._tracks:
            at = track.pose.inverse() @ gap.pose
            apart, turned = math.hypot(at.x, at.y), abs(math.remainder(at.theta, math.pi))
            jamb_off = abs(at.y) + abs(gap.width - track.width) / 2
            if apart < least and turned < SAME_TURN and jamb_off < OTHER_JAMB:
                best, least = track, apart
        return best


def _away(track: _Track, sensor: Pose2) -> float:
    return math.hypot(track.pose.x - sensor.x, track.pose.y - sensor.y)


def _same_passage(track: _Track, other: _Track) -> bool:
    """Return whether a doorway lies within, or closely before or behind, the opening of another."""
    at = other.pose.inverse() @ track.pose
    return abs(at.x) < RIVAL and abs(at.y) < (track.width + other.width) / 4


def _measure(track: _Track, view: RangeView) -> bool:
    """Add one view's measurement to a track, and whether it refutes the track. Return whether the view showed it."""
    sight = measure_gap(view, track.pose, track.width)
    if sight is None:
        return False
    track.evidence = track.evidence.with_sight(sight, track.pose)
    none_there = sight.through >= STATE_BEAMS and not math.isfinite(min(sight.right_doubt, sight.left_doubt))
    if math.hypot(*sight.seat) < CLOSE and abs(sight.seat[0]) > abs(sight.seat[1]):
        track.refuted.append(none_there)
    return not none_there


def _moved(first: Pose2, second: Pose2) -> bool:
    """Return whether a pose has changed by so much that cells seen from it no longer fit."""
    turned = abs(math.remainder(second.theta - first.theta, math.tau))
    return math.hypot(second.x - first.x, second.y - first.y) > CELL or turned > SPACE_TURN


def _note_stopped(track: _Track, view: RangeView) -> bool:
    """Note the share of a view's beams that end in the opening; return whether the view tells it."""
    through, stopped = beams_at_gap(view, track.pose, track.width)
    if through + stopped < STATE_BEAMS:
        return False
    track.opening.stopped.append(stopped / (through + stopped))
    return True


def _note_space(track: _Track, view: RangeView) -> None:
    """Note the floor seen free before and behind a track."""
    opening = track.opening
    if opening.space_at is None or _moved(opening.space_at, track.pose):
        opening.space, opening.space_at = NO_SPACE, track.pose
    opening.space = looked_at(opening.space, view, opening.space_at)


def _note_leaf(track: _Track, view: RangeView) -> None:
    """Note a track's leaf, as a view shows it."""
    local = transform_points(track.pose.inverse(), view.ends[view.met])
    near = local[np.hypot(local[:, 0], local[:, 1]) < 2.0 * track.width]
    track.opening.leaf = find_leaf(near, track.width)


def _heard(track: _Track, sonar: Pose2, heard: float) -> bool | None:
    """Return whether a sonar's reading tells of something in a track's opening; None if it tells nothing."""
    at = track.pose.inverse() @ sonar
    toward = -math.copysign(1.0, at.x) * math.cos(at.theta)
    if toward < math.cos(HEARD_ASLANT) or math.isnan(heard):
        return None
    away = abs(at.x) / toward
    inside = abs(at.y + away * math.sin(at.theta)) < track.width / 2 - GLASS_ECHO / 2
    if away > HEARD_WITHIN or not inside or heard < away - GLASS_ECHO:
        return None
    return heard < away + GLASS_ECHO


def _doorway(track: _Track, hears: bool) -> Doorway:
    """Return what is known of a track; `hears` tells that the chair has sonars."""
    opening = track.opening
    echoes = sum(opening.echoes)
    silent = len(opening.echoes) - echoes
    clear, state = free_width(opening.space, track.width), DoorState.OPEN
    if not track.validated or not opening.stopped:
        clear, state = 0.0, DoorState.UNKNOWN
    elif echoes >= ECHOES or float(np.median(opening.stopped)) > SHUT:
        clear, state = 0.0, DoorState.CLOSED
    elif opening.leaf is not None:
        clear = min(clear, opening.leaf.clear(track.width))
        state = DoorState.AJAR if opening.leaf.clear(track.width) < NARROWEST else DoorState.OPEN
    if state is DoorState.OPEN and hears and silent < ECHOES:
        clear, state = 0.0, DoorState.UNKNOWN
    return Doorway(
        number=-1 if track.number is None else track.number,
        pose=track.pose,
        width=track.width,
        clear=clear,
        error=track.error,
        state=state,
        leaf=opening.leaf,
        sights=len(track.evidence.sights),
        validated=track.validated,
        seen_ns=track.seen_ns,
    )
