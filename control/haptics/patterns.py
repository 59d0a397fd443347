"""Patterns of vibration: which motors of a layout play a symbol, how long and how strongly. Their data: `patterns.yaml`.

Motors are numbered as in the layout; a rider's fitting (`waychair.firmware_bridge.glove.fitting`) turns them into the board's
outputs.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from waychair.control.haptics.symbols import Advice, Symbol
from waychair.errors import GloveError, PatternError
from waychair.firmware_bridge.glove.layouts import TactorLayout, layout_named
from waychair.firmware_bridge.glove.messages import STEPS_MAX, PlayStep
from waychair.yaml_files import load_yaml

PATTERNS_FILE = Path(__file__).with_name("patterns.yaml")

STRENGTHS = (90, 140, 195, 255)
"""Drive of the four levels of strength, of 255: a person tells at most four apart (van Erp 2002)."""

AT = "at"
"""The motor towards the obstacle, in a sequence of `obstacle_at`."""


@dataclass(frozen=True, slots=True)
class Burst:
    """Motors of the layout that vibrate at once, at a level of strength, and the rest after it."""

    tactors: tuple[int, ...]
    level: int
    on_ms: int
    off_ms: int


@dataclass(frozen=True, slots=True)
class Pattern:
    """Bursts in turn; the last one's `off_ms` is the gap to the next pattern."""

    symbol: Symbol
    bursts: tuple[Burst, ...]

    @property
    def duration_ms(self) -> int:
        """The time from its first vibration to its last."""
        return sum(burst.on_ms + burst.off_ms for burst in self.bursts) - self.gap_ms

    @property
    def gap_ms(self) -> int:
        """The rest that follows it."""
        return self.bursts[-1].off_ms

    def steps(self) -> tuple[PlayStep, ...]:
        """Return the steps of PLAY, whose masks name motors of the layout."""
        return tuple(
            PlayStep(sum(1 << k for k in burst.tactors), STRENGTHS[burst.level - 1], burst.on_ms, burst.off_ms)
            for burst in self.bursts
        )


@dataclass(frozen=True, slots=True)
class TouchVocabulary:
    """The patterns of one layout. Those of `obstacle_at` are by motor, all others by symbol."""

    layout: TactorLayout
    patterns: Mapping[Symbol, Pattern]
    obstacles: Mapping[int, Pattern]

    def steps(self) -> Mapping[str, tuple[PlayStep, ...]]:
        """Return the steps of PLAY of each symbol but the obstacles, by its value."""
        return {symbol.value: pattern.steps() for symbol, pattern in self.patterns.items()}

    def pattern(self, advice: Advice) -> Pattern:
        """Return the pattern of a piece of advice; of an obstacle, that of the motor nearest to its direction."""
        if advice.symbol is Symbol.OBSTACLE_AT:
            return self.obstacles[self.layout.towards(advice.direction or 0.0)]
        return self.patterns[advice.symbol]


class _Written(msgspec.Struct, forbid_unknown_fields=True):
    sequence: list[int | str | list[int]]
    on_ms: int
    off_ms: int
    gap_ms: int
    strength: int


def vocabulary(layout: str, path: Path = PATTERNS_FILE) -> TouchVocabulary:
    """Return the patterns of a layout, by its name.

    Raises:
        GloveError: there is no such layout.
        PatternError: the file cannot be read, has no patterns for the layout, or one of them cannot be played.
    """
    found = vocabularies(path)
    if layout not in found:
        layout_named(layout)
        raise PatternError(f"{path} has no patterns for the layout '{layout}': write all symbols of it")
    return found[layout]


@functools.cache
def vocabularies(path: Path = PATTERNS_FILE) -> Mapping[str, TouchVocabulary]:
    """Return the patterns of a file by layout; raises as `vocabulary`."""
    values = load_yaml(path, PatternError)
    try:
        read = msgspec.convert(values, dict[str, dict[Symbol, _Written]])
    except msgspec.ValidationError as error:
        raise PatternError(f"{path}: {error}; write the pattern as the shipped ones are") from error
    return {name: _vocabulary(name, written, path) for name, written in read.items()}


def _vocabulary(name: str, written: Mapping[Symbol, _Written], path: Path) -> TouchVocabulary:
    try:
        layout = layout_named(name)
    except GloveError as error:
        raise PatternError(f"{path}: {error}") from error
    if missing := [symbol.value for symbol in Symbol if symbol not in written]:
        raise PatternError(f"{path}: the layout '{name}' has no pattern for {', '.join(missing)}: write one for each")
    obstacle = written[Symbol.OBSTACLE_AT]
    pointing = [k for k, tactor in enumerate(layout.tactors) if tactor.direction is not None]
    where = f"{path}: {name}: "
    return TouchVocabulary(
        layout,
        {
            symbol: _pattern(symbol, each, len(layout.tactors), where)
            for symbol, each in written.items()
            if symbol is not Symbol.OBSTACLE_AT
        },
        {k: _pattern(Symbol.OBSTACLE_AT, obstacle, len(layout.tactors), where, k) for k in pointing},
    )


def _pattern(symbol: Symbol, written: _Written, motors: int, where: str, towards: int | None = None) -> Pattern:
    def refused(text: str) -> PatternError:
        return PatternError(f"{where}{symbol.value} {text}")

    if not 1 <= len(written.sequence) <= STEPS_MAX:
        raise refused(f"has {len(written.sequence)} bursts: the board plays 1 to {STEPS_MAX}")
    if not 1 <= written.strength <= len(STRENGTHS):
        raise refused(f"has the strength {written.strength}: give a level from 1 to {len(STRENGTHS)}")
    for name, value in (("on_ms", written.on_ms), ("off_ms", written.off_ms), ("gap_ms", written.gap_ms)):
        if not (1 if name == "on_ms" else 0) <= value <= 65_535:
            raise refused(f"has {name} = {value}: give a time that the board can keep")
    bursts = []
    for k, entry in enumerate(written.sequence):
        tactors = _tactors(entry, towards)
        if not tactors or any(not 0 <= motor < motors for motor in tactors) or len(set(tactors)) < len(tactors):
            raise refused(f"plays {entry!r} in burst {k + 1}: name motors from 0 to {motors - 1}, each once")
        last = k == len(written.sequence) - 1
        bursts.append(Burst(tactors, written.strength, written.on_ms, written.gap_ms if last else written.off_ms))
    return Pattern(symbol, tuple(bursts))


def _tactors(entry: Any, towards: int | None) -> tuple[int, ...]:
    """Return the motors of an entry of a sequence; none if it is not possible there."""
    if entry == AT:
        return () if towards is None else (towards,)
    if isinstance(entry, int):
        return (entry,)
    return tuple(entry) if isinstance(entry, list) else ()
