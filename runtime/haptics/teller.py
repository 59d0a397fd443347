"""Tells a rider one piece of advice at a time, by touch, speech, tones and text, alone or together.

Each channel may fail by itself: the glove's trouble, or a missing speech program, becomes a notice, and the others go on.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from waychair.control.haptics.advice import AdviceMemory, advise, valid_ms
from waychair.control.haptics.patterns import TouchVocabulary, vocabulary
from waychair.control.haptics.profile import HapticsProfile
from waychair.control.haptics.symbols import PRIORITY, Advice, Symbol
from waychair.control.haptics.words import Wording, advice_words
from waychair.firmware_bridge.glove.bridge import GloveBridge
from waychair.runtime.haptics.haptic_state import HapticState
from waychair.runtime.haptics.sounds import Sounds

REPEAT_OFFER = "say or press repeat to hear it again"
"""Sentence with which advice falls silent."""


@dataclass(frozen=True, slots=True)
class ToldAdvice:
    """One tick: the advice that was said, in words for the page, and why it was not felt, if it was not.

    `offer`: the sentence with which advice fell silent; `repeats` and `yes`: presses of the glove's buttons.
    """

    said: Advice | None = None
    text: str = ""
    unfelt: str = ""
    offer: str = ""
    yes: int = 0
    repeats: int = 0


class Teller:
    """One rider's channels. `memory` knows the last symbol said, `notices` what is amiss now."""

    def __init__(self, profile: HapticsProfile, glove: GloveBridge | None, sounds: Sounds | None) -> None:
        """`glove` and `sounds` are None where there are none.

        Raises:
            GloveError: the layout is not known.
            PatternError: its patterns are impossible.
        """
        self.memory = AdviceMemory()
        self._profile = profile
        self._glove = glove if profile.touch else None
        self._sounds = sounds
        self._words = vocabulary(profile.layout)

    def tick(
        self, wanted: Sequence[Advice], now_ns: int, *, asked: bool = False, reacted: bool | None = None
    ) -> ToldAdvice:
        """Say the advice that is due now; arguments as of `advise`. The glove's button "repeat" asks as well."""
        yes = repeats = 0
        if self._glove is not None:
            self._glove.tick(now_ns, armed=True)
            yes, repeats = self._glove.presses.yes, self._glove.presses.repeat
        if self._sounds is not None:
            self._sounds.tick(now_ns)
        asked = asked or repeats > 0
        done, self.memory = advise(wanted, self._words, self.memory, now_ns, asked=asked, reacted=reacted)
        if done.stop and self._glove is not None:
            self._glove.stop()
        if done.say is None:
            offer = REPEAT_OFFER if done.offer_repeat else ""
            if offer and self._sounds is not None:
                self._sounds.tell(offer, None, now_ns, interrupts=False)
            return ToldAdvice(offer=offer, yes=yes, repeats=repeats)
        return replace(self._say(done.say, now_ns, done.interrupts), yes=yes, repeats=repeats)

    def announce(self, sentence: str, now_ns: int) -> None:
        """Speak a sentence that is no symbol, such as an answer to the rider; what is being spoken ends, but for a warning."""
        if self._sounds is not None:
            last = self.memory.said
            warns = last is not None and last.advice.symbol is Symbol.WARNING and now_ns < last.free_ns
            self._sounds.tell(sentence, None, now_ns, interrupts=not warns)

    @property
    def heard(self) -> bool:
        """Whether advice can be heard, by speech or tones."""
        return self._sounds is not None and self._sounds.heard

    def silence(self, now_ns: int) -> str:
        """Return why no channel reaches the rider now, with a remedy; empty if one does."""
        if self.heard:
            return ""
        if self._glove is not None:
            return self._glove.problem(now_ns)
        return "there is neither a glove nor a voice: plug in the glove, or switch speech on"

    def shown(self, before: HapticState, told: ToldAdvice, now_ns: int) -> HapticState:
        """Return the channels' state after a tick: the symbol said last, and glove and notices as they are now."""
        shown = replace(
            before,
            stamp_ns=now_ns,
            glove=None if self._glove is None else self._glove.report(now_ns),
            notices=self.notices(now_ns),
        )
        if told.said is None:
            return shown
        bursts = () if told.unfelt or self._glove is None else self._words.pattern(told.said).bursts
        return replace(
            shown,
            symbol=told.said.symbol.value,
            text=told.text,
            count=before.count + 1,
            play=tuple((each.tactors, each.on_ms, each.off_ms) for each in bursts),
            unfelt=told.unfelt,
        )

    @property
    def words(self) -> TouchVocabulary:
        """The symbols' patterns for this rider's layout."""
        return self._words

    def notices(self, now_ns: int) -> tuple[str, ...]:
        """Return a sentence for each thing that is amiss: the glove, its motors, the speech program."""
        told: list[str] = []
        if self._glove is not None:
            problem = self._glove.problem(now_ns)
            told += [problem] if problem else [*self._glove.notices(), *self._glove.refusals]
        if self._sounds is not None:
            told += self._sounds.notices
        return tuple(told)

    def _say(self, advice: Advice, now_ns: int, interrupts: bool) -> ToldAdvice:
        unfelt = self._feel(advice, now_ns)
        if self._sounds is not None:
            felt = self._glove is not None and not unfelt
            if advice.symbol is Symbol.WARNING and (felt or self._profile.tones):
                self._sounds.keep_quiet(now_ns)
            wording = Wording(self._profile.wording)
            self._sounds.tell(advice_words(advice, wording), advice, now_ns, interrupts)
        return ToldAdvice(advice, advice_words(advice, Wording.FULL), unfelt)

    def _feel(self, advice: Advice, now_ns: int) -> str:
        """Play advice on the glove; return why it is not felt."""
        if self._glove is None:
            return ""
        steps = self._words.pattern(advice).steps()
        return self._glove.play(steps, PRIORITY[advice.symbol], valid_ms(advice, now_ns), now_ns)
