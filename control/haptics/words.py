"""Advice in words, by an abbreviated and a full wording, for speech and for the page."""

from __future__ import annotations

import enum
from collections.abc import Mapping
from types import MappingProxyType

from waychair.control.behaviours.commands import WORDS, sector_of
from waychair.control.haptics.symbols import Advice, Symbol


class Wording(enum.Enum):
    """SHORT: a word or two, for a rider who knows the symbols. FULL: a sentence with the reason."""

    SHORT = "short"
    FULL = "full"


SHORT: Mapping[Symbol, str] = MappingProxyType(
    {
        Symbol.FORWARD: "forward",
        Symbol.BACK: "back",
        Symbol.SWIVEL_LEFT: "turn left",
        Symbol.SWIVEL_RIGHT: "turn right",
        Symbol.NUDGE_LEFT: "a bit left",
        Symbol.NUDGE_RIGHT: "a bit right",
        Symbol.WARNING: "stop",
        Symbol.ARRIVED: "arrived",
        Symbol.OBSTACLE_AT: "obstacle {where}",
        Symbol.ATTENTION: "attention",
    }
)
"""Abbreviated wording by symbol."""

FULL: Mapping[Symbol, str] = MappingProxyType(
    {
        Symbol.FORWARD: "drive straight ahead",
        Symbol.BACK: "drive straight back",
        Symbol.SWIVEL_LEFT: "turn left on the spot",
        Symbol.SWIVEL_RIGHT: "turn right on the spot",
        Symbol.NUDGE_LEFT: "push the stick to the left for a moment",
        Symbol.NUDGE_RIGHT: "push the stick to the right for a moment",
        Symbol.WARNING: "stop the chair",
        Symbol.ARRIVED: "you have arrived",
        Symbol.OBSTACLE_AT: "there is something {where}",
        Symbol.ATTENTION: "please listen",
    }
)
"""Full wording by symbol."""

PLACES = MappingProxyType(dict(zip(WORDS, ("ahead", *WORDS[1:4], "behind", *WORDS[5:]), strict=True)))
"""Places of obstacles by the words of the eight directions."""


def advice_words(advice: Advice, wording: Wording) -> str:
    """Return a piece of advice in words; the full wording ends with the reason, if there is one."""
    table = FULL if wording is Wording.FULL else SHORT
    text = table[advice.symbol].format(where=_place(advice, wording))
    return f"{text}: {advice.reason}" if wording is Wording.FULL and advice.reason else text


def _place(advice: Advice, wording: Wording) -> str:
    place = PLACES[WORDS[sector_of(advice.direction or 0.0)]]
    return f"on the {place}" if wording is Wording.FULL and place in ("left", "right") else place
