"""The height of a car during a ride: constant jerk in seven parts, as lift drives are controlled."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

SPEED, ACCELERATION, JERK = 1.0, 0.5, 0.8
"""m/s, m/s^2, m/s^3; largest of a car. ISO 18738-1 measures rides; these are gentle ones of a hospital's lift."""


@dataclass(frozen=True, slots=True)
class RideProfile:
    """A ride of `height` [m], down if negative: durations [s] and jerks [m/s^3] of its parts."""

    height: float
    durations: tuple[float, ...]
    jerks: tuple[float, ...]

    @property
    def seconds(self) -> float:
        """Duration of the ride [s]."""
        return sum(self.durations)

    def at(self, seconds: float) -> tuple[float, float, float]:
        """Return height [m], speed [m/s] and acceleration [m/s^2] after this time; the ends hold beyond."""
        if seconds >= self.seconds:
            return self.height, 0.0, 0.0
        z = v = a = 0.0
        left = max(seconds, 0.0)
        for duration, jerk in zip(self.durations, self.jerks, strict=True):
            t = min(left, duration)
            z += v * t + a * t * t / 2 + jerk * t**3 / 6
            v += a * t + jerk * t * t / 2
            a += jerk * t
            left -= t
            if left <= 0.0:
                break
        return z, v, a


def ride_profile(height: float) -> RideProfile:
    """Return the fastest ride of a height [m] within the limits of a car."""
    way, sign = abs(height), math.copysign(1.0, height)
    speed = SPEED
    if _way_without_cruise(speed) > way:
        low, high = 0.0, SPEED
        for _ in range(60):
            speed = (low + high) / 2
            low, high = (low, speed) if _way_without_cruise(speed) > way else (speed, high)
    ramp = min(ACCELERATION / JERK, math.sqrt(speed / JERK))
    steady = max(0.0, speed / max(JERK * ramp, 1e-12) - ramp)
    cruise = max(0.0, way - _way_without_cruise(speed)) / max(speed, 1e-12)
    jerk = sign * JERK
    durations = (ramp, steady, ramp, cruise, ramp, steady, ramp)
    return RideProfile(height, durations, tuple(np.array([1, 0, -1, 0, -1, 0, 1]) * jerk))


def _way_without_cruise(speed: float) -> float:
    """Return the way [m] up to a speed and back to rest."""
    if speed <= 0.0:
        return 0.0
    full = speed >= ACCELERATION**2 / JERK
    seconds = speed / ACCELERATION + ACCELERATION / JERK if full else 2 * math.sqrt(speed / JERK)
    return speed * seconds
