"""The hand on the stick: amplitudes, bias, wander, and the drift of a hand that cannot see where straight ahead is.

All deflections are shares of the swing, turn to the left positive. The figures are assumptions of the trials in which this
guidance was worked out, not measured on drivers.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, slots=True)
class HandModel:
    """A hand. `spread` is the error of each amplitude, one sigma, as a share of it.

    `bias` is the constant sideways push of a hand that holds the stick, `wander` its slow change (one sigma, over `wander_s`),
    `drift` the random walk per square root of a second of the direction that the hand takes for straight; the spring of a
    stick that is let go sets it right again. `lag_s` is the time in which the stick follows.
    """

    forward: float = 0.26
    back: float = 0.22
    swivel: float = 0.23
    nudge: float = 0.15
    nudge_s: float = 0.2
    spread: float = 0.12
    bias: float = 0.025
    wander: float = 0.03
    wander_s: float = 2.0
    drift: float = 0.002
    lag_s: float = 0.06


class StickHand:
    """A hand that moves the stick; `step` once for every control step of the driver."""

    def __init__(self, model: HandModel, rng: np.random.Generator) -> None:
        self._model, self._rng = model, rng
        self._bias = rng.normal(0.0, model.bias, 2)
        self._wander = rng.normal(0.0, model.wander, 2)
        self._drift = 0.0
        self._at = np.zeros(2)
        self._wanted = np.zeros(2)
        self._nudge = (0.0, 0)  # deflection, and steps left

    @property
    def holds(self) -> bool:
        """Whether the hand pushes the stick."""
        return bool(self._wanted.any()) or self._nudge[1] > 0

    def hold(self, forward: float, turn: float) -> None:
        """Push the stick to these deflections, as well as this hand can."""
        self._wanted = np.array([forward, turn]) * (1.0 + self._model.spread * self._rng.standard_normal())

    def let_go(self) -> None:
        """Let the stick spring back."""
        self._wanted, self._nudge = np.zeros(2), (0.0, 0)

    def nudge(self, side: float, step_s: float) -> None:
        """Push the stick to a side (1 left, -1 right) for a moment, whatever else it does."""
        size = self._model.nudge * (1.0 + self._model.spread * self._rng.standard_normal())
        lasts = self._model.nudge_s * (1.0 + self._model.spread * self._rng.standard_normal())
        self._nudge = side * max(size, 0.0), max(1, round(lasts / step_s))

    def step(self, step_s: float) -> tuple[float, float]:
        """Return the stick's deflections (forward, turn) after a step."""
        m, keep = self._model, math.exp(-step_s / self._model.wander_s)
        self._wander = keep * self._wander + math.sqrt(1.0 - keep * keep) * self._rng.normal(0.0, m.wander, 2)
        target = self._wanted.copy()
        push, left = self._nudge
        if left > 0:
            target[1] += push
            self._nudge = push, left - 1
        if self.holds:
            self._drift += m.drift * math.sqrt(step_s) * float(self._rng.standard_normal())
            target += self._bias + self._wander
            target[1] += self._drift
        else:
            self._drift = 0.0
        self._at += (1.0 - math.exp(-step_s / m.lag_s)) * (target - self._at)
        if not self.holds and float(np.abs(self._at).max()) < _AT_REST:
            self._at[:] = 0.0
        forward, turn = np.clip(self._at, -1.0, 1.0).tolist()
        return forward, turn


_AT_REST = 0.01
"""A stick that is let go rests at neutral."""
