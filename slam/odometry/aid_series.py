"""The aids of a drive as series on one time axis, and their motions over the intervals between scans."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from waychair.geometry import compose, invert, wrap_angles
from waychair.types import BoolArray, FloatArray

_FASTEST = 4000.0  # in any unit; a greater rate or speed is a wild value
_LEAST_MISSING_S = 2.0  # wheels that are silent for longer while the chair moves are missing
_TURNS = 0.1  # [rad]; headings that vary by less over a recording are none
_SAME = 1e-9  # [m, rad]; poses that differ by less are the same reading
_LONGEST_GAP_S = 0.3
"""s; over a longer gap between IMU samples the turn is unknown."""


@dataclass(frozen=True, slots=True)
class WheelSeries:
    """Wheel odometry without broken steps: times (M,) [s], poses (M, 3) [m, m, rad], speeds (M, 2) [m/s, rad/s]."""

    times: FloatArray
    poses: FloatArray
    speeds: FloatArray
    read: FloatArray = field(default_factory=lambda: np.zeros(0))
    """Times (K,) [s] of readings that are not interpolated."""

    def missing(self, intervals: FloatArray) -> BoolArray:
        """Return which intervals (N, 2) [s] lie in gaps of the readings."""
        gaps = np.diff(self.read)
        long = gaps > max(_LEAST_MISSING_S, 10.0 * float(np.median(gaps))) if len(gaps) else np.zeros(0, np.bool_)
        begin, end = self.read[:-1][long], self.read[1:][long]
        if len(gaps):
            begin, end = np.append(begin, self.read[-1] + _LEAST_MISSING_S), np.append(end, np.inf)
        middle = intervals.mean(axis=1)[:, None]
        found: BoolArray = ((middle > begin) & (middle < end)).any(axis=1)
        return found

    def stuck(self, intervals: FloatArray) -> BoolArray:
        """Return which intervals (N, 2) [s] lie where the readings stay the same for long, as of a chair that stands.

        Poses without a heading look alike in turns on the spot; they are a fault of another kind.
        """
        if float(np.ptp(self.poses[:, 2])) < _TURNS:
            return np.zeros(len(intervals), np.bool_)
        same = np.abs(np.diff(np.hstack([self.poses, self.speeds]), axis=0)).max(axis=1) <= _SAME
        edges = np.flatnonzero(np.diff(np.concatenate([[0], same.astype(np.int64), [0]])))
        begin, end = self.times[edges[::2]], self.times[edges[1::2]]
        long = end - begin > _LEAST_MISSING_S
        middle = intervals.mean(axis=1)
        run = np.searchsorted(begin[long], middle) - 1
        found: BoolArray = (run >= 0) & (middle < np.append(end[long], -np.inf)[run])
        return found

    def motions(self, intervals: FloatArray, delay_s: float = 0.0) -> FloatArray:
        """Return the motions (N, 3) of the base over intervals (N, 2) [s], whose stamps are `delay_s` late.

        The translation is in the axes of the base half way through the turn; it is nan beyond the readings.
        """
        ends = [self._at(intervals[:, side] + delay_s) for side in (0, 1)]
        return half_way(compose(invert(ends[0]), ends[1]))

    def driven(self, intervals: FloatArray, delay_s: float = 0.0) -> FloatArray:
        """Return the same motions by the twists: way forward, zero, turn (N, 3)."""
        steps = np.diff(self.times, prepend=self.times[:1])[:, None]
        summed = np.cumsum(np.maximum(steps, 0.0) * np.clip(self.speeds, -_FASTEST, _FASTEST), axis=0)
        ways, turns = (_between(self.times, summed[:, k], intervals + delay_s) for k in (0, 1))
        return np.stack([ways, np.zeros_like(ways), turns], axis=1)

    def _at(self, times: FloatArray) -> FloatArray:
        heading = np.unwrap(self.poses[:, 2])
        columns = (self.poses[:, 0], self.poses[:, 1], heading)
        return np.stack([_interpolated(times, self.times, column) for column in columns], axis=1)


@dataclass(frozen=True, slots=True)
class ImuSeries:
    """IMU samples in axes of the base: times (M,) [s], gyro (M, 3) [rad/s], accel (M, 3) [m/s^2]."""

    times: FloatArray
    gyro: FloatArray
    accel: FloatArray

    def turns(self, intervals: FloatArray, axis: FloatArray, delay_s: float = 0.0) -> FloatArray:
        """Return the turns (N,) [rad] about an axis (3,) over intervals (N, 2) [s], whose stamps are `delay_s` late; nan
        where samples are missing."""
        steps = np.diff(self.times, prepend=self.times[:1])
        gaps = np.cumsum(steps > _LONGEST_GAP_S).astype(np.float64)
        summed = np.cumsum(np.clip(self.gyro @ axis, -_FASTEST, _FASTEST) * np.clip(steps, 0.0, _LONGEST_GAP_S))
        shifted = intervals + delay_s
        turned = _between(self.times, summed, shifted)
        begin, end = (np.searchsorted(self.times, shifted[:, side]) for side in (0, 1))
        last = len(self.times) - 1
        turned[gaps[np.clip(begin, 0, last)] != gaps[np.clip(end, 0, last)]] = np.nan
        return turned

    def forces(self, intervals: FloatArray) -> FloatArray:
        """Return the mean specific force (N, 3) [m/s^2] over intervals; nan where samples are missing."""
        summed = np.vstack([np.zeros(3), np.cumsum(self.accel, axis=0)])
        begin, end = (np.searchsorted(self.times, intervals[:, side]) for side in (0, 1))
        with np.errstate(invalid="ignore", divide="ignore"):
            found: FloatArray = (summed[end] - summed[begin]) / (end - begin)[:, None]
        return found


def half_way(motions: FloatArray) -> FloatArray:
    """Return motions (N, 3) with their translation in axes half way through the turn."""
    c, s = np.cos(0.5 * motions[:, 2]), np.sin(0.5 * motions[:, 2])
    x, y = motions[:, 0], motions[:, 1]
    return np.stack([c * x + s * y, c * y - s * x, wrap_angles(motions[:, 2])], axis=1)


def from_half_way(motions: FloatArray) -> FloatArray:
    """Return the motions (N, 3) of which these are `half_way`."""
    c, s = np.cos(0.5 * motions[:, 2]), np.sin(0.5 * motions[:, 2])
    x, y = motions[:, 0], motions[:, 1]
    return np.stack([c * x - s * y, s * x + c * y, motions[:, 2]], axis=1)


def robust_slope(
    values: FloatArray, reference: FloatArray, extra: FloatArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Return the factors of `values` = reference * factor (+ extra columns (N, K) * factors), with one sigma of each.

    Least absolute deviations by reweighting, so that slips and false matches do not count.
    """
    rows = reference[:, None] if extra is None else np.column_stack([reference, extra])
    weights: FloatArray = np.ones(len(values))
    solution: FloatArray = np.zeros(rows.shape[1], np.float64)
    for _ in range(8):
        weighted = rows * weights[:, None]
        normal = weighted.T @ rows + 1e-12 * np.eye(rows.shape[1])
        solution = np.asarray(np.linalg.solve(normal, weighted.T @ values), np.float64)
        off = np.abs(values - rows @ solution)
        weights = 1.0 / np.maximum(off, max(1e-6, 0.3 * float(np.median(off))))
    spread = 1.48 * float(np.median(off))
    sigma = spread * np.sqrt(np.diag(np.linalg.inv(rows.T @ rows + 1e-12 * np.eye(rows.shape[1]))))
    return solution, sigma


