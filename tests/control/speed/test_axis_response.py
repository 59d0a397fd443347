"""The expected response of an axis: the closed form of calibration's steps, for any ticks."""

from __future__ import annotations

import numpy as np
import pytest

from waychair.calibration.fits.axis_model import AxisModel
from waychair.calibration.fits.fit_steps import step_response
from waychair.control.speed.axis_response import AxisResponse, ExpectedSpeed, response_from_axis
from waychair.types import FloatArray

TICK = 50_000_000


@pytest.mark.parametrize("delay", [0.0, 0.05, 0.083, 0.3])
@pytest.mark.parametrize("lag", [0.1, 0.5])
@pytest.mark.parametrize("ramp", [0.5, 100.0])
def test_the_response_to_a_step_is_that_of_the_calibration(delay: float, lag: float, ramp: float) -> None:
    axis = ExpectedSpeed(AxisResponse(delay, lag, ramp))
    axis.advance(0)
    axis.command(0.8, 0)
    now = []
    for k in range(1, 80):
        axis.advance(k * TICK)
        now.append(axis.now)
    seconds: FloatArray = np.arange(1, 80, dtype=np.float64) * 0.05
    assert now == pytest.approx(step_response(seconds, np.array(0.8), delay, lag, ramp), abs=0.03)
    assert now[-1] == pytest.approx(0.8, abs=0.01)


def test_the_mean_over_a_tick_is_the_speed_that_encoders_measure() -> None:
    fine, coarse = (ExpectedSpeed(AxisResponse(0.07, 0.2)) for _ in range(2))
    for axis in (fine, coarse):
        axis.advance(0)
        axis.command(1.0, 0)
    for k in range(1, 21):
        parts = [fine.advance((k - 1) * TICK + j * TICK // 5) for j in range(1, 6)]
        assert coarse.advance(k * TICK) == pytest.approx(np.mean(parts), abs=1e-9)


def test_a_command_that_is_replaced_at_once_is_never_followed() -> None:
    axis = ExpectedSpeed(AxisResponse(0.0, 0.1))
    axis.advance(0)
    axis.command(1.0, 0)
    axis.command(0.0, 0)
    assert axis.advance(TICK) == 0.0


def test_a_long_pause_and_a_clock_that_goes_back_cause_no_jump() -> None:
    axis = ExpectedSpeed(AxisResponse(0.0, 1.0))
    axis.advance(0)
    axis.command(1.0, 0)
    axis.advance(10**12)
    assert axis.now == pytest.approx(1.0 - np.exp(-0.2), abs=0.01)
    before = axis.now
    axis.advance(0)
    assert axis.now == before


def test_an_axis_restarts_at_its_present_speed() -> None:
    axis = ExpectedSpeed(AxisResponse(0.2, 0.1))
    axis.restart(0.3, 0.3)
    axis.advance(0)
    assert axis.advance(TICK) == pytest.approx(0.3)


def test_a_calibration_without_steps_has_no_response_and_a_brake_is_no_delay() -> None:
    assert response_from_axis(AxisModel()) is None
    stepped = AxisModel(delay_s=0.4, lag_s=0.2, ramp=0.9)
    assert response_from_axis(stepped) == AxisResponse(0.4, 0.2, 0.9, doubt_s=0.0)
    assert response_from_axis(stepped, longest_s=0.15) == AxisResponse(0.15, 0.2, 0.9, doubt_s=0.0)
