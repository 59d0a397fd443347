"""Delays of the sensors' stamps, from the correlation of their turns with the gyro's.

Lidar, encoders and camera all measure the chair's turns. The delay of a sensor's stamps is the one at which its turns
agree best with the gyro's. This is the correlation of yaw rates (as in Furgale et al., Unified Temporal and Spatial
Calibration for Multi-Sensor Systems, IROS 2013, which refines it further), but over turns between the sensor's own
stamps, so that slow and irregular sensors lose nothing.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from scipy.optimize import minimize_scalar

from waychair.config import Settings, setting
from waychair.errors import CalibrationError, ThinData
from waychair.types import BoolArray, FloatArray, ImuSample, IntArray, Odometry, RgbdFrame, Scan, WheelTicks

T = TypeVar("T")

LEAST_TURNS = 40
"""Fewest turns for a delay."""

_LEAST_GRAVITY = 5.0  # m/s^2; with a smaller reading there is no accelerometer, and z counts as up


@dataclass(frozen=True, slots=True)
class SensorDelays(Settings):
    """Delays of each sensor's stamps against the gyro's; negative if they are early."""

    lidar_ns: int = setting(0, "ns", "of scans", low=-1_000_000_000, high=1_000_000_000)
    wheels_ns: int = setting(0, "ns", "of encoder counts or wheel odometry", low=-1_000_000_000, high=1_000_000_000)
    camera_ns: int = setting(0, "ns", "of pictures", low=-1_000_000_000, high=1_000_000_000)


@dataclass(frozen=True, slots=True)
class TimeOffsetSettings(Settings):
    """The range of the search, and the conditions for accepting a delay."""

    earliest_s: float = setting(-0.25, "s", "least delay that is looked for", low=-1.0, high=0.0)
    latest_s: float = setting(0.25, "s", "greatest delay that is looked for", low=0.01, high=1.0)
    step_s: float = setting(0.01, "s", "of the search, before the refinement", low=0.0005, high=0.05)
    span_s: float = setting(0.25, "s", "turns are taken over about this time", low=0.02, high=5.0)
    least_rate: float = setting(0.03, "rad/s", "least change (one sigma) of the yaw rate", low=0.001, high=5.0)
    most_sigma_s: float = setting(0.004, "s", "a delay must be known to this (one sigma)", low=0.0001, high=1.0)
    least_correlation: float = setting(0.9, "", "of a sensor's turns with the gyro's", low=0.0, high=1.0)
    outlier: float = setting(4.0, "", "turns are left out beyond so many sigmas", low=2.0, high=100.0)


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


def apply_delays(messages: Iterable[T], delays: SensorDelays) -> tuple[T, ...]:
    """Return the messages of all sensors with corrected stamps, sorted by them."""
    mended = [without_delay(message, delays) for message in messages]
    return tuple(sorted(mended, key=lambda message: message.stamp_ns))  # type: ignore[attr-defined]


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


def time_offset(heading: Heading, gyro: Heading, sensor: str, settings: TimeOffsetSettings | None = None) -> TimeOffset:
    """Return the delay of a sensor's stamps at which its turns fit the gyro's best, up to a scale and a bias.

    Raises:
        ThinData: too few turns, or the yaw rate hardly changed.
        CalibrationError: the turns agree at no delay, or only at one beyond the search range.
    """
    s = settings or TimeOffsetSettings()
    turns = _turns(heading, gyro, s)
    if len(turns.turns) < LEAST_TURNS:
        raise ThinData(
            f"{len(turns.turns)} turns seen by the {sensor} beside the gyro's are too few: record for longer"
        )
    if (change := turns.change()) < s.least_rate:
        raise ThinData(
            f"the yaw rate changed by {change:.2f} rad/s only, {s.least_rate:g} are needed: "
            "turn left and right repeatedly"
        )
    residuals = turns.residuals(_best(turns, s))
    spread = max(1.4826 * float(np.median(np.abs(residuals))), 1e-9)
    turns = turns.only(np.abs(residuals) <= s.outlier * spread)
    delay = _best(turns, s)
    residuals = turns.residuals(delay)
    correlation = math.sqrt(max(0.0, 1.0 - float(np.var(residuals)) / float(np.var(turns.turns))))
    if correlation < s.least_correlation:
        raise CalibrationError(
            f"the turns seen by the {sensor} do not follow the gyro's (correlation {correlation:.2f}, "
            f"{s.least_correlation:g} is needed): check how both are mounted, and record in a room that stands still"
        )
    if not s.earliest_s + s.step_s < delay < s.latest_s - s.step_s:
        raise CalibrationError(
            f"the stamps of the {sensor} are off by {1e3 * delay:.0f} ms or more, beyond the search range "
            f"({1e3 * s.earliest_s:.0f} to {1e3 * s.latest_s:.0f} ms): set its clock first"
        )
    rms = math.sqrt(float(np.mean(residuals**2)))
    if (sigma := _sigma(turns, delay, rms, s)) > s.most_sigma_s:
        raise ThinData(
            f"the delay of the {sensor} is known to {1e3 * sigma:.1f} ms only, {1e3 * s.most_sigma_s:g} ms are needed: "
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


def _turns(heading: Heading, gyro: Heading, s: TimeOffsetSettings) -> _Turns:
    """Return the turns over stretches of about `span_s` from each stamp on, if the gyro covers them at any delay."""
    times = (gyro.stamps_ns - gyro.stamps_ns[0]) * 1e-9
    seconds = (heading.stamps_ns - gyro.stamps_ns[0]) * 1e-9
    period = float(np.median(np.diff(seconds))) if len(seconds) > 1 else 0.0
    stride = max(1, round(s.span_s / period)) if period > 0.0 else 1
    pieces = np.cumsum(np.isnan(heading.headings))
    begin, end = seconds[:-stride], seconds[stride:]
    turns = heading.headings[stride:] - heading.headings[:-stride]
    usable = np.isfinite(turns) & (pieces[stride:] == pieces[:-stride])
    usable &= np.abs(end - begin - stride * period) < 0.5 * stride * period
    usable &= (begin - s.latest_s >= 0.0) & (end - s.earliest_s <= times[-1])
    return _Turns(begin[usable], end[usable], turns[usable], times, gyro.headings, stride)


def _best(turns: _Turns, s: TimeOffsetSettings) -> float:
    """Return the delay [s] of the least misfit: the best of a grid, refined between its neighbours (Brent's method)."""
    grid = np.arange(s.earliest_s, s.latest_s + 0.5 * s.step_s, s.step_s)
    best = float(grid[np.argmin([turns.misfit(float(delay)) for delay in grid])])
    bounds = (best - s.step_s, best + s.step_s)
    return float(minimize_scalar(turns.misfit, bounds=bounds, method="bounded", options={"xatol": 1e-6}).x)


def _sigma(turns: _Turns, delay: float, rms: float, s: TimeOffsetSettings) -> float:
    """Return the standard deviation [s] from the misfit's curvature, at most the width of the search.

    Overlapping stretches count as one, as if their residuals were equal. That is right if a sensor's heading drifts,
    and too large if it is merely noisy.
    """
    step = 0.5 * s.step_s
    curvature = (turns.misfit(delay + step) - 2.0 * turns.misfit(delay) + turns.misfit(delay - step)) / step**2
    widest = s.latest_s - s.earliest_s
    return min(widest, rms * math.sqrt(2.0 * turns.overlap / curvature)) if curvature > 0.0 else widest
