"""Patterns keep the limits of touch; one that breaks a limit is named with the limit, the place and the amount."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from waychair.control.haptics.limits import broken_limits, every_pattern, told_apart
from waychair.control.haptics.patterns import PATTERNS_FILE, TouchVocabulary, vocabulary
from waychair.control.haptics.symbols import PRIORITY, Advice, Symbol
from waychair.control.haptics.words import Wording, advice_words
from waychair.errors import GloveError, PatternError
from waychair.firmware_bridge.glove.layouts import layouts
from waychair.firmware_bridge.glove.messages import OFF_MAX_MS, ON_MAX_MS

NAMES = list(layouts())


def changed(folder: Path, line: str, old: str, new: str) -> TouchVocabulary:
    """The glove's patterns, with a change in the line that begins so."""
    text = PATTERNS_FILE.read_text()
    found = re.search(rf"^  {line}.*(?:\n    .*)*$", text, re.MULTILINE)
    assert found is not None
    assert old in found[0]
    path = folder / "patterns.yaml"
    path.write_text(text.replace(found[0], found[0].replace(old, new), 1))
    return vocabulary("glove_3x3", path)


@pytest.mark.parametrize("name", NAMES)
def test_the_shipped_patterns_of_every_layout_break_no_limit(name: str) -> None:
    assert broken_limits(vocabulary(name)) == ()


@pytest.mark.parametrize("name", NAMES)
def test_the_board_can_play_every_shipped_pattern(name: str) -> None:
    words = vocabulary(name)
    for pattern in every_pattern(words):
        for step in pattern.steps():
            assert 0 < step.mask < 1 << len(words.layout.tactors)
            assert 0 < step.on_ms <= ON_MAX_MS
            assert step.off_ms <= OFF_MAX_MS
            assert 0 < step.strength <= 255


@pytest.mark.parametrize(
    ("line", "old", "new", "limit", "amount"),
    [
        ("forward:", "on_ms: 150", "on_ms: 230", "longest pattern is 600 ms", "690 ms, that is 90 ms too much"),
        ("nudge_left:", "on_ms: 130", "on_ms: 170", "longest nudge is 300 ms", "340 ms, that is 40 ms too much"),
        ("swivel_left:", "on_ms: 112", "on_ms: 90", "shortest circuit is 400 ms", "360 ms, that is 40 ms too little"),
        ("back:", "gap_ms: 400", "gap_ms: 250", "shortest gap to the next pattern is 400", "150 ms too little"),
        ("arrived:", "on_ms: 500", "on_ms: 620", "longest vibration is 500 ms", "burst 1: "),
        ("forward:", "[7, 4, 1]", "[7, [4, 5], 1]", "motors at once, but for the warning is 1", "burst 2: "),
        ("warning:", "on_ms: 50", "on_ms: 80", "longest warning is 250 ms", "340 ms, that is 90 ms too much"),
        ("attention:", "on_ms: 80", "on_ms: 30", "shortest vibration is 50 ms", "30 ms, that is 20 ms too little"),
        ("back:", "[1, 4, 7]", "[7, 4, 1]", "pair told apart is 90 %", "forward and back"),
    ],
)
def test_a_broken_limit_is_told_with_its_place_and_amount(
    tmp_path: Path, line: str, old: str, new: str, limit: str, amount: str
) -> None:
    told = [each.sentence() for each in broken_limits(changed(tmp_path, line, old, new))]
    assert any(limit in sentence and amount in sentence for sentence in told), told
    assert all(sentence.startswith("glove_3x3: ") and sentence.endswith(")") for sentence in told)


@pytest.mark.parametrize(
    ("line", "old", "new", "error"),
    [
        ("forward:", "[7, 4, 1]", "[7, 9, 1]", "plays 9 in burst 2: name motors from 0 to 8"),
        ("forward:", "[7, 4, 1]", "[7, at, 1]", "plays 'at' in burst 2"),
        ("forward:", "[7, 4, 1]", "[]", "has 0 bursts"),
        ("forward:", "strength: 3", "strength: 5", "has the strength 5"),
        ("forward:", "on_ms: 150", "on_ms: 0", "has on_ms = 0"),
        ("forward:", "on_ms: 150", "on_ms: .nan", "Expected `int`"),
        ("forward:", "forward:", "foreward:", "foreward"),
        ("forward:", "on_ms: 150, ", "", "on_ms"),
    ],
)
def test_a_pattern_that_cannot_be_played_is_refused_with_one_sentence(
    tmp_path: Path, line: str, old: str, new: str, error: str
) -> None:
    with pytest.raises(PatternError, match=re.escape(error)):
        changed(tmp_path, line, old, new)


def test_a_layout_without_patterns_and_one_that_is_not_known_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "patterns.yaml"
    text = PATTERNS_FILE.read_text()
    path.write_text(text[: text.index("belt_8:")])
    with pytest.raises(PatternError, match="no patterns for the layout 'belt_8'"):
        vocabulary("belt_8", path)
    with pytest.raises(GloveError, match="no layout 'hat'"):
        vocabulary("hat", path)


def test_mirrored_patterns_are_told_apart_and_equal_ones_are_not() -> None:
    words = vocabulary("glove_3x3")
    forward, back = words.patterns[Symbol.FORWARD], words.patterns[Symbol.BACK]
    assert told_apart(forward, forward, words.layout) == pytest.approx(0.5)
    assert told_apart(forward, back, words.layout) == pytest.approx(0.9783, abs=1e-4)  # normal cdf of sqrt(8) / 1.4


@pytest.mark.parametrize(
    ("direction", "motor"), [(0.0, 1), (0.8, 0), (1.6, 3), (2.4, 6), (3.14, 7), (-2.4, 8), (-1.6, 5), (-0.8, 2)]
)
def test_an_obstacle_is_played_by_the_outer_motor_towards_it(direction: float, motor: int) -> None:
    pattern = vocabulary("glove_3x3").pattern(Advice(Symbol.OBSTACLE_AT, 1, 0, direction))
    assert [burst.tactors for burst in pattern.bursts] == [(motor,), (motor,)]


def test_every_symbol_has_a_priority_and_the_warning_the_highest() -> None:
    assert set(PRIORITY) == set(Symbol)
    assert max(PRIORITY, key=lambda symbol: PRIORITY[symbol]) is Symbol.WARNING


def test_every_symbol_has_a_short_and_a_full_wording() -> None:
    for symbol in Symbol:
        advice = Advice(symbol, 1, 0, 1.6, "a table")
        short, full = advice_words(advice, Wording.SHORT), advice_words(advice, Wording.FULL)
        assert 0 < len(short.split()) <= 3
        assert full.endswith(": a table")
        assert len(full) > len(short)
    assert advice_words(Advice(Symbol.OBSTACLE_AT, 1, 0, 1.6), Wording.SHORT) == "obstacle left"
    assert advice_words(Advice(Symbol.OBSTACLE_AT, 1, 0, 3.1), Wording.FULL) == "there is something behind"
