"""One voice: sounds follow each other, a warning ends speech, and a missing program is told once."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from waychair.control.haptics.profile import HapticsProfile
from waychair.control.haptics.symbols import Advice, Symbol
from waychair.control.haptics.tones import LEVEL, RATE_HZ, tone
from waychair.runtime.haptics.sounds import Sounds, speech_words

FORWARD = Advice(Symbol.FORWARD, 1, 10**18)
MS = 1_000_000

RECORDER = """#!/bin/sh
name=$(basename "$0")
for last; do :; done
echo "begin $name $(basename "$last")" >> "$LOG"
[ "$last" = endless ] && exec sleep 600
sleep 0.05
echo "end $name $(basename "$last")" >> "$LOG"
"""


class Room:
    """Programs that write down when they begin and end in place of a loudspeaker; "endless" ends only if it is ended."""

    def __init__(
        self, folder: Path, profile: HapticsProfile, programs: tuple[str, ...] = ("espeak-ng", "aplay")
    ) -> None:
        self.log = folder / "log"
        self.programs = {}
        for name in programs:
            path = folder / name
            path.write_text(RECORDER)
            path.chmod(0o755)
            self.programs[name] = str(path)
        os.environ["LOG"] = str(self.log)
        self.sounds = Sounds(profile, self.programs.get)

    def lines(self) -> list[str]:
        return self.log.read_text().splitlines() if self.log.exists() else []

    def wait(self, count: int, now_ns: int = 0) -> list[str]:
        """Ticks until so many lines are written."""
        until = time.monotonic() + 10
        while len(self.lines()) < count and time.monotonic() < until:
            self.sounds.tick(now_ns)
            time.sleep(0.005)
        return self.lines()


@pytest.fixture
def room(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Room]:
    """Speech and tones together."""
    monkeypatch.setenv("LOG", "")
    made = Room(tmp_path, HapticsProfile(tones=True))
    yield made
    made.sounds.close()


def test_the_tone_comes_before_the_words_and_they_never_sound_at_once(room: Room) -> None:
    room.sounds.tell("forward", FORWARD, 0, interrupts=False)
    assert room.wait(4) == [
        "begin aplay forward.wav",
        "end aplay forward.wav",
        "begin espeak-ng forward",
        "end espeak-ng forward",
    ]


def test_words_that_wait_are_replaced_by_later_ones(room: Room) -> None:
    room.sounds.tell("first", None, 0, interrupts=False)
    room.sounds.tell("second", None, 0, interrupts=False)
    room.sounds.tell("third", None, 0, interrupts=False)
    assert [line for line in room.wait(4) if line.startswith("begin")] == [
        "begin espeak-ng first",
        "begin espeak-ng third",
    ]


def test_an_interruption_ends_the_words_that_are_spoken(room: Room) -> None:
    room.sounds.tell("endless", None, 0, interrupts=False)
    room.wait(1)
    room.sounds.tell("stop", None, 0, interrupts=True)
    assert room.wait(3) == ["begin espeak-ng endless", "begin espeak-ng stop", "end espeak-ng stop"]


def test_nothing_is_spoken_for_half_a_second_after_a_warning_that_was_felt(room: Room) -> None:
    room.sounds.tell("endless", None, 0, interrupts=False)
    room.wait(1)
    room.sounds.keep_quiet(100 * MS)
    room.sounds.tell("stop", None, 100 * MS, interrupts=True)
    room.sounds.tick(599 * MS)
    assert not room.sounds.sounding
    assert room.lines() == ["begin espeak-ng endless"]
    room.sounds.tick(600 * MS)
    assert room.wait(3, 600 * MS)[1:] == ["begin espeak-ng stop", "end espeak-ng stop"]


def test_a_missing_speech_program_is_one_notice_and_tones_go_on(tmp_path: Path) -> None:
    room = Room(tmp_path, HapticsProfile(tones=True), ("aplay",))
    for _ in range(3):
        room.sounds.tell("forward", FORWARD, 0, interrupts=True)
    room.wait(2)
    assert room.sounds.notices == [
        "no speech program was found, so advice is not spoken: install one (`sudo apt install espeak-ng`)"
    ]
    assert room.lines()[0] == "begin aplay forward.wav"
    room.sounds.close()


def test_a_missing_player_is_one_notice(tmp_path: Path) -> None:
    room = Room(tmp_path, HapticsProfile(tones=True), ("espeak-ng",))
    assert [notice.partition(",")[0] for notice in room.sounds.notices] == ["no program that plays sound was found"]
    room.sounds.close()


def test_a_channel_that_the_rider_does_not_want_is_not_missed(tmp_path: Path) -> None:
    room = Room(tmp_path, HapticsProfile(speech=False), ())
    room.sounds.tell("forward", FORWARD, 0, interrupts=True)
    assert room.sounds.notices == []
    assert not room.sounds.sounding
    room.sounds.close()


def test_a_program_that_fails_is_told_once(tmp_path: Path) -> None:
    room = Room(tmp_path, HapticsProfile())
    (tmp_path / "espeak-ng").write_text("#!/bin/sh\nexit 1\n")
    for _ in range(3):
        room.sounds.tell("forward", None, 0, interrupts=False)
        until = time.monotonic() + 10
        while room.sounds.sounding and time.monotonic() < until:
            time.sleep(0.005)
        room.sounds.tick(0)
    assert room.sounds.notices == ["espeak-ng failed, so advice may not be heard: check the sound of this computer"]
    room.sounds.close()


def test_rate_and_volume_are_the_riders() -> None:
    assert speech_words("/usr/bin/espeak-ng", "-stop", 300, 0.5) == [
        "/usr/bin/espeak-ng",
        "-s",
        "300",
        "-a",
        "48",
        "--",
        "-stop",
    ]
    assert speech_words("spd-say", "a", 450, 1.0) == [
        "spd-say", "--wait", "--rate", "100", "--volume", "100", "--", "a",
    ]  # fmt: skip
    assert speech_words("spd-say", "a", 175, 0.5)[2:6] == ["--rate", "0", "--volume", "0"]


@pytest.mark.skipif(shutil.which("espeak-ng") is None, reason="espeak-ng is not installed")
def test_espeak_accepts_the_command() -> None:
    import subprocess

    words = speech_words(shutil.which("espeak-ng") or "", "a bit left", 175, 0.8)
    done = subprocess.run([words[0], "--stdout", *words[1:]], capture_output=True, check=False)
    assert done.returncode == 0
    assert done.stdout[:4] == b"RIFF"
    assert len(done.stdout) > 10_000


@pytest.mark.parametrize("symbol", list(Symbol))
def test_every_symbol_has_a_tone_of_its_own_within_its_level(symbol: Symbol) -> None:
    samples = tone(Advice(symbol, 1, 0, 0.0), 1.0)
    assert samples.shape[1] == 2
    assert 0.1 <= len(samples) / RATE_HZ <= 0.6
    assert 0.9 * LEVEL < np.abs(samples).max() <= LEVEL
    assert np.abs(samples[[0, -1]]).max() < 0.01
    others = [tone(Advice(other, 1, 0, 0.0), 1.0) for other in Symbol if other is not symbol]
    assert not any(len(samples) == len(other) and np.allclose(samples, other) for other in others)


def test_a_tone_is_in_the_ear_of_its_side() -> None:
    for advice, ear in ((Advice(Symbol.NUDGE_LEFT, 1, 0), 0), (Advice(Symbol.OBSTACLE_AT, 1, 0, -np.pi / 2), 1)):
        samples = np.abs(tone(advice, 1.0)).max(axis=0)
        assert samples[ear] > 0.9 * LEVEL
        assert samples[1 - ear] < 1e-9
