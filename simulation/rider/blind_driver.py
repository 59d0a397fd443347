"""A simulated driver without sight: feels the glove's motors and nothing else, understands, reacts, and moves the stick.

It neither reads the truth nor any message of the computer. The levels of the glove's program on this computer are its only
input, so protocol, queue and interruption of the glove are part of every trial. Simulated drivers are not blind drivers:
trials with them show faults of the guidance, never that it helps a person.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, TypeAlias

import numpy as np

from waychair.firmware_bridge.glove.layouts import TactorLayout
from waychair.firmware_bridge.glove.levels import MotorLevels
from waychair.firmware_bridge.glove.messages import PlayStep
from waychair.simulation.rider.hand import HandModel, StickHand
from waychair.simulation.rider.skin import FeltBurst, Recogniser, Skin, SkinModel
from waychair.types import JoystickInput

Learnt: TypeAlias = Mapping[str, tuple[PlayStep, ...]]
"""The patterns that a driver has learnt, by the name of the symbol."""

Answer: TypeAlias = Literal[
    "forward", "back", "swivel_left", "swivel_right", "nudge_left", "nudge_right", "stop", "nothing"
]

ANSWERS: Mapping[str, Answer] = {
    "forward": "forward",
    "back": "back",
    "swivel_left": "swivel_left",
    "swivel_right": "swivel_right",
    "nudge_left": "nudge_left",
    "nudge_right": "nudge_right",
    "warning": "stop",
    "arrived": "stop",
}
"""What a driver does about each symbol; every other one is listened to only."""


@dataclass(frozen=True, slots=True)
class DriverModel:
    """A driver. Times in s, from the end of a pattern; `sure` is the share of symbols that the mind does not mix up.

    `warnings_felt` is the share of warnings that are noticed. After `patience_s` of silence the driver lets go of the stick.
    """

    skin: SkinModel = field(default_factory=SkinModel)
    hand: HandModel = field(default_factory=HandModel)
    reaction_s: float = 0.45
    reaction_spread_s: float = 0.12
    startle_s: float = 0.32
    startle_spread_s: float = 0.07
    sure: float = 1.0
    warnings_felt: float = 1.0
    patience_s: float = 3.0


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
        self._names = [name for name in learnt if name in ANSWERS and ANSWERS[name] != "stop"]
        self._hand = StickHand(m.hand, streams[1])
        self._waiting: list[Felt] = []
        self._heard_ns: int | None = None
        self._now_ns: int | None = None
        self.felt: list[Felt] = []

    def step(self, now_ns: int, levels: MotorLevels) -> JoystickInput:
        """Feel the levels of the milliseconds since the last step, and return the stick."""
        pattern = self._skin.feel(levels)
        if pattern is not None:
            self._understand(pattern, self._skin.ended_ms * 1_000_000)
        step_s = 0.0 if self._now_ns is None else (now_ns - self._now_ns) * 1e-9
        self._now_ns = now_ns
        for felt in [each for each in self._waiting if each.reacts_ns <= now_ns]:
            self._waiting.remove(felt)
            self._act(felt, step_s)
        if self._heard_ns is not None and now_ns - self._heard_ns > self.model.patience_s * 1e9:
            self._hand.let_go()
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
        hand, m = self._hand, self.model.hand
        self._heard_ns = felt.reacts_ns
        answer = ANSWERS.get(felt.symbol or "", "nothing")
        if answer == "stop":
            hand.let_go()
        elif answer == "forward":
            hand.hold(m.forward, 0.0)
        elif answer == "back":
            hand.hold(-m.back, 0.0)
        elif answer in ("swivel_left", "swivel_right"):
            hand.hold(0.0, m.swivel if answer == "swivel_left" else -m.swivel)
        elif answer in ("nudge_left", "nudge_right"):
            hand.nudge(1.0 if answer == "nudge_left" else -1.0, max(step_s, 1e-3))
