"""Delays of the sensors' stamps, from the correlation of their turns with the gyro's.

Lidar, encoders and camera all measure the chair's turns. The delay of a sensor's stamps is the one at which its turns
agree best with the gyro's. This is the correlation of yaw rates (as in Furgale et al., Unified Temporal and Spatial
Calibration for Multi-Sensor Systems, IROS 2013, which refines it further), but over turns between the sensor's own
stamps, so that slow and irregular sensors lose nothing.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from waychair.calibration.measured import Measured, measured
from waychair.errors import CalibrationError, ThinData
from waychair.types import BoolArray, FloatArray, ImuSample, IntArray, Odometry, RgbdFrame, Scan, WheelTicks

T = TypeVar("T")

LEAST_TURNS = 40
"""Fewest turns for a delay."""

_LEAST_GRAVITY = 5.0  # m/s^2; with a smaller reading there is no accelerometer, and z counts as up


@dataclass(frozen=True, slots=True)
class SensorDelays(Measured):
    """Delays of each sensor's stamps against the gyro's; negative if they are early."""

    lidar_ns: int = measured(0, "ns", "of scans", low=-1_000_000_000, high=1_000_000_000)
    wheels_ns: int = measured(0, "ns", "of encoder counts or wheel odometry", low=-1_000_000_000, high=1_000_000_000)
    camera_ns: int = measured(0, "ns", "of pictures", low=-1_000_000_000, high=1_000_000_000)


EARLIEST_S, LATEST_S, STEP_S = -0.25, 0.25, 0.01
"""s; range and step of the search for a delay, before its refinement."""

SPAN_S = 0.25
"""s; turns are taken over about this time."""

LEAST_RATE = 0.03
"""rad/s; least change (one sigma) of the yaw rate."""

MOST_SIGMA_S = 0.004
"""s; a delay must be known to this (one sigma)."""

LEAST_CORRELATION = 0.9
"""Least correlation of a sensor's turns with the gyro's."""

OUTLIER = 4.0
"""Sigmas; turns with larger residuals are left out."""


@dataclass(frozen=True, slots=True)
class Heading:
    """A sensor's headings (N,) [rad, left positive, not wrapped] at ascending stamps_ns (N,).

    Only differences count. A nan marks a break; turns across it are unknown.
    """

    stamps_ns: IntArray
    headings: FloatArray


@dataclass(frozen=True, slots=True)
class TimeOffset:
    """`delay_ns` of a sensor's stamps against the gyro's with its standard deviation, the number of turns, their
    correlation with the gyro's, and the rms of the residuals [rad]."""

    delay_ns: int
    sigma_ns: int
    turns: int
    correlation: float
    rms_rad: float


def without_delay(message: T, delays: SensorDelays) -> T:
    """Return a sensor's message with its stamp corrected; messages of the gyro and others stay as they are."""
    late = _delay_of(message, delays)
    return dataclasses.replace(message, stamp_ns=message.stamp_ns - late) if late else message  # type: ignore[type-var, attr-defined]


def heading_from_gyro(samples: Sequence[ImuSample]) -> Heading:
    """Return the integral of the gyro's rate about the vertical; the gyro's bias does not matter here.

    The accelerometer's mean gives the vertical, so that the IMU may be mounted in any attitude. A sample counts as the
    mean rate since the sample before; a gyro that reports the rate at its stamp shifts every delay by half a sample,
    2.5 ms at 200 Hz.

    Raises:
        ThinData: there are fewer than two samples with different stamps.
    """
    stamps = np.array([sample.stamp_ns for sample in samples], np.int64)
    rates = np.array([sample.gyro for sample in samples], np.float64).reshape(-1, 3)
    forces = np.array([sample.accel for sample in samples], np.float64).reshape(-1, 3)
    known = np.flatnonzero(np.isfinite(rates).all(axis=1) & np.isfinite(forces).all(axis=1))
    stamps, first = np.unique(stamps[known], return_index=True)
    if len(stamps) < 2:
        raise ThinData(f"{len(stamps)} gyro samples tell no turn: record the IMU too (topic imu/data)")
    force = forces[known].mean(axis=0)
    up = force / np.linalg.norm(force) if np.linalg.norm(force) > _LEAST_GRAVITY else np.array([0.0, 0.0, 1.0])
    steps = (rates[known][first[1:]] @ up) * np.diff(stamps) * 1e-9
    return Heading(stamps, np.concatenate([[0.0], np.cumsum(steps)]))


