"""A chair of exactly the fitted form, plus noise, with known parameters for a calibration to find."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from waychair.calibration.fits.axis_model import AxisModel, AxisSide
from waychair.calibration.fits.fitted_dac import FittedDac
from waychair.calibration.fits.sweep import Sample

STEP_S = 0.01

TRUE = FittedDac(
    bits=12,
    volts_max=3.3,
    track=0.54,
    forward=AxisModel(
        neutral=1.64,
        sign=1,
        above=AxisSide(dead_band=0.09, gain=1.1, curve=0.15, limit=1.30),
        below=AxisSide(dead_band=0.11, gain=0.9, curve=-0.10, limit=0.75),
        delay_s=0.08,
        lag_s=0.16,
        ramp=0.9,
    ),
    turn=AxisModel(
        neutral=1.66,
        sign=-1,
        above=AxisSide(dead_band=0.10, gain=2.4, curve=-0.3, limit=2.2),
        below=AxisSide(dead_band=0.08, gain=2.0, curve=0.2, limit=2.3),
        delay_s=0.06,
        lag_s=0.20,
        ramp=3.0,
    ),
    v_per_turn=-0.011,
    turn_per_v=-0.10,
    turn_fade=0.15,
)

NEUTRAL = (TRUE.forward.neutral, TRUE.turn.neutral)


class SyntheticChair:
    """A `Drive`: each axis follows the model with delay, ramp and lag; the measurements have white noise."""

    def __init__(self, model: FittedDac = TRUE, noise: tuple[float, float] = (0.01, 0.02), seed: int = 0) -> None:
        self.now_ns = 0
        self._model = model
        self._noise = noise
        self._rng = np.random.default_rng(seed)
        self._axes = (model.forward, model.turn)
        self._on_the_way = tuple(deque([0.0] * round(axis.delay_s / STEP_S)) for axis in self._axes)
        self._ramped = [0.0, 0.0]
        self._reached = [0.0, 0.0]

    def hold(self, forward_volts: float, turn_volts: float, seconds: float) -> list[Sample]:
        """Return samples at 50 Hz."""
        samples = []
        for step in range(round(seconds / STEP_S)):
            for k, (axis, volts) in enumerate(zip(self._axes, (forward_volts, turn_volts), strict=True)):
                self._on_the_way[k].append(axis.speed(volts))
                change = self._on_the_way[k].popleft() - self._ramped[k]
                self._ramped[k] += max(-axis.ramp * STEP_S, min(axis.ramp * STEP_S, change))
                self._reached[k] += (1.0 - math.exp(-STEP_S / axis.lag_s)) * (self._ramped[k] - self._reached[k])
            self.now_ns += round(STEP_S * 1e9)
            if step % 2:
                samples.append(self._sample())
        return samples

    def _sample(self) -> Sample:
        twist = self._model.twist_from_axis_speeds(self._reached[0], self._reached[1])
        a, b = self._rng.standard_normal(2) * self._noise
        # stamped in the middle of its 20 ms, like the speed of an encoder
        return Sample(self.now_ns - round(STEP_S * 1e9), twist.v + a, twist.omega + b)
