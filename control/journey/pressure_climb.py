"""The height by which a chair was lifted, by a barometer: the pressure before a ride and now, each a mean over a while."""

from __future__ import annotations

import math
from collections import deque

from waychair.control.journey.which_storey import climb_from_pressure
from waychair.types import PressureSample

MEAN_S = 1.5
"""s; time over which the pressure is averaged: white noise of 1.5 Pa at 10 Hz leaves 0.4 Pa, 3 cm."""

LEAST = 5
"""Fewest samples of a mean."""

LOWEST, HIGHEST = 30_000.0, 120_000.0
"""Pa; a reading outside is an error (BMP388: 30 to 125 kPa; 120 kPa is 1.4 km below the sea)."""


class PressureClimb:
    """The climb since `begin`; it hears the samples all the time."""

    def __init__(self) -> None:
        self._recent: deque[PressureSample] = deque()
        self._before: tuple[int, float] | None = None

    def hear(self, sample: PressureSample) -> None:
        """Take in a sample; one that is no pressure of air is left out."""
        if not (math.isfinite(sample.pascal) and LOWEST <= sample.pascal <= HIGHEST):
            return
        self._recent.append(sample)
        while sample.stamp_ns - self._recent[0].stamp_ns > MEAN_S * 1e9:
            self._recent.popleft()

    def begin(self, now_ns: int) -> None:
        """Count the climb from here."""
        self._before = self._mean(now_ns)

    def climb(self, now_ns: int) -> tuple[float, float] | None:
        """Return the climb [m] since `begin` and its standard deviation [m]; None without fresh samples then and now."""
        now = self._mean(now_ns)
        if self._before is None or now is None:
            return None
        return climb_from_pressure(self._before[1], now[1], (now[0] - self._before[0]) * 1e-9)

    def _mean(self, now_ns: int) -> tuple[int, float] | None:
        fresh = [each for each in self._recent if 0 <= now_ns - each.stamp_ns <= 2 * MEAN_S * 1e9]
        if len(fresh) < LEAST:
            return None
        return fresh[-1].stamp_ns, sum(each.pascal for each in fresh) / len(fresh)
