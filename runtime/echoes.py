"""A filter against sonar crosstalk: an echo counts only if a second one at nearly the same range confirms it.

Consecutive ranges have to agree as in error-eliminating rapid ultrasonic firing (Borenstein and Koren, IEEE
Transactions on Robotics and Automation 11(1), 1995), without its changes of the firing order.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace

import numpy as np

from waychair.config import Settings, setting
from waychair.types import SonarReadings


@dataclass(frozen=True, slots=True)
class EchoSettings(Settings):
    """When two echoes of a sonar count as echoes of the same thing."""

    agree: float = setting(
        0.15, "m", "echoes of one thing differ by no more: noise, and the chair's way", low=0.01, high=1
    )
    within_s: float = setting(0.25, "s", "and come within this time", low=0.02, high=2.0)


class EchoFilter:
    """Keeps the latest readings of each sonar."""

    def __init__(self, settings: EchoSettings) -> None:
        self._settings = settings
        self._before: deque[SonarReadings] = deque()

    def confirmed(self, readings: SonarReadings) -> SonarReadings:
        """Return the readings with nan (no information) for echoes that no earlier reading of the sonar confirms.

        No echo (+inf) and an echo below the least range (-inf) need no confirmation.
        """
        s, before = self._settings, self._before
        while before and not 0 < readings.stamp_ns - before[0].stamp_ns <= s.within_s * 1e9:
            before.popleft()
        ranges = readings.ranges
        again = np.zeros(len(ranges), np.bool_)
        for earlier in before:
            with np.errstate(invalid="ignore"):  # inf - inf
                again |= np.abs(ranges - earlier.ranges) <= s.agree
        before.append(readings)
        return replace(readings, ranges=np.where(np.isfinite(ranges) & ~again, np.float32(np.nan), ranges))
