"""The gain of each axis is estimated while it moves and never at rest, and a changed gain stops the chair."""

from __future__ import annotations

import math

import numpy as np
import pytest

from waychair.control.speed.axis_response import AxisResponse, ExpectedSpeed
from waychair.control.speed.gain_watch import AxisGain, GainWatch
from waychair.types import Twist

TICK_S = 0.05
RESPONSE = AxisResponse(0.08, 0.2, 0.9)


class Chair:
    """Answers by the response and its gains; the other axis' effect on the turn is `cross` [rad/m]."""

    def __init__(self, v: float = 1.0, omega: float = 1.0, cross: float = 0.0, offset: float = 0.0) -> None:
        self.watch = GainWatch(RESPONSE, RESPONSE)
        self.v, self.omega, self.cross, self.offset = v, omega, cross, offset
        self.true = ExpectedSpeed(RESPONSE), ExpectedSpeed(RESPONSE)
        self.now_ns = 0
        self.way = 0.0
        self.rng = np.random.default_rng(0)
        for axis in self.true:
            axis.advance(0)

    def tick(self, told: Twist, judged: bool = True) -> str:
        """One tick at this twist."""
        for axis, value in zip(self.true, (told.v, told.omega), strict=True):
            axis.command(value, self.now_ns)
        self.now_ns += round(TICK_S * 1e9)
        v, omega = (axis.advance(self.now_ns) for axis in self.true)
        v, omega = self.v * v + math.copysign(self.offset, v) * (v != 0.0), self.omega * omega + self.cross * v
        self.way += abs(v) * TICK_S
        measured = Twist(v + self.rng.normal(0.0, 0.01), omega + self.rng.normal(0.0, 0.02))
        return self.watch.step(told, measured, self.now_ns, judged=judged)

    def drive(self, metres: float, twists: list[Twist]) -> str:
        """Drive two seconds of each twist in turn, until this distance [m] or a fault."""
        k = 0
        while self.way < metres and k < 4000:
            if fault := self.tick(twists[k // 40 % len(twists)]):
                return fault
            k += 1
        return ""


WEAVING = [Twist(0.6, 0.0), Twist(0.5, 0.5), Twist(0.7, -0.4), Twist(0.3, 0.6), Twist(0.5, -0.6)]


@pytest.mark.parametrize("gain", [0.2, 0.4, 0.55, 1.5, 2.0])
def test_a_turned_speed_dial_stops_the_chair_within_three_metres_and_says_why(gain: float) -> None:
    chair = Chair(gain, gain)
    fault = chair.drive(3.0, [Twist(0.5, 0.0)])
    assert "speed dial or drive profile changed" in fault
    assert "calibrate again" in fault


@pytest.mark.parametrize("gain", [0.65, 0.7, 0.75, 1.25, 1.3, 1.35])
def test_a_doubtful_gain_slows_the_chair_within_three_metres(gain: float) -> None:
    chair = Chair(gain, gain)
    assert chair.drive(3.0, [Twist(0.5, 0.0)]) == ""
    assert chair.watch.speed_limit == 0.3
    assert chair.watch.gains[0] == pytest.approx(gain, abs=0.03)


@pytest.mark.parametrize("gain", [0.85, 0.95, 1.0, 1.1, 1.15])
def test_a_gain_that_is_nearly_right_changes_nothing(gain: float) -> None:
    chair = Chair(gain, gain)
    assert chair.drive(20.0, WEAVING) == ""
    assert chair.watch.speed_limit == math.inf
    assert chair.watch.gains == pytest.approx((gain, gain), abs=0.05)


def test_the_turn_axis_alone_suffices() -> None:
    chair = Chair(1.0, 0.5)
    assert "speed dial" in chair.drive(6.0, WEAVING)


def test_a_chair_that_pulls_to_one_side_is_not_taken_for_one_that_turns_too_much() -> None:
    chair = Chair(cross=0.15)
    assert chair.drive(20.0, WEAVING) == ""
    assert chair.watch.gains[1] == pytest.approx(1.0, abs=0.08)


def test_a_small_error_of_the_dead_band_does_not_count_as_a_gain() -> None:
    chair = Chair(offset=0.025)
    assert chair.drive(10.0, [Twist(0.2, 0.0), Twist(0.5, 0.0)]) == ""
    assert chair.watch.speed_limit == math.inf


@pytest.mark.parametrize("told", [Twist(), Twist(0.1, 0.0), Twist(0.0, 0.2)])
def test_without_excitation_nothing_is_found(told: Twist) -> None:
    chair = Chair(0.3, 0.3)
    for _ in range(400):
        assert chair.tick(told) == ""
    assert chair.watch.gains == (1.0, 1.0)


def test_excluded_ticks_and_readings_that_are_not_numbers_change_no_estimate() -> None:
    chair = Chair(0.3, 0.3)
    for _ in range(100):
        chair.tick(Twist(0.5, 0.5), judged=False)
    assert chair.watch.gains == (1.0, 1.0)
    chair.v = math.nan
    for _ in range(100):
        chair.tick(Twist(0.5, 0.5))
    assert chair.watch.gains == (1.0, 1.0)


def test_a_dial_turned_during_the_drive_is_found_and_one_turned_back_clears_the_doubt() -> None:
    chair = Chair()
    assert chair.drive(10.0, [Twist(0.5, 0.0)]) == ""
    chair.v = 0.7
    assert chair.drive(13.0, [Twist(0.5, 0.0)]) == ""
    assert chair.watch.speed_limit == 0.3
    chair.v = 1.0
    assert chair.drive(17.0, [Twist(0.5, 0.0)]) == ""
    assert chair.watch.speed_limit == math.inf


def test_a_fault_stays_until_a_new_watch_starts() -> None:
    chair = Chair(0.5)
    fault = chair.drive(3.0, [Twist(0.5, 0.0)])
    chair.v = 1.0
    for _ in range(400):
        assert chair.tick(Twist(0.5, 0.0)) == fault


def test_the_recursion_is_least_squares_where_the_gain_is_constant() -> None:
    axis = AxisGain(0.05, first_gain=1.0, first_cross=1.0, drift=1e-4)
    rng = np.random.default_rng(3)
    rows = rng.uniform(0.2, 1.0, (300, 2))
    measured = rows @ [0.8, 0.1] + rng.normal(0.0, 0.02, 300)
    for (own, other), value in zip(rows, measured, strict=True):
        axis.update(own, other, value, TICK_S)
    expected = np.linalg.lstsq(rows, measured, rcond=None)[0]
    assert axis.gain == pytest.approx(expected[0], abs=0.01)
