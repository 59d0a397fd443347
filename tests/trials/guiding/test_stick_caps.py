"""Caps on the stick: never wider than the push, and a stop before things."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from waychair.calibration.chair_body import CHAIR_A
from waychair.simulation.plant.kinematic_chair import moved
from waychair.trials.guiding.stick_caps import NO_CAPS, CapsByScan, StickCaps, clamped
from waychair.types import JoystickInput, Pose2, Twist

VALUES = (-1.0, -0.4, -0.05, 0.0, 0.05, 0.4, 1.0)


def wall_ahead(distance: float) -> np.ndarray:
    """Return points of a wall across the way, this far before the chair's front."""
    y = np.linspace(-0.6, 0.6, 25)
    return np.column_stack([np.full_like(y, CHAIR_A.front + distance), y])


def test_a_clamped_stick_is_never_farther_from_rest_and_never_of_another_sign() -> None:
    for forward, turn, ahead, behind, left, right in itertools.product(VALUES, VALUES, *[(0.0, 0.2, 1.0)] * 4):
        stick = clamped(JoystickInput(0, forward, turn), StickCaps(ahead, behind, left, right))
        for out, pushed in ((stick.forward, forward), (stick.turn, turn)):
            assert abs(out) <= abs(pushed)
            assert out * pushed >= 0.0


def test_nothing_near_caps_nothing_ahead() -> None:
    caps = CapsByScan(CHAIR_A).caps(np.zeros((0, 2)), Twist(), JoystickInput(0, 1.0, 0.3))
    assert caps.forward == NO_CAPS.forward
    assert caps.left == NO_CAPS.left


@pytest.mark.parametrize("stick", [0.2, 0.6])
def test_a_chair_that_obeys_its_caps_stops_before_a_wall(stick: float) -> None:
    maker, wall, twist = CapsByScan(CHAIR_A), wall_ahead(1.2), Twist()
    x = 0.0
    for _ in range(160):
        points = wall - (x, 0.0)
        allowed = clamped(JoystickInput(0, stick, 0.0), maker.caps(points, twist, JoystickInput(0, stick, 0.0)))
        wanted = maker.twist_of(allowed.forward, 0.0).v
        change = 0.05 * (0.9 if wanted > twist.v else 1.2)
        twist = Twist(twist.v + min(max(wanted - twist.v, -change), change))
        x += moved(Pose2(), twist, 0.05).x
    assert 0.9 < x < 1.2


def test_a_turn_towards_a_thing_beside_the_front_is_held_and_the_turn_away_is_free() -> None:
    points = np.array([[CHAIR_A.front - 0.05, CHAIR_A.width / 2 + 0.03]] * 4)
    maker = CapsByScan(CHAIR_A)
    assert maker.caps(points, Twist(), JoystickInput(0, 0.0, 0.5)).left <= 0.12
    assert maker.caps(points, Twist(), JoystickInput(0, 0.0, -0.5)).right == 1.0
