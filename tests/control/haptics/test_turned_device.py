"""A device that sits the wrong way round is told from a rider who mixes symbols up now and then."""

from __future__ import annotations

import numpy as np
import pytest

from waychair.control.haptics.symbols import Symbol
from waychair.control.haptics.turned_device import IN_A_ROW, OppositeAnswers
from waychair.types import JoystickInput

LEAD_S, TICK_NS = 1.1, 50_000_000
PUSHES = {
    Symbol.FORWARD: (0.26, 0.0),
    Symbol.BACK: (-0.22, 0.0),
    Symbol.SWIVEL_LEFT: (0.0, 0.23),
    Symbol.SWIVEL_RIGHT: (0.0, -0.23),
}
OPPOSITE = {
    Symbol.FORWARD: Symbol.BACK,
    Symbol.BACK: Symbol.FORWARD,
    Symbol.SWIVEL_LEFT: Symbol.SWIVEL_RIGHT,
    Symbol.SWIVEL_RIGHT: Symbol.SWIVEL_LEFT,
}


def answered(symbols: list[Symbol], done: list[Symbol]) -> OppositeAnswers:
    """Say each symbol to a stick at rest, and answer it after 0.9 s by what `done` says."""
    answers, now_ns = OppositeAnswers(), 0
    for symbol, does in zip(symbols, done, strict=True):
        answers = answers.said(symbol, JoystickInput(now_ns), now_ns, LEAD_S)
        for tick in range(40):
            forward, turn = PUSHES[does] if tick >= 18 else (0.0, 0.0)
            answers = answers.after(JoystickInput(now_ns, forward, turn), now_ns)
            now_ns += TICK_NS
    return answers


@pytest.mark.parametrize(
    ("said", "swapped", "told"),
    [
        ([Symbol.SWIVEL_LEFT, Symbol.SWIVEL_RIGHT] * 2, True, "left and right were"),
        ([Symbol.FORWARD, Symbol.BACK] * 2, True, "ahead and back were"),
        ([Symbol.FORWARD, Symbol.SWIVEL_LEFT] * IN_A_ROW, True, "ahead and back, and left and right,"),
        ([Symbol.FORWARD, Symbol.SWIVEL_LEFT] * 4, False, ""),
        ([Symbol.SWIVEL_LEFT] * (IN_A_ROW - 1), True, ""),
    ],
)
def test_opposite_answers_in_a_row_tell_how_the_device_sits(said: list[Symbol], swapped: bool, told: str) -> None:
    words = answered(said, [OPPOSITE[each] if swapped else each for each in said]).words
    assert words.startswith(told)
    assert bool(words) is bool(told)


def test_a_rider_who_mixes_up_a_third_of_all_symbols_is_hardly_ever_taken_for_one_with_a_turned_device() -> None:
    rng, symbols = np.random.default_rng(1), list(PUSHES)
    told = 0
    for _ in range(100):
        said = [symbols[k] for k in rng.integers(0, 4, 40)]
        others = {each: [one for one in symbols if one is not each] for each in symbols}
        done = [others[each][rng.integers(0, 3)] if rng.random() < 0.3 else each for each in said]
        told += any(answered(said[:k], done[:k]).words for k in (10, 20, 30, 40))
    assert told <= 2


def test_a_symbol_is_judged_on_its_own_axis_once_it_should_be_obeyed() -> None:
    turning = JoystickInput(0, 0.0, -0.23)
    answers = OppositeAnswers().said(Symbol.FORWARD, turning, 0, LEAD_S)
    assert answers.after(JoystickInput(0, -0.26, -0.23), 1_000_000_000) is answers
    assert answers.after(JoystickInput(0, 0.26, -0.23), 2_000_000_000) == OppositeAnswers()
    assert answers.after(JoystickInput(0, -0.26, -0.23), 2_000_000_000) == OppositeAnswers(along=1)
    assert answers.said(Symbol.SWIVEL_RIGHT, turning, 500_000_000, LEAD_S).waits == (Symbol.SWIVEL_RIGHT, 1_800_000_000)
    assert answers.said(Symbol.NUDGE_LEFT, turning, 500_000_000, LEAD_S) is answers


def test_a_hand_that_goes_on_with_the_opposite_may_have_missed_the_symbol_and_gives_no_answer() -> None:
    pulls, answers = JoystickInput(0, -0.26, 0.0), OppositeAnswers()
    for second in range(0, 20, 2):
        answers = answers.said(Symbol.FORWARD, pulls, second * 10**9, LEAD_S).after(pulls, (second + 2) * 10**9)
    assert answers == OppositeAnswers()


def test_a_stick_that_nobody_tells_of_is_no_answer() -> None:
    waits = OppositeAnswers(3).said(Symbol.FORWARD, JoystickInput(0), 0, LEAD_S)
    assert waits.after(None, 2_000_000_000) == OppositeAnswers(3)
    assert OppositeAnswers(3).said(Symbol.FORWARD, None, 0, LEAD_S) == OppositeAnswers(3)
