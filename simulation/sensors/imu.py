"""The IMU: the true motion at its mount with the errors of a MEMS sensor."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from waychair.config import Settings, setting
from waychair.types import FloatArray, ImuSample

_DRAWN_SAMPLES = 1024
"""Number of samples for which errors are drawn in one call."""


@dataclass(frozen=True, slots=True)
class ImuErrors:
    """Biases, scale errors and range of a MEMS IMU, the same on all three axes of a sensor.

    The figures, and the noise of `ImuSettings`, are plausible for a unit of the class of Bosch's BMI088 or TDK's
    ICM-20948 that was calibrated once and then mounted: 16 bits over +-3 g and +-2000 deg/s, noise of about 0.2 mg and
    0.014 deg/s per root Hz. The drift includes warming up and cooling down, and so is larger than the bias instability
    of a data sheet.
    """

    accel_start_bias: float = 0.05  # m/s^2, one sigma; bias when switched on
    gyro_start_bias: float = 0.003  # rad/s, one sigma; bias when switched on
    accel_drift: float = 0.003  # m/s^2, one sigma; drift of the bias
    gyro_drift: float = 0.0002  # rad/s, one sigma; drift of the bias
    drift_s: float = 200.0  # s; correlation time of the drift
    scale: float = 0.003  # one sigma; scale error of each axis
    accel_range: float = 29.4  # m/s^2; largest reading
    gyro_range: float = 34.9  # rad/s; largest reading
    bits: int = 16  # of a reading, with its sign


@dataclass(frozen=True, slots=True)
class ImuSettings(Settings):
    """Rate and white noise of the IMU."""

    rate_hz: float = setting(
        0.0,
        "Hz",
        "samples per second of the IMU; larger: turns are sampled more finely; 0: no IMU",
        low=0.0,
        high=1000.0,
    )
    accel_noise: float = setting(
        0.0018,
        "m/s^2/sqrt(Hz)",
        "density of the accelerometer's white noise; larger: noisier accelerations",
        low=0.0,
        high=1.0,
    )
    gyro_noise: float = setting(
        0.00024, "rad/s/sqrt(Hz)", "density of the gyro's white noise; larger: noisier turn rates", low=0.0, high=0.1
    )


ERRORS = ImuErrors()
"""The errors of the simulated IMU."""


class Imu:
    """The IMU with the scale errors and biases drawn at its start, the drifting biases, and its own random stream."""

    def __init__(self, settings: ImuSettings, rng: np.random.Generator, errors: ImuErrors = ERRORS) -> None:
        s, e = settings, errors
        self._rng = rng
        self._scale = 1.0 + e.scale * rng.standard_normal(6)
        self._start_bias = np.repeat([e.accel_start_bias, e.gyro_start_bias], 3) * rng.standard_normal(6)
        self._white = np.repeat([s.accel_noise, s.gyro_noise], 3) * math.sqrt(s.rate_hz)
        self._drift = np.repeat([e.accel_drift, e.gyro_drift], 3)
        self._wandering = rng.standard_normal(6)
        self._keep = math.exp(-1.0 / (e.drift_s * s.rate_hz)) if s.rate_hz > 0.0 else 0.0
        self._largest = np.repeat([e.accel_range, e.gyro_range], 3)
        self._step = self._largest / 2 ** (e.bits - 1)
        self._errors = np.empty((0, 6))
        self._next = 0

    def sample(self, stamp_ns: int, specific_force: FloatArray, angular_rate: FloatArray) -> ImuSample:
        """Return the reading (REP-145) of a specific force (3,) [m/s^2], +g up at rest, and a rate (3,) [rad/s]."""
        if self._next == len(self._errors):
            self._draw()
        read = np.empty(6)
        read[:3] = specific_force
        read[3:] = angular_rate
        read *= self._scale
        read += self._errors[self._next]
        self._next += 1
        np.rint(read / self._step, out=read)
        read *= self._step
        np.minimum(np.maximum(read, -self._largest, out=read), self._largest, out=read)
        return ImuSample(stamp_ns, read[:3], read[3:])

    def _draw(self) -> None:
        """Draw the errors of the next samples: white noise, and biases that are first-order Gauss-Markov sequences."""
        white, fresh = self._rng.standard_normal((2, _DRAWN_SAMPLES, 6))
        wandered = gauss_markov(self._wandering, fresh, self._keep)
        self._wandering = wandered[-1]
        self._errors = self._white * white + self._drift * wandered + self._start_bias
        self._next = 0


@njit(cache=True)
def gauss_markov(start: FloatArray, fresh: FloatArray, keep: float) -> FloatArray:
    """Return the next values (N, K) of K first-order Gauss-Markov sequences of unit variance.

    They follow `start` (K,) and use unit normals `fresh` (N, K); `keep` is the correlation of one value with the next.
    """
    values = np.empty_like(fresh)
    gain = math.sqrt(1.0 - keep * keep)
    for k in range(fresh.shape[1]):
        value = start[k]
        for i in range(fresh.shape[0]):
            value = keep * value + gain * fresh[i, k]
            values[i, k] = value
    return values
