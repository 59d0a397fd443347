"""A rider's practice: decisions at places, and levels of prompting that fall with right ones and rise after an error.

Guidance that fades helped learners to drive (Marchal-Crespo et al. 2010); the steps are this program's.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass

from waychair.planning.movements import MovementKind

NO_PROMPT, AT_DECISIONS, BEFORE, STEERS = 0, 1, 2, 3
"""The levels: none, at decisions, also in time before, and the chair offers to drive."""

LEVELS = ("no prompts", "at decisions", "also in time before", "the chair drives on request")
"""Their names."""

RIGHT_IN_A_ROW = 3
"""Right decisions at a place after which its level falls by one."""

HESITATES_S = 4.0
"""s; a rider who rests so long before the goal hesitates, and is told again."""


class RiderDecision(enum.StrEnum):
    """What a rider did at a place."""

    FOLLOWED = "followed"
    OTHER = "other"
    HESITATED = "hesitated"
    TURNED_BACK = "turned back"


@dataclass(frozen=True, slots=True)
class Practice:
    """A rider's practice at a place: the level of prompting there, and the right decisions in a row."""

    level: int
    right: int = 0


@dataclass(frozen=True, slots=True)
class DecisionMade:
    """A decision at a place, for the rider's own record: proposed and done, the rest before it [s], and its prompts."""

    place: str
    proposed: MovementKind
    decision: RiderDecision
    hesitation_s: float
    prompts: int


def practised(known: Practice, made: DecisionMade) -> Practice:
    """Return the practice at a place after a decision there."""
    if made.decision in (RiderDecision.OTHER, RiderDecision.TURNED_BACK):
        return Practice(min(known.level + 1, BEFORE))
    if made.decision is RiderDecision.HESITATED or made.hesitation_s > HESITATES_S:
        return Practice(known.level)
    if known.right + 1 >= RIGHT_IN_A_ROW:
        return Practice(max(known.level - 1, NO_PROMPT))
    return Practice(known.level, known.right + 1)
