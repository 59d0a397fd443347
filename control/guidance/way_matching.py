"""The way of a storey's graph on which a chair is: matched from its poses, with hysteresis, and only to ways that join.

A way beyond a junction counts once the chair is half a metre along it: a rider who drives past a corner before turning has
not chosen yet. Direction is that of the chair's motion, so that a chair may drive backwards.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, replace

import numpy as np

from waychair.geometry import wrap_angle
from waychair.planning.building.guided_ways import StoreyWays
from waychair.types import FloatArray, Pose2

BEYOND_M = 0.5
"""m; a chair this far along a way has taken it (source system's editor: stops are half a metre apart at least)."""

SURELY_M = 1.0
"""m; so far along a way it counts however the chair stands on it."""

STANDS_ALONG = math.radians(50.0)
"""rad; a chair nearer than `SURELY_M` has taken a way only if it stands along it so well."""

LESS_BY = 0.2
"""m; another way must fit better by this."""

ACROSS_M = 0.8
"""m; a chair that moves across a way fits as badly as one so far beside it."""

PROPOSED_M = 0.3
"""m; the proposed way fits better by this: of two ways side by side, the rider is on the one that was told."""

SHORT_M = 1.0
"""m; beyond a way that is shorter, the next ones are looked at, too."""

LASTS_S = 0.1
"""s; a better way must fit better for so long."""

BACK_M = 0.6
"""m; a chair that has come back by this has turned back."""

COURSE_M = 0.25
"""m; the direction of motion is that of the last motion this long."""

OFF_M, OFF_S = 1.6, 1.0
"""m, s; a chair so far from all near ways for so long is looked for anew."""


@dataclass(frozen=True, slots=True)
class PlaceOnWay:
    """A chair on a way: from the junction behind it to that ahead, and how far from the former [m].

    `farthest` [m]: the farthest so far, None for a new way. `course` [rad]: the direction of motion since `anchor`.
    `pending` fits better since `since_ns`. `off_ns`: since when the chair is off all ways.
    """

    edge: tuple[int, int]
    along: float
    anchor: tuple[float, float]
    course: float | None = None
    farthest: float | None = None
    pending: tuple[int, int] | None = None
    since_ns: int = 0
    off_ns: int | None = None


def matched(
    track: PlaceOnWay | None,
    known: StoreyWays,
    pose: Pose2,
    now_ns: int,
    in_sight: Callable[[FloatArray, FloatArray], bool] = lambda one, other: True,
    proposed: Collection[tuple[int, int]] = (),
) -> PlaceOnWay:
    """Return the way on which a chair is now; `track` None: the nearest one in sight. `proposed` are the plan's ways."""
    if track is None:
        return _nearest(known, pose, in_sight)
    track = _with_course(track, pose)
    at = np.array([pose.x, pose.y])
    own = _score(known, track.edge, at, _course(track, pose))
    fits = own[0] - (PROPOSED_M if track.edge in proposed and own[1] < BEYOND_M else 0.0)
    best, least, away = track.edge, fits, own[1]
    for edge in _joined(known, track.edge):
        score, aside, _ = _score(known, edge, at, _course(track, pose))
        away = min(away, aside)
        if edge in proposed and aside < BEYOND_M and edge[0] != track.edge[0]:  # no other way that was not taken
            score -= PROPOSED_M
        if score < least:
            best, least = edge, score
    if away > OFF_M:
        since = track.off_ns or now_ns
        if (now_ns - since) * 1e-9 > OFF_S:
            found = _nearest(known, pose, in_sight)
            return replace(found, course=track.course, anchor=track.anchor)
        return replace(track, off_ns=since)
    track = replace(track, off_ns=None)
    if best != track.edge and least + LESS_BY < fits and _has_taken(known, best, at, pose):
        if track.pending != best:
            return replace(_went_on(track, own[2]), pending=best, since_ns=now_ns)
        if (now_ns - track.since_ns) * 1e-9 >= LASTS_S:
            return replace(track, edge=best, along=_score(known, best, at, None)[2], farthest=None, pending=None)
        return _went_on(track, own[2])
    length = _length(known, track.edge) if best in (track.edge, track.edge[::-1]) else 0.0
    return _went_on(replace(track, pending=None), own[2], length)


def _went_on(track: PlaceOnWay, along: float, length: float = 0.0) -> PlaceOnWay:
    """Return the track with the chair farther along its way; on its way back if `length` [m] of the way is given."""
    farthest = max(along, track.farthest if track.farthest is not None else along)
    if length and along < farthest - BACK_M:
        behind, ahead = track.edge
        return replace(track, edge=(ahead, behind), along=length - along, farthest=None)
    return replace(track, along=along, farthest=farthest)


def _with_course(track: PlaceOnWay, pose: Pose2) -> PlaceOnWay:
    dx, dy = pose.x - track.anchor[0], pose.y - track.anchor[1]
    if math.hypot(dx, dy) < COURSE_M:
        return track
    return replace(track, anchor=(pose.x, pose.y), course=math.atan2(dy, dx))


def _course(track: PlaceOnWay, pose: Pose2) -> float:
    return pose.theta if track.course is None else track.course


def _nearest(known: StoreyWays, pose: Pose2, in_sight: Callable[[FloatArray, FloatArray], bool]) -> PlaceOnWay:
    """Return the nearest way in sight; the nearest one if none is."""
    at = np.array([pose.x, pose.y])
    if not len(known.ways):
        return PlaceOnWay((0, 0), 0.0, (pose.x, pose.y))
    starts, ends = known.points[known.ways[:, 0]], known.points[known.ways[:, 1]]
    line = ends - starts
    square = np.maximum((line**2).sum(axis=1), 1e-12)
    share = np.clip(((at - starts) * line).sum(axis=1) / square, 0.0, 1.0)
    feet = starts + share[:, None] * line
    away = np.hypot(*(feet - at).T)
    order = np.argsort(away)
    chosen = next((k for k in order if in_sight(at, feet[k])), order[0])
    one, other = (int(each) for each in known.ways[chosen])
    along, length = float(share[chosen] * np.sqrt(square[chosen])), float(np.sqrt(square[chosen]))
    if math.cos(_heading(known, (one, other)) - pose.theta) < 0.0:
        one, other, along = other, one, length - along
    return PlaceOnWay((one, other), along, (pose.x, pose.y))


def _joined(known: StoreyWays, edge: tuple[int, int]) -> Iterator[tuple[int, int]]:
    """Yield the ways that lead on from both ends of a way, and from the far end of a short one."""
    for place, behind in (edge[::-1], edge):
        for onwards in known.junctions[place].ways:
            if onwards == behind:
                continue
            yield place, onwards
            if _length(known, (place, onwards)) < SHORT_M:
                for beyond in known.junctions[onwards].ways:
                    if beyond != place:
                        yield onwards, beyond


def _score(
    known: StoreyWays, edge: tuple[int, int], at: FloatArray, course: float | None
) -> tuple[float, float, float]:
    """Return how badly a chair fits a way [m], its distance from it [m], and how far along it is [m]."""
    (ax, ay), (bx, by) = known.points[edge[0]], known.points[edge[1]]
    dx, dy = float(bx - ax), float(by - ay)
    length = math.hypot(dx, dy) or 1e-9
    along = ((at[0] - ax) * dx + (at[1] - ay) * dy) / length
    nearest = min(max(along, 0.0), length)
    aside = math.hypot(at[0] - ax - nearest * dx / length, at[1] - ay - nearest * dy / length)
    across = 0.0 if course is None else ACROSS_M * abs(math.sin(course - math.atan2(dy, dx)))
    return float(aside + across), float(aside), float(nearest)


def _has_taken(known: StoreyWays, edge: tuple[int, int], at: FloatArray, pose: Pose2) -> bool:
    along, length = _score(known, edge, at, None)[2], _length(known, edge)
    if along < min(BEYOND_M, 0.9 * length):
        return False
    stands = abs(wrap_angle(pose.theta - _heading(known, edge)))
    return along >= min(SURELY_M, 0.9 * length) or min(stands, math.pi - stands) < STANDS_ALONG


def _length(known: StoreyWays, edge: tuple[int, int]) -> float:
    return math.dist(known.points[edge[0]], known.points[edge[1]])


def _heading(known: StoreyWays, edge: tuple[int, int]) -> float:
    dx, dy = known.points[edge[1]] - known.points[edge[0]]
    return math.atan2(dy, dx)
