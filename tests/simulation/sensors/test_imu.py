"""The inertial unit: REP-145, and errors of the size of its settings."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from waychair.simulation.sensors.imu import Imu, ImuErrors, ImuSettings, gauss_markov
from waychair.types import FloatArray

SILENT = ImuSettings(rate_hz=200.0, accel_noise=0.0, gyro_noise=0.0)
PERFECT = ImuErrors(
    accel_start_bias=0.0,
    gyro_start_bias=0.0,
    accel_drift=0.0,
    gyro_drift=0.0,
    scale=0.0,
    bits=24,
)
GRAVITY = np.array([0.0, 0.0, 9.81])
STILL = np.zeros(3)


def _imu(seed: int = 0, settings: ImuSettings = SILENT, **changes: float) -> Imu:
    return Imu(settings, np.random.default_rng(seed), dataclasses.replace(PERFECT, **changes))


def _readings(imu: Imu, count: int, force: FloatArray = GRAVITY, rate: FloatArray = STILL) -> FloatArray:
    """(count, 6): accel and gyro."""
    samples = [imu.sample(k, force, rate) for k in range(count)]
    return np.array([np.concatenate([sample.accel, sample.gyro]) for sample in samples])


def test_at_rest_it_measures_gravity_upwards_and_no_rotation() -> None:
    sample = _imu().sample(7, GRAVITY, STILL)
    assert sample.stamp_ns == 7
    assert sample.accel == pytest.approx([0.0, 0.0, 9.81], abs=1e-5)
    assert sample.gyro == pytest.approx([0.0, 0.0, 0.0], abs=1e-5)


def test_samples_are_copies_and_leave_the_input_unchanged() -> None:
    imu, force = _imu(), GRAVITY.copy()
    first = imu.sample(0, force, STILL)
    imu.sample(1, 2 * GRAVITY, STILL + 1.0)
    assert first.accel[2] == pytest.approx(9.81, abs=1e-5)
    np.testing.assert_array_equal(force, GRAVITY)


@pytest.mark.parametrize("rate_hz", [50.0, 200.0])
def test_white_noise_has_its_stated_density(rate_hz: float) -> None:
    settings = ImuSettings(rate_hz=rate_hz, accel_noise=0.002, gyro_noise=0.0003)
    noise = _readings(_imu(settings=settings), 6000) - [0, 0, 9.81, 0, 0, 0]
    expected = np.repeat([0.002, 0.0003], 3) * math.sqrt(rate_hz)
    assert noise.std(axis=0) == pytest.approx(expected, rel=0.05)
    assert np.abs(noise.mean(axis=0)) == pytest.approx(np.zeros(6), abs=float(expected.max()) / 20)
    assert np.corrcoef(noise[:-1, 0], noise[1:, 0])[0, 1] == pytest.approx(0.0, abs=0.05)
    assert np.corrcoef(noise.T)[0, 1:] == pytest.approx(np.zeros(5), abs=0.05)


def test_the_bias_at_the_start_stays_and_differs_from_unit_to_unit() -> None:
    biases = []
    for seed in range(300):
        readings = _readings(_imu(seed, accel_start_bias=0.05, gyro_start_bias=0.003), 3)
        assert readings.std(axis=0) == pytest.approx(np.zeros(6), abs=1e-12)
        biases.append(readings[0] - [0, 0, 9.81, 0, 0, 0])
    assert np.std(biases, axis=0) == pytest.approx(np.repeat([0.05, 0.003], 3), rel=0.15)


def test_the_drift_has_its_stated_size_and_time_constant() -> None:
    drift = _readings(_imu(accel_drift=0.02, gyro_drift=0.001, drift_s=1.0), 60_000)[:, [0, 1, 3, 4, 5]]
    assert drift.std(axis=0) == pytest.approx([0.02, 0.02, 0.001, 0.001, 0.001], rel=0.2)
    after_one_drift_s = np.corrcoef(drift[:-200, 0], drift[200:, 0])[0, 1]
    assert after_one_drift_s == pytest.approx(math.exp(-1.0), abs=0.12)
    assert np.abs(np.diff(drift[:, 0])).max() < 0.02 * math.sqrt(2 / 200) * 5  # without jumps, also between banks


def test_scale_errors_grow_with_the_motion() -> None:
    imu = _imu(5, scale=0.01)
    one, two = (imu.sample(0, k * np.ones(3), k * np.ones(3)) for k in (1.0, 2.0))
    errors = np.concatenate([one.accel - 1.0, one.gyro - 1.0])
    assert (np.abs(errors) > 1e-4).any()
    assert np.concatenate([two.accel - 2.0, two.gyro - 2.0]) == pytest.approx(2 * errors, abs=1e-5)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_readings_are_limited_to_the_range(sign: float) -> None:
    sample = _imu(accel_range=29.4, gyro_range=34.9).sample(0, sign * np.full(3, 99.0), sign * np.full(3, 99.0))
    assert sample.accel == pytest.approx(np.full(3, sign * 29.4))
    assert sample.gyro == pytest.approx(np.full(3, sign * 34.9))


def test_readings_are_rounded_to_the_last_bit() -> None:
    imu, step = _imu(bits=10, accel_range=20.48, gyro_range=5.12), np.repeat([0.04, 0.01], 3)
    forces = np.random.default_rng(0).uniform(-4.0, 4.0, (50, 3))
    readings = np.array([np.concatenate([(s := imu.sample(0, f, f)).accel, s.gyro]) for f in forces])
    assert readings / step == pytest.approx(np.rint(readings / step), abs=1e-9)
    assert (np.abs(readings - np.hstack([forces, forces])) <= step / 2 + 1e-9).all()


def test_errors_do_not_depend_on_the_motion_and_the_same_seed_repeats_them() -> None:
    settings, errors = ImuSettings(rate_hz=200.0), ImuErrors(scale=0.0, bits=24)
    still, moving, again = (Imu(settings, np.random.default_rng(4), errors) for _ in range(3))
    at_rest, in_motion = _readings(still, 1500), _readings(moving, 1500, GRAVITY + 1.0, STILL + 0.5)
    np.testing.assert_array_equal(at_rest, _readings(again, 1500))
    assert in_motion - at_rest == pytest.approx(np.tile(np.repeat([1.0, 0.5], 3), (1500, 1)), abs=1e-5)


def test_gauss_markov_equals_its_recurrence() -> None:
    rng = np.random.default_rng(0)
    start, fresh, keep = rng.standard_normal(3), rng.standard_normal((40, 3)), 0.9
    expected, value = [], start
    for normals in fresh:
        value = keep * value + math.sqrt(1 - keep**2) * normals
        expected.append(value)
    np.testing.assert_allclose(gauss_markov(start, fresh, keep), expected)
