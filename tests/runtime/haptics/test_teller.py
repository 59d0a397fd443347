"""Advice goes to the glove, the voice and the page together; each may fail by itself, and the glove never lies."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from tests.firmware_bridge.glove.rig import spans
from waychair.control.haptics.patterns import vocabulary
from waychair.control.haptics.profile import HapticsProfile, load_profile, save_profile
from waychair.control.haptics.symbols import Advice, Symbol
from waychair.errors import ConfigError, GloveError
from waychair.firmware_bridge.glove.bridge import GloveBridge
from waychair.firmware_bridge.glove.layouts import layout_named
from waychair.firmware_bridge.glove.program import GloveInputs, HostGlove, build_glove
from waychair.firmware_bridge.transports import Reconnecting
from waychair.runtime.haptics.sounds import Sounds
from waychair.runtime.haptics.teller import Teller, ToldAdvice

MS = 1_000_000
LATER = 10**18


class Rider:
    """A teller with the shipped glove, in ticks of 10 ms."""

    def __init__(self, program: Path, profile: HapticsProfile) -> None:
        self.glove = HostGlove(program)
        transport = self.glove.transport
        bridge = GloveBridge(Reconnecting(lambda: transport), "A", layout_named("glove_3x3"), profile.fitting())
        self.sounds = Sounds(profile, {}.get)
        self.teller = Teller(profile, bridge, self.sounds)
        self.now_ms = 0
        self.inputs = GloveInputs()
        self.told: list[tuple[int, ToldAdvice]] = []
        self.levels = np.zeros((0, 16), np.uint8)

    def run(self, ms: int, *wanted: Advice) -> None:
        for _ in range(ms // 10):
            told = self.teller.tick(wanted, self.now_ms * MS)
            if told != ToldAdvice():
                self.told.append((self.now_ms, told))
            self.now_ms += 10
            self.levels = np.concatenate([self.levels, self.glove.step(self.now_ms, self.inputs).levels])


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The glove as a program."""
    return build_glove(tmp_path_factory.mktemp("glove"))


@pytest.fixture
def rider(program: Path) -> Iterator[Rider]:
    """A rider with a glove in order, and without a speech program."""
    made = Rider(program, HapticsProfile())
    with made.glove:
        made.run(100)
        yield made
        made.sounds.close()


def test_advice_is_felt_and_written_and_a_missing_voice_is_told(rider: Rider) -> None:
    rider.run(600, Advice(Symbol.FORWARD, 1, LATER, reason="the door is 2 m ahead"))
    assert spans(rider.levels, 1) == [(400, 150)]
    assert [(when, told.text, told.unfelt) for when, told in rider.told] == [
        (100, "drive straight ahead: the door is 2 m ahead", "")
    ]
    assert "no speech program" in rider.teller.notices(rider.now_ms * MS)[0]


def test_a_warning_is_felt_within_a_tick_and_5_ms_while_another_symbol_plays(rider: Rider) -> None:
    rider.run(50, Advice(Symbol.SWIVEL_LEFT, 1, LATER))
    begun = rider.now_ms
    rider.run(300, Advice(Symbol.SWIVEL_LEFT, 1, LATER), Advice(Symbol.WARNING, 2, LATER))
    assert all(begun <= spans(rider.levels[begun:], motor)[0][0] + begun <= begun + 5 for motor in range(9))
    assert [length for _, length in spans(rider.levels[begun:], 8)] == [50, 50, 50]


def test_a_wrong_symbol_is_never_felt_in_place_of_the_one_that_was_said(rider: Rider) -> None:
    """With any one motor broken, every symbol is felt as it is written, without its broken motor, or not at all."""
    words = vocabulary("glove_3x3")
    for broken in range(9):
        rider.inputs = GloveInputs(open_motors=1 << broken)
        for number, symbol in enumerate((Symbol.FORWARD, Symbol.NUDGE_LEFT, Symbol.SWIVEL_RIGHT, Symbol.ARRIVED)):
            rider.run(100)
            begun = len(rider.levels)
            rider.run(1200, Advice(symbol, 100 * broken + number, LATER))
            felt = rider.levels[begun:]
            bursts = words.patterns[symbol].bursts
            needs = {motor for burst in bursts for motor in burst.tactors}
            expected = set() if broken in needs else needs
            assert {motor for motor in range(16) if felt[:, motor].any()} == expected, (broken, symbol)
            assert bool(rider.told[-1][1].unfelt) == (broken in needs)


def test_a_dead_glove_or_one_that_is_not_worn_is_told_and_the_words_go_on(rider: Rider) -> None:
    rider.inputs = GloveInputs(worn=False)
    rider.run(100)
    rider.run(100, Advice(Symbol.FORWARD, 1, LATER))
    assert rider.told[-1][1].unfelt == "the glove is not worn: put it on"
    assert rider.told[-1][1].text == "drive straight ahead"
    rider.glove.kill()
    rider.run(1000)
    rider.run(200, Advice(Symbol.BACK, 2, LATER))
    assert rider.told[-1][1].text == "drive straight back"
    assert rider.told[-1][1].unfelt != ""
    assert any("glove" in notice for notice in rider.teller.notices(rider.now_ms * MS))


def test_the_gloves_button_asks_for_the_symbol_again(rider: Rider) -> None:
    forward = Advice(Symbol.FORWARD, 1, LATER)
    rider.run(1500, forward)
    rider.inputs = GloveInputs(repeat=True)
    rider.run(100, forward)
    rider.inputs = GloveInputs()
    rider.run(600, forward)
    assert [told.said for _, told in rider.told] == [forward, forward]
    assert 1500 < rider.told[1][0] - 100 < 1650


def test_silence_is_offered_to_a_rider_who_ignores_the_advice(rider: Rider) -> None:
    rider.run(8000, Advice(Symbol.FORWARD, 1, LATER))
    assert [told.offer != "" for _, told in rider.told] == [False, False, True]


def test_a_profile_is_read_back_as_it_was_written(tmp_path: Path) -> None:
    profile = HapticsProfile(
        hand="left", turned=(2,), gains=(200,) * 9, tones=True, wording="full", rate=250, volume=0.3
    )
    save_profile(tmp_path / "rider.yaml", profile)
    assert load_profile(tmp_path / "rider.yaml") == profile


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("hand: both", "hand = 'both' is impossible: choose among none, left, right"),
        ("wording: long", "wording = 'long' is impossible"),
        ("volume: 1.5", "volume = 1.5 is impossible"),
        ("loudness: 1", "loudness"),
        ("layout: hat", "there is no layout 'hat'"),
        ("gains: [1, 2]", "has 2 gains"),
    ],
)
def test_an_impossible_profile_is_refused(tmp_path: Path, text: str, error: str) -> None:
    path = tmp_path / "rider.yaml"
    path.write_text(text + "\n")
    with pytest.raises((ConfigError, GloveError), match=error):
        load_profile(path)


def test_the_papers_signals_have_codes_for_the_glove_of_nine_motors_only() -> None:
    assert HapticsProfile(advice="paper").as_paper
    with pytest.raises(ConfigError, match="no code for the layout 'belt_8': choose glove_3x3"):
        HapticsProfile(advice="paper", layout="belt_8", hand="none")
    with pytest.raises(ConfigError, match="choose among guide, paper"):
        HapticsProfile(advice="loud")
