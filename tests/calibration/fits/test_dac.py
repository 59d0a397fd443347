"""The converter's counts for wheel speeds: the printed equations, their limits, and the way back."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waychair.calibration.fits.dac import (
    DEFAULT,
    PAPER,
    LinearDac,
    counts_from_wheel_speeds,
    neutral_counts,
    volts_from_counts,
    wheel_speeds_from_counts,
)
from waychair.errors import CalibrationError, ConfigError
from waychair.types import WheelSpeeds

ONE_COUNT = 0.0175
"""Speed of one count [m/s], the larger of the two axes."""

anything = st.floats(-1e6, 1e6)
drivable = st.floats(-0.45, 0.45)
models = st.sampled_from([DEFAULT, PAPER])


def _forward_and_turn(v: float, d: float, model: LinearDac) -> tuple[int, int]:
    return counts_from_wheel_speeds(model, WheelSpeeds(v - d / 2, v + d / 2))


def test_the_published_equations_hold_around_neutral() -> None:
    forward, turn = counts_from_wheel_speeds(PAPER, WheelSpeeds(0.5, 0.3))
    assert forward == math.floor(127.5 + 28.2122 * 0.5 + 30.1732 * 0.3 + 0.5)
    assert turn == math.floor(127.5 + 57.0194 * 0.5 - 58.6717 * 0.3 + 0.5)


def test_driving_moves_the_forward_axis_and_turning_left_lowers_the_turn_axis() -> None:
    assert _forward_and_turn(1.0, 0.0, PAPER) == (186, 126)
    assert _forward_and_turn(0.0, 1.0, PAPER) == (128, 70)


def test_without_a_neutral_a_straight_line_would_need_counts_below_zero() -> None:
    turn = PAPER.turn_left * 0.5 + PAPER.turn_right * 0.5
    assert turn < 0.0


def test_rest_is_at_the_middle_of_the_converter() -> None:
    assert neutral_counts(DEFAULT) == neutral_counts(PAPER) == (128, 128)
    assert volts_from_counts(DEFAULT, 128, 128) == pytest.approx((1.65, 1.65), abs=0.5 * 3.3 / 255 + 1e-12)


@settings(deadline=None)
@given(models, anything, anything)
def test_counts_stay_within_the_converter_and_the_swing(model: LinearDac, left: float, right: float) -> None:
    for counts in counts_from_wheel_speeds(model, WheelSpeeds(left, right)):
        assert 0 <= counts <= 255
        assert abs(counts - model.neutral) <= model.swing + 0.5


@settings(deadline=None)
@given(models, drivable, drivable)
def test_the_inverse_is_exact_to_one_count_of_speed(model: LinearDac, left: float, right: float) -> None:
    back = wheel_speeds_from_counts(model, *counts_from_wheel_speeds(model, WheelSpeeds(left, right)))
    assert abs(back.left - left) < ONE_COUNT
    assert abs(back.right - right) < ONE_COUNT


@settings(deadline=None)
@given(models, st.integers(36, 219), st.integers(100, 155))
def test_counts_survive_conversion_to_speeds_and_back(model: LinearDac, forward: int, turn: int) -> None:
    speeds = wheel_speeds_from_counts(model, forward, turn)
    back = counts_from_wheel_speeds(model, speeds)
    for count, again, dead_band in zip((forward, turn), back, (7.3, 7.3), strict=True):
        if abs(count - model.neutral) > dead_band + 0.5:
            assert again == count


@settings(deadline=None)
@given(models, st.floats(-5, 5), st.floats(-5, 5), st.floats(0, 2), st.floats(-2, 2))
def test_a_higher_speed_never_gives_fewer_forward_counts(
    model: LinearDac, v: float, d: float, more: float, turn: float
) -> None:
    assert _forward_and_turn(v + more, turn, model)[0] >= _forward_and_turn(v, turn, model)[0]
    assert _forward_and_turn(turn, d + more, model)[1] <= _forward_and_turn(turn, d, model)[1]


@settings(deadline=None)
@given(st.floats(2.0, 50.0), st.floats(-1.0, 1.0))
def test_a_command_beyond_the_limits_keeps_its_arc(factor: float, ratio: float) -> None:
    slow = wheel_speeds_from_counts(PAPER, *counts_from_wheel_speeds(PAPER, WheelSpeeds(2.0 * ratio, 2.0)))
    fast = wheel_speeds_from_counts(
        PAPER, *counts_from_wheel_speeds(PAPER, WheelSpeeds(2.0 * ratio * factor, 2.0 * factor))
    )
    cross = fast.left * slow.right - fast.right * slow.left
    assert abs(cross) <= 2 * ONE_COUNT * (abs(slow.left) + abs(slow.right))


def test_the_smallest_command_clears_the_dead_band() -> None:
    forward, _ = _forward_and_turn(0.02, 0.0, DEFAULT)
    assert forward - DEFAULT.neutral > DEFAULT.dead_band_forward
    assert _forward_and_turn(0.02, 0.0, PAPER)[0] == 129


def test_counts_inside_the_dead_band_mean_no_motion() -> None:
    assert wheel_speeds_from_counts(DEFAULT, 134, 121) == WheelSpeeds(0.0, 0.0)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1e308])
def test_speeds_that_are_not_finite_numbers_are_refused(bad: float) -> None:
    with pytest.raises(CalibrationError, match="finite"):
        counts_from_wheel_speeds(DEFAULT, WheelSpeeds(bad, 0.1))


@pytest.mark.parametrize("counts", [-1, 256])
def test_counts_outside_the_converter_have_no_volts(counts: int) -> None:
    with pytest.raises(CalibrationError, match=r"0\.\.255"):
        volts_from_counts(DEFAULT, counts, 128)


def test_coefficients_without_an_inverse_are_refused() -> None:
    with pytest.raises(ConfigError, match="inverted"):
        LinearDac(turn_left=28.2122, turn_right=30.1732)


def test_a_dead_band_that_fills_the_swing_is_refused() -> None:
    with pytest.raises(ConfigError, match="dead_band_turn"):
        LinearDac(dead_band_turn=92.7)
