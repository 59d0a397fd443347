"""Simulated chairs are calibrated by their own sensors, and then follow their commands."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from waychair.calibration.chair_body import CHAIR_A
from waychair.calibration.fits.axis_model import AxisModel, AxisSide
from waychair.calibration.fits.dac import DEFAULT
from waychair.calibration.fits.fit_dac import DacFit, LeastData
from waychair.calibration.fits.fitted_dac import FittedDac
from waychair.calibration.fits.stopping import StopSettings, permitted_speed
from waychair.calibration.fits.sweep import SweepSettings
from waychair.errors import WorldError
from waychair.recordings.recording import RecordingWriter
from waychair.simulation.plant.plant import PlantSettings, randomised
from waychair.simulation.sensors.camera import CameraSettings
from waychair.simulation.sensors.imu import ImuErrors
from waychair.simulation.simulator import Simulator, SimulatorSettings, with_all_sensors
from waychair.trials.calibrate import (
    ChairUnderTest,
    acceptance_chairs,
    calibrate_dac,
    calibrate_stops,
    chair_in_hall,
    command_grid,
    inverse_error,
    measured_neutral,
    settled_twist,
)
from waychair.trials.calibrate_sensors import (
    WHEELS_HALL,
    calibrate_camera,
    calibrate_imu,
    calibrate_wheels,
    camera_from_recording,
    nominal_mount,
    with_displaced_camera,
)
from waychair.trials.halls import open_hall
from waychair.trials.measured_speeds import EncoderSpeeds
from waychair.trials.simulated_drive import SimulatedDrive, with_gyro
from waychair.types import Pose2, RgbdFrame, Scan

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


def test_a_calibrated_chair_does_as_it_is_told_and_better_than_by_the_linear_model(fit: DacFit) -> None:
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


def test_a_chair_without_encoders_is_calibrated_by_lidar_and_gyro() -> None:
    blind = chair_in_hall(SETTINGS, CHAIR_A, SEED, encoders=False)
    found = calibrate_dac(blind, replace(SHORT, levels=5, combined=1), replace(ENOUGH, levels=6))
    error = inverse_error(found.model, PLANT, CHAIR_A, command_grid()[::3])
    assert error.max_v <= 0.040
    assert error.max_omega <= 0.060


def test_a_hall_that_is_too_small_spoils_the_measurement_and_is_refused() -> None:
    drive = SimulatedDrive(Simulator(open_hall(4.0), CHAIR_A, SETTINGS, SEED), EncoderSpeeds(CHAIR_A))
    assert drive.hold(PLANT.neutral_volts + 0.5, PLANT.neutral_volts, 1.0)
    with pytest.raises(WorldError, match="larger hall"):
        drive.hold(PLANT.neutral_volts + 1.2, PLANT.neutral_volts, 5.0)


def test_the_neutral_is_read_to_two_millivolts() -> None:
    for seed in range(20):
        assert measured_neutral(PLANT, seed) == pytest.approx([PLANT.neutral_volts] * 2, abs=0.002)


def test_commands_beyond_the_models_reach_do_not_count(fit: DacFit) -> None:
    error = inverse_error(fit.model, PLANT, CHAIR_A, np.array([[0.3, 0.0], [3.0, 0.0], [0.0, 9.0]]))
    assert (error.commands, error.beyond) == (1, 2)


def test_a_chair_settles_at_what_its_electronics_say() -> None:
    plain = replace(PlantSettings(), speed_noise=0.0, slip_noise=0.0, left_wheel_scale=1.0, right_wheel_scale=1.0)
    volts = plain.neutral_volts + plain.forward_dead_band + 0.4
    assert settled_twist(plain, CHAIR_A, volts, plain.neutral_volts).v == pytest.approx(0.4 * plain.forward_gain)


def test_the_stops_of_a_chair_permit_what_was_measured(chair: ChairUnderTest, fit: DacFit) -> None:
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


@pytest.mark.parametrize(("mapped", "close"), [(False, 0.001), (True, 0.004)])
def test_wheels_and_track_are_found_from_a_square_both_ways_round(mapped: bool, close: float) -> None:
    uneven = replace(PLANT, left_wheel_scale=1.006, right_wheel_scale=0.996, track_scale=1.01)
    simulator = Simulator(open_hall(WHEELS_HALL, 0.05), CHAIR_A, replace(SETTINGS, plant=uneven), SEED)
    found = calibrate_wheels(simulator, mapped=mapped, rounds=1)
    assert found.left_radius == pytest.approx(1.006 * CHAIR_A.wheel_radius, rel=close)
    assert found.right_radius == pytest.approx(0.996 * CHAIR_A.wheel_radius, rel=close)
    assert found.track == pytest.approx(1.01 * CHAIR_A.track, rel=2.0 * close)


def test_the_gyros_bias_and_noise_are_those_it_was_switched_on_with() -> None:
    settings = with_gyro(SETTINGS)
    found = calibrate_imu(Simulator(open_hall(), CHAIR_A, settings, SEED), 30.0)
    assert found.gyro_noise == pytest.approx(settings.imu.gyro_noise, rel=0.1)
    assert found.accel_noise == pytest.approx(settings.imu.accel_noise, rel=0.1)
    assert max(abs(value) for value in found.gyro_bias) < 4.0 * ImuErrors().gyro_start_bias
    assert max(abs(value) for value in found.gyro_bias) > 0.1 * ImuErrors().gyro_start_bias


def test_a_camera_that_was_mounted_by_hand_is_found_by_walls_and_floor() -> None:
    if Simulator(open_hall(), CHAIR_A, SimulatorSettings(), 0).camera_problem is not None:
        pytest.skip("nothing to render with")
    true = with_displaced_camera(CHAIR_A, SEED)
    small = replace(SETTINGS, camera=CameraSettings(width=320, height=240))
    found = calibrate_camera(true, nominal_mount(CHAIR_A), small, SEED).camera_from_laser
    expected = nominal_mount(true)
    assert np.linalg.norm(found.translation - expected.translation) < 0.010
    assert Rotation.from_matrix(found.rotation @ expected.rotation.T).magnitude() < math.radians(0.3)


def test_a_camera_is_found_from_a_recording_of_a_chair_that_stood_still_by_turns(tmp_path: Path) -> None:
    if Simulator(open_hall(), CHAIR_A, SimulatorSettings(), 0).camera_problem is not None:
        pytest.skip("nothing to render with")
    true, path = with_displaced_camera(CHAIR_A, SEED), tmp_path / "turns.mcap"
    small = with_all_sensors(SETTINGS)
    small = replace(small, camera=replace(small.camera, width=320, height=240, rate_hz=5.0))
    with RecordingWriter(path, {}) as writer:
        for turn in range(6):
            world = replace(open_hall(6.0, 0.05), start=Pose2(3.0, 3.0, math.tau * (turn + 0.5) / 6))
            for message in Simulator(world, true, small, SEED).advance(600_000_000):
                if isinstance(message, Scan | RgbdFrame):
                    writer.write(replace(message, stamp_ns=message.stamp_ns + (turn + 1) * 10**9))
    found = camera_from_recording(path, CHAIR_A).camera_from_laser
    expected = nominal_mount(true)
    assert np.linalg.norm(found.translation - expected.translation) < 0.015
    assert Rotation.from_matrix(found.rotation @ expected.rotation.T).magnitude() < math.radians(0.4)


def test_the_acceptance_has_twelve_chairs_inside_the_form_and_eight_outside() -> None:
    chairs = acceptance_chairs()
    assert len(chairs) == 20
    assert sum(plant.family == PLANT.family for plant in chairs.values()) == 12
    assert len({plant.forward_gain for plant in chairs.values()}) == 20


def test_a_chair_that_is_slower_in_reverse_is_stopped_from_its_fastest_forward(chair: ChairUnderTest) -> None:
    """The model predicts half the speed in reverse; unreached speeds do not improve the table."""
    fast = AxisSide(gain=PLANT.forward_gain, dead_band=PLANT.forward_dead_band, limit=1.0)
    forward = AxisModel(neutral=chair.neutral[0], above=fast, below=replace(fast, limit=0.5))
    model = FittedDac(forward=replace(forward, delay_s=PLANT.delay_s, lag_s=PLANT.lag_s, ramp=PLANT.acceleration))
    table, stops = calibrate_stops(chair, model, StopSettings(repetitions=1, step=0.4))
    assert table.speeds[-1] == pytest.approx(0.98, abs=0.05)
    assert min(stop.v for stop in stops) == pytest.approx(-0.49, abs=0.05)
