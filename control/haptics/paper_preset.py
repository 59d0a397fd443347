"""The paper's own advice as a preset: what its `encode_packet` sends, when it changes, or again after a while.

The codes are those of `waychair.control.behaviours.glove`: a sequence through the centre for each of eight directions, a circuit
for a swivel, outer motors for obstacles, all motors for the warning. It is a baseline: its vocabulary is larger than
touch carries, and it neither anticipates nor falls silent.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from waychair.control.behaviours.commands import (
    WORDS,
    Move,
    Signal,
    SignalKind,
    move_words,
    sector_middles,
    signal_words,
)
from waychair.control.behaviours.glove import GloveLayout, encode_signal
from waychair.control.behaviours.sonar import Obstacle
from waychair.control.haptics.advice import GAP_NS, MILLISECOND_NS
from waychair.control.haptics.patterns import STRENGTHS
from waychair.control.haptics.symbols import PRIORITY, Advice, Symbol
from waychair.firmware_bridge.glove.messages import STEPS_MAX, PlayStep

AGAIN_NS = 2_000_000_000
"""Time after which a signal that holds is sent again."""

_OF_KIND = {
    SignalKind.WARNING: Symbol.WARNING,
    SignalKind.DIRECTION: Symbol.FORWARD,
    SignalKind.SPACE: Symbol.OBSTACLE_AT,
}
"""The symbol whose priority a kind of signal has."""


@dataclass(frozen=True, slots=True)
class PaperPlay:
    """A signal of the paper as PLAY: its steps for the 3x3 glove, and its priority."""

    steps: tuple[PlayStep, ...]
    priority: int

    @property
    def duration_ns(self) -> int:
        """The time that it takes, without the gap after it."""
        return sum(step.on_ms + step.off_ms for step in self.steps) * MILLISECOND_NS


def told_as_advice(signal: Signal, number: int, valid_until_ns: int) -> Advice:
    """Return a signal as the piece of advice that comes nearest to it, for page and record; its words are the reason."""
    symbol, direction = _OF_KIND[signal.kind], None
    if signal.kind is SignalKind.DIRECTION:
        direction = signal.orientation
        if signal.move is Move.SWIVEL:
            symbol = Symbol.SWIVEL_LEFT if direction >= 0.0 else Symbol.SWIVEL_RIGHT
    elif signal.kind is SignalKind.SPACE:
        nearest = max(range(len(signal.classes)), key=signal.classes.__getitem__)
        direction = sector_middles(len(signal.classes))[nearest]
    return Advice(symbol, number, valid_until_ns, direction, signal_words(signal))


def paper_codes() -> Mapping[str, tuple[PlayStep, ...]]:
    """Return the codes that a person has to learn, by the paper's words: eight directions, two swivels, warning, obstacles."""
    middles = sector_middles()
    signals = {
        move_words(move, angle): Signal(SignalKind.DIRECTION, move=move, orientation=angle)
        for move, angles in ((Move.GO, middles), (Move.SWIVEL, (1.0, -1.0)))
        for angle in angles
    }
    signals["warning"] = Signal(SignalKind.WARNING)
    for k, word in enumerate(WORDS):
        near = tuple(int(Obstacle.IMMEDIATE if k == each else Obstacle.FAR) for each in range(len(WORDS)))
        signals[f"obstacle {word}"] = Signal(SignalKind.SPACE, classes=near)
    played = {name: paper_play(signal, GloveLayout(middles)) for name, signal in signals.items()}
    return {name: play.steps for name, play in played.items() if play is not None}


@dataclass(frozen=True, slots=True)
class PaperMemory:
    """The signal that was sent last, and when it ends [ns]."""

    signal: Signal | None = None
    ends_ns: int = 0


def paper_play(signal: Signal, static: GloveLayout) -> PaperPlay | None:
    """Return a signal's code as PLAY; None where there is nothing to feel, such as no obstacle near."""
    code = encode_signal(signal, static)
    strength = STRENGTHS[-1 if signal.kind is SignalKind.WARNING else -2]
    steps = [
        PlayStep(sum(1 << tactor for tactor in stimulus.tactors), strength, stimulus.milliseconds, 0)
        for stimulus in code.stimuli[:STEPS_MAX]
    ]
    return PaperPlay(tuple(steps), PRIORITY[_OF_KIND[signal.kind]]) if steps else None


def paper_advice(
    signal: Signal, static: GloveLayout, memory: PaperMemory, now_ns: int
) -> tuple[PaperPlay | None, PaperMemory]:
    """Return what is to be played now, if anything, and the memory after it.

    A signal is sent when it differs from the last one, or when it has held for a while. A warning is sent at once; all others
    leave the gap.
    """
    same = memory.signal is not None and _felt_alike(signal, memory.signal)
    warns = signal.kind is SignalKind.WARNING
    due = now_ns >= memory.ends_ns + AGAIN_NS if same else warns or now_ns >= memory.ends_ns + GAP_NS
    if memory.signal is not None and not due:
        return None, memory
    play = paper_play(signal, static)
    if play is None:
        return None, PaperMemory(signal, memory.ends_ns)
    return play, PaperMemory(signal, now_ns + play.duration_ns)


def _felt_alike(first: Signal, second: Signal) -> bool:
    """Return whether two signals are played by the same code; their reasons are not felt."""
    parts = ((s.kind, s.move, round(s.orientation, 3), s.classes) for s in (first, second))
    return len(set(parts)) == 1
