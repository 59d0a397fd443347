"""The sound track of a drive, with the real speech program: one voice, its level, and silence after warnings."""

from __future__ import annotations

import math
import shutil
import wave
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from waychair.control.haptics.profile import HapticsProfile
from waychair.control.haptics.symbols import Advice, Symbol
from waychair.control.haptics.tones import RATE_HZ
from waychair.errors import ConfigError
from waychair.runtime.haptics.teller import Teller
from waychair.trials.guiding.sound_track import SoundTrack, heard_figures

pytestmark = pytest.mark.skipif(shutil.which("espeak-ng") is None, reason="espeak-ng is not installed")

MS = 1_000_000
TICK_MS = 50


class Told:
    """A rider who hears and feels nothing, and the track of it."""

    def __init__(self, *, tones: bool = True) -> None:
        self.track = SoundTrack()
        profile = HapticsProfile(tones=tones)
        self.teller = Teller(profile, None, self.track.loudspeaker(profile))

    def run(self, until_ms: int, advice: Advice | None = None) -> None:
        """Let time pass; the advice is due in its first tick."""
        wanted = [] if advice is None else [replace(advice, valid_until_ns=self.track.now_ns + 150 * MS)]
        while self.track.now_ns < until_ms * MS:
            self.teller.tick(wanted, self.track.now_ns, reacted=True)
            wanted = []
            self.track.now_ns += TICK_MS * MS


def test_advice_is_heard_as_a_tone_and_words_one_after_the_other_and_is_saved(tmp_path: Path) -> None:
    told = Told()
    for at, symbol in enumerate((Symbol.FORWARD, Symbol.NUDGE_LEFT, Symbol.SWIVEL_RIGHT)):
        told.run(2000 * (at + 1), Advice(symbol, at + 1, 0))
    assert [sound.words for sound in told.track.sounds if sound.words] == ["forward", "a bit left", "turn right"]
    heard = heard_figures(told.track, [])
    assert heard.is_fit
    assert heard.after_warning_dbfs == -math.inf
    told.track.save(tmp_path / "sound.wav")
    with wave.open(str(tmp_path / "sound.wav")) as file:
        assert (file.getframerate(), file.getnframes()) == (RATE_HZ, 6 * RATE_HZ)
        left, right = np.frombuffer(file.readframes(6 * RATE_HZ), "<i2").reshape(-1, 2).T
    nudge = slice(round(2.0 * RATE_HZ), round(2.15 * RATE_HZ))
    assert np.abs(left[nudge]).max() > 1000 > np.abs(right[nudge]).max(), "the tone is in the left ear"


def test_a_warning_ends_the_sentence_that_is_spoken_and_half_a_second_is_silent() -> None:
    told = Told()
    told.teller.announce("This sentence is long enough to be spoken for some seconds.", 0)
    told.run(1000)
    told.run(3000, Advice(Symbol.WARNING, 1, 0, reason="stop"))
    sentence = told.track.sounds[0]
    assert sentence.end_ns == pytest.approx(1000 * MS, abs=MS)
    heard = heard_figures(told.track, [1000 * MS])
    assert (heard.is_fit, heard.warnings) == (True, 1)
    spoken_on = heard_figures(told.track, [500 * MS])  # as if the warning had come in the middle of the words
    assert not spoken_on.is_fit
    assert spoken_on.after_warning_dbfs > -30.0


LONG = "This sentence is long enough to be spoken for some seconds."


def test_a_rider_who_feels_nothing_is_told_the_newest_advice_once_the_voice_is_free() -> None:
    told = Told(tones=False)
    told.teller.announce(LONG, 0)
    for number in range(1, 100):
        told.run(60 * number, Advice(Symbol.NUDGE_LEFT if number < 40 else Symbol.FORWARD, number, 0))
    sentence, advice, *_ = told.track.sounds
    assert (sentence.words, advice.words) == (LONG, "forward")
    assert 0 <= advice.begin_ns - sentence.end_ns < 100 * MS


def test_words_that_a_long_sentence_has_kept_waiting_are_not_spoken_late() -> None:
    track = SoundTrack()
    sounds = track.loudspeaker(HapticsProfile())
    for symbol in (Symbol.NUDGE_LEFT, Symbol.ARRIVED):
        sounds.tell(LONG, None, track.now_ns, interrupts=False)
        sounds.tell(symbol.value, Advice(symbol, 1, 0), track.now_ns, interrupts=False)
        for _ in range(120):
            track.now_ns += TICK_MS * MS
            sounds.tick(track.now_ns)
    assert [sound.words for sound in track.sounds] == [LONG, LONG, "arrived"], "that the rider has arrived stays true"


def test_without_the_speech_program_there_is_no_track(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "/nowhere")
    with pytest.raises(ConfigError, match="apt install espeak-ng"):
        SoundTrack()
