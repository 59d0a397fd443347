"""The unit and the origin of the times that a lidar's driver gives for each point of a cloud.

Drivers give seconds, microseconds or nanoseconds, since the cloud's stamp, before it, or since an epoch of their own clock.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from waychair.recordings.plausibility.sweep_readings import LONGEST, SHORTEST
from waychair.types import FloatArray

_UNITS = {1.0: "seconds", 1e-3: "milliseconds", 1e-6: "microseconds", 1e-9: "nanoseconds"}
_SLACK = 1.1  # a sweep may last so much longer than the time to the next cloud, by jitter
_WHOLE = 0.4  # of the time between clouds; the usual least duration of a sweep
_NEAR_S = 10.0  # s; an absolute time so near to the stamp comes from the same clock


@dataclass(frozen=True, slots=True)
class PointTimes:
    """How the times of points are read: `unit` [s]; `absolute` ones count from the stamps' epoch, `foreign` ones from another."""

    unit: float
    absolute: bool = False
    foreign: bool = False

    def seconds(self, times: FloatArray, stamp_ns: int) -> FloatArray:
        """Return the times (N,) [s] after the stamp; the first point of a foreign clock is taken to be at the stamp."""
        if self.foreign:
            return np.asarray((times - times.min(initial=np.inf)) * self.unit, np.float64)
        if not self.absolute:
            return np.asarray(times * self.unit, np.float64)
        return np.asarray((times - stamp_ns * 1e-9 / self.unit) * self.unit, np.float64)

    def text(self) -> str:
        """Return the reading in words."""
        origin = (
            "on another clock" if self.foreign else "since the epoch" if self.absolute else "since the cloud's stamp"
        )
        return f"{_UNITS[self.unit]} {origin}"


def point_times(clouds: Sequence[tuple[int, FloatArray]], interval: float) -> PointTimes | None:
    """Return how the times of some clouds are read; None if no unit gives a sweep that fits between two clouds.

    Args:
        clouds: stamp [ns] and times (N,) as told, of each.
        interval: [s] between clouds; 0 if unknown.
    """
    filled = [(stamp_ns, times) for stamp_ns, times in clouds if len(times)]
    if not filled:
        return None
    spread = float(np.median([np.ptp(times) for _, times in filled]))
    longest = min(_SLACK * interval, LONGEST) if interval > 0.0 else LONGEST
    fitting = [unit for unit in _UNITS if SHORTEST <= spread * unit <= longest]
    likely = [unit for unit in fitting if spread * unit >= _WHOLE * interval] or fitting
    if not likely:
        return None
    unit = likely[0]
    away = float(np.median([abs(np.median(times) * unit - stamp_ns * 1e-9) for stamp_ns, times in filled]))
    size = float(np.median([np.abs(times).max() for _, times in filled])) * unit
    if size <= 2.0 * longest:
        return PointTimes(unit)
    return PointTimes(unit, absolute=True) if away < _NEAR_S else PointTimes(unit, foreign=True)
