"""Scans as their messages tell them, before anything in them is believed."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from waychair.types import Float32Array

MOST_BEAMS = 100_000
"""A scan with more beams is damaged: the finest lidars have 36,000."""


@dataclass(frozen=True, slots=True)
class ToldScan:
    """The fields of a sensor_msgs/LaserScan; units are those that the message should have.

    `stamp_ns` of the first beam; ranges (N,) float32 [m]; angles [rad]; `time_increment` and `scan_time` [s].
    """

    stamp_ns: int
    ranges: Float32Array
    angle_min: float
    angle_max: float
    angle_increment: float
    time_increment: float = 0.0
    scan_time: float = 0.0
    range_min: float = 0.0
    range_max: float = math.inf

    @property
    def steps(self) -> int:
        """Return the number of steps from the first beam to the last one."""
        return len(self.ranges) - 1

    @property
    def shape(self) -> tuple[int, float, float, float]:
        """Return the number of beams, and the angles as told: equal for all sound scans of most lidars."""
        return len(self.ranges), self.angle_min, self.angle_max, self.angle_increment

    def distances(self) -> Float32Array:
        """Return the finite ranges above zero (K,) [m]."""
        usable: Float32Array = self.ranges[np.isfinite(self.ranges) & (self.ranges > 0.0)]
        return usable
