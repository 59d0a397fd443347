"""When a symbol is said: priority, validity, interruption, repetition when ignored, silence when nothing changed.

`advise` is a pure step. The caller lists the advice that now holds; the step returns the one to be said now, if any. Rules:

- The warning interrupts everything and waits for nothing. Other symbols wait for the gap after the one before.
- Advice that is no longer valid is dropped.
- The same advice (by its number) is said once, once more if it still holds after a while, and then no more: a rider who
  ignores two symbols in a row is right until proved wrong. "Repeat" is offered instead. Warnings go on.
- Obstacles are told when nothing else is, on change, or when asked.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from waychair.control.haptics.patterns import TouchVocabulary
from waychair.control.haptics.symbols import PRIORITY, Advice, Symbol

REPEAT_NS = 3_000_000_000
"""Time after which advice that still holds is said again: pattern, reaction and hand take about a second of it."""

WARN_AGAIN_NS = 1_500_000_000
"""The same of a warning."""

UNANSWERED_MAX = 2
"""Symbols in a row without an answer, after which advice falls silent."""

GAP_NS = 400_000_000
"""Rest after a symbol that was stopped; patterns have their own (`Pattern.gap_ms`)."""

MILLISECOND_NS = 1_000_000


@dataclass(frozen=True, slots=True)
class Said:
    """Advice that was said: when its pattern ends, and leaves room for the next [ns]."""

    advice: Advice
    ends_ns: int
    free_ns: int


@dataclass(frozen=True, slots=True)
class AdviceMemory:
    """What `advise` remembers: the last advice said, the last obstacle told, symbols without an answer, and silence.

    `offered`: "repeat" was offered since advice fell silent.
    """

    said: Said | None = None
    obstacle: Advice | None = None
    unanswered: int = 0
    quiet: bool = False
    offered: bool = False


@dataclass(frozen=True, slots=True)
class Advised:
    """The advice to be said now; `stop`: the symbol that plays is to be stopped first; `offer_repeat`: advice fell silent.

    `interrupts`: it is to cut off the speech that is being spoken.
    """

    say: Advice | None = None
    stop: bool = False
    offer_repeat: bool = False
    interrupts: bool = False


NOTHING = Advised()


def advise(
    wanted: Sequence[Advice],
    words: TouchVocabulary,
    memory: AdviceMemory,
    now_ns: int,
    *,
    asked: bool = False,
    reacted: bool | None = None,
) -> tuple[Advised, AdviceMemory]:
    """Return the advice to be said now, and the memory after it.

    `asked`: the rider pressed "repeat". `reacted`: whether the rider has done something since the last symbol; None: not
    known, so that new guidance counts as a reaction.
    """
    top = _top(wanted, now_ns)
    memory = _after_reaction(memory, top, reacted, asked)
    if top is None:
        return NOTHING, memory
    if top.symbol is Symbol.WARNING:
        return _warn(top, words, memory, now_ns, asked)
    if memory.said is not None and now_ns < memory.said.free_ns:
        return _wait(top, memory, memory.said, now_ns)
    if not asked and not _is_due(top, memory, now_ns):
        return NOTHING, memory
    guiding = top.symbol not in (Symbol.OBSTACLE_AT, Symbol.ATTENTION)
    if guiding and not asked and memory.unanswered >= UNANSWERED_MAX:
        offer = not memory.offered
        return Advised(offer_repeat=offer), replace(memory, quiet=True, offered=True)
    return _say(top, words, memory, now_ns, counted=guiding)


def valid_ms(advice: Advice, now_ns: int) -> int:
    """Return the time for which advice may still begin, for PLAY."""
    return min(max((advice.valid_until_ns - now_ns) // MILLISECOND_NS, 0), 0xFFFF)


def _top(wanted: Sequence[Advice], now_ns: int) -> Advice | None:
    """Return the most important advice that is still valid; of equal ones the first."""
    valid = [advice for advice in wanted if advice.valid_until_ns >= now_ns]
    return max(valid, key=lambda advice: PRIORITY[advice.symbol], default=None)


def _after_reaction(memory: AdviceMemory, top: Advice | None, reacted: bool | None, asked: bool) -> AdviceMemory:
    if reacted is None:
        last = memory.said
        reacted = top is not None and last is not None and top.number != last.advice.number
        reacted = reacted and top is not None and PRIORITY[top.symbol] == PRIORITY[Symbol.FORWARD]
    if reacted or asked:
        return replace(memory, unanswered=0, quiet=False, offered=False)
    return memory


def _warn(
    top: Advice, words: TouchVocabulary, memory: AdviceMemory, now_ns: int, asked: bool
) -> tuple[Advised, AdviceMemory]:
    said = memory.said
    same = said is not None and said.advice.symbol is Symbol.WARNING
    if said is not None and same:
        again = now_ns >= said.ends_ns + WARN_AGAIN_NS or (now_ns >= said.free_ns and (asked or _is_new(top, said)))
        if not again:
            return NOTHING, memory
    return _say(top, words, memory, now_ns, counted=False)


def _is_new(top: Advice, said: Said) -> bool:
    return top.number != said.advice.number


def _wait(top: Advice, memory: AdviceMemory, said: Said, now_ns: int) -> tuple[Advised, AdviceMemory]:
    """Wait for the gap; a less important symbol that still plays is stopped, and its gap begins now."""
    if now_ns < said.ends_ns and PRIORITY[said.advice.symbol] < PRIORITY[top.symbol]:
        return Advised(stop=True), replace(memory, said=replace(said, ends_ns=now_ns, free_ns=now_ns + GAP_NS))
    return NOTHING, memory


def _is_due(top: Advice, memory: AdviceMemory, now_ns: int) -> bool:
    """Return whether advice is new, or ignored for so long that it is said again."""
    if top.symbol is Symbol.OBSTACLE_AT:
        return memory.obstacle is None or memory.obstacle.number != top.number
    said = memory.said
    if said is None or _is_new(top, said):
        return True
    return now_ns >= said.ends_ns + REPEAT_NS


def _say(
    top: Advice, words: TouchVocabulary, memory: AdviceMemory, now_ns: int, counted: bool
) -> tuple[Advised, AdviceMemory]:
    pattern = words.pattern(top)
    ends_ns = now_ns + pattern.duration_ms * MILLISECOND_NS
    said = memory.said
    playing = said is not None and now_ns < said.ends_ns
    return Advised(top, interrupts=playing or top.symbol is Symbol.WARNING), replace(
        memory,
        said=Said(top, ends_ns, ends_ns + pattern.gap_ms * MILLISECOND_NS),
        obstacle=top if top.symbol is Symbol.OBSTACLE_AT else memory.obstacle,
        unanswered=memory.unanswered + counted,
    )
