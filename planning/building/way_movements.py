"""The movements along the junctions of one storey, with landmarks: straight to the second door on the left, turn left.

The graph bends where it likes; people are told turns. The line through the junctions is first simplified, so that small bends
and jogs are none, and each movement is an interval of the way along it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from waychair.geometry import wrap_angle
from waychair.planning.movements import Movement, MovementKind
from waychair.types import FloatArray, Pose2

BEND_M = 0.35
"""m; a line that leaves the straight by less than this does not bend."""

TURN_FROM, ROUND_FROM = math.radians(40.0), math.radians(140.0)
"""rad; smaller changes of heading are no turn, larger ones turn the chair round."""

ONE_TURN_M = 1.2
"""m; turns so near to each other are one."""

DOOR_FROM_M, DOOR_TO_M = 1.5, 0.5
"""m before and behind a door: the movement through it."""

SAME_DOOR_M = 1.0
"""m; doors on the way so near to each other are one: the graph tells both its sides."""

WORTH_M = 0.8
"""m; a shorter straight part before a turn or a door is not told."""

TO_DOOR_M = 2.5
"""m; a way to the side leads to a door if one is so near."""

_ORDINALS = ("next", "second", "third", "fourth", "fifth")


@dataclass(frozen=True, slots=True)
class ToldMovement:
    """A movement on a part of a plan: where it begins and ends [m along the part], and the junction that it is about."""

    movement: Movement
    begins: float
    ends: float
    junction: int


class _Junction(Protocol):
    @property
    def ways(self) -> tuple[int, ...]: ...


class _Ways(Protocol):
    """The part of `StoreyWays` that is needed here."""

    @property
    def junctions(self) -> Sequence[_Junction]: ...
    @property
    def points(self) -> FloatArray: ...
    def has_door(self, one: int, other: int) -> bool: ...
    def passes_door(self, before: int, here: int, after: int) -> bool: ...


@dataclass(frozen=True, slots=True)
class _Mark:
    """A turn or a door [m along], the index of its junction on the part, and the turn's angle [rad], 0 for a door."""

    at: float
    index: int
    angle: float


def told_along(
    ways: _Ways, passed: Sequence[int], points: FloatArray, along: FloatArray, end: str, *, is_lift: bool
) -> tuple[ToldMovement, ...]:
    """Return the movements along junctions.

    Args:
        ways: the storey's.
        passed: (K,) the junctions.
        points: (K, 2) [m].
        along: (K,) [m] from the first one.
        end: the name of the goal or lift at the end.
        is_lift: a lift is at the end.
    """
    if not passed:
        return ()
    if len(passed) == 1:
        return () if is_lift else (_arrived(points, along, passed, 0.0),)
    corners = _simplified(points)
    turns = _turns(points, along, corners)
    doors = _doors(ways, passed, along)
    told: list[ToldMovement] = []
    done = 0.0
    for mark in sorted([*turns, *doors], key=lambda each: each.at):
        is_turn = mark.angle != 0.0
        until = mark.at if is_turn else max(done, mark.at - DOOR_FROM_M)
        if until - done > WORTH_M:
            landmark = _landmark(ways, passed, points, along, corners, done, mark) if is_turn else "to the door"
            told.append(_straight(points, along, corners, done, until, landmark, passed[mark.index]))
        here = _pose_at(points, along, corners, mark.at)
        if is_turn:
            kind = MovementKind.LEFT if mark.angle > 0.0 else MovementKind.RIGHT
            kind = MovementKind.TURN_ROUND if abs(mark.angle) > ROUND_FROM else kind
            after = Pose2(here.x, here.y, wrap_angle(here.theta + mark.angle))
            movement = Movement(kind, start=here, end=after, angle=mark.angle)
            told.append(ToldMovement(movement, mark.at, mark.at, passed[mark.index]))
            done = max(done, mark.at)
        else:
            following = next((each.at for each in turns if each.at > mark.at), math.inf)
            begins, ends = until, max(until, min(mark.at + DOOR_TO_M, float(along[-1]), following))
            start = _pose_at(points, along, corners, begins)
            movement = Movement(MovementKind.DOOR, distance=ends - begins, start=start, end=here)
            told.append(ToldMovement(movement, begins, ends, passed[mark.index]))
            done = ends
    if float(along[-1]) - done > 0.05:
        told.append(_straight(points, along, corners, done, float(along[-1]), f"to {end}", passed[-1]))
    if not is_lift:
        told.append(_arrived(points, along, passed, float(along[-1])))
    return tuple(told)


def _arrived(points: FloatArray, along: FloatArray, passed: Sequence[int], at: float) -> ToldMovement:
    x, y = points[-1]
    pose = Pose2(float(x), float(y), 0.0)
    return ToldMovement(Movement(MovementKind.ARRIVED, start=pose, end=pose), at, at, passed[-1])


def _straight(
    points: FloatArray, along: FloatArray, corners: list[int], begins: float, ends: float, landmark: str, junction: int
) -> ToldMovement:
    start, end = (_pose_at(points, along, corners, at) for at in (begins + 1e-6, ends))
    movement = Movement(MovementKind.STRAIGHT, distance=ends - begins, start=start, end=end, landmark=landmark)
    return ToldMovement(movement, begins, ends, junction)