def correlation(values: FloatArray, reference: FloatArray, known: BoolArray) -> float:
    """Return the correlation of two series (N,) where both are known; 0 where one does not change."""
    known = known & np.isfinite(values)
    if known.sum() < 10:
        return 0.0
    a, b = values[known] - np.median(values[known]), reference[known] - np.median(reference[known])
    limit = 4.0 * float(np.quantile(np.abs(a), 0.9))  # a wild value must not decide
    a = np.clip(a, -limit, limit) if limit > 0.0 else a
    size = float(np.sqrt((a @ a) * (b @ b)))
    return float(a @ b) / size if size > 1e-12 else 0.0


def _between(times: FloatArray, summed: FloatArray, intervals: FloatArray) -> FloatArray:
    begin, end = (_interpolated(intervals[:, side], times, summed) for side in (0, 1))
    return end - begin


def _interpolated(at: FloatArray, times: FloatArray, values: FloatArray) -> FloatArray:
    found: FloatArray = np.interp(at, times, values)
    found[(at < times[0] - _LONGEST_GAP_S) | (at > times[-1] + _LONGEST_GAP_S)] = np.nan
    return found


@dataclass(frozen=True, slots=True)
class ScanSeries:
    """Motions by scans over intervals (N, 2) [s]: motions (N, 3) half way through the turn, and which of their turns and
    translations were measured (N,).

    `compared` (N,): whether the scans at the ends were compared at all; two that lie far apart in time are not.
    """

    intervals: FloatArray
    motions: FloatArray
    turn_known: BoolArray
    way_known: BoolArray
    compared: BoolArray
    sweep_s: float = 0.0
    """Time [s] for which the lidar sweeps; scans are then corrected by the twist, and their motion is that half a sweep
    after their stamps."""

    @property
    def seconds(self) -> FloatArray:
        """Lengths (N,) [s] of the intervals."""
        found: FloatArray = self.intervals[:, 1] - self.intervals[:, 0]
        return found

    def filled(self) -> FloatArray:
        """Return the motions (N, 3) with those that were not measured interpolated from their neighbours' speeds.

        Between scans that were not compared the chair stands: nothing tells for how long it went on.
        """
        rates, middle = self.motions / self.seconds[:, None], self.intervals.mean(axis=1)
        for column, known in ((0, self.way_known), (1, self.way_known), (2, self.turn_known)):
            if known.any():
                unknown = self.compared & ~known
                rates[unknown, column] = np.interp(middle[unknown], middle[known], rates[known, column])
        found: FloatArray = rates * self.seconds[:, None]
        return found

    def with_all(self, times: FloatArray) -> ScanSeries:
        """Return the series with all intervals between the `times` (M,) [s] of scans, also those that were not compared."""
        steps = np.stack([times[:-1], times[1:]], axis=1)[np.diff(times) > 0.0]
        middle = steps.mean(axis=1)
        run = np.searchsorted(self.intervals[:, 0], middle) - 1
        between = steps[(run < 0) | (middle > np.append(self.intervals[:, 1], -np.inf)[run])]
        at = np.searchsorted(self.intervals[:, 0], between[:, 0])
        return ScanSeries(
            np.insert(self.intervals, at, between, axis=0), np.insert(self.motions, at, 0.0, axis=0),
            np.insert(self.turn_known, at, False), np.insert(self.way_known, at, False),
            np.insert(self.compared, at, False), self.sweep_s,
        )  # fmt: skip
