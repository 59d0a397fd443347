"""The limits of touch, with their sources, and a checker that holds patterns to them: which limit, where, by how much.

Pairs of symbols are compared by an ideal observer of felt places: a place is felt with Gaussian noise of 0.7 of the spacing of
the motors, which is what places of a 3x3 array on the wrist are told apart by (Chen et al., EuroHaptics 2008: two places).
Durations are felt with a noise as well. The simulated driver (`simulation/`) has a finer model.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass

from waychair.control.haptics.patterns import STRENGTHS, Burst, Pattern, TouchVocabulary
from waychair.control.haptics.symbols import Symbol
from waychair.firmware_bridge.glove.layouts import TactorLayout


@dataclass(frozen=True, slots=True)
class TouchLimit:
    """A limit of touch: its value, its unit and its source."""

    name: str
    value: float
    unit: str
    source: str


BURST_SHORTEST = TouchLimit("shortest vibration", 50, "ms", "proposal: below it strength and place are felt badly")
BURST_LONGEST = TouchLimit("longest vibration", 500, "ms", "proposal: heat and nuisance; the board plays no longer one")
PATTERN_LONGEST = TouchLimit("longest pattern", 600, "ms", "proposal: the channel carries about one symbol a second")
NUDGE_LONGEST = TouchLimit("longest nudge", 300, "ms", "proposal: a nudge of the stick takes 0.3 s")
WARNING_LONGEST = TouchLimit("longest warning", 250, "ms", "proposal: more than four motors at once for at most 250 ms")
GAP_SHORTEST = TouchLimit(
    "shortest gap to the next pattern", 400, "ms", "Niwa et al., World Haptics 2009: 95 % right above 400 ms"
)
CIRCUIT_SHORTEST = TouchLimit(
    "shortest circuit", 400, "ms", "Niwa et al., World Haptics 2009: about 100 % right from 400 ms on"
)
AT_ONCE = TouchLimit(
    "motors at once, but for the warning",
    1,
    "motors",
    "Enriquez & MacLean 2008, Wang et al. 2018: a common onset masks; 27.8 % right with three",
)
STRENGTHS_MOST = TouchLimit("levels of strength", 4, "levels", "van Erp 2002")
SYMBOLS_MOST = TouchLimit(
    "symbols while driving", 9, "symbols", "proposal, after Jones et al. 2006-2009: 7 to 8 of 8 patterns at 99 %"
)
SPACING_SMALLEST = TouchLimit(
    "smallest spacing", 24, "mm", "Sofia & Jones 2013: waves are still felt 24 mm from a motor; van Erp 2005: 2-3 cm"
)
TOLD_APART = TouchLimit(
    "pair told apart", 90, "%", "proposal; felt place with a noise of 0.7 of the spacing (Chen et al. 2008)"
)

PLACE_NOISE = 0.7
"""Noise of a felt place, in spacings of the layout."""

RHYTHM = 0.25
"""Ratio of durations that is just told apart, as a logarithm: an assumption, on the safe side of Weber fractions of 0.1-0.2."""

NUDGES = (Symbol.NUDGE_LEFT, Symbol.NUDGE_RIGHT)
CIRCUITS = (Symbol.SWIVEL_LEFT, Symbol.SWIVEL_RIGHT)
AT_REST = (Symbol.ATTENTION,)
"""Symbols that are said at rest only, so that they need not be told from the others while driving."""


@dataclass(frozen=True, slots=True)
class Broken:
    """A limit that is broken: by which layout and symbol, and the value there."""

    limit: TouchLimit
    where: str
    value: float

    def sentence(self) -> str:
        """Return which limit is broken, where, by how much, and by which source."""
        unit = self.limit.unit
        over = abs(self.value - self.limit.value)
        return (
            f"{self.where}: {self.limit.name} is {self.limit.value:g} {unit}, here {self.value:g} {unit}, that is {over:g} "
            f"{unit} too {'much' if self.value > self.limit.value else 'little'} ({self.limit.source})"
        )


def broken_limits(words: TouchVocabulary) -> tuple[Broken, ...]:
    """Return all limits that the patterns of a layout break, in the order of the symbols."""
    name = words.layout.name
    found: list[Broken] = []
    if words.layout.spacing_mm < SPACING_SMALLEST.value:
        found.append(Broken(SPACING_SMALLEST, name, words.layout.spacing_mm))
    if (driving := len([symbol for symbol in Symbol if symbol not in AT_REST])) > SYMBOLS_MOST.value:
        found.append(Broken(SYMBOLS_MOST, name, driving))
    levels = len({burst.level for pattern in every_pattern(words) for burst in pattern.bursts})
    if levels > STRENGTHS_MOST.value or len(STRENGTHS) > STRENGTHS_MOST.value:
        found.append(Broken(STRENGTHS_MOST, name, levels))
    for pattern in every_pattern(words):
        found += _of_pattern(pattern, f"{name}: {pattern.symbol.value}")
    found += _pairs(words)
    return tuple(dict.fromkeys(found))


def every_pattern(words: TouchVocabulary) -> Iterator[Pattern]:
    """Yield the patterns of a layout, of obstacles one for each motor."""
    yield from words.patterns.values()
    yield from words.obstacles.values()


def _of_pattern(pattern: Pattern, where: str) -> Iterator[Broken]:
    warning = pattern.symbol is Symbol.WARNING
    for k, burst in enumerate(pattern.bursts):
        at = f"{where}, burst {k + 1}"
        if burst.on_ms < BURST_SHORTEST.value:
            yield Broken(BURST_SHORTEST, at, burst.on_ms)
        if burst.on_ms > BURST_LONGEST.value:
            yield Broken(BURST_LONGEST, at, burst.on_ms)
        if len(burst.tactors) > AT_ONCE.value and not warning:
            yield Broken(AT_ONCE, at, len(burst.tactors))
    longest = WARNING_LONGEST if warning else NUDGE_LONGEST if pattern.symbol in NUDGES else PATTERN_LONGEST
    if pattern.duration_ms > longest.value:
        yield Broken(longest, where, pattern.duration_ms)
    if pattern.gap_ms < GAP_SHORTEST.value:
        yield Broken(GAP_SHORTEST, where, pattern.gap_ms)
    if pattern.symbol in CIRCUITS and pattern.duration_ms < CIRCUIT_SHORTEST.value:
        yield Broken(CIRCUIT_SHORTEST, where, pattern.duration_ms)


def _pairs(words: TouchVocabulary) -> Iterator[Broken]:
    driving = [pattern for symbol, pattern in words.patterns.items() if symbol not in AT_REST]
    for first, second in itertools.combinations([*driving, *words.obstacles.values()], 2):
        if first.symbol is second.symbol:
            continue  # where an obstacle is, is felt roughly; that there is one, is the symbol
        told = round(100.0 * told_apart(first, second, words.layout), 1)
        if told < TOLD_APART.value:
            yield Broken(TOLD_APART, f"{words.layout.name}: {first.symbol.value} and {second.symbol.value}", told)


def told_apart(first: Pattern, second: Pattern, layout: TactorLayout) -> float:
    """Return how often an ideal observer of felt places tells two patterns apart, from 0.5 to 1.

    The bursts are compared in turn. A burst of one pattern that has no fellow is felt as a difference of a spacing and a
    half (an assumption); so is one motor against many, and another number of pulses with pauses between them.
    """
    unlike = 1.5 * layout.spacing_mm
    squares = 0.0
    for a, b in itertools.zip_longest(first.bursts, second.bursts):
        far = unlike if a is None or b is None else _between(a, b, layout, unlike)
        squares += far * far
    if _pulses(first) != _pulses(second):
        squares += unlike * unlike
    rhythm = math.log(first.duration_ms / second.duration_ms) / RHYTHM
    squares += (rhythm * PLACE_NOISE * layout.spacing_mm) ** 2
    deviation = math.sqrt(squares) / (2.0 * PLACE_NOISE * layout.spacing_mm)
    return 0.5 * (1.0 + math.erf(deviation / math.sqrt(2.0)))


def _pulses(pattern: Pattern) -> int:
    """Return the number of vibrations with pauses between them."""
    return 1 + sum(burst.off_ms >= BURST_SHORTEST.value for burst in pattern.bursts[:-1])


def _between(a: Burst, b: Burst, layout: TactorLayout, unlike: float) -> float:
    """Return how far apart two bursts are felt [mm]."""
    if (len(a.tactors) > 1) != (len(b.tactors) > 1):
        return unlike
    if len(a.tactors) > 1:
        return 0.0
    far = layout.skin_distance_mm(a.tactors[0], b.tactors[0])
    return min(far, 4.0 * layout.spacing_mm)
