"""Check of an IMU's gyro against the turns of the scans."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from waychair.slam.odometry.aid_evidence import (
    DEGREES,
    DELAYS_S,
    ENOUGH_TURN,
    GOOD,
    LEAST_CORRELATION,
    LEAST_DELAY_S,
    NEAR,
    Evidence,
    Stretch,
    delay_of,
    factors,
    unlike,
)
from waychair.slam.odometry.aid_findings import AidPart, AidState, Cause
from waychair.slam.odometry.aid_series import ImuSeries, correlation, robust_slope
from waychair.slam.odometry.aid_windows import turn_agreement
from waychair.types import BoolArray, FloatArray

_UP = np.array([0.0, 0.0, 1.0])
_CLEAR, _GAIN = 0.97, 0.03  # correlation that needs no delay, and gain of one that does
_FINER_S = np.arange(-0.1, 0.11, 0.02)  # [s]


@dataclass(frozen=True, slots=True)
class GyroUse:
    """How the gyro is used between two times [s]: turn rate = gyro @ axis / scale - bias, stamps `delay_s` late.

    `axis` None: it is left out.
    """

    begin_s: float
    end_s: float
    axis: FloatArray | None
    scale: float = 1.0
    bias: float = 0.0
    sideways: tuple[float, float] = (0.0, 0.0)
    """Bias [rad/s] of the rates about x and y, where that about z is wrong too."""
    delay_s: float = 0.0


def check_gyro(evidence: Evidence, imu: ImuSeries) -> tuple[GyroUse, ...]:
    """Return the uses of the gyro that differ from the told one."""
    scans = evidence.scans
    told = imu.turns(scans.intervals, _UP)
    found = evidence.turn(told)
    if np.abs(evidence.turns[evidence.known_turn]).sum() < ENOUGH_TURN and not found.bad.any():
        return ()
    runs = evidence.runs(found)
    whole = _corrected_gyro(evidence, imu, evidence.whole()) if runs else None
    if whole is not None:
        return (whole,)
    if runs:
        return tuple(_fitted_gyro(evidence, imu, run) for run in runs)
    delay = delay_of(evidence, lambda late: imu.turns(scans.intervals, _UP, late))
    if delay:
        evidence.add(AidPart.GYRO, AidState.CORRECTED, Cause.DELAY, None, value=delay)
        return (GyroUse(-math.inf, math.inf, _UP, delay_s=delay),)
    return ()


def _fitted_gyro(evidence: Evidence, imu: ImuSeries, run: Stretch) -> GyroUse:
    """Return the use of the gyro in a stretch in which it is not right as it is, and note why."""
    corrected = _corrected_gyro(evidence, imu, run)
    if corrected is not None:
        return corrected
    known = evidence.known_turn & run.inside
    told = imu.turns(evidence.scans.intervals, _UP)[known]
    size, true = float(np.nansum(np.abs(told))), float(np.abs(evidence.turns[known]).sum())
    evidence.add(
        AidPart.GYRO,
        AidState.LEFT_OUT,
        unlike(told / evidence.scans.seconds[known], size, true),
        run,
        value=size / max(true, 1e-9),
    )
    return GyroUse(*run.around, None)


def _bounds(run: Stretch) -> tuple[float, float]:
    return (-math.inf if run.since_s is None else run.since_s), (math.inf if run.until_s is None else run.until_s)


def _corrected_gyro(evidence: Evidence, imu: ImuSeries, run: Stretch) -> GyroUse | None:
    """Return the correction by which the gyro agrees with the scans in a stretch, and note it; None without one."""
    scans, known = evidence.scans, evidence.known_turn & run.inside
    found = _axis_and_delay(evidence, imu, known)
    if found is None:
        return None
    axis, delay = found
    turns = imu.turns(scans.intervals, axis, delay)
    usable = known & np.isfinite(turns)
    solution, sigma = robust_slope(turns[usable], evidence.turns[usable], scans.seconds[usable, None])
    late = delay - 0.5 * scans.sweep_s if delay else 0.0
    for scale in factors(float(solution[0]), float(sigma[0])):
        bias = float(np.median((turns[usable] / scale - evidence.turns[usable]) / scans.seconds[usable]))
        for offset in (0.0, bias):
            after = turn_agreement(evidence.spans, turns / scale - offset * scans.seconds, evidence.turns, known)
            if after.share > GOOD or evidence.runs(after):
                continue
            cause = _gyro_cause(axis, scale, late)
            told = late if cause is Cause.DELAY else offset if cause is Cause.BIAS else scale
            evidence.add(AidPart.GYRO, AidState.CORRECTED, cause, run, value=told, sigma=float(sigma[0]))
            since, until = _bounds(run)
            rates = imu.gyro[(imu.times > since) & (imu.times < until)] / scale
            sideways = np.median(rates[:, :2], axis=0).tolist() if offset and len(rates) else (0.0, 0.0)
            return GyroUse(since, until, axis, scale, offset, (sideways[0], sideways[1]), late)
    return None


def _axis_and_delay(evidence: Evidence, imu: ImuSeries, known: BoolArray) -> tuple[FloatArray, float] | None:
    """Return the axis (3,) about which the IMU turns as the scans do, and the delay [s]; None where there is none."""

    def agreed(axis: FloatArray, delay: float) -> float:
        return abs(correlation(imu.turns(evidence.scans.intervals, axis, delay), evidence.turns, known))

    axis = max(np.eye(3)[::-1], key=lambda axis: agreed(axis, 0.0))
    now, delay = agreed(axis, 0.0), 0.0
    if now <= _CLEAR:
        tried = [(agreed(each, float(late)), float(late), each) for each in np.eye(3)[::-1] for late in DELAYS_S]
        best, near, other = max(tried, key=lambda row: row[0])
        if best > now + _GAIN:
            axis, now = other, best
            delay = max((near + late for late in _FINER_S), key=lambda late: agreed(axis, late))
    return (axis, float(delay)) if now > LEAST_CORRELATION else None


def _gyro_cause(axis: FloatArray, scale: float, delay: float) -> Cause:
    if axis[2] == 0.0:
        return Cause.ON_EDGE
    if abs(abs(scale) - DEGREES) < 1e-6:
        return Cause.DEGREES
    if scale < 0.0:
        return Cause.OTHER_WAY
    if abs(scale - 1.0) > NEAR:
        return Cause.SCALE
    return Cause.DELAY if abs(delay) >= LEAST_DELAY_S else Cause.BIAS


def gyro_turns(imu: ImuSeries, intervals: FloatArray, uses: tuple[GyroUse, ...]) -> FloatArray:
    """Return the turns (N,) by the gyro as it is used, nan where it is not."""
    turns = imu.turns(intervals, _UP)
    for use in uses:
        inside = (intervals[:, 1] > use.begin_s) & (intervals[:, 0] < use.end_s)
        if use.axis is None:
            turns[inside] = np.nan
        else:
            fitted = imu.turns(intervals, use.axis, use.delay_s) / use.scale - use.bias * (
                intervals[:, 1] - intervals[:, 0]
            )
            turns[inside] = fitted[inside]
    return turns


def up_axis(imu: ImuSeries) -> FloatArray:
    """Return the signed axis (3,) of the IMU that points up by its accelerometer; z without gravity."""
    force = np.median(imu.accel, axis=0) if len(imu.accel) else _UP
    axis = int(np.argmax(np.abs(force)))
    if abs(force[axis]) < 0.5 * float(np.linalg.norm(force)) or not np.isfinite(force).all() or not force.any():
        return _UP
    up = np.zeros(3)
    up[axis] = math.copysign(1.0, force[axis])
    return up
