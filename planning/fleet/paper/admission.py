"""Which of several chairs enters a section first, by the paper's node.

The higher priority goes first. For equal ones the paper says three times that the node takes either at random ("half-half
chance"), and twice that time decides: "the latest/earliest", then "the latest wins". Random is the default here, the other
two are settings. On a section of two lanes chairs of opposite directions keep right and are admitted at once.
"""

from __future__ import annotations

import enum
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol


class Tie(enum.Enum):
    """The chair that goes first among chairs of equal priority."""

    HALF_HALF = "half-half"
    EARLIEST = "earliest"
    LATEST = "latest"


class Dice(Protocol):
    """A random stream, such as `random.Random`."""

    def randrange(self, stop: int, /) -> int:
        """Return an integer in [0, stop)."""


@dataclass(frozen=True, slots=True)
class Asking:
    """A chair that asks for a section, with its priority and the time [s] since which it has asked."""

    chair: int
    priority: int
    since_s: float


def first_to_go(asking: Sequence[Asking], tie: Tie, dice: Dice) -> Asking:
    """Return the chair that goes first; `asking` has at least one."""
    highest = max(each.priority for each in asking)
    equal = sorted((each for each in asking if each.priority == highest), key=lambda each: (each.since_s, each.chair))
    if tie is Tie.EARLIEST:
        return equal[0]
    if tie is Tie.LATEST:
        return equal[-1]
    return equal[dice.randrange(len(equal))]
