"""Ride comfort: the weighting of ISO 2631-1, hard stops, and commanded beside actual jerk."""

from __future__ import annotations

import math

import numpy as np
import pytest

from waychair.control.speed.limiter import LimiterSettings
from waychair.trials.ride import Ride, TrueMotion, ride_of, weighted
from waychair.types import FloatArray

LIMITS = LimiterSettings()
SECONDS = np.arange(0.0, 12.0, 0.01)


def ride(v: FloatArray, told: FloatArray | None = None) -> Ride:
    """Return the comfort figures of a straight drive at v (T,) [m/s], sampled every 10 ms."""
    stamps = np.round(1e9 * SECONDS).astype(np.int64)
    twists = np.column_stack([v, np.zeros(len(v))])
    return ride_of(
        TrueMotion(stamps, np.zeros((len(v), 3)), twists, np.full(len(v), math.inf), v if told is None else told)
    )


def stopping(braking: float) -> FloatArray:
    """Return speeds with a gentle start, 0.8 m/s, and a stop at 8 s."""
    return np.clip(np.minimum(0.2 * SECONDS, 0.8 - braking * (SECONDS - 8.0)), 0.0, 0.8)


@pytest.mark.parametrize(("hertz", "weight"), [(0.5, 0.853), (1.0, 1.011), (2.0, 0.890), (4.0, 0.512), (8.0, 0.253)])
def test_accelerations_are_weighted_by_the_table_of_the_standard(hertz: float, weight: float) -> None:
    seconds = np.arange(0.0, 60.0, 0.01)
    felt = weighted(np.sin(math.tau * hertz * seconds))[2000:]
    assert math.sqrt(2.0 * (felt**2).mean()) == pytest.approx(weight, rel=0.03)


def test_a_comfortable_stop_counts_as_jerk_and_a_hard_one_as_a_hard_stop() -> None:
    gentle, hard = ride(stopping(LIMITS.braking)), ride(stopping(LIMITS.emergency))
    assert gentle.hard_stops == 0
    assert hard.hard_stops == 1
    assert gentle.jerk > 1.0  # braking starts and ends abruptly
    assert hard.jerk < 1.0  # only the start counts
    assert hard.slowing_down > gentle.slowing_down
    assert hard.dose > gentle.dose
    assert hard.above_a_little >= hard.above_fairly


def test_jerk_added_by_the_chair_is_shown_beside_the_commanded_jerk() -> None:
    told = 0.4 * (1.0 - np.cos(math.tau * SECONDS / 12.0))
    shaken = ride(told + 0.02 * np.sin(math.tau * SECONDS), told)
    assert shaken.jerk_told < 0.2
    assert shaken.jerk > 0.5
    assert shaken.weighted_rms == pytest.approx(0.02 * math.tau * 1.011 / math.sqrt(2.0), rel=0.1)
