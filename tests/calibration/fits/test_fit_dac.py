"""The fit: the parameters of a known chair are found in noise and with outliers; unfit data is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.calibration.synthetic import NEUTRAL, TRUE, SyntheticChair
from waychair.calibration.fits.dac_plot import plot_fit
from waychair.calibration.fits.drive_log import SweepLog
from waychair.calibration.fits.fit_dac import DacFit, LeastData, fit_dac
from waychair.calibration.fits.fit_steps import fit_steps
from waychair.calibration.fits.fitted_dac import FittedDac
from waychair.calibration.fits.stick_levels import on_blocks
from waychair.calibration.fits.sweep import NEAR_NEUTRAL, SweepSettings, sweep
from waychair.errors import CalibrationError, NotMonotone, NotRepeatable, ThinData
from waychair.types import Twist, WheelSpeeds

PLAN = SweepSettings(levels=45, repetitions=1, combined=3)
ENOUGH = LeastData(repetitions=1)


@pytest.fixture(scope="module")
def log() -> SweepLog:
    """A sweep of the known chair."""
    return sweep(SyntheticChair(), NEUTRAL, PLAN)


@pytest.fixture(scope="module")
def fit(log: SweepLog) -> DacFit:
    """The model fitted to that sweep."""
    return fit_dac(log, NEUTRAL, TRUE.track, ENOUGH)


def _inverse_errors(model: FittedDac) -> np.ndarray:
    """Return (N, 2) the speeds of the known chair minus those commanded through `model`."""
    errors = []
    for v in np.linspace(-0.6, 0.9, 11).tolist():
        for omega in np.linspace(-1.2, 1.2, 9).tolist():
            half = 0.5 * omega * TRUE.track
            volts = model.volts_from_counts(*model.counts_from_wheel_speeds(WheelSpeeds(v - half, v + half)))
            done = TRUE.twist_from_volts(*volts)
            errors.append((done.v - v, done.omega - omega))
    return np.array(errors)


def test_the_fitted_inverse_is_exact_to_10_mm_and_15_mrad_per_second(fit: DacFit) -> None:
    v, omega = np.abs(_inverse_errors(fit.model)).max(axis=0)
    assert v <= 0.010
    assert omega <= 0.015


def test_the_parameters_of_the_chair_are_found(fit: DacFit) -> None:
    for axis in ("forward", "turn"):
        found, true = getattr(fit.model, axis), getattr(TRUE, axis)
        assert found.sign == true.sign
        for side in ("above", "below"):
            assert getattr(found, side).dead_band == pytest.approx(getattr(true, side).dead_band, abs=0.006)
            assert getattr(found, side).limit == pytest.approx(getattr(true, side).limit, rel=0.02)
        assert found.delay_s == pytest.approx(true.delay_s, abs=0.015)
        assert found.lag_s == pytest.approx(true.lag_s, abs=0.015)
        assert found.ramp == pytest.approx(true.ramp, rel=0.05)
    assert fit.model.v_per_turn == pytest.approx(TRUE.v_per_turn, abs=0.003)
    assert fit.model.turn_per_v == pytest.approx(TRUE.turn_per_v, abs=0.015)
    assert fit.model.turn_fade == pytest.approx(TRUE.turn_fade, abs=0.02)
    assert fit.margins == pytest.approx((0.09, 0.08), abs=0.006)


def test_the_report_names_every_level_and_its_residual(fit: DacFit) -> None:
    for axis in ("forward", "turn"):
        rows = [row for row in fit.levels if row.axis == axis]
        assert len(rows) >= PLAN.levels
        assert max(abs(row.residual) for row in rows) < 0.04
        assert len({row.volts for row in rows}) == len(rows)
    assert fit.outliers == 0
    assert fit.rms[0] < 0.004
    assert fit.rms[1] < 0.008


def test_one_wrong_hold_in_ten_does_not_spoil_the_fit(log: SweepLog) -> None:
    twists = log.twists.copy()
    changed = np.flatnonzero((np.diff(log.counts, axis=0) != 0).any(axis=1)) + 1
    rng = np.random.default_rng(1)
    moving = [k for k in range(20, len(changed) - 1) if np.abs(log.volts[changed[k]] - NEUTRAL).max() > 0.3]
    for k in rng.choice(moving, len(moving) // 10, replace=False).tolist():
        twists[changed[k] : changed[k + 1]] *= 1.0 + rng.choice([-0.08, 0.08])
    found = fit_dac(replace(log, twists=twists), NEUTRAL, TRUE.track, ENOUGH)
    v, omega = np.abs(_inverse_errors(found.model)).max(axis=0)
    assert v <= 0.015
    assert omega <= 0.030


def test_8_bits_suffice_for_25_mm_and_30_mrad_per_second() -> None:
    coarse = sweep(SyntheticChair(), NEUTRAL, replace(PLAN, bits=8, levels=89))
    found = fit_dac(coarse, NEUTRAL, TRUE.track, ENOUGH)
    v, omega = np.abs(_inverse_errors(found.model)).max(axis=0)
    assert found.model.bits == 8
    assert v <= 0.025
    assert omega <= 0.030


def test_reversed_wiring_is_found_by_its_signs() -> None:
    odd = replace(TRUE, forward=replace(TRUE.forward, sign=-1), turn=replace(TRUE.turn, sign=1))
    found = fit_dac(sweep(SyntheticChair(odd), NEUTRAL, PLAN), NEUTRAL, TRUE.track, ENOUGH).model
    assert (found.forward.sign, found.turn.sign) == (-1, 1)
    assert found.twist_from_volts(2.2, 1.66).v == pytest.approx(odd.twist_from_volts(2.2, 1.66).v, abs=0.01)


def test_a_chair_that_slows_down_into_turns_and_turns_less_at_speed_is_found() -> None:
    cut = replace(TRUE, turn_fade=0.25, speed_cut=0.12)
    found = fit_dac(sweep(SyntheticChair(cut), NEUTRAL, PLAN), NEUTRAL, TRUE.track, ENOUGH).model
    assert found.turn_fade == pytest.approx(0.25, abs=0.03)
    assert found.speed_cut == pytest.approx(0.12, abs=0.02)
    for v, omega in ((0.5, 0.8), (-0.4, 1.0), (0.6, -0.6), (0.8, 0.0), (0.0, 1.2)):
        done = cut.twist_from_axis_speeds(*found.axis_speeds(Twist(v, omega)))
        assert (done.v, done.omega) == pytest.approx((v, omega), abs=0.015)


@pytest.mark.parametrize(
    ("factors", "says"),
    [
        ((1.0, 0.78), "slower at the end of the sweep than at its beginning, because of hot motors"),
        ((1.0, 1.28), "faster at the end of the sweep than at its beginning, as if its speed dial"),
    ],
)
def test_a_drift_is_named_by_its_direction(log: SweepLog, factors: tuple[float, float], says: str) -> None:
    """Quickly at first, as motors grow hot, so that most levels agree with each other."""
    cold, hot = factors
    factor = hot + (cold - hot) * np.exp(-np.linspace(0.0, 10.0, len(log.twists)))
    with pytest.raises(NotRepeatable, match=f"forward axis was [0-9]+ % {says}"):
        fit_dac(replace(log, twists=log.twists * factor[:, None]), NEUTRAL, TRUE.track, ENOUGH)


def test_too_few_levels_are_refused(log: SweepLog) -> None:
    with pytest.raises(ThinData, match=r"forward axis alone are too few .*at least 60"):
        fit_dac(log, NEUTRAL, TRUE.track, LeastData(levels=60, repetitions=1))


def test_too_few_repetitions_are_refused(log: SweepLog) -> None:
    with pytest.raises(ThinData, match="at least 3 times"):
        fit_dac(log, NEUTRAL, TRUE.track)


def test_a_log_without_rests_gives_no_lag(log: SweepLog) -> None:
    driven = (np.abs(log.volts - NEUTRAL) > NEAR_NEUTRAL).any(axis=1)
    restless = SweepLog(log.stamps_ns[driven], log.counts[driven], log.twists[driven], log.bits, log.volts_max)
    with pytest.raises(ThinData, match="no step from rest"):
        fit_steps(restless, 0, NEUTRAL, NEAR_NEUTRAL)


def test_less_speed_at_more_stick_is_refused(log: SweepLog) -> None:
    twists = log.twists.copy()
    twists[log.volts[:, 0] > NEUTRAL[0] + 0.9, 0] *= 0.6
    with pytest.raises(NotMonotone, match="forward axis above neutral"):
        fit_dac(replace(log, twists=twists), NEUTRAL, TRUE.track, ENOUGH)


@pytest.mark.parametrize("change", [1.25, 0.8])
@pytest.mark.parametrize(("begin", "end"), [(0.0, 0.12), (0.65, 1.0)])
@pytest.mark.parametrize(("axis", "name"), [(0, "forward"), (1, "turn")])
def test_fading_motors_and_a_changed_profile_are_refused(
    log: SweepLog, change: float, begin: float, end: float, axis: int, name: str
) -> None:
    part = np.arange(len(log.twists)) / len(log.twists)
    twists = log.twists.copy()
    twists[(part >= begin) & (part < end), axis] *= change
    with pytest.raises((NotRepeatable, NotMonotone), match=f"{name} axis"):
        fit_dac(replace(log, twists=twists), NEUTRAL, TRUE.track, ENOUGH)


def test_a_neutral_outside_of_the_log_is_refused(log: SweepLog) -> None:
    with pytest.raises(CalibrationError, match=r"never at its neutral of 3\.640"):
        fit_dac(log, (NEUTRAL[0] + 2.0, NEUTRAL[1]), TRUE.track, ENOUGH)


@pytest.mark.parametrize(("off", "refused"), [(0.08, False), (0.13, True)])
def test_a_neutral_outside_of_the_dead_band_is_refused(off: float, refused: bool) -> None:
    neutral = (NEUTRAL[0] + off, NEUTRAL[1])
    plan = replace(PLAN, swing=1.0, combined=0)
    if refused:
        with pytest.raises(CalibrationError, match="forward axis still moves at its neutral"):
            sweep(SyntheticChair(), neutral, plan)
    else:
        log = sweep(SyntheticChair(), neutral, plan)
        assert fit_dac(log, neutral, TRUE.track, ENOUGH).margins[0] == pytest.approx(0.09 - off, abs=0.008)


def test_speeds_without_their_signs_are_refused(log: SweepLog) -> None:
    with pytest.raises(CalibrationError, match="same way on both sides"):
        fit_dac(replace(log, twists=np.abs(log.twists)), NEUTRAL, TRUE.track, ENOUGH)


def test_an_axis_that_does_not_move_is_refused(log: SweepLog) -> None:
    with pytest.raises(ThinData, match="turn axis"):
        fit_dac(replace(log, twists=log.twists * (1.0, 0.0)), NEUTRAL, TRUE.track, ENOUGH)


def test_on_blocks_only_signs_and_dead_bands_are_found(log: SweepLog) -> None:
    """Wheels in the air turn faster than on the floor: that must not matter."""
    forward, turn = on_blocks(replace(log, twists=1.3 * log.twists), NEUTRAL, NEAR_NEUTRAL)
    assert (forward.sign, turn.sign) == (TRUE.forward.sign, TRUE.turn.sign)
    level = 1.2 / 23
    for found, true in ((forward, TRUE.forward), (turn, TRUE.turn)):
        assert found.dead_band_above == pytest.approx(true.above.dead_band, abs=0.6 * level)
        assert found.dead_band_below == pytest.approx(true.below.dead_band, abs=0.6 * level)


def test_the_sweep_refuses_a_converter_that_cannot_reach_the_stick() -> None:
    with pytest.raises(CalibrationError, match="gain stage"):
        sweep(SyntheticChair(), (6.0, 6.0), PLAN)


@pytest.mark.parametrize("suffix", [".png", ".svg"])
def test_the_fit_is_drawn(fit: DacFit, tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"fit{suffix}"
    plot_fit(fit, path)
    assert path.stat().st_size > 10_000
    assert path.read_bytes()[:4] in (b"\x89PNG", b"<?xm")
