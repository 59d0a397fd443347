"""A filter against sonar crosstalk: an echo counts only if a second one at nearly the same range confirms it.

Consecutive ranges have to agree as in error-eliminating rapid ultrasonic firing (Borenstein and Koren, IEEE
Transactions on Robotics and Automation 11(1), 1995), without its changes of the firing order.
"""

from __future__ import annotations

from collections import deque
from dataclasses import replace

import numpy as np

from waychair.types import SonarReadings

_SAME_RANGE = 0.15  # m; greatest difference between two echoes of one thing: noise and the chair's motion
_SAME_TIME_S = 0.25  # s; greatest time between two echoes of one thing


class EchoFilter:
    """Keeps the latest readings of each sonar."""

    def __init__(self) -> None:
        self._before: deque[SonarReadings] = deque()

    def confirmed(self, readings: SonarReadings) -> SonarReadings:
        """Return the readings with nan (no information) for echoes that no earlier reading of the sonar confirms.

        No echo (+inf) and an echo below the least range (-inf) need no confirmation.
        """
        before = self._before
        while before and not 0 < readings.stamp_ns - before[0].stamp_ns <= _SAME_TIME_S * 1e9:
            before.popleft()
        ranges = readings.ranges
        again = np.zeros(len(ranges), np.bool_)
        for earlier in before:
            with np.errstate(invalid="ignore"):  # inf - inf
                again |= np.abs(ranges - earlier.ranges) <= _SAME_RANGE
        before.append(readings)
        return replace(readings, ranges=np.where(np.isfinite(ranges) & ~again, np.float32(np.nan), ranges))
