"""The game at rest with a simulated driver on the shipped glove: reactions and mixed-up symbols are found."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from tests.cli.command import refused, waychair
from waychair.control.haptics.learning import RiderLearner, expected
from waychair.control.haptics.patterns import vocabulary
from waychair.control.haptics.profile import HapticsProfile
from waychair.control.haptics.symbols import Symbol
from waychair.errors import GloveError
from waychair.firmware_bridge.glove.program import GloveInputs
from waychair.runtime.haptics.learning_game import ASKED, GameAnswer, play_game, summary, turned_device
from waychair.runtime.haptics.learnt_file import load_learner
from waychair.simulation.rider.blind_driver import DriverModel
from waychair.simulation.rider.driver_presets import DRIVERS
from waychair.trials.guiding.game_players import simulated_player

WORDS = vocabulary("glove_3x3")


def _played(model: DriverModel, seconds: float) -> tuple[list[GameAnswer], RiderLearner]:
    learner = RiderLearner()
    with simulated_player(HapticsProfile(), WORDS, model, 3) as player:
        return list(play_game(player, WORDS, learner, seconds, 3)), learner


def test_a_driver_who_feels_well_answers_rightly_and_the_lag_is_found() -> None:
    answers, learner = _played(replace(DRIVERS["default"], reaction_s=0.8, patience_s=1.0), 90.0)
    assert len(answers) > 18
    assert {each.said for each in answers} == set(ASKED)
    assert sum(each.right for each in answers) >= 0.85 * len(answers)
    assert abs(learner.model.lag_s - (0.8 + 0.2)) < 0.1  # the reaction, hand and chair
    assert f"of {len(answers)} symbols" in summary(answers, learner)


def test_symbols_that_are_mixed_up_are_named() -> None:
    answers, learner = _played(replace(DRIVERS["default"], sure=0.3, patience_s=1.0), 40.0)
    wrong = [each for each in answers if not each.right]
    assert wrong
    assert sum(learner.answers().values()) == len(answers)
    assert "taken for" in summary(answers, learner)


def test_a_device_that_sits_the_wrong_way_round_is_told_by_the_answers() -> None:
    model = replace(DRIVERS["default"], reaction_s=0.8, patience_s=1.0)
    with simulated_player(HapticsProfile(turned=(4,)), WORDS, model, 3) as player:
        answers = list(play_game(player, WORDS, RiderLearner(), 60.0, 3))
    assert turned_device(answers).startswith("ahead and back were answered as each other")
    assert turned_device(answers) in summary(answers, RiderLearner())


@pytest.mark.parametrize(
    ("opposite", "told"),
    [
        (ASKED[:2], "ahead and back were answered as each other"),
        (ASKED[2:], "left and right were answered as each other"),
        (ASKED, "ahead and back, and left and right, were answered as each other"),
        (ASKED[4:], ""),
        ((), ""),
    ],
)
def test_answers_by_the_opposite_tell_how_the_device_sits(opposite: tuple[Symbol, ...], told: str) -> None:
    pairs = (ASKED[:2], ASKED[2:4], ASKED[4:])
    other = {symbol: next(each for each in pair if each is not symbol) for pair in pairs for symbol in pair}
    answers = [GameAnswer(each, expected(other[each] if each in opposite else each), 0.5) for each in ASKED]
    assert turned_device(answers * 2).split(":")[0] == told
    assert not turned_device(answers), "too few"


def test_a_glove_that_plays_nothing_ends_the_game_with_its_reason() -> None:
    with simulated_player(HapticsProfile(), WORDS, DRIVERS["default"], 0) as player:
        player._glove.step(player.now_ns // 1_000_000 + 20, GloveInputs(worn=False))
        player._glove.kill()
        with pytest.raises(GloveError, match="glove"):
            list(play_game(player, WORDS, RiderLearner(), 30.0))


def test_the_command_plays_keeps_exports_and_forgets(tmp_path: Path) -> None:
    kept, copy = tmp_path / "learnt.json", tmp_path / "copy.json"
    done = waychair("haptics", "learn", "--driver", "default", "--minutes", "0.3", "--learnt", kept, "--export", copy)
    assert done.returncode == 0, done.stderr
    assert "symbols were answered rightly" in done.stdout
    assert load_learner(kept).exported() == load_learner(copy).exported() != RiderLearner().exported()
    done = waychair("haptics", "learn", "--reset", "--learnt", kept)
    assert (done.returncode, done.stdout) == (0, "")
    assert not kept.exists()
    assert "there is no rider" in refused(waychair("haptics", "learn"))
    wrong = waychair("haptics", "learn", "--port", f"pty:{tmp_path}", "--stick", tmp_path / "js9")
    assert "js9 cannot be opened" in refused(wrong)