def _simplified(points: FloatArray) -> list[int]:
    """Return the indices of a line's corners (Douglas and Peucker 1973), its ends among them."""
    kept, open_ = {0, len(points) - 1}, [(0, len(points) - 1)]
    while open_:
        first, last = open_.pop()
        if last - first < 2:
            continue
        line = points[last] - points[first]
        length = float(np.hypot(*line))
        inner = points[first + 1 : last] - points[first]
        if length < 1e-6:
            away = np.hypot(*inner.T)
        else:
            share = np.clip(inner @ line / length**2, 0.0, 1.0)
            away = np.hypot(*(inner - share[:, None] * line).T)
        farthest = int(away.argmax())
        if away[farthest] > BEND_M:
            kept.add(first + 1 + farthest)
            open_ += [(first, first + 1 + farthest), (first + 1 + farthest, last)]
    return sorted(kept)


def _turns(points: FloatArray, along: FloatArray, corners: list[int]) -> list[_Mark]:
    """Return the turns of a line: corners, of which near ones count as one."""
    found: list[_Mark] = []
    for before, here, after in zip(corners, corners[1:], corners[2:], strict=False):
        change = wrap_angle(_heading(points, here, after) - _heading(points, before, here))
        last = found[-1] if found else None
        if last is not None and along[here] - last.at < ONE_TURN_M:
            found[-1] = replace(last, angle=last.angle + change)
        else:
            found.append(_Mark(float(along[here]), here, change))
    return [each for each in found if abs(each.angle) > TURN_FROM]


def _doors(ways: _Ways, passed: Sequence[int], along: FloatArray) -> list[_Mark]:
    found: list[_Mark] = []
    for k, junction in enumerate(passed):
        inner = 0 < k < len(passed) - 1
        places = [float(along[k])] if inner and ways.passes_door(passed[k - 1], junction, passed[k + 1]) else []
        if k + 1 < len(passed) and ways.has_door(junction, passed[k + 1]):
            places.append(float(along[k] + along[k + 1]) / 2)
        found += [_Mark(at, k, 0.0) for at in places if not found or at - found[-1].at > SAME_DOOR_M]
    return found


def _heading(points: FloatArray, one: int, other: int) -> float:
    dx, dy = points[other] - points[one]
    return math.atan2(dy, dx)


def _pose_at(points: FloatArray, along: FloatArray, corners: list[int], at: float) -> Pose2:
    """Return the point of the line at a distance [m], with the heading of the simplified line before it."""
    k = min(max(int(np.searchsorted(along[corners], at)), 1), len(corners) - 1)
    x = float(np.interp(at, along, points[:, 0]))
    y = float(np.interp(at, along, points[:, 1]))
    return Pose2(x, y, _heading(points, corners[k - 1], corners[k]))


def _landmark(
    ways: _Ways,
    passed: Sequence[int],
    points: FloatArray,
    along: FloatArray,
    corners: list[int],
    begins: float,
    turn: _Mark,
) -> str:
    """Return where a straight part ends that a turn follows: the how manyth door, or way, on that side."""
    if abs(turn.angle) > ROUND_FROM:
        return ""
    side, word = math.copysign(1.0, turn.angle), "left" if turn.angle > 0.0 else "right"
    corner = turn.index
    to_door = _leads_to_door(ways, passed[corner - 1], passed[corner], passed[corner + 1])
    count = 1
    for k in range(1, turn.index):
        if not begins + 0.3 < along[k] < along[turn.index] - 0.3:
            continue
        heading = _pose_at(points, along, corners, float(along[k])).theta
        for other in ways.junctions[passed[k]].ways:
            if other in (passed[k - 1], passed[k + 1]):
                continue
            dx, dy = ways.points[other] - ways.points[passed[k]]
            away = wrap_angle(math.atan2(dy, dx) - heading) * side
            if TURN_FROM < away < ROUND_FROM and _leads_to_door(ways, passed[k - 1], passed[k], other) == to_door:
                count += 1
    if not to_door and _ends_there(ways, passed[turn.index], _pose_at(points, along, corners, turn.at).theta):
        return f"to the end, then {word}"
    if count > len(_ORDINALS):
        return ""
    return f"to the {_ORDINALS[count - 1]} {'door' if to_door else 'way'} on the {word}"


def _leads_to_door(ways: _Ways, came: int, junction: int, towards: int) -> bool:
    """Return whether a way leads to a door, for those who come from `came`, before it branches or turns out to be long."""
    before, here, after, driven = came, junction, towards, 0.0
    while driven <= TO_DOOR_M:
        if ways.passes_door(before, here, after) or ways.has_door(here, after):
            return True
        driven += math.dist(ways.points[here], ways.points[after])
        onwards = [each for each in ways.junctions[after].ways if each != here]
        if len(onwards) != 1:
            return False
        before, here, after = here, after, onwards[0]
    return False


def _ends_there(ways: _Ways, junction: int, heading: float) -> bool:
    """Return whether no way goes on straight at a junction."""
    for other in ways.junctions[junction].ways:
        dx, dy = ways.points[other] - ways.points[junction]
        if abs(wrap_angle(math.atan2(dy, dx) - heading)) < TURN_FROM:
            return False
    return True
