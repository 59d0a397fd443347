"""Simulated chairs are calibrated by their own sensors, and then follow their commands."""

from __future__ import annotations

from dataclasses import replace

import pytest
from evaluation.scenes.chair_score import command_grid, inverse_error

from waychair.calibration.chair_body import CHAIR_A
from waychair.calibration.drives.dac_and_stops import ChairUnderTest, calibrate_dac, calibrate_stops
from waychair.calibration.fits.axis_model import AxisModel, AxisSide
from waychair.calibration.fits.dac import DEFAULT
from waychair.calibration.fits.fit_dac import DacFit, LeastData
from waychair.calibration.fits.fitted_dac import FittedDac
from waychair.calibration.fits.stopping import StopSettings, permitted_speed
from waychair.calibration.fits.sweep import SweepSettings
from waychair.simulation.plant.plant import PlantSettings, randomised
from waychair.simulation.simulator import SimulatorSettings
from waychair.trials.simulated_calibration import chair_in_hall

SEED = 4
PLANT = randomised(PlantSettings(), SEED)
SETTINGS = SimulatorSettings(plant=PLANT)
SHORT = SweepSettings(levels=11, repetitions=1, combined=2)
ENOUGH = LeastData(levels=11, repetitions=1)


@pytest.fixture(scope="module")
def chair() -> ChairUnderTest:
    """A chair of the model's form."""
    return chair_in_hall(SETTINGS, CHAIR_A, SEED)


@pytest.fixture(scope="module")
def fit(chair: ChairUnderTest) -> DacFit:
    """The fit of a short sweep."""
    return calibrate_dac(chair, SHORT, ENOUGH)


@pytest.mark.sampled(1)
def test_a_calibrated_chair_follows_commands_better_than_with_the_linear_model(fit: DacFit) -> None:
    commands = command_grid()[::2]
    fitted, linear = (inverse_error(model, PLANT, CHAIR_A, commands) for model in (fit.model, DEFAULT))
    assert fitted.max_v <= 0.010
    assert fitted.max_omega <= 0.015
    assert fitted.commands == len(commands)
    assert linear.max_v > 0.02
    assert linear.max_omega > 0.05


def test_delay_lag_and_ramps_are_found_from_the_steps(fit: DacFit) -> None:
    forward, turn = fit.steps
    for found in (forward, turn):
        assert found.delay_s == pytest.approx(PLANT.delay_s, abs=0.015)
        assert found.lag_s == pytest.approx(PLANT.lag_s, abs=0.03)
    assert forward.ramp == pytest.approx(PLANT.acceleration, rel=0.1)
    assert turn.ramp == pytest.approx(PLANT.turn_acceleration, rel=0.1)


@pytest.mark.nightly
def test_a_chair_without_encoders_is_calibrated_by_lidar_and_gyro() -> None:
    blind = chair_in_hall(SETTINGS, CHAIR_A, SEED, encoders=False)
    found = calibrate_dac(blind, replace(SHORT, levels=5, combined=1), replace(ENOUGH, levels=6))
    error = inverse_error(found.model, PLANT, CHAIR_A, command_grid()[::3])
    assert error.max_v <= 0.040
    assert error.max_omega <= 0.060


def test_the_speed_limit_is_that_of_the_measured_stops(chair: ChairUnderTest, fit: DacFit) -> None:
    settings = StopSettings(repetitions=1, step=0.5, fastest=0.9)
    table, stops = calibrate_stops(chair, fit.model, settings)
    assert {(s.v > 0.05) - (s.v < -0.05) for s in stops} == {-1, 0, 1}
    for stop in stops:
        if abs(stop.v) > 0.1:
            # delay, then lag, then the controller's ramp
            least = abs(stop.v) * PLANT.delay_s + stop.v**2 / (2.0 * PLANT.deceleration)
            assert least < stop.distance_m < least + abs(stop.v) * 2.0 * PLANT.lag_s + 0.02
            assert table.distance(min(abs(stop.v), table.speeds[-1])) > stop.distance_m
    assert permitted_speed(table) == pytest.approx(0.9, abs=0.05)
    assert permitted_speed(None) == 0.3


def test_a_chair_that_is_slower_in_reverse_is_stopped_from_its_fastest_forward(chair: ChairUnderTest) -> None:
    """The model predicts half the speed in reverse; unreached speeds do not improve the table."""
    fast = AxisSide(gain=PLANT.forward_gain, dead_band=PLANT.forward_dead_band, limit=1.0)
    forward = AxisModel(neutral=chair.neutral[0], above=fast, below=replace(fast, limit=0.5))
    model = FittedDac(forward=replace(forward, delay_s=PLANT.delay_s, lag_s=PLANT.lag_s, ramp=PLANT.acceleration))
    table, stops = calibrate_stops(chair, model, StopSettings(repetitions=1, step=0.4))
    assert table.speeds[-1] == pytest.approx(0.98, abs=0.05)
    assert min(stop.v for stop in stops) == pytest.approx(-0.49, abs=0.05)
