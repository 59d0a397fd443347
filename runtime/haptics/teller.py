"""Tells a rider one piece of advice at a time, by touch, speech, tones and text, alone or together.

Each channel may fail by itself: the glove's trouble, or a missing speech program, becomes a notice, and the others go on.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from waychair.control.behaviours.commands import Signal, sector_middles
from waychair.control.behaviours.glove import GloveLayout
from waychair.control.haptics.advice import AdviceMemory, advise, valid_ms
from waychair.control.haptics.guide_numbers import VALID_NS
from waychair.control.haptics.paper_preset import PaperMemory, paper_advice, told_as_advice
from waychair.control.haptics.patterns import TouchVocabulary, vocabulary
from waychair.control.haptics.profile import HapticsProfile
from waychair.control.haptics.symbols import PRIORITY, Advice, Symbol
from waychair.control.haptics.words import Wording, advice_words
from waychair.firmware_bridge.glove.bridge import GloveBridge
from waychair.firmware_bridge.glove.messages import PlayStep
from waychair.runtime.haptics.haptic_state import HapticState
from waychair.runtime.haptics.sounds import Sounds

REPEAT_OFFER = "press repeat or yes to hear it again"
"""Sentence with which advice falls silent."""


@dataclass(frozen=True, slots=True)
class ToldAdvice:
    """One tick: the advice that was said, in words for the page, its pattern, and why it was not felt, if it was not.

    `offer`: the sentence with which advice fell silent; `repeats` and `yes`: presses of the glove's buttons.
    """

    said: Advice | None = None
    text: str = ""
    steps: tuple[PlayStep, ...] = ()
    unfelt: str = ""
    offer: str = ""
    yes: int = 0
    repeats: int = 0


class Teller:
    """One rider's channels. `memory` knows the last symbol said, `notices` what is amiss now."""

    def __init__(
        self,
        profile: HapticsProfile,
        glove: GloveBridge | None,
        sounds: Sounds | None,
        words: TouchVocabulary | None = None,
    ) -> None:
        """`glove` and `sounds` are None where there are none; `words` are the shipped patterns of the layout by default.

        Raises:
            GloveError: the layout is not known.
            PatternError: its patterns are impossible.
        """
        self.memory = AdviceMemory()
        self._profile = profile
        self._glove = glove if profile.touch else None
        self._sounds = sounds
        self._words = words or vocabulary(profile.layout)
        self._paper = PaperMemory()
        self._signals = 0

    def tick(
        self, wanted: Sequence[Advice], now_ns: int, *, asked: bool = False, reacted: bool | None = None
    ) -> ToldAdvice:
        """Say the advice that is due now; arguments as of `advise`. The glove's button "repeat" asks as well.

        While a rider who feels nothing hears something else, only warnings are due: other advice would not be heard in time.
        """
        yes, repeats = self._begin_tick(now_ns)
        if self.speaks and not self._is_felt(now_ns):
            wanted = [each for each in wanted if each.symbol is Symbol.WARNING]
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

    def tell_as_paper(self, signal: Signal | None, now_ns: int) -> ToldAdvice:
        """Play the signal of the behaviour cells by the paper's own code, when it changes or has held for a while.

        It is felt only: the paper has no words.
        """
        yes, repeats = self._begin_tick(now_ns)
        told = ToldAdvice(yes=yes, repeats=repeats)
        if signal is None:
            return told
        static = GloveLayout(sector_middles(len(signal.classes)))
        play, self._paper = paper_advice(signal, static, self._paper, now_ns)
        if play is None:
            return told
        self._signals += 1
        advice = told_as_advice(signal, self._signals, now_ns + VALID_NS)
        unfelt = self._feel(play.steps, play.priority, valid_ms(advice, now_ns), now_ns)
        return replace(told, said=advice, text=advice.reason, steps=play.steps, unfelt=unfelt)

    @property
    def as_paper(self) -> bool:
        """Whether this rider feels the paper's own signals."""
        return self._profile.as_paper

    def _begin_tick(self, now_ns: int) -> tuple[int, int]:
        """Run glove and sounds; return the presses of the glove's buttons "yes" and "repeat"."""
        if self._sounds is not None:
            self._sounds.tick(now_ns)
        if self._glove is None:
            return 0, 0
        self._glove.tick(now_ns, armed=True)
        return self._glove.presses.yes, self._glove.presses.repeat

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

    @property
    def speaks(self) -> bool:
        """Whether something is spoken or played now, or waits to be."""
        return self._sounds is not None and self._sounds.busy

    def _is_felt(self, now_ns: int) -> bool:
        """Return whether there is a glove in order."""
        return self._glove is not None and not self._glove.problem(now_ns)

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
        felt = () if told.unfelt or self._glove is None else told.steps
        return replace(
            shown,
            symbol=told.said.symbol.value,
            text=told.text,
            count=before.count + 1,
            play=tuple((step.motors, step.on_ms, step.off_ms) for step in felt),
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
        steps = self._words.pattern(advice).steps()
        unfelt = self._feel(steps, PRIORITY[advice.symbol], valid_ms(advice, now_ns), now_ns)
        if self._sounds is not None and not (advice.spoken and self._sounds.speech):
            felt = self._glove is not None and not unfelt
            if advice.symbol is Symbol.WARNING and (felt or self._profile.tones):
                self._sounds.keep_quiet(now_ns)
            wording = Wording(self._profile.wording)
            self._sounds.tell(advice_words(advice, wording), advice, now_ns, interrupts)
        text = advice.reason if advice.spoken else advice_words(advice, Wording.FULL)
        return ToldAdvice(advice, text, steps, unfelt)

    def _feel(self, steps: tuple[PlayStep, ...], priority: int, valid: int, now_ns: int) -> str:
        """Play a pattern on the glove if it can begin within `valid` [ms]; return why it is not felt."""
        return "" if self._glove is None else self._glove.play(steps, priority, valid, now_ns)
