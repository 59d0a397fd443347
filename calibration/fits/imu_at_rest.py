"""Bias and noise of an IMU from a recording at rest.

The Allan deviation at short times, where it falls with the root of the time, gives the density of the white noise; its
least value gives the instability of the bias (IEEE Std 952-1997, annex C).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from waychair.calibration.measured import Measured, measured
from waychair.errors import CalibrationError, ThinData
from waychair.types import FloatArray, ImuSample

GRAVITY = 9.80665
"""Standard gravity [m/s^2]."""

LEAST_S = 20.0
"""s; shortest recording."""

_MOST_GYRO = 0.02  # rad/s: means of parts of a recording at rest differ by less
_MOST_ACCEL = 0.1  # m/s^2
_WHITE_S = 0.1  # Allan deviations up to here are of white noise
_TO_INSTABILITY = 0.664  # sqrt(2 ln 2 / pi): least Allan deviation over the instability


@dataclass(frozen=True, slots=True)
class ImuCalibration(Measured):
    """Biases of x, y and z, axes as base, and the worst axis' noise."""

    gyro_bias: tuple[float, float, float] = measured((0.0, 0.0, 0.0), "rad/s", "reading at rest")
    accel_bias: tuple[float, float, float] = measured((0.0, 0.0, 0.0), "m/s^2", "reading at rest, less gravity upwards")
    gyro_noise: float = measured(0.0, "rad/s/sqrt(Hz)", "density of the white noise", low=0.0, high=1.0)
    accel_noise: float = measured(0.0, "m/s^2/sqrt(Hz)", "density of the white noise", low=0.0, high=10.0)
    gyro_instability: float = measured(0.0, "rad/s", "of the bias", low=0.0, high=1.0)
    accel_instability: float = measured(0.0, "m/s^2", "of the bias", low=0.0, high=10.0)


def imu_at_rest(samples: Sequence[ImuSample]) -> ImuCalibration:
    """Return biases and noise from a recording on a level floor, the IMU's axes as the base's.

    A sloping floor or a tilted IMU is taken for a bias of the accelerometer: 10 mm/m is 0.1 m/s^2.

    Raises:
        ThinData: shorter than `LEAST_S`.
        CalibrationError: the chair moved meanwhile, or +g is not upwards.
    """
    stamps = np.array([sample.stamp_ns for sample in samples], np.int64)
    period = float(stamps[-1] - stamps[0]) * 1e-9 / (len(stamps) - 1) if len(stamps) > 1 else 0.0
    seconds = period * len(stamps)
    if seconds < LEAST_S - 1e-6:
        raise ThinData(f"a recording of {seconds:.2f} s is too short for an IMU: record {LEAST_S:g} s or more at rest")
    gyro = np.array([sample.gyro for sample in samples], float)
    accel = np.array([sample.accel for sample in samples], float)
    for name, values, most in (("gyro", gyro, _MOST_GYRO), ("accel", accel, _MOST_ACCEL)):
        parts = np.array([part.mean(axis=0) for part in np.array_split(values, 10)])
        if (wandered := float(np.ptp(parts, axis=0).max())) > most:
            raise CalibrationError(f"the {name} drifted by {wandered:.3f} meanwhile: record with the chair at rest")
    up = accel.mean(axis=0)
    if up[2] < 0.9 * GRAVITY:
        raise CalibrationError(
            f"the z axis reads {up[2]:.2f} m/s^2 at rest, not +g: align the IMU's axes with the base's"
        )
    gyro_noise, gyro_instability = _noise(gyro, period)
    accel_noise, accel_instability = _noise(accel, period)
    return ImuCalibration(
        gyro_bias=_three(gyro.mean(axis=0)),
        accel_bias=_three(up - (0.0, 0.0, GRAVITY)),
        gyro_noise=gyro_noise,
        accel_noise=accel_noise,
        gyro_instability=gyro_instability,
        accel_instability=accel_instability,
    )


def allan_deviation(values: FloatArray, lengths: Sequence[int]) -> FloatArray:
    """Return the overlapping Allan deviations (L, K) of K sequences (N, K) for averaging lengths n; 2 n <= N."""
    sums = np.vstack([np.zeros(values.shape[1]), np.cumsum(values - values.mean(axis=0), axis=0)])
    deviations = []
    for n in lengths:
        means = (sums[n:] - sums[:-n]) / n
        deviations.append(np.sqrt(0.5 * np.mean((means[n:] - means[:-n]) ** 2, axis=0)))
    return np.array(deviations)


def _noise(values: FloatArray, period: float) -> tuple[float, float]:
    """Return the density of the white noise and the instability of the bias, of the worst axis."""
    lengths = np.unique(np.geomspace(1, len(values) // 9, 40).astype(np.int64))
    deviations = allan_deviation(values, lengths.tolist())
    times = lengths * period
    short = times <= max(_WHITE_S, 4.0 * period)
    white = np.median(deviations[short] * np.sqrt(times[short, None]), axis=0)
    return float(white.max()), float(deviations.min(axis=0).max() / _TO_INSTABILITY)


def _three(values: FloatArray) -> tuple[float, float, float]:
    return float(values[0]), float(values[1]), float(values[2])
