"""The movement to be told now, of those along a part of a plan, and whether it is spoken of: pure functions of the pose."""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass, replace

import numpy as np

from waychair.control.guidance.practice import AT_DECISIONS, BEFORE, HESITATES_S
from waychair.geometry import wrap_angle
from waychair.planning.building.guided_ways import StoreyPart
from waychair.planning.movements import TURNS, Movement, MovementKind
from waychair.types import Pose2

AGAIN_S = 4.0
"""s; nothing is said again within this time while nothing has changed."""

REMINDS_S = 8.0
"""s; from one reminder of a rider who rests to the next."""

NOW_M, SOON_M = 0.9, 3.0
"""m; before a turn it is told, and foretold."""

TURNED_M = 0.5
"""m; so far behind a corner its turn is over."""

ALIGNED, FACES_AWAY, FACES_WELL = math.radians(30.0), math.radians(75.0), math.radians(45.0)
"""rad; a chair this well aligned has turned; one that faces away from its way has to turn first, until it faces it well."""

ROUND_FROM = math.radians(140.0)
"""rad; a chair that faces away by this turns round."""

LOOK_AHEAD_M = 1.0
"""m; a chair should face the point of its way so far ahead."""

NEAR_M = 0.4
"""m; the direction to a nearer point tells nothing."""

ARRIVED_M = 0.6
"""m; a goal is reached within this of its node."""

AT_ONCE = frozenset(
    (
        *TURNS,
        MovementKind.WAIT,
        MovementKind.INTO_LIFT,
        MovementKind.PRESS,
        MovementKind.LEAVE_LIFT,
        MovementKind.ARRIVED,
    )
)
"""The movements that are decisions; the others are told in time before them."""

TAKES_TIME = (MovementKind.WAIT, MovementKind.PRESS)
"""Movements during which the chair rests, so that a rest is no hesitation."""


class Cue(enum.StrEnum):
    """When a movement is told: now, in time before, or again."""

    NOW = "now"
    SOON = "soon"
    AGAIN = "again"


@dataclass(frozen=True, slots=True)
class Speech:
    """What has been said: in which plan, the movement told last, that foretold last, and the prompts since the last place.

    `words`: movements that were said, each with its number in the plan and the time [ns].
    """

    plan: int = 0
    key: tuple[object, ...] = ()
    soon: tuple[object, ...] = ()
    words: tuple[tuple[Movement, int, int], ...] = ()
    prompts: int = 0


@dataclass(frozen=True, slots=True)
class Occasion:
    """An occasion to speak: of a plan's movement and its number there, `left` [m] before its end, at a level of prompting.

    `following`: the movement after it. `rests_s`: the chair rests so long.
    """

    plan: int
    number: int
    movement: Movement
    level: int
    left: float = math.inf
    following: Movement | None = None
    rests_s: float = 0.0

    @property
    def key(self) -> tuple[object, ...]:
        """What tells it from others; a turn is one, however it looks half done."""
        kind = self.movement.kind
        return self.plan, self.number, "turn" if kind in TURNS else kind, self.movement.lift


def spoken(speech: Speech, occasion: Occasion, now_ns: int) -> tuple[Speech, Cue | None]:
    """Return the speech after an occasion, and the cue to speak, None for silence."""
    movement, level, following = occasion.movement, occasion.level, occasion.following
    words = speech.words if speech.plan == occasion.plan else ()
    cue: Cue | None = None
    if occasion.key != speech.key and level >= (AT_DECISIONS if movement.kind in AT_ONCE else BEFORE):
        cue = Cue.NOW
    foretold = following is not None and following.kind in AT_ONCE and movement.kind not in AT_ONCE
    is_soon = occasion.left < SOON_M and movement.distance > SOON_M + 2.0 and speech.soon != occasion.key
    if foretold and is_soon and level >= BEFORE:
        cue, speech = Cue.SOON, replace(speech, soon=occasion.key)
    silent_s = (now_ns - max((at for *_, at in words), default=-(10**15))) * 1e-9
    rests = occasion.rests_s > HESITATES_S and movement.kind not in TAKES_TIME
    if cue is None and rests and silent_s > REMINDS_S and level >= AT_DECISIONS:
        cue = Cue.AGAIN
    is_next = cue is Cue.SOON and following is not None
    said, number = (following, occasion.number + 1) if is_next and following else (movement, occasion.number)
    if any(_alike(each, said) and k == number and (now_ns - at) * 1e-9 < AGAIN_S for each, k, at in words):
        cue = None
    if cue is not None:
        words = (*(each for each in words if (now_ns - each[2]) * 1e-9 < AGAIN_S + REMINDS_S), (said, number, now_ns))
    prompts = speech.prompts + (cue is not None)
    return replace(speech, plan=occasion.plan, key=occasion.key, words=words, prompts=prompts), cue


