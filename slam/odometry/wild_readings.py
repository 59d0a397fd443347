"""Single readings of IMU and wheels that no chair can cause, as a bit that flipped on the cable; they are left out.

A reading is wild that differs from the median of the seconds around it by far more than a chair's rates do. The scale of
the recording counts, not the unit: a gyro in degrees is not wild. Faults that last are those of `aid_check`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from waychair.slam.odometry.aid_findings import AidFinding, AidPart, AidState, Cause
from waychair.types import BoolArray, FloatArray, ImuSample, Odometry, SensorFrame, Twist

_BLOCK_S = 1.0  # [s]; medians are of so long, and of three such blocks the median one counts
_LEAST_BLOCK = 5  # readings
_TURN_OFF, _SPEED_OFF, _FORCE_OFF = 5.0, 4.0, 80.0
"""[rad/s], [m/s], [m/s^2]: a chair's reading differs by less from those around it; a kerb shakes by up to 50 m/s^2."""
_MOVES = 0.2  # [rad/s], [m/s]; a slower block tells nothing about the scale of the rates
_GRAVITY = 9.81  # [m/s^2]
_MOST = 0.1  # share of wild readings; more are a fault of another kind


def wild_rates(times: FloatArray, rates: FloatArray, most_off: float) -> BoolArray:
    """Return which rates (N,) at times (N,) [s] are wild: further than `most_off` from the others around them.

    Where the usual rates of the recording are above 1, as in other units, `most_off` is in units of them.
    """
    around, blocks = _medians(times, rates)
    moving = np.abs(blocks)[np.abs(blocks) > _MOVES]
    usual = float(np.quantile(moving, 0.9)) if len(moving) else 0.0
    return _unless_many(~(np.abs(rates - around) <= most_off * max(usual, 1.0)))


def wild_forces(times: FloatArray, forces: FloatArray) -> BoolArray:
    """Return which specific forces (N, 3) [m/s^2] at times (N,) [s] are wild."""
    size = float(np.linalg.norm(np.median(forces, axis=0)))
    unit = size / _GRAVITY if size > 0.5 else 1.0
    off = np.stack([forces[:, axis] - _medians(times, forces[:, axis])[0] for axis in range(3)], axis=1)
    near: BoolArray = np.abs(off) <= _FORCE_OFF * unit
    wild: BoolArray = ~np.all(near, axis=1)
    return _unless_many(wild)


def without_wild_readings(
    frames: tuple[SensorFrame, ...], times: FloatArray
) -> tuple[tuple[SensorFrame, ...], list[AidFinding]]:
    """Return frames at times (N,) [s] without wild IMU samples and speeds of odometry, and the findings about them.

    Wild speeds give way to those of the readings around them. The same frames are returned where nothing is wild.
    """
    frames, samples = _without_wild_samples(frames, times)
    frames, speeds = _without_wild_speeds(frames, times)
    return frames, [*samples, *speeds]


def _without_wild_samples(
    frames: tuple[SensorFrame, ...], times: FloatArray
) -> tuple[tuple[SensorFrame, ...], list[AidFinding]]:
    rows = [(_at(begin, frame, sample), sample) for begin, frame in _timed(frames, times) for sample in frame.imu]
    if len(rows) < 2 * _LEAST_BLOCK:
        return frames, []
    at = np.array([row[0] for row in rows])
    gyro, accel = np.array([row[1].gyro for row in rows]), np.array([row[1].accel for row in rows])
    by_gyro = np.any([wild_rates(at, gyro[:, axis], _TURN_OFF) for axis in range(3)], axis=0)
    by_accel = wild_forces(at, accel) if np.isfinite(accel).all() else np.zeros(len(at), np.bool_)
    if not (by_gyro | by_accel).any():
        return frames, []
    findings = [
        _finding(part, at[wild], values[wild])
        for part, wild, values in ((AidPart.GYRO, by_gyro, gyro), (AidPart.GRAVITY, by_accel & ~by_gyro, accel))
        if wild.any()
    ]
    gone = iter((by_gyro | by_accel).tolist())
    return tuple(replace(frame, imu=tuple(s for s in frame.imu if not next(gone))) for frame in frames), findings


def _without_wild_speeds(
    frames: tuple[SensorFrame, ...], times: FloatArray
) -> tuple[tuple[SensorFrame, ...], list[AidFinding]]:
    rows = [
        (_at(begin, frame, reading), reading, reading.stamp_ns == frame.stamp_ns)
        for begin, frame in _timed(frames, times)
        for reading in frame.wheels
        if isinstance(reading, Odometry)
    ]
    if len(rows) < 2 * _LEAST_BLOCK:
        return frames, []
    at, between = np.array([row[0] for row in rows]), np.array([row[2] for row in rows])
    speeds = np.array([(row[1].twist.v, row[1].twist.omega) for row in rows])
    wild = wild_rates(at, speeds[:, 0], _SPEED_OFF) | wild_rates(at, speeds[:, 1], _TURN_OFF)
    if not wild.any():
        return frames, []
    told = wild & ~between if (wild & ~between).any() else wild  # the others are interpolated between them
    finding = _finding(AidPart.TWIST, at[told], speeds[told])
    for column in (0, 1):
        speeds[wild, column] = np.interp(at[wild], at[~wild], speeds[~wild, column])
    mended = iter(speeds.tolist())
    changed = [
        replace(
            frame,
            wheels=tuple(
                replace(reading, twist=Twist(*next(mended))) if isinstance(reading, Odometry) else reading
                for reading in frame.wheels
            ),
        )
        for frame in frames
    ]
    return tuple(changed), [finding]


def _timed(frames: tuple[SensorFrame, ...], times: FloatArray) -> Sequence[tuple[float, SensorFrame]]:
    return list(zip(times.tolist(), frames, strict=True))


def _at(begin_s: float, frame: SensorFrame, reading: ImuSample | Odometry) -> float:
    return begin_s + (reading.stamp_ns - frame.stamp_ns) * 1e-9


def _finding(part: AidPart, at: FloatArray, values: FloatArray) -> AidFinding:
    largest = float(np.abs(values).max())
    return AidFinding(
        part, AidState.LEFT_OUT, Cause.WILD, float(at[0]), float(at[-1]), value=largest, count=len(at)
    )  # fmt: skip


def _medians(times: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the median around each value (N,), and those of the blocks (B,)."""
    usual = max(float(np.median(np.diff(times))), 1e-4)
    size = min(max(round(_BLOCK_S / usual), _LEAST_BLOCK), len(values))
    count = -(-len(values) // size)
    padded = np.pad(np.nan_to_num(values), (0, count * size - len(values)), mode="reflect")
    blocks = np.median(padded.reshape(count, size), axis=1)
    wide = np.pad(blocks, 1, mode="edge")
    middle: FloatArray = np.median(np.stack([wide[:-2], wide[1:-1], wide[2:]]), axis=0)
    return np.repeat(middle, size)[: len(values)], middle


def _unless_many(wild: BoolArray) -> BoolArray:
    return wild if wild.mean() <= _MOST else np.zeros(len(wild), np.bool_)
