"""Check of an IMU's accelerometer against gravity, and against the motion of wheels and scans."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from waychair.slam.odometry.aid_evidence import Evidence
from waychair.slam.odometry.aid_findings import AidPart, AidState, Cause
from waychair.slam.odometry.aid_series import ImuSeries, WheelSeries
from waychair.slam.odometry.aid_windows import WindowAgreement
from waychair.slam.odometry.odometry_model import OdometrySettings
from waychair.slam.odometry.slip import SlipDetector
from waychair.types import BoolArray, FloatArray

GRAVITY = 9.80665
_UPRIGHT = math.cos(math.radians(20.0))  # a chair does not lean further
_FORCE_OFF = 1.5  # [m/s^2]; the mean force may differ from gravity by twice this
_LEAST_SOUND = 0.15  # share of the windows with gravity as it should be
_LEAST_LEAN = math.sin(math.radians(3.0))  # an IMU that leans by less does little harm
_LEAST_HARM, _HARM_SHARE = 0.5, 0.02  # [m] by which slips that were none move the chair, and share of its way
_SLIPPED = 0.5  # share of a slip that the scans must show


@dataclass(frozen=True, slots=True)
class ForceUse:
    """How the IMU's readings are used: acceleration times `scale` (0: left out), and both in axes turned by `level`."""

    scale: float = 1.0
    level: FloatArray | None = None


