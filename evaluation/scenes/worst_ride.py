"""Comfort figures of several drives together, and the limiter's limits beside them."""

from __future__ import annotations

from collections.abc import Sequence

from waychair.control.speed.limiter import LimiterSettings
from waychair.trials.ride import STILL, Ride
from waychair.types import Json


def worst_of(rides: Sequence[Ride]) -> Ride:
    """Return the figures of several drives: their extremes, and the r.m.s. over their whole time in motion."""
    time = sum(ride.moving_s for ride in rides)
    if not time:
        return STILL

    def mean(name: str, power: int = 1) -> float:
        """Return the power mean of a figure, weighted by time in motion."""
        return float((sum(ride.moving_s * getattr(ride, name) ** power for ride in rides) / time) ** (1.0 / power))

    extremes = ("speeding_up", "slowing_down", "sideways", "jerk", "jerk_p99", "jerk_told", "dose")
    return Ride(
        moving_s=time,
        rms=mean("rms", 2),
        weighted_rms=mean("weighted_rms", 2),
        above_a_little=mean("above_a_little"),
        above_fairly=mean("above_fairly"),
        hard_stops=sum(ride.hard_stops for ride in rides),
        **{name: max(float(getattr(ride, name)) for ride in rides) for name in extremes},
    )


def limits_row(settings: LimiterSettings) -> Json:
    """Return the row of the limiter's limits, with the emergency deceleration."""
    return {
        "scene": "limits",
        "speeding_up": settings.acceleration,
        "slowing_down": settings.braking,
        "slowing_down_emergency": settings.emergency,
        "sideways": settings.lateral,
        "jerk": settings.jerk,
    }
