"""A short drive over the small floor with wheel odometry and an IMU, as they are and with a fault of their own."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tests.bags import SECOND
from tests.cases.mapping.lidar_floor import MOUNT, Drive, Lidar, sweeps, walls
from waychair.geometry import compose, interpolate, pose_from_array
from waychair.offline.aids import CheckedRecording, checked_recording
from waychair.offline.mapping import Mapping, MappingSettings, map_recording
from waychair.recordings.recording import Recording
from waychair.slam.odometry.aid_findings import AidFinding, AidPart, AidState, Cause
from waychair.slam.trajectory_errors import truth_errors
from waychair.types import FloatArray, ImuSample, Odometry, Pose2, Scan, SensorFrame, Trajectory, Twist

START = 1_710_000_000 * SECOND
LEGS = ((6.4, 0.0), (0.0, math.pi / 2), (4.2, 0.0), (0.0, math.pi), (4.2, 0.0), (0.0, -math.pi / 2), (5.0, 0.0))
"""Metres ahead, and radians to the left."""

LIDAR = Lidar(beams=180)
_WHEELS_S, _IMU_S = 1 / 15, 0.02  # between readings
_LONG, _TURNS_FAR = 1.005, 1.01  # errors of sound wheels


@dataclass(frozen=True, slots=True)
class Wheels:
    """Readings of wheel odometry: times (N,) [s], poses (N, 3) with an unwrapped heading, speeds (N, 2)."""

    times: FloatArray
    poses: FloatArray
    speeds: FloatArray

    def moved(self, change: Callable[[FloatArray, FloatArray], FloatArray]) -> Wheels:
        """The readings with other poses, from their times and poses."""
        return replace(self, poses=change(self.times, self.poses.copy()))

    def rolled(self, way: float = 1.0, turn: float = 1.0) -> Wheels:
        """The readings of wheels whose ways and turns are other by factors."""
        steps = np.diff(self.poses, axis=0)
        headings = np.concatenate([[0.0], np.cumsum(turn * steps[:, 2])])
        middle = 0.5 * (self.poses[1:, 2] + self.poses[:-1, 2])
        ahead = way * (np.cos(middle) * steps[:, 0] + np.sin(middle) * steps[:, 1])
        middle = 0.5 * (headings[1:] + headings[:-1])
        x, y = (np.concatenate([[0.0], np.cumsum(ahead * of(middle))]) for of in (np.cos, np.sin))
        return Wheels(self.times, np.stack([x, y, headings], axis=1), self.speeds * (way, turn))


@dataclass(frozen=True, slots=True)
class Imu:
    """Samples of an IMU: times (N,) [s], gyro (N, 3) [rad/s], accel (N, 3) [m/s^2]."""

    times: FloatArray
    gyro: FloatArray
    accel: FloatArray


WheelFault, ImuFault, ScanFault = Callable[[Wheels], Wheels], Callable[[Imu], Imu], Callable[[Scan], Scan]


def wheels_of(drive: Drive) -> Wheels:
    """Sound wheels on a drive: their ways 0.5 % too long, their turns 1 % too far."""
    times = np.arange(0.0, drive.seconds, _WHEELS_S)
    true, later = drive.at(times), drive.at(times + 0.01)
    turn = (later[:, 2] - true[:, 2]) / 0.01
    ahead = np.hypot(*(later - true)[:, :2].T) / 0.01
    return Wheels(times, true, np.stack([ahead, turn], axis=1)).rolled(_LONG, _TURNS_FAR)


def imu_of(drive: Drive) -> Imu:
    """A sound IMU on a drive."""
    rng, times = np.random.default_rng(5), np.arange(0.0, drive.seconds, _IMU_S)
    true = drive.at(times)
    rate = np.gradient(true[:, 2], _IMU_S)
    speed = np.hypot(*np.gradient(true[:, :2], _IMU_S, axis=0).T)
    gyro, accel = rng.normal(0.0, 0.002, (len(times), 3)), rng.normal(0.0, 0.05, (len(times), 3))
    gyro[:, 2] += rate
    accel += np.stack([np.gradient(speed, _IMU_S), speed * rate, np.full(len(times), 9.81)], axis=1)
    return Imu(times, gyro, accel)


def recorded(
    wheels: WheelFault | None = lambda sound: sound,
    imu: ImuFault | None = None,
    scan: ScanFault = lambda sound: sound,
    told: Pose2 | None = None,
    legs: tuple[tuple[float, float], ...] = LEGS,
) -> tuple[Recording, Trajectory]:
    """A recording of the drive with faults, and the true poses; without wheels or IMU where these are None.

    `told` is the mount of the lidar as the recording has it.
    """
    drive = Drive(legs)
    readings = [] if wheels is None else _readings(wheels(wheels_of(drive)))
    samples = [] if imu is None else _samples(imu(imu_of(drive)))
    frames, done, imu_done = [], 0, 0
    for begin, ranges in sweeps(drive, LIDAR, walls()):
        stamp = START + round(begin * SECOND)
        swept = Scan(
            stamp, ranges.astype(np.float32), LIDAR.first, LIDAR.step, LIDAR.period / LIDAR.beams, 0.1, LIDAR.reach
        )
        until = next((k for k in range(done, len(readings)) if readings[k].stamp_ns > stamp), len(readings))
        imu_until = next((k for k in range(imu_done, len(samples)) if samples[k].stamp_ns > stamp), len(samples))
        if readings and not 0 < until < len(readings):
            continue
        own = (*readings[done:until], _between(readings[until - 1], readings[until], stamp)) if readings else ()
        frames.append(SensorFrame(stamp, scan=scan(swept), wheels=own, imu=tuple(samples[imu_done:imu_until])))
        done, imu_done = until, imu_until
    times = np.arange(0.0, drive.seconds, 0.05)
    truth = Trajectory(START + np.rint(times * SECOND).astype(np.int64), drive.at(times))
    return Recording(Path("drive.mcap"), tuple(frames), told or Pose2(*MOUNT), "made"), truth


def checked(recording: Recording) -> CheckedRecording:
    """The recording with its aids checked."""
    return checked_recording(recording, 20.0)


def error_of(recording: Recording, truth: Trajectory) -> tuple[float, Mapping]:
    """The RMSE [m] of the map's trajectory, and the map."""
    mapping = map_recording(recording, MappingSettings())
    return truth_errors(mapping.result.drive_trajectory, truth).rmse_m, mapping