def check_force(evidence: Evidence, imu: ImuSeries | None) -> ForceUse:
    """Return the use of the accelerometer, which shows gravity upright and of its size in most windows."""
    if imu is None or len(imu.times) < 10:
        return ForceUse()
    starts, times = evidence.spans.starts, evidence.spans.times
    bounds = np.stack([times[starts[:-1], 0], times[starts[1:] - 1, 1]], axis=1)
    mean = imu.forces(bounds)
    sizes = np.linalg.norm(mean, axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        sound = (np.abs(sizes - GRAVITY) <= 2.0 * _FORCE_OFF) & (mean[:, 2] >= _UPRIGHT * sizes)
    bad, known = np.isfinite(sizes) & ~sound, np.isfinite(sizes)
    if known.any() and sound.sum() >= _LEAST_SOUND * known.sum():
        runs = evidence.runs(WindowAgreement(bad, bounds[:, 1] - bounds[:, 0]))
        for run in runs:
            lost = float(np.nanmedian(sizes[bad])) / GRAVITY
            evidence.add(AidPart.GRAVITY, AidState.LEFT_OUT, Cause.NO_GRAVITY, run, value=lost)
        return ForceUse(0.0) if runs else _levelled(evidence, mean[sound])
    return ForceUse(_force_scale(evidence, np.median(imu.accel, axis=0)))


def _force_scale(evidence: Evidence, force: FloatArray) -> float:
    """Return the factor of an accelerometer with a mean force (3,) that is not gravity, 0 to leave it out; note why."""
    size = float(np.linalg.norm(force))
    if size > 0.0 and force[2] / size >= _UPRIGHT:
        for factor, cause in ((1.0, Cause.IN_G), (1000.0, Cause.IN_MILLI_G), (100.0 * GRAVITY, Cause.IN_CENTIMETRES)):
            if abs(size / factor - 1.0) < 0.12:
                evidence.add(AidPart.GRAVITY, AidState.CORRECTED, cause, None, value=factor / GRAVITY)
                return GRAVITY / factor
    if size < 0.5:
        cause = Cause.NO_GRAVITY
    elif abs(force[2]) / size >= _UPRIGHT:
        cause = Cause.UPSIDE_DOWN if force[2] < 0.0 else Cause.SCALE
    else:
        cause = Cause.ON_EDGE
    evidence.add(AidPart.GRAVITY, AidState.LEFT_OUT, cause, None, value=size / GRAVITY)
    return 0.0


def _levelled(evidence: Evidence, forces: FloatArray) -> ForceUse:
    """Return the rotation that makes mean forces (N, 3) upright, if they lean by the same angle all the time."""
    usual = np.median(forces, axis=0)
    lean = float(np.hypot(usual[0], usual[1]) / np.linalg.norm(usual))
    spread = float(np.median(np.hypot(*(forces - usual)[:, :2].T))) / GRAVITY
    if lean < _LEAST_LEAN or spread > 0.3 * lean:
        return ForceUse()
    evidence.add(
        AidPart.GRAVITY, AidState.CORRECTED, Cause.LEANING, None, value=math.degrees(math.asin(min(lean, 1.0)))
    )
    up = usual / np.linalg.norm(usual)
    cross = np.array([[0.0, 0.0, -up[0]], [0.0, 0.0, -up[1]], [up[0], up[1], 0.0]])
    return ForceUse(1.0, np.eye(3) + cross + cross @ cross / (1.0 + up[2]))  # Rodrigues' formula


def shows_false_slips(
    evidence: Evidence, imu: ImuSeries, use: ForceUse, wheels: WheelSeries, motions: FloatArray
) -> bool:
    """Note that the accelerometer shows slips of the wheels where their motions (N, 3) agree with the scans.

    So it is where the axes of the IMU are turned about the vertical, or where it shakes more than the chair.
    """
    scans = evidence.scans
    slipped = np.diff(_slip_distance(imu, use, wheels, scans.intervals), axis=1)[:, 0]
    off = scans.motions[:, 0] - motions[:, 0]
    false = evidence.known_way & np.isfinite(off) & (np.abs(off - slipped) > _SLIPPED * np.abs(slipped))
    false &= ~_beside(wheels.stuck(scans.intervals) | wheels.missing(scans.intervals))  # the wheels are wrong there
    harm, way = float(np.abs(slipped[false]).sum()), float(np.abs(np.nan_to_num(motions[:, 0])).sum())
    if harm < max(_LEAST_HARM, _HARM_SHARE * way) or harm < _SLIPPED * float(np.abs(slipped).sum()):
        return False
    evidence.add(AidPart.GRAVITY, AidState.LEFT_OUT, Cause.FALSE_SLIPS, None, value=harm)
    return True


def _beside(mask: BoolArray) -> BoolArray:
    """Return a mask (N,) with the intervals before and after each of its runs."""
    wide = np.concatenate([[False], mask, [False]])
    found: BoolArray = wide[:-2] | wide[1:-1] | wide[2:]
    return found


def _slip_distance(imu: ImuSeries, use: ForceUse, wheels: WheelSeries, intervals: FloatArray) -> FloatArray:
    """Return the sums (N, 2) [m] of the ways that the accelerometer adds to the wheels' until the ends of intervals."""
    ahead = (imu.accel if use.level is None else imu.accel @ use.level.T)[:, 0] * use.scale
    ahead = np.where(np.isfinite(ahead), ahead, 0.0)
    felt = np.concatenate([[0.0], np.cumsum(np.minimum(np.diff(imu.times, append=imu.times[-1]), 0.1) * ahead)])
    detector, total, sums = SlipDetector(OdometrySettings().slip_speed), 0.0, [0.0]
    at = felt[np.searchsorted(imu.times, wheels.times)]
    steps = np.diff(wheels.poses, axis=0)
    c, s = np.cos(wheels.poses[:-1, 2]), np.sin(wheels.poses[:-1, 2])
    ways = (c * steps[:, 0] + s * steps[:, 1]).tolist()
    for way, seconds, gain in zip(ways, np.diff(wheels.times).tolist(), np.diff(at).tolist(), strict=True):
        if seconds > 0.0:
            detector.add_acceleration(gain / seconds, seconds)
            speed = detector.slip_speed(way / seconds, seconds)
            total += 0.0 if speed is None else speed * seconds - way
        sums.append(total)
    found: FloatArray = np.stack([np.interp(intervals[:, side], wheels.times, sums) for side in (0, 1)], axis=1)
    return found
