"""A pushed chair is distinguished from one that coasts, and from one driven by its rider."""

from __future__ import annotations

import math

from waychair.calibration.chair_body import CHAIR_A
from waychair.control.safety.pushing import Pushing
from waychair.types import JoystickInput, WheelTicks

MS = 1_000_000
PER_M = CHAIR_A.ticks_per_turn / (2 * math.pi * CHAIR_A.wheel_radius)


def wheels(x: float, turn: float = 0.0) -> WheelTicks:
    """The counts of a chair that drove straight, then turned on the spot."""
    aside = turn * CHAIR_A.track / 2
    return WheelTicks(0, round((x - aside) * PER_M), round((x + aside) * PER_M))


def told(pushing: Pushing, ms: int, x: float, released: bool = True, stick: float = 0.0, turn: float = 0.0) -> bool:
    return pushing.update(ms * MS, released, JoystickInput(0, stick), wheels(x, turn))


def stands(pushing: Pushing, from_ms: int, x: float, seconds: float = 1.5) -> list[bool]:
    return [told(pushing, from_ms + k * 50, x) for k in range(round(20 * seconds))]


def test_a_standing_chair_that_moves_counts_as_pushed_until_it_stands_again() -> None:
    pushing = Pushing(CHAIR_A)
    assert not any(stands(pushing, 0, 0.0))
    assert not pushing.pushed
    told(pushing, 2000, 0.04)
    assert not pushing.pushed
    told(pushing, 2050, 0.06)
    assert pushing.pushed
    assert stands(pushing, 2100, 0.06).count(True) == 1
    assert not pushing.pushed


def test_a_coasting_chair_is_not_pushed() -> None:
    pushing = Pushing(CHAIR_A)
    stands(pushing, 0, 0.0)
    told(pushing, 2000, 0.5, released=False)
    for k in range(20):
        told(pushing, 2050 + 50 * k, 0.5 + 0.03 * k)
        assert not pushing.pushed


def test_a_chair_driven_by_joystick_is_not_pushed() -> None:
    pushing = Pushing(CHAIR_A)
    stands(pushing, 0, 0.0)
    for k in range(20):
        told(pushing, 2000 + 50 * k, 0.05 * k, stick=0.5)
        assert not pushing.pushed


def test_without_stick_or_wheel_data_nothing_is_claimed() -> None:
    pushing = Pushing(CHAIR_A)
    stands(pushing, 0, 0.0)
    assert not pushing.update(3000 * MS, True, None, wheels(5.0))
    assert not pushing.update(3050 * MS, True, JoystickInput(0), None)
    assert not pushing.pushed


def test_a_stick_at_rest_within_the_threshold_is_not_held() -> None:
    for at_rest, pushed in ((0.2, True), (0.1, False)):
        pushing = Pushing(CHAIR_A, at_rest=at_rest)
        for k in range(60):
            told(pushing, 50 * k, 0.0 if k < 50 else 0.2, stick=0.15)
        assert pushing.pushed is pushed


def test_a_chair_that_is_turned_on_the_spot_is_pushed() -> None:
    pushing = Pushing(CHAIR_A)
    stands(pushing, 0, 0.0)
    told(pushing, 2000, 0.0, turn=0.08)
    assert not pushing.pushed
    told(pushing, 2050, 0.0, turn=-0.12)
    assert pushing.pushed