def _alike(one: Movement, other: Movement) -> bool:
    """Return whether two movements are told by the same words."""
    return replace(one, angle=0.0, start=None, end=None) == replace(other, angle=0.0, start=None, end=None)


def present(part: StoreyPart, first: int, at: float, pose: Pose2) -> int:
    """Return the index of the first movement from `first` on that is not over, for a chair `at` [m] along a part."""
    index = first
    while index < len(part.told) and _is_over(part, index, at, pose):
        index += 1
    return index


def _is_over(part: StoreyPart, index: int, at: float, pose: Pose2) -> bool:
    each = part.told[index]
    kind = each.movement.kind
    if kind is MovementKind.ARRIVED:
        return False
    if kind in TURNS:
        after = each.movement.end
        turned = after is not None and abs(wrap_angle(pose.theta - after.theta)) < ALIGNED
        return at > each.ends + TURNED_M or (turned and at > each.begins - TURNED_M)
    following = part.told[index + 1].movement.kind if index + 1 < len(part.told) else None
    return at >= each.ends - (NOW_M if following in TURNS else 0.0)


def turned_from(movement: Movement, pose: Pose2) -> Movement:
    """Return a turn as it is from the chair's own heading, which need not be that of the way to the corner."""
    if movement.kind not in TURNS or movement.start is None or movement.end is None:
        return movement
    if abs(wrap_angle(movement.start.theta - pose.theta)) < FACES_WELL:
        return movement
    angle = wrap_angle(movement.end.theta - pose.theta)
    return replace(movement, kind=_side(angle), angle=angle)


def _side(angle: float) -> MovementKind:
    if abs(angle) > ROUND_FROM:
        return MovementKind.TURN_ROUND
    return MovementKind.LEFT if angle > 0.0 else MovementKind.RIGHT


def turning(part: StoreyPart, index: int, at: float, pose: Pose2, before: MovementKind | None) -> MovementKind | None:
    """Return the turn that a chair needs first which faces away from its way; None if it does not."""
    bearing = bearing_to(part, at, pose)
    if index < len(part.told):
        told = part.told[index]
        start = told.movement.start
        if told.movement.kind in TURNS and start is not None:
            bearing = wrap_angle(start.theta - pose.theta) if told.begins - at > NEAR_M else 0.0
    if abs(bearing) < (FACES_AWAY if before is None else FACES_WELL):
        return None
    return MovementKind.TURN_ROUND if before is MovementKind.TURN_ROUND else _side(bearing)


def bearing_to(part: StoreyPart, at: float, pose: Pose2) -> float:
    """Return the direction [rad] of the way ahead from the chair's heading; 0 at its end."""
    if len(part.along) < 2:
        return 0.0
    target = min(at + LOOK_AHEAD_M, float(part.along[-1]))
    x, y = (float(np.interp(target, part.along, part.points[:, axis])) for axis in (0, 1))
    if math.hypot(x - pose.x, y - pose.y) < NEAR_M:  # the direction of the way itself
        k = min(max(int(np.searchsorted(part.along, target)), 1), len(part.along) - 1)
        dx, dy = part.points[k] - part.points[k - 1]
        return wrap_angle(math.atan2(dy, dx) - pose.theta)
    return wrap_angle(math.atan2(y - pose.y, x - pose.x) - pose.theta)


def nearest_along(part: StoreyPart, begins: float, ends: float, pose: Pose2) -> float:
    """Return how far along a part [m] its point between two others is that is nearest to the chair."""
    along = np.linspace(begins, min(ends, float(part.along[-1])), 21)
    x, y = (np.interp(along, part.along, part.points[:, axis]) for axis in (0, 1))
    return float(along[np.hypot(x - pose.x, y - pose.y).argmin()])


def reached(part: StoreyPart, pose: Pose2) -> bool:
    """Return whether the chair is at the end of a part."""
    x, y = part.points[-1]
    return math.hypot(x - pose.x, y - pose.y) < ARRIVED_M
