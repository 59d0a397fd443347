"""Wheels, inertial unit and camera of simulated chairs are found by their own sensors."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from waychair.calibration.chair_body import CHAIR_A
from waychair.calibration.drives.camera_views import nominal_mount
from waychair.calibration.drives.measured_speeds import EncoderSpeeds
from waychair.errors import WorldError
from waychair.simulation.plant.plant import PlantSettings, randomised
from waychair.simulation.sensors.camera import CameraSettings
from waychair.simulation.sensors.imu import ImuErrors
from waychair.simulation.simulator import Simulator, SimulatorSettings
from waychair.trials.open_hall import open_hall
from waychair.trials.simulated_calibration import (
    WHEELS_HALL,
    calibrate_camera,
    calibrate_imu,
    calibrate_wheels,
    measured_neutral,
    with_displaced_camera,
)
from waychair.trials.simulated_drive import SimulatedDrive, with_gyro

SEED = 4
PLANT = randomised(PlantSettings(), SEED)
SETTINGS = SimulatorSettings(plant=PLANT)


def test_a_hall_that_is_too_small_is_refused() -> None:
    drive = SimulatedDrive(Simulator(open_hall(4.0), CHAIR_A, SETTINGS, SEED), EncoderSpeeds(CHAIR_A))
    assert drive.hold(PLANT.neutral_volts + 0.5, PLANT.neutral_volts, 1.0)
    with pytest.raises(WorldError, match="larger hall"):
        drive.hold(PLANT.neutral_volts + 1.2, PLANT.neutral_volts, 5.0)


def test_the_neutral_is_read_to_two_millivolts() -> None:
    for seed in range(20):
        assert measured_neutral(PLANT, seed) == pytest.approx([PLANT.neutral_volts] * 2, abs=0.002)


@pytest.mark.nightly
@pytest.mark.parametrize(("mapped", "close"), [(False, 0.001), (True, 0.004)])
def test_wheels_and_track_are_found_from_a_square_in_both_directions(mapped: bool, close: float) -> None:
    uneven = replace(PLANT, left_wheel_scale=1.006, right_wheel_scale=0.996, track_scale=1.01)
    simulator = Simulator(open_hall(WHEELS_HALL, 0.05), CHAIR_A, replace(SETTINGS, plant=uneven), SEED)
    found = calibrate_wheels(simulator, mapped=mapped, rounds=1)
    assert found.left_radius == pytest.approx(1.006 * CHAIR_A.wheel_radius, rel=close)
    assert found.right_radius == pytest.approx(0.996 * CHAIR_A.wheel_radius, rel=close)
    assert found.track == pytest.approx(1.01 * CHAIR_A.track, rel=2.0 * close)


def test_bias_and_noise_of_the_gyro_are_found() -> None:
    settings = with_gyro(SETTINGS)
    found = calibrate_imu(Simulator(open_hall(), CHAIR_A, settings, SEED), 30.0)
    assert found.gyro_noise == pytest.approx(settings.imu.gyro_noise, rel=0.1)
    assert found.accel_noise == pytest.approx(settings.imu.accel_noise, rel=0.1)
    assert max(abs(value) for value in found.gyro_bias) < 4.0 * ImuErrors().gyro_start_bias
    assert max(abs(value) for value in found.gyro_bias) > 0.1 * ImuErrors().gyro_start_bias


def test_a_camera_mounted_by_hand_is_found_from_walls_and_floor() -> None:
    if Simulator(open_hall(), CHAIR_A, SimulatorSettings(), 0).camera_problem is not None:
        pytest.skip("nothing to render with")
    true = with_displaced_camera(CHAIR_A, SEED)
    small = replace(SETTINGS, camera=CameraSettings(width=320, height=240))
    found = calibrate_camera(true, nominal_mount(CHAIR_A), small, SEED).camera_from_laser
    expected = nominal_mount(true)
    assert np.linalg.norm(found.translation - expected.translation) < 0.010
    assert Rotation.from_matrix(found.rotation @ expected.rotation.T).magnitude() < math.radians(0.3)
