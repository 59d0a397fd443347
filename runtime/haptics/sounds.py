"""Speech and tones by programs of this computer, one at a time: never two voices at once.

Speech: `espeak-ng`, else `spd-say`. Tones: `paplay`, `aplay`, or sox's `play`. A program that is missing or fails is told
once, in one sentence, and everything else goes on.
"""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

from waychair.control.haptics.profile import HapticsProfile
from waychair.control.haptics.symbols import Advice, Symbol
from waychair.control.haptics.tones import tone, wave_file

WARNING_QUIET_NS = 500_000_000
"""Time after a warning that was felt or heard in which nothing is spoken."""

SPEECH_PROGRAMS = ("espeak-ng", "spd-say")
TONE_PROGRAMS = ("paplay", "aplay", "play")

Find = Callable[[str], str | None]


class RunningSound(Protocol):
    """A program that sounds, as `subprocess.Popen` has it."""

    def poll(self) -> int | None:
        """Return its exit status; None while it sounds."""

    def kill(self) -> None:
        """End it at once."""

    def wait(self) -> int:
        """Return its exit status once it has ended."""


StartSound = Callable[[Sequence[str]], RunningSound]
"""Starts the command of a sound; raises OSError where it cannot."""


LATE_NS = 800_000_000
"""Advice that could not begin to sound by then is not said any more: the chair is elsewhere by now."""


@dataclass(frozen=True, slots=True)
class _Job:
    """A command that makes a sound, and until when it may begin, None for ever."""

    words: tuple[str, ...]
    until_ns: int | None
    speech: bool = False


def _start_program(words: Sequence[str]) -> RunningSound:
    return subprocess.Popen(words, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


class Sounds:
    """One rider's loudspeaker. `notices` are sentences about missing or failing programs, each once."""

    def __init__(self, profile: HapticsProfile, find: Find = shutil.which, start: StartSound = _start_program) -> None:
        self._start_sound = start
        self.notices: list[str] = []
        self._profile = profile
        self._speech = _found(SPEECH_PROGRAMS, find)
        self._player = _found(TONE_PROGRAMS, find)
        self._running: RunningSound | None = None
        self._name = ""
        self._waiting: list[_Job] = []
        self._quiet_until_ns = 0
        self._folder = tempfile.TemporaryDirectory(prefix="waychair-tones-")
        if profile.speech and self._speech is None:
            self.notices.append(
                "no speech program was found, so advice is not spoken: install one (`sudo apt install espeak-ng`)"
            )
        if profile.tones and self._player is None:
            self.notices.append(
                "no program that plays sound was found, so there are no tones: install one (`sudo apt install alsa-utils`)"
            )

    @property
    def sounding(self) -> bool:
        """Whether something is spoken or played now."""
        return self._running is not None and self._running.poll() is None

    @property
    def busy(self) -> bool:
        """Whether something sounds now, or waits to."""
        return self.sounding or bool(self._waiting)

    @property
    def speech(self) -> bool:
        """Whether sentences are spoken: the rider wants them, and there is a program."""
        return self._profile.speech and self._speech is not None

    @property
    def heard(self) -> bool:
        """Whether advice can be heard: as speech, or as tones."""
        profile = self._profile
        return self.speech or (profile.tones and self._player is not None)

    def tell(self, words: str, advice: Advice | None, now_ns: int, interrupts: bool) -> None:
        """Play the tone of advice and then speak the words, as the profile wants; None: no tone.

        A waiting sound is replaced, and advice that has waited for `LATE_NS` is dropped, so that nothing late is spoken; that the rider
        has arrived stays true. `interrupts`: the present sound ends at once.
        """
        if interrupts:
            self.hush()
        jobs = []
        until_ns = None if advice is None or advice.symbol is Symbol.ARRIVED else now_ns + LATE_NS
        if advice is not None and self._profile.tones and self._player is not None:
            jobs.append(_Job((self._player, str(self._tone_file(advice))), until_ns))
        if self._profile.speech and self._speech is not None:
            spoken = speech_words(self._speech, words, self._profile.rate, self._profile.volume)
            jobs.append(_Job(tuple(spoken), until_ns, speech=True))
        self._waiting = jobs
        self.tick(now_ns)

    def keep_quiet(self, now_ns: int) -> None:
        """Speak nothing for a while after a warning that is felt or heard: the speech that runs ends at once."""
        self.hush()
        self._quiet_until_ns = now_ns + WARNING_QUIET_NS

    def tick(self, now_ns: int) -> None:
        """Begin the sound that waits, once the one before has ended."""
        if self._running is not None:
            code = self._running.poll()
            if code is None:
                return
            if code > 0:
                self._tell_once(f"{self._name} failed, so advice may not be heard: check the sound of this computer")
            self._running = None
        self._waiting = [job for job in self._waiting if job.until_ns is None or now_ns <= job.until_ns]
        if self._waiting and not (self._waiting[0].speech and now_ns < self._quiet_until_ns):
            begun, *after = self._waiting
            self._waiting = [replace(job, until_ns=None) for job in after]  # the words that follow their tone
            self._start(begun.words)

    def hush(self) -> None:
        """End the present sound, and forget the waiting ones."""
        self._waiting = []
        running, self._running = self._running, None
        if running is None or running.poll() is not None:
            return
        running.kill()
        running.wait()
        if self._speech is not None and Path(self._speech).name == "spd-say":
            subprocess.run(
                [self._speech, "--cancel"], check=False, capture_output=True
            )  # its server speaks, not itself

    def close(self) -> None:
        """End all sounds, and remove their files."""
        self.hush()
        self._folder.cleanup()

    def _start(self, words: Sequence[str]) -> None:
        self._name = Path(words[0]).name
        try:
            self._running = self._start_sound(words)
        except OSError as error:
            self._tell_once(
                f"{words[0]} cannot be run ({error.strerror}), so advice may not be heard: install it again"
            )

    def _tell_once(self, sentence: str) -> None:
        if sentence not in self.notices:
            self.notices.append(sentence)

    def _tone_file(self, advice: Advice) -> Path:
        direction = "" if advice.direction is None else f"{advice.direction:.1f}"
        path = Path(self._folder.name) / f"{advice.symbol.value}{direction}.wav"
        if not path.exists():
            path.write_bytes(wave_file(tone(advice, self._profile.volume)))
        return path


def speech_words(program: str, text: str, rate: int, volume: float) -> list[str]:
    """Return the command that speaks a text at a rate [words/min] and a volume in [0, 1]."""
    if Path(program).name == "spd-say":
        relative = max(-100, min(100, round((rate - 175) / 2.75)))  # speech-dispatcher's -100 to 100; 0 is about 175
        return [program, "--wait", "--rate", str(relative), "--volume", str(round(200 * volume - 100)), "--", text]
    return [program, "-s", str(rate), "-a", str(round(_LOUDEST * volume)), "--", text]


_LOUDEST = 95
"""espeak-ng's amplitude at full volume, of 200: at 104 the loudest samples of a long sentence are clipped."""


def _found(programs: Sequence[str], find: Find) -> str | None:
    return next((path for path in map(find, programs) if path is not None), None)
