"""F20 and F21 at their limits of error and duration, and cases that are no fault."""

from __future__ import annotations

import math

import pytest

from waychair.control.speed.axis_response import AxisResponse
from waychair.control.speed.following_faults import FollowingWatch
from waychair.types import Twist

TICK_S = 0.05
TRACK = 0.54
RESPONSE = AxisResponse(0.1, 0.2)


@pytest.fixture
def watch() -> FollowingWatch:
    """The watch of a chair that was just switched on."""
    return FollowingWatch(RESPONSE, RESPONSE, TRACK)


def driven(watch: FollowingWatch, expected: Twist | None, measured: Twist, seconds: float, since: float = 0.0) -> str:
    """Return the fault after a drive of this duration."""
    for k in range(round(seconds / TICK_S) + 1):
        fault = watch.driving(expected or Twist(0.5, 0.0), expected, measured, round((since + k * TICK_S) * 1e9))
    return fault


def rested(watch: FollowingWatch, measured: Twist, seconds: float, since: float = 0.0) -> str:
    """Return the fault after the lines were at neutral for this duration."""
    for k in range(round(seconds / TICK_S) + 1):
        fault = watch.at_neutral(measured, round((since + k * TICK_S) * 1e9))
    return fault


@pytest.mark.parametrize("missed", [-0.31, 0.31, 0.5, -1.0])
def test_f20_a_residual_of_more_than_the_limit_for_half_a_second_is_a_fault(
    watch: FollowingWatch, missed: float
) -> None:
    assert driven(watch, Twist(0.8, 0.0), Twist(0.8 - missed, 0.0), 0.45) == ""
    fault = driven(watch, Twist(0.8, 0.0), Twist(0.8 - missed, 0.0), 0.0, since=0.5)
    assert "does not follow (F20)" in fault
    assert "free-wheel" in fault


@pytest.mark.parametrize("missed", [-0.29, 0.0, 0.29])
def test_f20_a_smaller_residual_is_never_a_fault(watch: FollowingWatch, missed: float) -> None:
    assert driven(watch, Twist(0.8, 0.0), Twist(0.8 - missed, 0.0), 30.0) == ""


def test_f20_a_residual_with_a_break_starts_its_time_again(watch: FollowingWatch) -> None:
    assert driven(watch, Twist(0.8, 0.0), Twist(0.3, 0.0), 0.4) == ""
    assert driven(watch, Twist(0.8, 0.0), Twist(0.7, 0.0), 0.05, since=0.45) == ""
    assert driven(watch, Twist(0.8, 0.0), Twist(0.3, 0.0), 0.45, since=0.55) == ""


def test_f20_counts_the_wheel_with_the_larger_error(watch: FollowingWatch) -> None:
    assert driven(watch, Twist(0.4, 0.8), Twist(0.25, 0.2), 0.5) != ""  # 0.15 + 0.6 * 0.27 = 0.31 m/s


def test_f20_a_chair_that_does_not_move_is_a_fault_at_any_speed_above_a_crawl(watch: FollowingWatch) -> None:
    assert driven(watch, Twist(0.1, 0.0), Twist(0.0, 0.0), 1.95) == ""
    assert "does not move (F20)" in driven(watch, Twist(0.1, 0.0), Twist(0.0, 0.0), 0.0, since=2.0)


def test_f20_waits_for_the_brake_for_a_limited_time(watch: FollowingWatch) -> None:
    assert driven(watch, None, Twist(), 1.9) == ""
    assert "does not move" in driven(watch, None, Twist(), 0.2, since=1.95)


@pytest.mark.parametrize("measured", [Twist(0.051, 0.0), Twist(-0.2, 0.0), Twist(0.0, 0.2), Twist(0.03, -0.1)])
def test_f21_motion_at_neutral_for_three_tenths_of_a_second_is_a_fault(watch: FollowingWatch, measured: Twist) -> None:
    assert rested(watch, Twist(), 1.0) == ""
    assert rested(watch, measured, 0.25, since=1.05) == ""
    assert "moves at neutral (F21)" in rested(watch, measured, 0.05, since=1.35)


@pytest.mark.parametrize("measured", [Twist(0.049, 0.0), Twist(-0.04, 0.02), Twist(0.0, 0.18)])
def test_f21_less_motion_is_never_a_fault(watch: FollowingWatch, measured: Twist) -> None:
    assert rested(watch, measured, 30.0) == ""


def test_f21_a_chair_may_coast_to_rest_for_a_limited_time(watch: FollowingWatch) -> None:
    driven(watch, Twist(0.8, 0.0), Twist(0.8, 0.0), 1.0)
    allowed = 0.1 + 4.0 * 0.2 + 0.8 / 0.6
    for k in range(round(allowed / TICK_S)):
        speed = max(0.0, 0.8 - 0.35 * k * TICK_S)
        assert watch.at_neutral(Twist(speed, 0.0), round((1.05 + k * TICK_S) * 1e9)) == ""
    assert rested(watch, Twist(0.1, 0.0), 0.45, since=1.05 + allowed) != ""


def test_f21_a_rider_who_drives_causes_no_fault(watch: FollowingWatch) -> None:
    rested(watch, Twist(), 1.0)
    for _ in range(100):
        assert watch.released() == ""


def test_a_fault_stays(watch: FollowingWatch) -> None:
    fault = driven(watch, Twist(0.8, 0.0), Twist(), 0.5)
    assert fault
    assert rested(watch, Twist(), 5.0, since=1.0) == fault
    assert watch.released() == fault


def test_readings_that_are_not_numbers_count_as_no_motion(watch: FollowingWatch) -> None:
    assert rested(watch, Twist(math.nan, math.inf), 5.0) == ""
