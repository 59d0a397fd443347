"""Tilt of the chair (roll and pitch) from the IMU, and the lidar beams that end on the floor because of it.

A planar lidar at 0.3 m sees a ramp of 1:12 as follows. From level ground, before the ramp: its face 3.6 m beyond the
foot, if it rises that high. Going up: nothing, because the beams run parallel to it. Going down: the level floor 3.6 m
beyond the foot, as a wall across the path that recedes before the chair. Over a sill of 2 cm: for a moment the floor 7 m
ahead. The pitch reveals the last two. One scan cannot tell the first from a wall at any pitch; beams that pass over that
place once the chair is on the ramp clear it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.types import BoolArray, FloatArray, ImuSample, Scan, Twist

_LONGEST_NS = 100_000_000  # the filter restarts after a longer gap of the IMU


_SETTLE_S = 1.5  # time within which the accelerometer corrects the gyro
_LEARN_S = 10.0  # time within which the gyro's bias is learnt
_LEAST_TILT = 0.026  # rad; beams that point down by less do not reach the floor
_FLOOR_MARGIN = 0.10  # m; beams that end this low end on the floor


@dataclass(frozen=True, slots=True)
class Tilt:
    """Tilt of the base at a stamp: roll to the right and pitch nose down [rad] (REP-103: about x, then about y)."""

    stamp_ns: int
    roll: float = 0.0
    pitch: float = 0.0

    def level_from_base(self) -> FloatArray:
        """Return the rotation (3, 3) to axes with z upright and x below the base's x."""
        (sr, cr), (sp, cp) = ((math.sin(angle), math.cos(angle)) for angle in (self.roll, self.pitch))
        return np.array([[cp, sp * sr, sp * cr], [0.0, cr, -sr], [-sp, cp * sr, cp * cr]])


class TiltFilter:
    """Roll and pitch from gyro and accelerometer, corrected for the chair's own acceleration by the wheels.

    It is a complementary filter on the two angles with the gyro's bias as integral term (Mahony, Hamel and Pflimlin, IEEE
    TAC 2008). The accelerometer's bias must be calibrated: 0.05 m/s^2 make 0.3 degrees.
    """

    def __init__(self, body: ChairBody) -> None:
        self._body = body
        self._tilt: Tilt | None = None
        self._bias = (0.0, 0.0)  # of the gyro about x and y [rad/s]
        self._speed = 0.0

    @property
    def tilt(self) -> Tilt | None:
        """The latest tilt; None before the first sample."""
        return self._tilt

    def update(self, sample: ImuSample, twist: Twist) -> Tilt:
        """Add a sample, in axes of the base, of a chair that moves with `twist`; return the tilt at its stamp.

        Samples that are not finite or late are ignored. The first sample is taken at rest.
        """
        (ax, ay, az), (p, q, r), last = sample.accel.tolist(), sample.gyro.tolist(), self._tilt
        if not math.isfinite(ax + ay + az + p + q + r) or not math.isfinite(twist.v + twist.omega):
            return last or Tilt(sample.stamp_ns)
        late_ns = 0 if last is None else last.stamp_ns - sample.stamp_ns
        if last is not None and 0 <= late_ns < 10 * _LONGEST_NS:
            return last
        if last is None or late_ns > 0 or -late_ns > _LONGEST_NS:
            self._speed = twist.v
            self._tilt = Tilt(sample.stamp_ns, *_gravity_angles(ax, ay, az))
            return self._tilt
        seconds = -late_ns * 1e-9
        self._tilt = self._stepped(
            last, sample.stamp_ns, accel=(ax, ay, az), gyro=(p, q, r), twist=twist, seconds=seconds
        )
        self._speed = twist.v
        return self._tilt

    def _stepped(
        self,
        last: Tilt,
        stamp_ns: int,
        accel: tuple[float, float, float],
        gyro: tuple[float, float, float],
        twist: Twist,
        seconds: float,
    ) -> Tilt:
        body, (ax, ay, az) = self._body, accel
        p, q, r = gyro[0] - self._bias[0], gyro[1] - self._bias[1], gyro[2]
        sr, cr = math.sin(last.roll), math.cos(last.roll)
        roll = last.roll + seconds * (p + math.tan(last.pitch) * (q * sr + r * cr))
        pitch = last.pitch + seconds * (q * cr - r * sr)
        # the specific force less centripetal and forward acceleration is gravity; jolts need no filter, because over
        # time they average to a change of speed
        ax += twist.omega * twist.omega * body.imu_x - (twist.v - self._speed) / seconds
        ay += twist.omega * twist.omega * body.imu_y - twist.v * twist.omega
        seen_roll, seen_pitch = _gravity_angles(ax, ay, az)
        part, learn = seconds / _SETTLE_S, seconds / (_SETTLE_S * _LEARN_S)
        off_roll, off_pitch = seen_roll - roll, seen_pitch - pitch
        self._bias = (self._bias[0] - learn * off_roll, self._bias[1] - learn * off_pitch)
        return Tilt(stamp_ns, roll + part * off_roll, pitch + part * off_pitch)


def ground_beams(scan: Scan, body: ChairBody, tilt: Tilt) -> BoolArray:
    """Return the mask (N,) of beams that may end on the floor, and so give no evidence of obstacles.

    They point down and end near or below the level plane of the drive wheels: beyond the foot of a ramp the floor lies
    there or lower. A real obstacle behind that point is not lost, because it is seen from level ground. This is for
    mapping only: code that protects the rider must not ignore these beams.
    """
    start, ahead = _beams(scan, body, tilt)
    with np.errstate(invalid="ignore"):
        height = start[2] + scan.ranges.astype(np.float64) * ahead[:, 2]
        ground: BoolArray = np.isfinite(scan.ranges) & (ahead[:, 2] < -math.sin(_LEAST_TILT)) & (height < _FLOOR_MARGIN)
    return ground


def levelled(scan: Scan, body: ChairBody, tilt: Tilt) -> Scan:
    """Return the scan projected onto the floor plane, with nan for beams that may end on the floor."""
    if max(abs(tilt.roll), abs(tilt.pitch)) < _LEAST_TILT:
        return scan
    _, ahead = _beams(scan, body, tilt)
    ranges = (scan.ranges * np.hypot(ahead[:, 0], ahead[:, 1])).astype(np.float32)
    ranges[ground_beams(scan, body, tilt)] = np.nan
    return replace(scan, ranges=ranges)


def _beams(scan: Scan, body: ChairBody, tilt: Tilt) -> tuple[FloatArray, FloatArray]:
    """Return the beams' origin (3,) [m] and unit vectors (N, 3), in level axes from the base's origin."""
    level_from_base, angles = tilt.level_from_base(), body.laser_theta + scan.angles()
    ahead = np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=1) @ level_from_base.T
    start: FloatArray = level_from_base @ np.array([body.laser_x, body.laser_y, body.laser_z])
    return start, ahead


def _gravity_angles(ax: float, ay: float, az: float) -> tuple[float, float]:
    """Return the roll and pitch [rad] at which gravity alone gives this acceleration."""
    return math.atan2(ay, az), math.atan2(-ax, math.hypot(ay, az))
