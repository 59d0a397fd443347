"""The skin: what is felt of the motors' levels, and how well it is told apart."""

from __future__ import annotations

import numpy as np
import pytest

from tests.simulation.rider.played import LEARNT, WORDS, PlainGlove
from waychair.simulation.rider.skin import FeltBurst, Recogniser, Skin, SkinModel

EXACT = SkinModel(common=1e-3, single=1.0, timing=0.02)


def felt(name: str, model: SkinModel, seed: int = 0) -> list[FeltBurst]:
    glove, skin = PlainGlove(), Skin(WORDS.layout, model, np.random.default_rng(seed))
    glove.play(LEARNT[name])
    for now_ms in range(20, 2000, 20):
        pattern = skin.feel(glove.step(now_ms))
        if pattern is not None:
            return pattern
    raise AssertionError("no pattern ended")


@pytest.mark.parametrize("name", sorted(LEARNT))
def test_a_skin_without_errors_understands_every_symbol(name: str) -> None:
    assert Recogniser(WORDS.layout, LEARNT, EXACT).recognise(felt(name, EXACT)) == name


def test_the_default_skin_understands_nine_of_ten_symbols_of_each_kind() -> None:
    recogniser = Recogniser(WORDS.layout, LEARNT, SkinModel())
    for name in LEARNT:
        right = sum(recogniser.recognise(felt(name, SkinModel(), seed)) == name for seed in range(25))
        assert right >= 20, name


def test_a_vibration_below_the_threshold_is_not_felt() -> None:
    skin = Skin(WORDS.layout, SkinModel(threshold=250), np.random.default_rng(0))
    glove = PlainGlove()
    glove.play(LEARNT["forward"])
    assert all(skin.feel(glove.step(now_ms)) is None for now_ms in range(20, 1500, 20))


def test_a_warning_wipes_out_the_pattern_that_it_interrupts() -> None:
    glove, skin = PlainGlove(), Skin(WORDS.layout, EXACT, np.random.default_rng(0))
    glove.play(LEARNT["forward"])
    skin.feel(glove.step(200))
    glove.play(LEARNT["warning"])
    patterns = [skin.feel(glove.step(now_ms)) for now_ms in range(220, 1500, 20)]
    (pattern,) = [each for each in patterns if each is not None]
    assert Recogniser(WORDS.layout, LEARNT, EXACT).recognise(pattern) == "warning"


def test_bursts_soon_after_the_last_pattern_are_felt_less_exactly() -> None:
    model = SkinModel()
    assert model.single_after(100.0) > model.single_after(300.0) > model.single_after(400.0) == model.single
