"""The sound track of a simulated drive: all that the rider's loudspeaker says, at the simulated time at which it says it.

The chair's own `Sounds` decides what sounds when; speech is made by espeak-ng into a file instead of the loudspeaker.
"""

from __future__ import annotations

import io
import math
import shutil
import subprocess
import tempfile
import wave
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from waychair.control.haptics.profile import HapticsProfile
from waychair.control.haptics.tones import RATE_HZ, wave_file
from waychair.errors import ConfigError
from waychair.files import write_bytes
from waychair.runtime.haptics.sounds import TONE_PROGRAMS, WARNING_QUIET_NS, Sounds
from waychair.types import FloatArray

SPEAKER = "espeak-ng"

ENDED, KILLED = 0, -9
"""Exit status of a sound that came to its end, and of one that was cut off."""


@dataclass(frozen=True, slots=True)
class TrackSound:
    """A sound of the track: its beginning, samples (n, 2) in [-1, 1] at `RATE_HZ`, and the words; those of a tone are empty."""

    begin_ns: int
    samples: FloatArray
    words: str = ""

    @property
    def end_ns(self) -> int:
        """The end of its last sample."""
        return self.begin_ns + round(len(self.samples) / RATE_HZ * 1e9)

    def cut(self, now_ns: int) -> TrackSound:
        """Return it without what would sound from now on."""
        return replace(self, samples=self.samples[: sample_index(now_ns - self.begin_ns)])


def sample_index(after_ns: int) -> int:
    """Return the index of the sample a time after the first one."""
    return after_ns * RATE_HZ // 1_000_000_000


class SoundTrack:
    """The track of one drive, from the simulated time 0 on; the caller moves `now_ns` on."""

    def __init__(self) -> None:
        """Begin an empty track.

        Raises:
            ConfigError: there is no espeak-ng.
        """
        self.now_ns = 0
        self.sounds: list[TrackSound] = []
        speaker = shutil.which(SPEAKER)
        if speaker is None:
            raise ConfigError(f"a sound track needs the speech program {SPEAKER}: `sudo apt install {SPEAKER}`")
        self._programs = {SPEAKER: speaker, TONE_PROGRAMS[0]: TONE_PROGRAMS[0]}

    def loudspeaker(self, profile: HapticsProfile) -> Sounds:
        """Return a rider's loudspeaker that plays into this track."""
        return Sounds(profile, self._programs.get, self._start)

    def samples(self) -> FloatArray:
        """Return the samples (n, 2) from the track's beginning to now; sounds at once add up."""
        whole = np.zeros((sample_index(self.now_ns), 2))
        for sound in self.sounds:
            first = sample_index(sound.begin_ns)
            part = sound.samples[: max(0, len(whole) - first)]
            whole[first : first + len(part)] += part
        return whole

    def save(self, path: Path) -> None:
        """Write the track as a WAV file.

        Raises:
            OutputError: the file cannot be written.
        """
        write_bytes(path, wave_file(self.samples()))

    def _start(self, words: Sequence[str]) -> _Playing:
        if words[0] == self._programs[SPEAKER]:
            sound = TrackSound(self.now_ns, _spoken(words), words[-1])
        else:
            sound = TrackSound(self.now_ns, _samples_of(Path(words[-1]).read_bytes()))
        self.sounds.append(sound)
        return _Playing(self, len(self.sounds) - 1)


@dataclass(frozen=True, slots=True)
class HeardFigures:
    """A track by measurement: moments in which two sounds overlap, level of the speech and greatest peak [dBFS], warnings, and the
    greatest level in the half second of silence that each of them wants, -inf if it is silent."""

    overlaps: int
    speech_dbfs: float
    peak_dbfs: float
    warnings: int
    after_warning_dbfs: float

    @property
    def is_fit(self) -> bool:
        """Whether one voice speaks, at a level that is heard and not clipped, and is silent after warnings."""
        return (
            not self.overlaps and -30.0 < self.speech_dbfs < self.peak_dbfs < -0.5 and self.after_warning_dbfs < -60.0
        )


def heard_figures(track: SoundTrack, warnings_ns: Sequence[int]) -> HeardFigures:
    """Measure a track of which the warnings were said at these times; their own tones do not count as speech."""
    mixed, ends = track.samples(), 0
    overlaps, speech, tones = 0, np.zeros(len(mixed), np.bool_), np.zeros(len(mixed), np.bool_)
    for sound in sorted(track.sounds, key=lambda each: each.begin_ns):
        overlaps += sound.begin_ns < ends
        ends = max(ends, sound.end_ns)
        (speech if sound.words else tones)[sample_index(sound.begin_ns) : sample_index(sound.end_ns)] = True
    wanted = np.zeros(len(mixed), np.bool_)
    for at_ns in warnings_ns:
        wanted[sample_index(at_ns) : sample_index(at_ns + WARNING_QUIET_NS)] = True
    loud = np.abs(mixed).max(axis=1, initial=0.0)
    voiced = mixed[speech & (loud > _VOICED)]
    return HeardFigures(
        overlaps=overlaps,
        speech_dbfs=_dbfs(float(np.sqrt((voiced**2).mean())) if len(voiced) else 0.0),
        peak_dbfs=_dbfs(float(loud.max(initial=0.0))),
        warnings=len(warnings_ns),
        after_warning_dbfs=_dbfs(float(loud[wanted & ~tones].max(initial=0.0))),
    )


_VOICED = 0.01
"""Least amplitude of a sample that belongs to a voice, not to a pause in it: -40 dBFS."""


def _dbfs(amplitude: float) -> float:
    return 20.0 * math.log10(amplitude) if amplitude > 0.0 else -math.inf


class _Playing:
    """A sound of a track under way, as if a program played it."""

    def __init__(self, track: SoundTrack, at: int) -> None:
        self._track, self._at, self._killed = track, at, False

    def poll(self) -> int | None:
        if self._killed:
            return KILLED
        return ENDED if self._track.now_ns >= self._track.sounds[self._at].end_ns else None

    def kill(self) -> None:
        self._track.sounds[self._at] = self._track.sounds[self._at].cut(self._track.now_ns)
        self._killed = True

    def wait(self) -> int:
        return KILLED if self._killed else ENDED


def _spoken(words: Sequence[str]) -> FloatArray:
    """Return the samples that a command of the speech program would play."""
    with tempfile.TemporaryDirectory(prefix="waychair-speech-") as folder:
        path = Path(folder) / "speech.wav"
        subprocess.run([words[0], "-w", str(path), *words[1:]], check=True, capture_output=True)
        return _samples_of(path.read_bytes())


def _samples_of(data: bytes) -> FloatArray:
    """Return the samples (n, 2) of a WAV file of 16 bits, at `RATE_HZ`."""
    with wave.open(io.BytesIO(data)) as file:
        assert (file.getsampwidth(), file.getframerate()) == (2, RATE_HZ)
        raw = np.frombuffer(file.readframes(file.getnframes()), "<i2").reshape(-1, file.getnchannels()) / 32_767
    both: FloatArray = np.repeat(raw, 2, axis=1) if raw.shape[1] == 1 else raw
    return both
