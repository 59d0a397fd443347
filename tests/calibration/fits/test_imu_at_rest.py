"""Inertial unit at rest: bias, white noise, instability; recordings that are not at rest are refused."""

from __future__ import annotations

import math

import numpy as np
import pytest

from waychair.calibration.fits.imu_at_rest import GRAVITY, LEAST_S, allan_deviation, imu_at_rest
from waychair.errors import CalibrationError, ThinData
from waychair.types import FloatArray, ImuSample

RATE_HZ = 200.0
GYRO_BIAS = (0.004, -0.002, 0.001)
ACCEL_BIAS = (0.05, -0.03, 0.02)


def _recorded(
    seconds: float, gyro_noise: float = 0.0003, accel_noise: float = 0.002, drift: FloatArray | None = None
) -> list[ImuSample]:
    rng = np.random.default_rng(0)
    count = round(seconds * RATE_HZ)
    gyro = np.array(GYRO_BIAS) + gyro_noise * math.sqrt(RATE_HZ) * rng.standard_normal((count, 3))
    accel = (
        np.array(ACCEL_BIAS) + (0.0, 0.0, GRAVITY) + accel_noise * math.sqrt(RATE_HZ) * rng.standard_normal((count, 3))
    )
    if drift is not None:
        gyro += np.outer(np.linspace(0.0, 1.0, count), drift)
    return [ImuSample(round(k / RATE_HZ * 1e9), accel[k], gyro[k]) for k in range(count)]


def test_known_bias_and_noise_are_found() -> None:
    found = imu_at_rest(_recorded(60.0))
    assert found.gyro_bias == pytest.approx(GYRO_BIAS, abs=3 * 0.0003 / math.sqrt(60.0))
    assert found.accel_bias == pytest.approx(ACCEL_BIAS, abs=3 * 0.002 / math.sqrt(60.0))
    assert found.gyro_noise == pytest.approx(0.0003, rel=0.05)
    assert found.accel_noise == pytest.approx(0.002, rel=0.05)


def test_a_drifting_bias_shows_as_instability() -> None:
    steady = imu_at_rest(_recorded(60.0)).gyro_instability
    wandering = imu_at_rest(_recorded(60.0, drift=np.array([0.0, 0.0, 0.02]))).gyro_instability
    assert wandering > 2.5 * steady


@pytest.mark.parametrize("length", [1, 2, 7, 50])
def test_the_allan_deviation_matches_its_definition(length: int) -> None:
    values = np.random.default_rng(1).standard_normal((200, 2)).cumsum(axis=0)
    means = np.array([values[k : k + length].mean(axis=0) for k in range(200 - length + 1)])
    steps = np.array([means[k + length] - means[k] for k in range(200 - 2 * length + 1)])
    expected = np.sqrt(0.5 * (steps**2).mean(axis=0))
    assert allan_deviation(values, [length])[0] == pytest.approx(expected)


@pytest.mark.parametrize("seconds", [0.0, 1.0, LEAST_S - 0.01])
def test_a_short_recording_is_refused(seconds: float) -> None:
    with pytest.raises(ThinData, match="too short"):
        imu_at_rest(_recorded(seconds))


def test_a_chair_that_moves_is_refused() -> None:
    samples = _recorded(30.0)
    moved = [
        ImuSample(s.stamp_ns, s.accel, s.gyro + np.array([0.0, 0.0, 0.3]) * (s.stamp_ns > 20_000_000_000))
        for s in samples
    ]
    with pytest.raises(CalibrationError, match="gyro drifted"):
        imu_at_rest(moved)


def test_a_unit_mounted_on_its_side_is_refused() -> None:
    turned = [ImuSample(s.stamp_ns, s.accel[[2, 1, 0]], s.gyro) for s in _recorded(30.0)]
    with pytest.raises(CalibrationError, match="z axis"):
        imu_at_rest(turned)
