"""Speeds come down in comfort: with limited jerk, within the way there is, on the same arc."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waychair.planning.motion import DwaSettings, Motion, motion_after, slowing_speed, stopping, towards
from waychair.types import Twist

PROMPT = DwaSettings(reaction_time=0.0)


@given(st.floats(0.0, 3.0), st.floats(0.0, 0.5))
@settings(max_examples=100, deadline=None)
def test_the_speed_on_the_way_to_a_slow_place_leaves_just_the_way_for_half_the_braking_and_jerk(
    way: float, end: float
) -> None:
    """Against the profile itself: the acceleration goes down by the jerk, stays, and comes back, in fine steps."""
    a, jerk, speed = DwaSettings().braking / 2, DwaSettings().jerk / 2, slowing_speed(way, end, DwaSettings())
    down = speed - end
    ramp = min(a / jerk, math.sqrt(max(down, 0.0) / jerk))
    level = max(down - jerk * ramp**2, 0.0) / a
    times = np.linspace(0.0, 2 * ramp + level, 20001)
    slowing = jerk * np.minimum(np.minimum(times, ramp), times[-1] - times)
    v = speed - np.concatenate([[0.0], np.cumsum((slowing[1:] + slowing[:-1]) / 2 * np.diff(times))])
    assert v[-1] == pytest.approx(end, abs=1e-4)
    assert np.trapezoid(v, times) == pytest.approx(way, abs=1e-3)
    assert slowing_speed(-way, end, DwaSettings()) == pytest.approx(end)


@given(st.floats(0.02, 0.8), st.floats(-0.8, 0.8), st.floats(-1.5, 0.0))
@settings(max_examples=60, deadline=None)
def test_a_stop_in_comfort_keeps_its_arc_and_ends_in_a_stand_with_limited_jerk(
    v: float, omega: float, a: float
) -> None:
    command, motion, accelerations = Twist(v, omega), Motion(Twist(a)), [a]
    for _ in range(200):
        following = stopping(command, PROMPT, motion)
        motion, before, command = motion_after(motion, command, following, PROMPT), command, following
        assert 0.0 <= command.v <= before.v
        assert command.v * omega == pytest.approx(command.omega * v, abs=1e-6)
        accelerations.append(motion.acceleration.v)
    assert abs(command.v) < 1e-3
    if abs(v) / PROMPT.braking >= abs(omega) / PROMPT.alpha and a == 0.0:
        # a fifth for the last step of a tick
        assert np.abs(np.diff(accelerations)).max() <= 1.2 * PROMPT.jerk * PROMPT.period


@given(st.floats(0.0, 0.4), st.floats(0.0, 0.8), st.floats(-1.5, 0.0))
def test_hard_braking_is_not_carried_on_into_driving_the_other_way(v: float, target: float, a: float) -> None:
    assert towards(Twist(v), Twist(target), PROMPT, Motion(Twist(a))).v >= 0.0
    assert towards(Twist(-v), Twist(-target), PROMPT, Motion(Twist(-a))).v <= 0.0
