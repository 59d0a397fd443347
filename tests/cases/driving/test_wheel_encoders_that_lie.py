"""Wheel encoders that are exchanged, reversed or dead are named, whatever else they look like."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from tests.runtime.riding import FAR, Ride
from waychair.calibration.chair_body import CHAIR_A
from waychair.control.drive.navigator import Stage
from waychair.control.speed.wheel_signs import WheelSigns
from waychair.runtime.chair import ChairState
from waychair.runtime.drive_base import ChairMessage
from waychair.slam.odometry.wheel_counts import wheel_paths
from waychair.types import Goal, Pose2, Twist, WheelTicks

TRACK = CHAIR_A.track
Wrong = Callable[[WheelTicks], WheelTicks]

EXCHANGED: Wrong = lambda told: replace(told, left=told.right, right=told.left)
LEFT_BACK: Wrong = lambda told: replace(told, left=-told.left)
RIGHT_BACK: Wrong = lambda told: replace(told, right=-told.right)
BOTH_BACK: Wrong = lambda told: replace(told, left=-told.left, right=-told.right)
LEFT_DEAD: Wrong = lambda told: replace(told, left=7)
RIGHT_DEAD: Wrong = lambda told: replace(told, right=7)
BOTH_DEAD: Wrong = lambda told: replace(told, left=7, right=7)


def ended(wrong: Wrong, goal: Goal = FAR) -> tuple[ChairState, Ride]:
    """Drive with wrong encoders until the drive ends; return the state then, and the ride."""

    def change(messages: tuple[ChairMessage, ...]) -> tuple[ChairMessage, ...]:
        return tuple(wrong(message) if isinstance(message, WheelTicks) else message for message in messages)

    with Ride() as ride:
        ride.change = change
        ride.tick(20)
        ride.chair.go(goal)
        ride.chair.confirm()
        for _ in range(200):
            state = ride.tick()
            if state.navigation.stage is not Stage.DRIVING:
                break
        return state, ride


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        (LEFT_BACK, "the left wheel's encoder counts backwards"),
        (RIGHT_BACK, "the right wheel's encoder counts backwards"),
        (BOTH_BACK, "both wheel encoders count backwards"),
        (LEFT_DEAD, "the left wheel's encoder tells no motion"),
        (RIGHT_DEAD, "the right wheel's encoder tells no motion"),
        (BOTH_DEAD, "both wheel encoders tell no motion while the scans do"),
    ],
    ids=["left backwards", "right backwards", "both backwards", "left dead", "right dead", "both dead"],
)
def test_encoders_that_lie_end_the_drive_within_a_step_and_are_named(wrong: Wrong, told: str) -> None:
    state, ride = ended(wrong)
    assert state.navigation.stage is Stage.FAILED
    assert state.verdict.halt is not None
    assert state.verdict.halt.stop.id == "disobeys"
    assert told in state.verdict.reason
    assert "dial" not in state.verdict.reason
    assert ride.simulator.truth().x < 2.7
    assert ride.simulator.contacts == 0


def test_exchanged_encoders_are_named_at_the_first_turn() -> None:
    state, ride = ended(EXCHANGED, Goal(Pose2(2.5, 3.5, 2.0), 0.3, 0.3))
    assert state.navigation.stage is Stage.FAILED
    assert "the wheel encoders are exchanged, left for right" in state.verdict.reason
    assert ride.simulator.contacts == 0


def judged(
    wheels: Callable[[float, float], tuple[float, float]], twist: Callable[[float], Twist], gain: float = 1.0
) -> str:
    """Return the fault after 1.5 s of a motion, as told by encoders that map the true wheel speeds."""
    watch, noise = WheelSigns(TRACK), np.random.default_rng(4)
    for k in range(30):
        now = twist(0.05 * k)
        left, right = (gain * (now.v + side * now.omega * TRACK / 2) for side in (-1.0, 1.0))
        told_left, told_right = wheels(left + noise.normal(0.0, 0.02), right + noise.normal(0.0, 0.02))
        watch.step(now, (0.05 * told_left, 0.05 * told_right), 50_000_000 * k, judged=True)
    return watch.fault


BEND: Callable[[float], Twist] = lambda t: Twist(0.4, 0.6 * math.sin(2.0 * t))
SPIN: Callable[[float], Twist] = lambda t: Twist(0.0, 0.6)


@pytest.mark.parametrize("gain", [0.55, 0.8, 1.3])
@pytest.mark.parametrize("twist", [BEND, SPIN, lambda t: Twist(0.5)], ids=["bend", "spin", "straight"])
def test_a_turned_speed_dial_is_not_blamed_on_the_encoders(twist: Callable[[float], Twist], gain: float) -> None:
    assert judged(lambda left, right: (left, right), twist, gain) == ""


@pytest.mark.parametrize("weak", [0.6, 0.75])
def test_a_weak_motor_is_not_blamed_on_the_encoders(weak: float) -> None:
    assert judged(lambda left, right: (weak * left, right), BEND) == ""


def test_a_bend_tells_exchanged_encoders_from_reversed_ones_and_a_turn_on_the_spot_names_both() -> None:
    assert "exchanged, left for right (F20)" in judged(lambda left, right: (right, left), BEND)
    assert "both wheel encoders count backwards" in judged(lambda left, right: (-left, -right), BEND)
    assert "exchanged and count backwards" in judged(lambda left, right: (-right, -left), BEND)
    assert "exchanged, left for right, or both count backwards" in judged(lambda left, right: (right, left), SPIN)


def test_the_speed_dial_may_be_turned_as_well() -> None:
    assert "left wheel's encoder counts backwards" in judged(lambda left, right: (-left, right), BEND, gain=0.7)


def test_paths_of_wheels_pass_the_end_of_their_counters() -> None:
    before, now = WheelTicks(0, 2**31 - 10, -(2**31) + 10), WheelTicks(1, -(2**31) + 10, 2**31 - 10)
    per_count = math.tau * CHAIR_A.wheel_radius / CHAIR_A.ticks_per_turn
    assert wheel_paths(before, now, CHAIR_A) == pytest.approx((20 * per_count, -20 * per_count))


def told_after(expected: tuple[float, float], measured: tuple[float, float]) -> str:
    """Return the fault told after half a second in which the left and right wheel should drive and seem to drive so far [m]."""
    signs, ticks = WheelSigns(TRACK), 10
    v, omega = sum(expected) / 2 / 0.5, (expected[1] - expected[0]) / TRACK / 0.5
    signs.step(Twist(), None, 0, judged=True)
    for k in range(ticks):
        paths = measured[0] / ticks, measured[1] / ticks
        told = signs.step(Twist(v, omega), paths, (k + 1) * 50_000_000, judged=True)
    return told


def test_a_turn_about_one_wheel_shows_exchanged_encoders_before_the_pose_is_lost() -> None:
    assert "exchanged" in told_after((0.12, 0.0), (0.0, 0.12))
    assert "exchanged" in told_after((0.0, 0.12), (0.12, 0.0))
    assert told_after((0.12, 0.0), (0.12, 0.0)) == ""


def test_a_turn_about_one_wheel_names_nothing_that_two_causes_explain() -> None:
    assert told_after((0.12, 0.0), (-0.12, 0.0)) == ""  # the left one, or both


def test_a_dead_encoder_on_the_outside_of_a_tight_bend_is_named() -> None:
    assert "the left wheel's encoder tells no motion" in told_after((0.36, 0.1), (0.0, 0.1))
    assert "the right wheel's encoder tells no motion" in told_after((0.1, 0.36), (0.1, 0.0))
    assert told_after((0.36, 0.1), (0.0, 0.0)) == ""  # the chair stands
    assert told_after((0.2, 0.1), (0.0, 0.1)) == ""  # it may have stalled at a sill
