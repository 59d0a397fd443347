"""Several drives together are judged by their extremes and their mean over time."""

from __future__ import annotations

import pytest
from evaluation.scenes.worst_ride import worst_of

from tests.trials.test_ride import ride, stopping
from waychair.control.speed.limiter import LimiterSettings

LIMITS = LimiterSettings()


def test_rides_are_weighted_by_their_duration() -> None:
    gentle, hard = ride(stopping(LIMITS.braking)), ride(stopping(LIMITS.emergency))
    worst = worst_of([gentle, hard, hard])
    assert worst.hard_stops == 2
    assert worst.dose == hard.dose
    assert (
        min(gentle.weighted_rms, hard.weighted_rms) <= worst.weighted_rms <= max(gentle.weighted_rms, hard.weighted_rms)
    )
    assert worst_of([gentle]).above_a_little == pytest.approx(gentle.above_a_little)
