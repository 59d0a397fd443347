"""A short drive round a block of rooms with a lidar, wheels and an IMU; all of it is sound, and its poses are known."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np

from waychair.types import FloatArray

SECOND = 1_000_000_000
START_NS = 1_715_000_000 * SECOND
MOUNT = (0.25, 0.05)
"""Place of the lidar on the base [m]; it looks ahead."""
PERIOD_S, REACH_M, LEAST_M = 0.25, 6.0, 0.1
_WHEELS_S, _IMU_S, _STEP_S = 0.05, 0.02, 0.01  # between readings, and between poses
_SPEED, _TURN = 0.9, 0.9  # m/s, rad/s
_REST_S = 1.0
_LEGS = (
    (9.0, 0.0), (0.0, math.pi / 2), (6.4, 0.0), (0.0, math.pi / 2), (9.0, 0.0), (0.0, math.pi / 2), (6.4, 0.0),
    (0.0, math.pi / 2), (3.5, 0.0),
)  # fmt: skip
"""Metres ahead, and radians to the left."""
_BOXES = (  # two opposite corners [m]
    (-1.5, -1.2, 10.6, 7.7),
    (1.1, 1.0, 4.3, 5.3),
    (4.9, 1.0, 7.9, 3.2),
    (5.3, 3.9, 7.9, 5.3),
    (3.0, -1.2, 3.8, -0.8),
    (6.6, -1.2, 6.9, -0.7),
    (10.2, 1.6, 10.6, 2.9),
    (9.9, 7.2, 10.6, 7.7),
    (4.0, 7.3, 5.2, 7.7),
    (-1.5, 2.5, -1.1, 3.6),
    (-1.5, 6.9, -0.6, 7.7),
)


@dataclass(frozen=True, slots=True)
class SoundDrive:
    """Readings of a drive, times [s] since `START_NS`.

    Poses are (N, 3) with an unwrapped heading; `truth` are those of the base at `times`; scans are (N, beams) ranges [m],
    inf for nothing, whose first beam is measured at `scan_times`; `first_angle` and `step` [rad].
    """

    times: FloatArray
    truth: FloatArray
    wheel_times: FloatArray
    wheel_poses: FloatArray
    wheel_speeds: FloatArray
    imu_times: FloatArray
    gyro: FloatArray
    accel: FloatArray
    scan_times: FloatArray
    scans: FloatArray
    first_angle: float
    step: float

    def at(self, seconds: FloatArray) -> FloatArray:
        """Return the true poses (N, 3) at times (N,) [s]."""
        return np.stack([np.interp(seconds, self.times, column) for column in self.truth.T], axis=1)


@cache
def sound_drive(beams: int = 180, view: float = math.tau, sweep_s: float = PERIOD_S) -> SoundDrive:
    """Return the drive with a lidar of so many beams over a field of view [rad], ahead in its middle, in `sweep_s` [s]."""
    rng = np.random.default_rng(2026)
    truth = _poses()
    times = np.asarray(_STEP_S * np.arange(len(truth)), np.float64)
    step, first = view / beams, -view / 2

    def at(seconds: FloatArray) -> FloatArray:
        return np.stack([np.interp(seconds, times, column) for column in truth.T], axis=1)

    end = float(times[-1])
    scan_times = np.arange(0.05, end - PERIOD_S, PERIOD_S)
    later, angles = sweep_s / beams * np.arange(beams), np.asarray(first + step * np.arange(beams), np.float64)
    scans = np.array([_ranges(at(begin + later), angles, rng) for begin in scan_times.tolist()])
    wheel_times, imu_times = np.arange(0.0, end, _WHEELS_S), np.arange(0.0, end, _IMU_S)
    poses, speeds = _wheels(at(wheel_times), rng)
    gyro, accel = _imu(at(imu_times), rng)
    return SoundDrive(
        times, truth, wheel_times, poses, speeds, imu_times, gyro, accel, scan_times, scans, first, step
    )  # fmt: skip


def _poses() -> FloatArray:
    rows = [np.zeros(3)] * round(_REST_S / _STEP_S)
    for ahead, turn in _LEGS:
        steps = max(round(max(ahead / _SPEED, abs(turn) / _TURN) / _STEP_S), 1)
        x, y, theta = rows[-1]
        for share in 0.5 - 0.5 * np.cos(np.linspace(0.0, math.pi, steps + 1)[1:]):
            way = ahead * share
            rows.append(np.array([x + way * math.cos(theta), y + way * math.sin(theta), theta + turn * share]))
    return np.array(rows + [rows[-1]] * round(_REST_S / _STEP_S))


def _wheels(true: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Return poses and speeds of wheels whose ways are 0.7 % long and whose turns are 1 % wide."""
    steps = np.diff(true, axis=0)
    middle = 0.5 * (true[1:, 2] + true[:-1, 2])
    way = np.cos(middle) * steps[:, 0] + np.sin(middle) * steps[:, 1]
    way, turn = way * 1.007 * (1.0 + 0.01 * rng.standard_normal(len(way))), steps[:, 2] * 1.01
    heading = np.concatenate([[0.0], np.cumsum(turn)])
    middle = 0.5 * (heading[1:] + heading[:-1])
    x, y = (np.concatenate([[0.0], np.cumsum(way * of(middle))]) for of in (np.cos, np.sin))
    speeds = np.concatenate([[[0.0, 0.0]], np.stack([way, turn], axis=1) / _WHEELS_S])
    return np.stack([x, y, heading], axis=1), speeds


def _imu(true: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    rate, speed = np.gradient(true[:, 2], _IMU_S), np.hypot(*np.gradient(true[:, :2], _IMU_S, axis=0).T)
    gyro, accel = rng.normal(0.0, 0.002, (len(true), 3)), rng.normal(0.0, 0.05, (len(true), 3))
    gyro[:, 2] += rate + 0.001
    accel += np.stack([np.gradient(speed, _IMU_S), speed * rate, np.full(len(true), 9.81)], axis=1)
    return gyro, accel


def _ranges(base: FloatArray, angles: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Return the ranges (N,) [m] of beams, each measured from its own pose (N, 3) of the base."""
    c, s = np.cos(base[:, 2]), np.sin(base[:, 2])
    x, y = base[:, 0] + c * MOUNT[0] - s * MOUNT[1], base[:, 1] + s * MOUNT[0] + c * MOUNT[1]
    cos, sin = np.cos(angles + base[:, 2]), np.sin(angles + base[:, 2])
    nearest = np.full(len(angles), np.inf)
    with np.errstate(divide="ignore", invalid="ignore"):
        for x0, y0, x1, y1 in _BOXES:
            for wall in (x0, x1):
                far = (wall - x) / cos
                across = y + far * sin
                nearest = np.where((far > 1e-6) & (across >= y0) & (across <= y1), np.minimum(nearest, far), nearest)
            for wall in (y0, y1):
                far = (wall - y) / sin
                across = x + far * cos
                nearest = np.where((far > 1e-6) & (across >= x0) & (across <= x1), np.minimum(nearest, far), nearest)
    measured = nearest + 0.01 * rng.standard_normal(len(angles))
    return np.where(nearest > REACH_M, np.inf, measured)