def time_offset(heading: Heading, gyro: Heading, sensor: str) -> TimeOffset:
    """Return the delay of a sensor's stamps at which its turns fit the gyro's best, up to a scale and a bias.

    Raises:
        ThinData: too few turns, or the yaw rate hardly changed.
        CalibrationError: the turns agree at no delay, or only at one beyond the search range.
    """
    turns = _turns(heading, gyro)
    if len(turns.turns) < LEAST_TURNS:
        raise ThinData(
            f"{len(turns.turns)} turns seen by the {sensor} beside the gyro's are too few: record for longer"
        )
    if (change := turns.change()) < LEAST_RATE:
        raise ThinData(
            f"the yaw rate changed by {change:.2f} rad/s only, {LEAST_RATE:g} are needed: "
            "turn left and right repeatedly"
        )
    residuals = turns.residuals(_best(turns))
    spread = max(1.4826 * float(np.median(np.abs(residuals))), 1e-9)
    turns = turns.only(np.abs(residuals) <= OUTLIER * spread)
    delay = _best(turns)
    residuals = turns.residuals(delay)
    correlation = math.sqrt(max(0.0, 1.0 - float(np.var(residuals)) / float(np.var(turns.turns))))
    if correlation < LEAST_CORRELATION:
        raise CalibrationError(
            f"the turns seen by the {sensor} do not follow the gyro's (correlation {correlation:.2f}, "
            f"{LEAST_CORRELATION:g} is needed): check how both are mounted, and record in a room that stands still"
        )
    if not EARLIEST_S + STEP_S < delay < LATEST_S - STEP_S:
        raise CalibrationError(
            f"the stamps of the {sensor} are off by {1e3 * delay:.0f} ms or more, beyond the search range "
            f"({1e3 * EARLIEST_S:.0f} to {1e3 * LATEST_S:.0f} ms): set its clock first"
        )
    rms = math.sqrt(float(np.mean(residuals**2)))
    if (sigma := _sigma(turns, delay, rms)) > MOST_SIGMA_S:
        raise ThinData(
            f"the delay of the {sensor} is known to {1e3 * sigma:.1f} ms only, {1e3 * MOST_SIGMA_S:g} ms are needed: "
            "record for longer, with more turns to and fro"
        )
    return TimeOffset(round(1e9 * delay), round(1e9 * sigma), len(residuals), correlation, rms)


@dataclass(frozen=True, slots=True)
class _Turns:
    """Turns (N,) [rad] from begin to end (N,) [s], the gyro's headings (M,) at times (M,), and the turns' overlap."""

    begin: FloatArray
    end: FloatArray
    turns: FloatArray
    times: FloatArray
    headings: FloatArray
    overlap: int

    def of_gyro(self, delay: float) -> FloatArray:
        """Return the gyro's turns (N,) [rad] over the same stretches, for stamps late by `delay` [s]."""
        at_end = np.interp(self.end - delay, self.times, self.headings)
        turned: FloatArray = at_end - np.interp(self.begin - delay, self.times, self.headings)
        return turned

    def change(self) -> float:
        """Standard deviation of the yaw rate [rad/s]."""
        return float(np.std(self.of_gyro(0.0) / (self.end - self.begin)))

    def residuals(self, delay: float) -> FloatArray:
        """Return the residuals (N,) [rad] of the turns after the best scale and bias of the gyro."""
        model = np.stack([self.of_gyro(delay), self.end - self.begin], axis=1)
        left: FloatArray = self.turns - model @ np.linalg.solve(model.T @ model, model.T @ self.turns)
        return left

    def misfit(self, delay: float) -> float:
        """Return the sum of squared residuals."""
        residuals = self.residuals(delay)
        return float(residuals @ residuals)

    def only(self, chosen: BoolArray) -> _Turns:
        """Return the chosen turns."""
        return dataclasses.replace(self, begin=self.begin[chosen], end=self.end[chosen], turns=self.turns[chosen])


def _delay_of(message: object, delays: SensorDelays) -> int:
    if isinstance(message, Scan):
        return delays.lidar_ns
    if isinstance(message, WheelTicks | Odometry):
        return delays.wheels_ns
    return delays.camera_ns if isinstance(message, RgbdFrame) else 0


def _turns(heading: Heading, gyro: Heading) -> _Turns:
    """Return the turns over stretches of about `SPAN_S` from each stamp on, if the gyro covers them at any delay."""
    times = (gyro.stamps_ns - gyro.stamps_ns[0]) * 1e-9
    seconds = (heading.stamps_ns - gyro.stamps_ns[0]) * 1e-9
    period = float(np.median(np.diff(seconds))) if len(seconds) > 1 else 0.0
    stride = max(1, round(SPAN_S / period)) if period > 0.0 else 1
    pieces = np.cumsum(np.isnan(heading.headings))
    begin, end = seconds[:-stride], seconds[stride:]
    turns = heading.headings[stride:] - heading.headings[:-stride]
    usable = np.isfinite(turns) & (pieces[stride:] == pieces[:-stride])
    usable &= np.abs(end - begin - stride * period) < 0.5 * stride * period
    usable &= (begin - LATEST_S >= 0.0) & (end - EARLIEST_S <= times[-1])
    return _Turns(
        begin=begin[usable], end=end[usable], turns=turns[usable], times=times, headings=gyro.headings, overlap=stride
    )


def _best(turns: _Turns) -> float:
    """Return the delay [s] of the least misfit: the best of a grid, refined between its neighbours (Brent's method)."""
    from scipy.optimize import minimize_scalar  # here, since it loads slowly and few commands fit anything

    grid = np.arange(EARLIEST_S, LATEST_S + 0.5 * STEP_S, STEP_S)
    best = float(grid[np.argmin([turns.misfit(float(delay)) for delay in grid])])
    bounds = (best - STEP_S, best + STEP_S)
    return float(minimize_scalar(turns.misfit, bounds=bounds, method="bounded", options={"xatol": 1e-6}).x)


def _sigma(turns: _Turns, delay: float, rms: float) -> float:
    """Return the standard deviation [s] from the misfit's curvature, at most the width of the search.

    Overlapping stretches count as one, as if their residuals were equal. That is right if a sensor's heading drifts,
    and too large if it is merely noisy.
    """
    step = 0.5 * STEP_S
    curvature = (turns.misfit(delay + step) - 2.0 * turns.misfit(delay) + turns.misfit(delay - step)) / step**2
    widest = LATEST_S - EARLIEST_S
    return min(widest, rms * math.sqrt(2.0 * turns.overlap / curvature)) if curvature > 0.0 else widest