def looks(findings: tuple[AidFinding, ...]) -> list[tuple[AidPart, AidState, Cause]]:
    """Parts, states and causes of findings."""
    return [(found.part, found.state, found.cause) for found in findings]


def turned(poses: FloatArray, by: FloatArray) -> FloatArray:
    """Poses (N, 3) seen from another origin `by` (3,)."""
    return compose(by, poses)


def _readings(wheels: Wheels) -> list[Odometry]:
    rows = zip(wheels.times.tolist(), wheels.poses, wheels.speeds.tolist(), strict=True)
    told = [
        Odometry(START + round(time * SECOND), pose_from_array(_wrapped(pose)), Twist(v, omega))
        for time, pose, (v, omega) in rows
    ]
    return sorted(told, key=lambda reading: reading.stamp_ns)


def _samples(imu: Imu) -> list[ImuSample]:
    rows = zip(imu.times.tolist(), imu.accel, imu.gyro, strict=True)
    told = [ImuSample(START + round(time * SECOND), accel, gyro) for time, accel, gyro in rows]
    return sorted(told, key=lambda sample: sample.stamp_ns)


def _wrapped(pose: FloatArray) -> FloatArray:
    return np.array([pose[0], pose[1], math.remainder(float(pose[2]), math.tau)])


def _between(before: Odometry, after: Odometry, stamp_ns: int) -> Odometry:
    """The reading at a stamp between two, as the reader of bags makes it."""
    part = (stamp_ns - before.stamp_ns) / (after.stamp_ns - before.stamp_ns)
    v, omega = (
        float((1.0 - part) * first + part * second)
        for first, second in ((before.twist.v, after.twist.v), (before.twist.omega, after.twist.omega))
    )
    return Odometry(stamp_ns, interpolate(before.odom_from_base, after.odom_from_base, part), Twist(v, omega))
