"""The loop's stability and margin, from its exact sampled transfer function and from simulation in steps."""

from __future__ import annotations

import itertools
import math
from collections import deque

import numpy as np
import pytest
from evaluation.speed.loop_margins import TrueAxis, loop_polynomials, phase_margin, slowest_decay

from waychair.control.speed.axis_response import AxisResponse
from waychair.control.speed.speed_loop import (
    FASTEST_CROSSOVER,
    PHASE_MARGIN,
    ChairResponse,
    SpeedLoop,
    SpeedLoopSettings,
    gains,
    gains_of,
)
from waychair.types import Twist

PERIOD = 0.05
DELAYS = [0.05, 0.1, 0.15, 0.2, 0.25, 0.3]
LAGS = [0.1, 0.2, 0.3, 0.4, 0.5]


def test_the_gains_are_those_of_the_derivation() -> None:
    found = gains(0.2, 0.3, math.radians(60.0))
    assert found.integral == pytest.approx(math.radians(30.0) / 0.2)
    assert found.proportional == pytest.approx(found.integral * 0.3)
    assert gains(0.0, 0.3, math.radians(60.0), fastest=4.0).integral == 4.0


@pytest.mark.parametrize("held", [False, True])
@pytest.mark.parametrize(("gain", "least"), [(0.5, 50.0), (1.0, 45.0), (2.0, 35.0)])
def test_every_identified_axis_keeps_its_margin_at_half_and_twice_its_gain(
    gain: float, least: float, held: bool
) -> None:
    for delay, lag in itertools.product(DELAYS, LAGS):
        tuned = gains(delay + PERIOD, lag, PHASE_MARGIN, FASTEST_CROSSOVER)
        axis = TrueAxis(gain, delay, lag)
        assert math.degrees(phase_margin(tuned, axis, PERIOD, held=held)) >= least, axis
        assert slowest_decay(tuned, axis, PERIOD, held=held) < 1.0, axis


@pytest.mark.parametrize("held", [False, True])
def test_an_unidentified_chair_is_stable_too(held: bool) -> None:
    cautious = gains_of(AxisResponse())
    for gain, delay, lag in itertools.product([0.5, 1.0, 2.0], DELAYS, LAGS):
        assert slowest_decay(cautious, TrueAxis(gain, delay, lag), PERIOD, held=held) < 1.0, (gain, delay, lag)


def test_the_margin_agrees_with_the_closed_form_where_the_tick_is_short() -> None:
    tuned = gains(0.2, 0.3, math.radians(67.5))
    for gain in (0.5, 1.0, 2.0):
        expected = 0.5 * math.pi - gain * math.radians(22.5)
        assert phase_margin(tuned, TrueAxis(gain, 0.2, 0.3), 1e-3, held=False) == pytest.approx(expected, abs=0.02)


def test_a_loop_that_is_too_fast_has_no_margin_and_oscillates() -> None:
    wild = gains(0.05, 0.2, math.radians(45.0))
    axis = TrueAxis(2.0, 0.3, 0.2)
    assert phase_margin(wild, axis, PERIOD, held=False) < 0.0
    assert slowest_decay(wild, axis, PERIOD, held=False) > 1.0


@pytest.mark.parametrize(("delay", "lag"), [(0.0, 0.1), (0.05, 0.2), (0.12, 0.3), (0.3, 0.5)])
def test_the_transfer_function_agrees_with_the_chair_in_small_steps(delay: float, lag: float) -> None:
    tuned = gains(delay + PERIOD, lag, PHASE_MARGIN, FASTEST_CROSSOVER)
    above, below = loop_polynomials(tuned, TrueAxis(1.3, delay, lag), PERIOD, held=False)
    ticks = 60
    response = np.zeros(ticks)  # to a step of the error: the loop's numerator over its denominator, by long division
    above = np.concatenate([np.zeros(len(below) - len(above)), above])
    error, output = np.zeros(len(below)), np.zeros(len(below))
    for k in range(ticks):
        error = np.concatenate([[1.0], error[:-1]])
        value = (above @ error - below[1:] @ output[:-1]) / below[0]
        output = np.concatenate([[value], output[:-1]])
        response[k] = value
    chair = _Axis(1.3, delay, lag)
    integral, trims = 0.0, []
    means = []
    for _ in range(ticks):
        means.append(chair.mean)
        integral += tuned.integral * PERIOD
        trims.append(tuned.proportional + integral)
        chair.tick(trims[-1])
    assert response == pytest.approx(means, abs=2e-3)


@pytest.mark.parametrize("gain", [0.5, 1.0, 2.0])
@pytest.mark.parametrize("delay", [0.05, 0.3])
@pytest.mark.parametrize("lag", [0.1, 0.5])
def test_a_simulated_chair_reaches_its_speeds_and_keeps_them(gain: float, delay: float, lag: float) -> None:
    response = AxisResponse(delay, lag, doubt_s=0.0)
    settings = SpeedLoopSettings(max_trim_v=0.5, max_trim_omega=1.0, brake_s=0.0)
    loop, v, omega = (
        SpeedLoop(settings, response=ChairResponse(response, response)),
        _Axis(gain, delay, lag),
        _Axis(gain, delay, lag),
    )
    command = Twist(0.4, 0.3)
    late = []
    for k in range(600):
        sent = loop.step(command, Twist(v.mean, omega.mean), k * 50_000_000)
        v.tick(sent.v)
        omega.tick(sent.omega)
        if k >= 500:
            late.append((v.mean, omega.mean))
    assert np.array(late) == pytest.approx(np.array([[0.4, 0.3]] * 100), abs=0.01)


class _Axis:
    """A delay and a lag in steps of a millisecond."""

    def __init__(self, gain: float, delay: float, lag: float) -> None:
        self.gain, self.lag = gain, lag
        self.mean = self.speed = 0.0
        self.on_the_way = deque([0.0] * round(delay * 1000))

    def tick(self, value: float) -> None:
        before = self.speed
        total = 0.0
        for _ in range(50):
            self.on_the_way.append(value)
            self.speed += (1.0 - math.exp(-0.001 / self.lag)) * (self.gain * self.on_the_way.popleft() - self.speed)
            total += 0.5 * (before + self.speed)
            before = self.speed
        self.mean = total / 50
