"""The comfort limits of a drive, and the closed forms of the time that they need."""

from __future__ import annotations

import math
from dataclasses import dataclass

from waychair.control.speed.limiter import LimiterSettings
from waychair.planning.window.motion_limits import DwaSettings


@dataclass(frozen=True, slots=True)
class Comfort:
    """The limits of a drive [m, s, rad]: speeds, accelerations, jerks.

    `speed` forwards, `reverse` backwards, `turn_rate`; `acceleration` when the chair speeds up, `braking` when it slows
    down, `turn_acceleration`, `lateral` (v * omega); `jerk`, `turn_jerk`.
    """

    speed: float
    reverse: float
    turn_rate: float
    acceleration: float
    braking: float
    turn_acceleration: float
    lateral: float
    jerk: float
    turn_jerk: float


def comfort_of(limiter: LimiterSettings | None = None, window: DwaSettings | None = None) -> Comfort:
    """Return the limits that the comfort limiter and the planner's dynamic window allow together."""
    limiter, window = limiter or LimiterSettings(), window or DwaSettings()
    return Comfort(
        speed=min(limiter.max_speed, window.max_speed),
        reverse=min(limiter.max_speed, window.max_reverse),
        turn_rate=min(limiter.max_omega, window.max_omega),
        acceleration=min(limiter.acceleration, window.acceleration),
        braking=min(limiter.braking, window.braking),
        turn_acceleration=min(limiter.alpha, window.alpha),
        lateral=min(limiter.lateral, window.max_lateral),
        jerk=min(limiter.jerk, window.jerk),
        turn_jerk=window.alpha_jerk,
    )


def straight_time(length: float, comfort: Comfort, backwards: bool = False) -> float:
    """Return the least time [s] from rest to rest along a straight line of this length [m] (S-shaped speed profile)."""
    top = comfort.reverse if backwards else comfort.speed
    return rest_to_rest(length, top, comfort.acceleration, comfort.braking, comfort.jerk)


def turn_time(angle: float, comfort: Comfort) -> float:
    """Return the least time [s] from rest to rest for a turn on the spot [rad]."""
    alpha = comfort.turn_acceleration
    return rest_to_rest(abs(angle), comfort.turn_rate, alpha, alpha, comfort.turn_jerk)


def rest_to_rest(length: float, top: float, up: float, down: float, jerk: float) -> float:
    """Return the least time [s] from rest to rest over a length, with limits on speed, both accelerations and jerk.

    A ramp from 0 to a speed v lasts v / a + a / jerk, or 2 sqrt(v / jerk) where a is not reached, and its mean speed is
    v / 2 by symmetry. The highest speed is `top`, or the one at which the two ramps fill the length.
    """
    if length <= 0.0:
        return 0.0

    def ramps(speed: float) -> float:
        return _ramp(speed, up, jerk) + _ramp(speed, down, jerk)

    if top * ramps(top) / 2 <= length:
        return ramps(top) + (length - top * ramps(top) / 2) / top
    low, high = 0.0, top
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if middle * ramps(middle) / 2 < length else (low, middle)
    return ramps(high)


def _ramp(speed: float, acceleration: float, jerk: float) -> float:
    if speed >= acceleration**2 / jerk:
        return speed / acceleration + acceleration / jerk
    return 2.0 * math.sqrt(speed / jerk)
