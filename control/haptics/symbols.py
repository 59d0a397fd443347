"""The symbols that a driver without sight is told, and one piece of advice.

A symbol is the same for touch, speech, tones and text. `PRIORITY` is the priority of the board's PLAY: a higher one interrupts.
"""

from __future__ import annotations

import enum
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType


class Symbol(enum.Enum):
    """The vocabulary. `OBSTACLE_AT` has a direction; `ATTENTION` is said at rest only, before a question or a notice."""

    FORWARD = "forward"
    BACK = "back"
    SWIVEL_LEFT = "swivel_left"
    SWIVEL_RIGHT = "swivel_right"
    NUDGE_LEFT = "nudge_left"
    NUDGE_RIGHT = "nudge_right"
    WARNING = "warning"
    ARRIVED = "arrived"
    OBSTACLE_AT = "obstacle_at"
    ATTENTION = "attention"


PRIORITY: Mapping[Symbol, int] = MappingProxyType(
    {
        Symbol.WARNING: 200,
        Symbol.FORWARD: 100,
        Symbol.BACK: 100,
        Symbol.SWIVEL_LEFT: 100,
        Symbol.SWIVEL_RIGHT: 100,
        Symbol.NUDGE_LEFT: 100,
        Symbol.NUDGE_RIGHT: 100,
        Symbol.ARRIVED: 100,
        Symbol.ATTENTION: 60,
        Symbol.OBSTACLE_AT: 20,
    }
)
"""Priorities by symbol: the warning interrupts all others; obstacles are told when nothing else is."""


@dataclass(frozen=True, slots=True)
class Advice:
    """One piece of advice that now holds.

    `number` identifies it: the same number in later ticks is the same advice, which is not said again unless the rider
    ignores it; a second nudge needs a new number. Advice that has not begun by `valid_until_ns` is dropped: late advice
    is worse than none. `direction` [rad] is of OBSTACLE_AT, to the left of straight ahead. `reason` is for text and log.
    `spoken`: its reason is spoken anyway, so that the voice says nothing else.
    """

    symbol: Symbol
    number: int
    valid_until_ns: int
    direction: float | None = None
    reason: str = ""
    spoken: bool = False
