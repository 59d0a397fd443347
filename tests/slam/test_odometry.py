"""Dead reckoning from encoder counts."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from waychair.calibration.chair import CHAIR_A
from waychair.slam.odometry import COUNTS, WheelOdometry, arc
from waychair.types import WheelTicks

PER_METRE = CHAIR_A.ticks_per_turn / (math.tau * CHAIR_A.wheel_radius)


def test_equal_counts_drive_straight() -> None:
    odometry = WheelOdometry(CHAIR_A)
    odometry.update(WheelTicks(0, 0, 0))
    moved = odometry.update(WheelTicks(2_000_000_000, round(2 * PER_METRE), round(2 * PER_METRE)))
    assert moved.odom_from_base.x == pytest.approx(2.0, abs=1e-3)
    assert moved.odom_from_base.theta == 0.0
    assert moved.twist.v == pytest.approx(1.0, abs=1e-3)


def test_opposite_counts_turn_in_place_to_the_left() -> None:
    odometry = WheelOdometry(CHAIR_A)
    odometry.update(WheelTicks(0, 0, 0))
    way = round(CHAIR_A.track / 2 * math.pi / 2 * PER_METRE)
    moved = odometry.update(WheelTicks(10**9, -way, way))
    assert moved.odom_from_base.theta == pytest.approx(math.pi / 2, abs=2e-3)
    assert math.hypot(moved.odom_from_base.x, moved.odom_from_base.y) < 1e-9


def test_counters_that_wrap_do_not_throw_the_chair_back() -> None:
    odometry = WheelOdometry(CHAIR_A)
    odometry.update(WheelTicks(0, COUNTS - 10, COUNTS // 2 - 5))
    moved = odometry.update(WheelTicks(20_000_000, 10, COUNTS // 2 + 15))
    assert moved.odom_from_base.x == pytest.approx(20 / PER_METRE, rel=1e-6)


def test_stamps_that_stand_still_or_step_back_do_not_move_the_chair() -> None:
    odometry = WheelOdometry(CHAIR_A)
    odometry.update(WheelTicks(100, 0, 0))
    assert odometry.update(WheelTicks(100, 50, 50)).odom_from_base.x == 0.0
    assert odometry.update(WheelTicks(50, 90, 90)).twist.v == 0.0


def test_uncertainty_grows_with_the_way() -> None:
    odometry = WheelOdometry(CHAIR_A)
    spread = []
    for k in range(100):
        covariance = odometry.update(WheelTicks(k * 20_000_000, 300 * k, 300 * k)).covariance
        assert covariance is not None
        spread.append(covariance[1, 1])
    assert spread[0] == 0.0
    assert spread == sorted(spread)
    assert spread[-1] > 30 * spread[10] > 0.0


@given(st.floats(-5, 5), st.floats(-3, 3))
def test_an_arc_driven_in_two_halves_is_the_same_arc(distance: float, turn: float) -> None:
    whole, half = arc(distance, turn), arc(distance / 2, turn / 2)
    assert (half @ half).array() == pytest.approx(whole.array(), abs=1e-9)
