"""Sonar echoes that another one bears out: a ping of another's, heard by chance, is not something that stands there.

The rule that consecutive ranges have to agree is that of error-eliminating rapid ultrasonic firing (Borenstein and
Koren, IEEE Transactions on Robotics and Automation 11(1), 1995), without its changes of the firing order.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace

import numpy as np

from waychair.config import Settings, setting
from waychair.types import SonarReadings


@dataclass(frozen=True, slots=True)
class EchoSettings(Settings):
    """When two echoes of a sonar are taken to come from the same thing."""

    agree: float = setting(
        0.15, "m", "echoes of one thing differ by no more: noise, and the chair's way", low=0.01, high=1
    )
    within_s: float = setting(0.25, "s", "and come within this time", low=0.02, high=2.0)


class Echoes:
    """Remembers what each sonar said last."""

    def __init__(self, settings: EchoSettings) -> None:
        self._settings = settings
        self._before: deque[SonarReadings] = deque()

    def borne_out(self, readings: SonarReadings) -> SonarReadings:
        """The readings with nan, which says nothing, for echoes that the sonar has not heard a moment before as well.

        No echo (+inf) and too near a one (-inf) need no other.
        """
        s, before = self._settings, self._before
        while before and not 0 < readings.stamp_ns - before[0].stamp_ns <= s.within_s * 1e9:
            before.popleft()
        ranges = readings.ranges
        again = np.zeros(len(ranges), np.bool_)
        for earlier in before:
            with np.errstate(invalid="ignore"):  # of two infinities
                again |= np.abs(ranges - earlier.ranges) <= s.agree
        before.append(readings)
        return replace(readings, ranges=np.where(np.isfinite(ranges) & ~again, np.float32(np.nan), ranges))
