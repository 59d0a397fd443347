"""A simulated driver without sight whom nobody tells anything: ahead until the chair stands, a little back, a turn by chance.

The baseline of guidance. Such a driver feels the chair's own motion as everybody does, and nothing else. All times are
assumptions.
"""

from __future__ import annotations

import enum
import math

import numpy as np

from waychair.simulation.rider.hand import HandModel, StickHand
from waychair.types import JoystickInput, Twist

STANDS, NOTICED_S = 0.03, 1.0
"""m/s and s: after so long at rest against a push, something is in the way."""

STARTS_S, BACKS_S = 1.0, 1.5
"""s that a push needs to move the chair, and s of backing out."""

TURNS_S = (0.6, 3.0)
"""s; least and longest turn by chance."""


class _Does(enum.Enum):
    AHEAD = "ahead"
    BACK = "back"
    TURN = "turn"


class LoneDriver:
    """The driver; `step` once for every control step."""

    def __init__(self, hand: HandModel | None = None, seed: int = 0) -> None:
        self._model = hand or HandModel()
        choice, motion = (np.random.default_rng(each) for each in np.random.SeedSequence(seed).spawn(2))
        self._choice, self._hand = choice, StickHand(self._model, motion)
        self._does, self._until_s = _Does.AHEAD, math.inf
        self._moved_s = 0.0  # the last time at which the chair moved, or had not yet had the time to
        self._now_s: float | None = None

    def step(self, now_ns: int, felt: Twist) -> JoystickInput:
        """Feel the chair's twist and return the stick."""
        now_s = now_ns * 1e-9
        if self._now_s is None:
            self._now_s = now_s
            self._begin(_Does.AHEAD, now_s)
        step_s, self._now_s = now_s - self._now_s, now_s
        if abs(felt.v) > STANDS:
            self._moved_s = max(self._moved_s, now_s)
        if self._does is _Does.AHEAD:
            if now_s - self._moved_s > NOTICED_S:
                self._begin(_Does.BACK, now_s)
        elif now_s >= self._until_s:
            self._begin(_Does.TURN if self._does is _Does.BACK else _Does.AHEAD, now_s)
        forward, turn = self._hand.step(step_s) if step_s > 0.0 else (0.0, 0.0)
        return JoystickInput(now_ns, forward, turn)

    def _begin(self, does: _Does, now_s: float) -> None:
        """Move the hand, and choose for how long."""
        m, self._does = self._model, does
        if does is _Does.AHEAD:
            self._hand.hold(m.forward, 0.0)
            self._until_s, self._moved_s = math.inf, now_s + STARTS_S
        elif does is _Does.BACK:
            self._hand.hold(-m.back, 0.0)
            self._until_s = now_s + BACKS_S
        else:
            self._hand.hold(0.0, float(self._choice.choice([-1.0, 1.0])) * m.swivel)
            self._until_s = now_s + float(self._choice.uniform(*TURNS_S))
