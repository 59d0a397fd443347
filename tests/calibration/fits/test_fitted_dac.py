"""The default model: counts for wheel speeds and back, its limits, and the memory of the dead band's side."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.calibration.synthetic import TRUE
from waychair.calibration.fits.dac import DEFAULT, DacModel
from waychair.calibration.fits.fitted_dac import ENTER_OMEGA, ENTER_V, DeadBand, FittedDac
from waychair.errors import CalibrationError, ConfigError, NotMonotone
from waychair.types import Twist, WheelSpeeds

EIGHT_BITS = replace(TRUE, bits=8)
models = st.sampled_from([TRUE, EIGHT_BITS, replace(TRUE, bits=16), FittedDac()])
speeds = st.floats(-5.0, 5.0)


def _wheels(v: float, omega: float, track: float = TRUE.track) -> WheelSpeeds:
    return WheelSpeeds(v - 0.5 * omega * track, v + 0.5 * omega * track)


@given(models, speeds, speeds)
def test_counts_stay_within_the_converter(model: FittedDac, left: float, right: float) -> None:
    counts = model.counts_from_wheel_speeds(WheelSpeeds(left, right))
    assert all(isinstance(count, int) and 0 <= count <= model.counts_max for count in counts)


@given(st.floats(-0.6, 0.6), st.floats(-1.2, 1.2))
def test_the_inverse_undoes_coupling_and_fade(v: float, omega: float) -> None:
    a, b = TRUE.axis_speeds(Twist(v, omega))
    back = TRUE.twist_from_volts(TRUE.forward.volts(a), TRUE.turn.volts(b))
    assert (back.v, back.omega) == pytest.approx((v, omega), abs=1e-9)


@given(models, st.floats(-0.5, 0.5), st.floats(-1.0, 1.0))
def test_the_inverse_is_exact_to_the_rounding_of_the_converter(model: FittedDac, v: float, omega: float) -> None:
    back = model.twist_from_wheel_speeds(
        model.wheel_speeds_from_counts(*model.counts_from_wheel_speeds(_wheels(v, omega, model.track)))
    )
    step = model.volts_per_count
    assert abs(back.v - v) < 0.6 * step * 1.6 + 0.02 * 0.6 * step * 3.0
    assert abs(back.omega - omega) < 0.6 * step * 3.2 + 0.2 * 0.6 * step * 1.6


@given(models, st.floats(-1.0, 1.0), st.floats(1.5, 50.0))
def test_a_command_beyond_the_limits_keeps_its_arc(model: FittedDac, ratio: float, factor: float) -> None:
    slow, fast = (model.axis_speeds(Twist(k * 2.0 * ratio, k * 3.0)) for k in (1.0, factor))
    for v, omega in (slow, fast):
        reached = model.twist_from_volts(model.forward.volts(v), model.turn.volts(omega))
        assert reached.v * 3.0 == pytest.approx(reached.omega * 2.0 * ratio, abs=1e-6)
    assert fast == pytest.approx(slow, rel=1e-6)


@given(speeds, speeds)
def test_no_axis_is_commanded_beyond_its_reach(v: float, omega: float) -> None:
    a, b = TRUE.axis_speeds(Twist(v, omega))
    assert abs(a) <= TRUE.forward.reach(a) * (1 + 1e-9)
    assert abs(b) <= TRUE.turn.reach(b) * (1 + 1e-9)


def test_rest_is_the_measured_neutral_on_both_axes() -> None:
    counts = TRUE.neutral_counts()
    assert counts == TRUE.counts_from_wheel_speeds(WheelSpeeds())
    assert TRUE.volts_from_counts(*counts) == pytest.approx((1.64, 1.66), abs=0.5 * TRUE.volts_per_count)


@pytest.mark.parametrize("bits", [8, 10, 12, 16])
def test_a_crawl_clears_the_dead_band_at_any_resolution(bits: int) -> None:
    model = replace(TRUE, bits=bits)
    reached = model.wheel_speeds_from_counts(*model.counts_from_wheel_speeds(WheelSpeeds(0.05, 0.05)))
    assert reached.left + reached.right > 0.0


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1e308])
def test_speeds_that_are_not_finite_are_refused(bad: float) -> None:
    for model in (TRUE, DeadBand(TRUE)):
        with pytest.raises(CalibrationError, match="finite"):
            model.counts_from_wheel_speeds(WheelSpeeds(bad, -bad))


@pytest.mark.parametrize("counts", [-1, 4096])
def test_counts_outside_the_converter_have_no_volts(counts: int) -> None:
    with pytest.raises(CalibrationError, match=r"0\.\.4095"):
        TRUE.volts_from_counts(counts, 2048)


def test_a_model_that_cannot_turn_at_speed_is_refused() -> None:
    with pytest.raises(NotMonotone, match="turn_fade"):
        replace(TRUE, turn_fade=0.7)


def test_coupling_without_an_inverse_is_refused() -> None:
    with pytest.raises(NotMonotone, match="separated"):
        replace(TRUE, v_per_turn=0.5, turn_per_v=2.0)


def test_at_a_crawl_the_turn_axis_does_not_jump_across_its_dead_band() -> None:
    """A heading loop that asks for a little left, a little right: without memory each change is a jump of 180 mV."""
    demands = [0.02 * (-1) ** k for k in range(20)]
    hops = {}
    for name, model in (("plain", TRUE), ("held", DeadBand(TRUE))):
        model.counts_from_wheel_speeds(_wheels(0.1, 0.06))
        turn = [model.counts_from_wheel_speeds(_wheels(0.1, 0.1 * TRUE.turn_per_v + w))[1] for w in demands]
        hops[name] = sum(abs(b - a) * TRUE.volts_per_count > 0.15 for a, b in pairwise(turn))
    assert hops == {"plain": 19, "held": 0}


def test_a_small_speed_keeps_the_axis_at_the_edge_of_its_dead_band() -> None:
    for bits in (8, 12):
        model = replace(TRUE, bits=bits, v_per_turn=0.0, turn_per_v=0.0)
        held = DeadBand(model)
        for direction in (1.0, -1.0):
            held.counts_from_wheel_speeds(_wheels(0.1, direction * 0.3))
            _, turn = held.counts_from_wheel_speeds(_wheels(0.1, -direction * 0.01))
            volts = turn * model.volts_per_count
            assert model.turn.speed(volts) == pytest.approx(0.0, abs=1e-12)
            assert abs(volts - model.turn.edge(direction)) <= model.volts_per_count


@pytest.mark.parametrize("omega", [0.0251, 0.1, 1.0])
def test_a_larger_speed_crosses_to_the_other_side_of_the_dead_band(omega: float) -> None:
    model = replace(TRUE, v_per_turn=0.0, turn_per_v=0.0, turn_fade=0.0)
    held = DeadBand(model)
    held.counts_from_wheel_speeds(_wheels(0.1, 0.3))
    assert held.counts_from_wheel_speeds(_wheels(0.1, -omega)) == model.counts_from_wheel_speeds(_wheels(0.1, -omega))


def test_rest_gives_neutral_at_once_and_forgets_the_sides() -> None:
    held = DeadBand(TRUE)
    held.counts_from_wheel_speeds(_wheels(0.3, 0.5))
    assert held.counts_from_wheel_speeds(WheelSpeeds()) == TRUE.neutral_counts()
    assert held.counts_from_wheel_speeds(_wheels(0.0, 0.002)) == TRUE.neutral_counts()


@given(st.lists(st.tuples(st.floats(-0.6, 0.6), st.floats(-1.2, 1.2)), min_size=1, max_size=20))
def test_the_memory_of_the_side_changes_a_speed_by_less_than_its_threshold(demands: list[tuple[float, float]]) -> None:
    held = DeadBand(TRUE)
    for v, omega in demands:
        counts = held.counts_from_wheel_speeds(_wheels(v, omega))
        reached = held.model.twist_from_wheel_speeds(held.wheel_speeds_from_counts(*counts))
        assert abs(reached.v - v) < ENTER_V + 0.01 * ENTER_OMEGA + 0.002
        assert abs(reached.omega - omega) < ENTER_OMEGA + 0.1 * ENTER_V + 0.005


@pytest.mark.parametrize("model", [DEFAULT, TRUE, DeadBand(TRUE)])
def test_all_models_have_the_same_methods(model: DacModel) -> None:
    counts = model.counts_from_wheel_speeds(WheelSpeeds(0.05, 0.05))
    assert counts != model.neutral_counts()
    assert model.wheel_speeds_from_counts(*counts).left > 0.0
    assert all(volts > 0.0 for volts in model.volts_from_counts(*counts))


cuts = st.builds(
    lambda fade, cut: replace(TRUE, turn_fade=fade, speed_cut=cut), st.floats(-0.3, 0.3), st.floats(-0.2, 0.2)
)


@given(cuts, st.floats(-1.2, 1.2), st.floats(-2.0, 2.0))
def test_both_couplings_of_speed_and_turn_are_inverted_together(model: FittedDac, v_f: float, w_t: float) -> None:
    v_f, w_t = (max(-model.forward.reach(-1.0), v_f), max(-model.turn.reach(-1.0), w_t))
    back = model.axis_speeds(model.twist_from_axis_speeds(v_f, w_t))
    assert back == pytest.approx((v_f, w_t), abs=1e-9)


@given(cuts, st.floats(-1.0, 1.0), st.floats(0.5, 50.0))
def test_with_both_couplings_a_command_beyond_the_limits_keeps_its_arc(
    model: FittedDac, ratio: float, factor: float
) -> None:
    v, omega = factor * 2.0 * ratio, factor * 3.0
    a, b = model.axis_speeds(Twist(v, omega))
    assert abs(a) <= model.forward.reach(a) * (1 + 1e-9)
    assert abs(b) <= model.turn.reach(b) * (1 + 1e-9)
    reached = model.twist_from_axis_speeds(a, b)
    assert reached.v * omega == pytest.approx(reached.omega * v, abs=1e-6 * factor)
    at_reach = max(abs(a) / model.forward.reach(a), abs(b) / model.turn.reach(b))
    assert at_reach == pytest.approx(1.0) or (reached.v, reached.omega) == pytest.approx((v, omega))


def test_couplings_that_leave_no_speed_are_refused() -> None:
    with pytest.raises(NotMonotone, match="speed_cut"):
        replace(TRUE, speed_cut=0.4)
    with pytest.raises(NotMonotone, match="together leave nothing"):
        replace(TRUE, speed_cut=0.25, turn_fade=0.4)


@pytest.mark.parametrize("bits", [8, 12])
def test_a_converter_behind_a_gain_stage_starts_above_zero(bits: int) -> None:
    staged = replace(TRUE, bits=bits, volts_min=0.4, volts_max=2.9)
    assert staged.volts_from_counts(0, staged.counts_max) == pytest.approx((0.4, 2.9))
    assert staged.volts_from_counts(*staged.neutral_counts()) == pytest.approx(
        (1.64, 1.66), abs=0.5 * staged.volts_per_count
    )
    back = staged.twist_from_wheel_speeds(
        staged.wheel_speeds_from_counts(*staged.counts_from_wheel_speeds(_wheels(0.3, 0.5)))
    )
    assert (back.v, back.omega) == pytest.approx((0.3, 0.5), abs=4.0 * staged.volts_per_count)
    with pytest.raises(ConfigError, match="volts_min"):
        replace(TRUE, volts_min=3.3)
