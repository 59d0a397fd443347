"""A game at rest: the rider feels a symbol and answers by a stick that moves no chair. It shows reactions and mixed-up symbols.

A held push answers forward, back and turns, a short one a nudge, and letting go a warning. The next symbol comes once the
stick has rested.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from waychair.control.haptics.learning import RiderLearner, expected
from waychair.control.haptics.patterns import TouchVocabulary
from waychair.control.haptics.symbols import PRIORITY, Advice, Symbol
from waychair.control.haptics.turned_device import turned_words
from waychair.errors import GloveError
from waychair.firmware_bridge.glove.messages import PlayStep
from waychair.types import JoystickInput

ASKED = (
    Symbol.FORWARD,
    Symbol.BACK,
    Symbol.SWIVEL_LEFT,
    Symbol.SWIVEL_RIGHT,
    Symbol.NUDGE_LEFT,
    Symbol.NUDGE_RIGHT,
)
"""The symbols of the game: those that are answered by a push."""

HAND_AND_CHAIR_S = 0.2
"""s; from the push until the chair obeys, which the game at rest does not show (an assumption, as in the trials)."""

WATCHED_S = 2.5
"""s after the pattern's end within which an answer counts."""

LOOKED_AT_S = 0.7
"""s of a push that are looked at."""

SHORT_S = 0.5
"""s; a push that ends sooner is a nudge."""

PUSHED = 0.08
"""Share of the swing; beyond it the stick is pushed: beyond the unrest of a resting hand."""

RESTED_S, LONGEST_REST_S = 0.5, 8.0
"""s for which the stick rests before the next symbol, and after which the game goes on although it does not."""


class Player(Protocol):
    """The glove and the rider's stick."""

    @property
    def now_ns(self) -> int:
        """The time."""

    def tick(self) -> JoystickInput:
        """Let a control step pass; return the stick after it."""

    def play(self, steps: Sequence[PlayStep], priority: int) -> str:
        """Begin a pattern; return why it is not played, or ""."""


@dataclass(frozen=True, slots=True)
class GameAnswer:
    """The answer to a symbol: the motion that the push asks for, and its time [s] after the pattern's end, None without one."""

    said: Symbol
    done: str
    after_s: float | None

    @property
    def right(self) -> bool:
        """Whether the rider has understood."""
        return self.done == expected(self.said)


def play_game(
    player: Player, words: TouchVocabulary, learner: RiderLearner, seconds: float, seed: int = 0
) -> Iterator[GameAnswer]:
    """Yield the answers of a game of so many seconds, while the learner learns from them.

    The symbols come in random order, each as often as the others.

    Raises:
        GloveError: the glove plays nothing, so that there is nothing to learn.
    """
    rng, order = np.random.default_rng(seed), list[Symbol]()
    ends_ns = player.now_ns + round(seconds * 1e9)
    while player.now_ns < ends_ns:
        if not order:
            order = [ASKED[k] for k in rng.permutation(len(ASKED))]
        _rest(player)
        answer = _asked(player, words, order.pop())
        lag_s = None if answer.after_s is None else answer.after_s + HAND_AND_CHAIR_S
        learner.note_answer(answer.said, answer.done, lag_s)
        yield answer


def _rest(player: Player) -> None:
    """Wait until the stick has rested."""
    began_ns = rests_ns = player.now_ns
    while player.now_ns - rests_ns < RESTED_S * 1e9 and player.now_ns - began_ns < LONGEST_REST_S * 1e9:
        if _pushed(player.tick()):
            rests_ns = player.now_ns


def _asked(player: Player, words: TouchVocabulary, symbol: Symbol) -> GameAnswer:
    pattern = words.pattern(Advice(symbol, 0, 0))
    problem = player.play(pattern.steps(), PRIORITY[symbol])
    if problem:
        raise GloveError(problem)
    ended_ns = player.now_ns + pattern.duration_ms * 1_000_000
    pushed: list[JoystickInput] = []
    began_ns: int | None = None
    while player.now_ns < ended_ns + WATCHED_S * 1e9:
        stick = player.tick()
        if began_ns is None and _pushed(stick):
            began_ns = player.now_ns
        if began_ns is not None:
            pushed.append(stick)
            if player.now_ns - began_ns >= LOOKED_AT_S * 1e9:
                break
    if began_ns is None:
        return GameAnswer(symbol, "nothing", None)
    return GameAnswer(symbol, _motion(pushed, LOOKED_AT_S / len(pushed)), (began_ns - ended_ns) * 1e-9)


def _motion(pushed: Sequence[JoystickInput], step_s: float) -> str:
    """Return the motion that a push asks for, in the words of `learning`."""
    held = [each for each in pushed if _pushed(each)]
    forward = math.fsum(each.forward for each in held) / len(held)
    turn = math.fsum(each.turn for each in held) / len(held)
    if abs(forward) >= abs(turn):
        return "forward" if forward > 0.0 else "back"
    side = "left" if turn > 0.0 else "right"
    return side if len(held) * step_s >= SHORT_S else f"nudged {side}"


def _pushed(stick: JoystickInput) -> bool:
    return max(abs(stick.forward), abs(stick.turn)) > PUSHED


def summary(answers: Sequence[GameAnswer], learner: RiderLearner) -> str:
    """Return a game in words: how many were right, by symbol, what was mixed up, and the lag that is known now."""
    if not answers:
        return "nothing was asked"
    lines = [f"{sum(each.right for each in answers)} of {len(answers)} symbols were answered rightly"]
    for symbol in ASKED:
        of_it = [each for each in answers if each.said is symbol]
        wrong = sorted({each.done for each in of_it if not each.right})
        told = f"; taken for {', '.join(wrong)}" if wrong else ""
        if of_it:
            lines.append(f"  {symbol.value}: {sum(each.right for each in of_it)} of {len(of_it)}{told}")
    lines += [turned] if (turned := turned_device(answers)) else []
    lines.append(f"the chair obeys this rider about {learner.model.lag_s:.2f} s after a pattern's end")
    return "\n".join(lines)


TURNED_SHARE, TURNED_LEAST = 0.6, 4
"""Share of the answers that ask for the opposite on a device that sits the wrong way round: of a rider who answers at random it is a
third at most. And the fewest answers by which this is decided."""


def turned_device(answers: Sequence[GameAnswer]) -> str:
    """Return in a sentence how a device sits whose symbols were answered by their opposites; empty if they were not."""

    def swapped(one: Symbol, other: Symbol) -> bool:
        of_them = [each for each in answers if each.said in (one, other)]
        opposite = {one: expected(other), other: expected(one)}
        count = sum(each.done == opposite[each.said] for each in of_them)
        return len(of_them) >= TURNED_LEAST and count >= TURNED_SHARE * len(of_them)

    return turned_words(swapped(Symbol.FORWARD, Symbol.BACK), swapped(Symbol.SWIVEL_LEFT, Symbol.SWIVEL_RIGHT))
