"""Twist and wheel speeds of a differential drive."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waychair.control.speed.kinematics import saturate, twist_from_wheel_speeds, wheel_speeds_from_twist
from waychair.types import Twist, WheelSpeeds

speeds = st.floats(-3.0, 3.0)
tracks = st.floats(0.2, 1.5)


def test_turning_left_drives_the_right_wheel_forward() -> None:
    assert wheel_speeds_from_twist(Twist(0.0, 1.0), 0.5) == WheelSpeeds(-0.25, 0.25)


def test_a_turn_about_the_left_wheel_leaves_it_at_rest() -> None:
    assert wheel_speeds_from_twist(Twist(0.27, 1.0), 0.54) == WheelSpeeds(0.0, 0.54)


@settings(deadline=None)
@given(speeds, speeds, tracks)
def test_a_twist_survives_conversion_to_wheel_speeds_and_back(v: float, omega: float, track: float) -> None:
    back = twist_from_wheel_speeds(wheel_speeds_from_twist(Twist(v, omega), track), track)
    assert (back.v, back.omega) == pytest.approx((v, omega), abs=1e-12)


@settings(deadline=None)
@given(speeds, speeds, st.floats(0.1, 2.0))
def test_saturation_keeps_the_curvature_and_the_limit(left: float, right: float, limit: float) -> None:
    slow = saturate(WheelSpeeds(left, right), limit)
    assert max(abs(slow.left), abs(slow.right)) <= limit * (1 + 1e-12)
    assert slow.left * right == pytest.approx(slow.right * left, abs=1e-12)
    assert slow.left * left >= 0.0
    assert slow.right * right >= 0.0


@settings(deadline=None)
@given(speeds, speeds)
def test_speeds_within_the_limit_are_unchanged(left: float, right: float) -> None:
    assert saturate(WheelSpeeds(left, right), 3.0) == WheelSpeeds(left, right)
