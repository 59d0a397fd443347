"""One axis: dead band, quadratic, limit, and the way back."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from waychair.calibration.fits.axis_model import WITHIN_LIMIT, AxisModel, AxisSide
from waychair.errors import ConfigError, NotMonotone

limits = st.floats(0.2, 3.0)


@st.composite
def sides(draw: st.DrawFn) -> AxisSide:
    """Sides of which every one is monotone up to its limit."""
    gain, limit = draw(st.floats(0.3, 4.0)), draw(limits)
    curve = draw(st.floats(-0.9, 4.0)) * gain * gain / (4.0 * limit)
    return AxisSide(draw(st.floats(0.0, 0.3)), gain, curve, limit)


@st.composite
def axes(draw: st.DrawFn) -> AxisModel:
    """Axes of either sign."""
    return AxisModel(sign=draw(st.sampled_from([-1, 1])), above=draw(sides()), below=draw(sides()))


@given(axes(), st.floats(-3.0, 3.0))
def test_the_volts_for_a_speed_give_that_speed(axis: AxisModel, speed: float) -> None:
    asked = math.copysign(min(abs(speed), axis.reach(speed)), speed)
    assert axis.speed(axis.volts(asked)) == pytest.approx(asked, abs=1e-9)


@given(axes(), st.floats(-2.0, 2.0), st.floats(0.0, 1.0))
def test_more_volts_never_give_less_speed(axis: AxisModel, beyond: float, more: float) -> None:
    before, after = (axis.speed(axis.neutral + volts) for volts in (beyond, beyond + more))
    assert axis.sign * (after - before) >= -1e-12


@given(axes(), st.floats(-0.999, 0.999))
def test_the_axis_rests_in_its_dead_band_and_moves_from_its_edge_on(axis: AxisModel, part: float) -> None:
    side = axis.above if part > 0.0 else axis.below
    assert axis.speed(axis.neutral + part * side.dead_band) == 0.0
    for direction in (1.0, -1.0):
        assert direction * axis.speed(axis.edge(direction) + 0.01 * direction * axis.sign) > 0.0


@given(axes(), st.floats(1.0, 100.0))
def test_volts_never_exceed_the_limit(axis: AxisModel, factor: float) -> None:
    for direction in (1.0, -1.0):
        limit = axis.side(direction).limit
        assert abs(axis.speed(axis.volts(direction * factor * limit))) == pytest.approx(WITHIN_LIMIT * limit)


def test_rest_is_neutral() -> None:
    assert AxisModel(neutral=1.7).volts(0.0) == 1.7


def test_the_margin_is_the_distance_to_the_nearer_edge() -> None:
    assert AxisModel(above=AxisSide(dead_band=0.05), below=AxisSide(dead_band=0.12)).margin == 0.05


def test_a_curve_that_turns_back_before_its_limit_is_refused() -> None:
    AxisSide(gain=1.0, curve=-0.24, limit=1.0)
    with pytest.raises(NotMonotone, match="turns back"):
        AxisSide(gain=1.0, curve=-0.26, limit=1.0)


@pytest.mark.parametrize("gain", [0.0, -1.0, math.nan])
def test_a_gain_that_is_not_positive_is_refused(gain: float) -> None:
    with pytest.raises(ConfigError, match="gain"):
        AxisSide(gain=gain)


def test_an_axis_without_a_direction_is_refused() -> None:
    with pytest.raises(NotMonotone, match="sign"):
        AxisModel(sign=0)
