"""Check of an IMU: its gyro against the scans' turns, its accelerometer against gravity."""

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
    SNAP,
    Evidence,
    Run,
    delay_of,
    snapped,
    unlike,
)
from waychair.slam.odometry.aid_findings import Cause, Part, State
from waychair.slam.odometry.aid_series import ImuSeries, correlation, robust_slope
from waychair.slam.odometry.aid_windows import Agreement, turn_agreement
from waychair.types import FloatArray

GRAVITY = 9.80665
_UP = np.array([0.0, 0.0, 1.0])
_UPRIGHT = math.cos(math.radians(20.0))  # a chair does not lean further
_FORCE_OFF = 1.5  # [m/s^2]; the mean force may differ from gravity by this


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
    delay_s: float = 0.0


def check_force(evidence: Evidence, imu: ImuSeries | None) -> float:
    """Return the factor of the accelerometer; 0 to leave it out."""
    if imu is None or len(imu.times) < 10:
        return 1.0
    force = np.median(imu.accel, axis=0)
    size = float(np.linalg.norm(force))
    upright = size > 0.0 and force[2] / size >= _UPRIGHT
    if upright and abs(size - GRAVITY) <= _FORCE_OFF:
        return _check_force_over_time(evidence, imu)
    if upright:
        for factor, cause in ((1.0, Cause.IN_G), (1000.0, Cause.IN_MILLI_G), (100.0 * GRAVITY, Cause.IN_CENTIMETRES)):
            if abs(size / factor - 1.0) < 0.12:
                evidence.add(Part.GRAVITY, State.CORRECTED, cause, None, value=factor / GRAVITY)
                return GRAVITY / factor
    if size < 0.5:
        cause = Cause.NO_GRAVITY
    elif abs(force[2]) / size >= _UPRIGHT:
        cause = Cause.UPSIDE_DOWN if force[2] < 0.0 else Cause.SCALE
    else:
        cause = Cause.ON_EDGE
    evidence.add(Part.GRAVITY, State.LEFT_OUT, cause, None, value=size / GRAVITY)
    return 0.0


def _check_force_over_time(evidence: Evidence, imu: ImuSeries) -> float:
    """Leave the accelerometer out if gravity is lost for some time in the middle."""
    starts = evidence.spans.starts
    bounds = np.stack([evidence.spans.times[starts[:-1], 0], evidence.spans.times[starts[1:] - 1, 1]], axis=1)
    mean = imu.forces(bounds)
    size = np.linalg.norm(mean, axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        bad = np.isfinite(size) & ((np.abs(size - GRAVITY) > 2.0 * _FORCE_OFF) | (mean[:, 2] < _UPRIGHT * size))
    seconds = bounds[:, 1] - bounds[:, 0]
    runs = evidence.runs(Agreement(bad, seconds))
    for run in runs:
        evidence.add(
            Part.GRAVITY, State.LEFT_OUT, Cause.NO_GRAVITY, run, value=float(np.nanmedian(size[bad])) / GRAVITY
        )
    return 0.0 if runs else 1.0


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
        evidence.add(Part.GYRO, State.CORRECTED, Cause.DELAY, None, value=delay)
        return (GyroUse(-math.inf, math.inf, _UP, delay_s=delay),)
    return ()


def _fitted_gyro(evidence: Evidence, imu: ImuSeries, run: Run) -> GyroUse:
    """Return the use of the gyro in a stretch in which it is not right as it is, and note why."""
    corrected = _corrected_gyro(evidence, imu, run)
    if corrected is not None:
        return corrected
    known = evidence.known_turn & run.inside
    told = imu.turns(evidence.scans.intervals, _UP)[known]
    size, true = float(np.nansum(np.abs(told))), float(np.abs(evidence.turns[known]).sum())
    evidence.add(Part.GYRO, State.LEFT_OUT, unlike(told, size, true), run, value=size / max(true, 1e-9))
    return GyroUse(*_bounds(run), None)


def _bounds(run: Run) -> tuple[float, float]:
    return (-math.inf if run.since_s is None else run.since_s), (math.inf if run.until_s is None else run.until_s)


def _corrected_gyro(evidence: Evidence, imu: ImuSeries, run: Run) -> GyroUse | None:
    """Return the correction by which the gyro agrees with the scans in a stretch, and note it; None without one."""
    scans = evidence.scans
    known = evidence.known_turn & run.inside
    best = LEAST_CORRELATION
    use: tuple[FloatArray, float, FloatArray] | None = None
    for delay in (0.0, *DELAYS_S):
        for axis in np.eye(3):
            turns = imu.turns(scans.intervals, axis, delay)
            value = correlation(turns, evidence.turns, known)
            if abs(value) > best + (0.0 if delay == 0.0 else 0.03):
                best, use = abs(value), (axis, float(delay), turns)
        if use is not None and delay == 0.0 and best > 0.97:
            break
    if use is not None:
        axis, delay, turns = use
        usable = known & np.isfinite(turns)
        solution, sigma = robust_slope(turns[usable], evidence.turns[usable], scans.seconds[usable, None])
        scale, bias = snapped(float(solution[0]), float(sigma[0])), float(solution[1]) / float(solution[0])
        corrected = turns / scale - bias * scans.seconds
        after = turn_agreement(evidence.spans, corrected, evidence.turns, known)
        if after.share <= GOOD and not evidence.runs(after):
            late = delay - 0.5 * scans.sweep_s if abs(delay) > 0.0 else 0.0
            cause = _gyro_cause(axis, scale, bias, late)
            told = late if cause is Cause.DELAY else bias if cause is Cause.BIAS else scale
            evidence.add(Part.GYRO, State.CORRECTED, cause, run, value=told, sigma=float(sigma[0]))
            return GyroUse(*_bounds(run), axis, scale, bias, late)
    return None


def _gyro_cause(axis: FloatArray, scale: float, bias: float, delay: float) -> Cause:
    if axis[2] == 0.0:
        return Cause.ON_EDGE
    if abs(abs(scale) - DEGREES) < 1e-6:
        return Cause.DEGREES
    if scale < 0.0:
        return Cause.OTHER_WAY
    if abs(scale - 1.0) > SNAP:
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
