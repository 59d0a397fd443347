"""The vocabulary of the glove as nine static points, for comparison: each symbol is one motor, and no motor moves on."""

from __future__ import annotations

from dataclasses import replace

from waychair.control.haptics.patterns import Burst, Pattern, TouchVocabulary, vocabulary
from waychair.control.haptics.symbols import Symbol

POINTS = {
    Symbol.NUDGE_LEFT: 0,
    Symbol.FORWARD: 1,
    Symbol.NUDGE_RIGHT: 2,
    Symbol.ATTENTION: 5,
    Symbol.SWIVEL_RIGHT: 8,
    Symbol.ARRIVED: 7,
    Symbol.SWIVEL_LEFT: 6,
    Symbol.BACK: 3,
}
"""The motor of each symbol on the 3x3 glove, round its edge; the warning stays that of all motors.

A point is mixed up with its neighbours, so those are neighbours of which one taken for the other does least: a nudge for "forward",
"attention" or "arrived" for a turn, but no turn for a nudge. Nothing is in the middle, which is mixed up with all.
"""

ON_MS, GAP_MS, LEVEL = 200, 400, 3


def static_points() -> TouchVocabulary:
    """Return the vocabulary."""
    shipped = vocabulary("glove_3x3")
    points = {symbol: Pattern(symbol, (Burst((motor,), LEVEL, ON_MS, GAP_MS),)) for symbol, motor in POINTS.items()}
    return replace(shipped, patterns={**shipped.patterns, **points})
