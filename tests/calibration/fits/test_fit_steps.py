"""Steps: the closed form against integration, and known parameters found from simulated steps."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from waychair.calibration.fits.fit_steps import StepResponse, step_response


@given(st.floats(0.0, 0.3), st.floats(0.05, 0.5), st.floats(0.2, 5.0), st.floats(0.1, 1.5))
def test_the_closed_form_is_a_ramp_through_a_lag(delay: float, lag: float, ramp: float, final: float) -> None:
    step, ramped, reached = 0.0005, 0.0, 0.0
    seconds, expected = np.arange(0.0, 2.0, step), []
    for second in seconds:
        expected.append(reached)
        if second >= delay:
            ramped = min(final, ramped + ramp * step)
        reached += (1.0 - math.exp(-step / lag)) * (ramped - reached)
    found = step_response(seconds, np.full(len(seconds), final), delay, lag, ramp)
    assert np.abs(found - expected).max() < 2.0 * ramp * step + 1e-6


def test_after_the_settling_time_the_speed_is_held_to_one_percent() -> None:
    response = StepResponse(0.1, 0.2, 0.9)
    for speed in (0.1, 0.5, 1.4):
        at = np.array([response.settling_s(speed)])
        assert step_response(at, np.array([speed]), 0.1, 0.2, 0.9)[0] == pytest.approx(speed, rel=0.01)
