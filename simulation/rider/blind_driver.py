"""A simulated driver without sight: feels the glove's motors and nothing else, understands, reacts, and moves the stick.

It neither reads the truth nor any message of the computer. The levels of the glove's program on this computer are its only
input, so protocol, queue and interruption of the glove are part of every trial. Simulated drivers are not blind drivers:
trials with them show faults of the guidance, never that it helps a person.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np

from waychair.firmware_bridge.glove.layouts import TactorLayout
from waychair.firmware_bridge.glove.levels import MotorLevels
from waychair.firmware_bridge.glove.messages import PlayStep
from waychair.simulation.rider.hand import HandModel, StickHand
from waychair.simulation.rider.skin import FeltBurst, Recogniser, Skin, SkinModel
from waychair.types import JoystickInput

Learnt: TypeAlias = Mapping[str, tuple[PlayStep, ...]]
"""The patterns that a driver has learnt, by the name of the symbol."""


@dataclass(frozen=True, slots=True)
class Answer:
    """What a driver does about a symbol: hold the stick so far ahead and to the left, in shares of the hand's own amplitudes, or
    push it aside for a moment (`nudge`, 1 left). All at rest: let go."""

    forward: float = 0.0
    turn: float = 0.0
    nudge: float = 0.0


_EIGHT = ("forward", "front-left", "left", "rear-left", "back", "rear-right", "right", "front-right")
"""The source paper's words of eight directions, to the left."""

ANSWERS: Mapping[str, Answer] = {
    "forward": Answer(1.0),
    "back": Answer(-1.0),
    "swivel_left": Answer(turn=1.0),
    "swivel_right": Answer(turn=-1.0),
    "nudge_left": Answer(nudge=1.0),
    "nudge_right": Answer(nudge=-1.0),
    "warning": Answer(),
    "arrived": Answer(),
    "swivel counter-clockwise": Answer(turn=1.0),
    "swivel clockwise": Answer(turn=-1.0),
    **{f"go {word}": Answer(math.cos(k * math.pi / 4), math.sin(k * math.pi / 4)) for k, word in enumerate(_EIGHT)},
}
"""What a driver does about each symbol, of this chair's vocabulary and of the source paper's; every other one is listened to only."""


@dataclass(frozen=True, slots=True)
class DriverModel:
    """A driver. Times in s, from the end of a pattern; `sure` is the share of symbols that the mind does not mix up.

    `warnings_felt` is the share of warnings that are noticed. `obeys`: 1 does what a symbol asks for, -1 the opposite, and 0 holds the
    stick at rest. After `patience_s` of silence the driver lets go of the stick, and
    after `tries_s` at rest pushes ahead by their own wish.
    """

    skin: SkinModel = field(default_factory=SkinModel)
    hand: HandModel = field(default_factory=HandModel)
    reaction_s: float = 0.45
    reaction_spread_s: float = 0.12
    startle_s: float = 0.32
    startle_spread_s: float = 0.07
    sure: float = 1.0
    warnings_felt: float = 1.0
    obeys: float = 1.0
    patience_s: float = 3.0
    tries_s: float = math.inf


_SOONEST_S = 0.15
"""s; nobody reacts sooner."""


@dataclass(frozen=True, slots=True)
class Felt:
    """One pattern as the driver took it: end of the pattern, the symbol (None: not understood), time of the reaction."""

    ended_ns: int
    symbol: str | None
    reacts_ns: int


class BlindDriver:
    """The driver; `felt` lists all patterns that it took in, in order."""

    def __init__(self, layout: TactorLayout, learnt: Learnt, model: DriverModel | None = None, seed: int = 0) -> None:
        self.model = m = model or DriverModel()
        streams = [np.random.default_rng(each) for each in np.random.SeedSequence(seed).spawn(3)]
        self._mind = streams[2]
        self._skin = Skin(layout, m.skin, streams[0])
        self._recogniser = Recogniser(layout, dict(learnt), m.skin)
        self._names = [name for name in learnt if ANSWERS.get(name, Answer()) != Answer()]
        self._hand = StickHand(m.hand, streams[1])
        self._waiting: list[Felt] = []
        self._heard_ns: int | None = None
        self._now_ns: int | None = None
        self._rests_ns = 0  # since when the hand does not push
        self.felt: list[Felt] = []

    def step(self, now_ns: int, levels: MotorLevels) -> JoystickInput:
        """Feel the levels of the milliseconds since the last step, and return the stick."""
        pattern = self._skin.feel(levels)
        if pattern is not None:
            self._understand(pattern, self._skin.ended_ms * 1_000_000)
        if self._now_ns is None:
            self._now_ns = self._rests_ns = now_ns
        step_s = (now_ns - self._now_ns) * 1e-9
        self._now_ns = now_ns
        for felt in [each for each in self._waiting if each.reacts_ns <= now_ns]:
            self._waiting.remove(felt)
            self._act(felt, step_s)
        if self._heard_ns is not None and now_ns - self._heard_ns > self.model.patience_s * 1e9:
            self._hand.let_go()
        if self._hand.holds:
            self._rests_ns = now_ns
        elif now_ns - self._rests_ns > self.model.tries_s * 1e9:
            self._heard_ns = now_ns
            self._hand.hold(self.model.hand.forward, 0.0)
        forward, turn = self._hand.step(step_s) if step_s > 0.0 else (0.0, 0.0)
        return JoystickInput(now_ns, forward, turn)

    def _understand(self, pattern: list[FeltBurst], ended_ns: int) -> None:
        m, rng = self.model, self._mind
        symbol = self._recogniser.recognise(pattern)
        is_warning = symbol == "warning"
        if is_warning and rng.random() >= m.warnings_felt:
            symbol = None
        elif symbol in self._names and rng.random() >= m.sure:
            symbol = str(rng.choice([name for name in self._names if name != symbol]))
        mean, spread = (m.startle_s, m.startle_spread_s) if is_warning else (m.reaction_s, m.reaction_spread_s)
        after_s = max(_SOONEST_S, rng.normal(mean, spread))
        felt = Felt(ended_ns, symbol, ended_ns + round(after_s * 1e9))
        self.felt.append(felt)
        if symbol is not None:
            self._waiting = [] if is_warning else self._waiting
            self._waiting.append(felt)

    def _act(self, felt: Felt, step_s: float) -> None:
        """Do what a symbol asks for; it also tells the driver that somebody is there."""
        hand, m, obeys = self._hand, self.model.hand, self.model.obeys
        self._heard_ns = felt.reacts_ns
        answer = ANSWERS.get(felt.symbol or "")
        if answer is None:
            return
        if answer == Answer():
            hand.let_go()
        elif answer.nudge:
            hand.nudge(obeys * answer.nudge, max(step_s, 1e-3))
        else:
            ahead = obeys * answer.forward
            hand.hold(ahead * (m.forward if ahead > 0.0 else m.back), obeys * answer.turn * m.swivel)
