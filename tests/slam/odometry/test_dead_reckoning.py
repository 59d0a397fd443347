"""Dead reckoning of frames: fused odometry at the scan's stamp, levelled scans, and frames that pass unchanged."""

from __future__ import annotations

import math

import numpy as np
import pytest

from waychair.calibration.chair_body import CHAIR_A
from waychair.slam.odometry.dead_reckoning import DeadReckoning
from waychair.types import ImuSample, Odometry, Pose2, Scan, SensorFrame, Twist, WheelTicks

STEP = 20_000_000


def imu(stamp_ns: int, rate: float = 0.0, pitch: float = 0.0) -> ImuSample:
    gravity = 9.81 * np.array([-math.sin(pitch), 0.0, math.cos(pitch)])
    return ImuSample(stamp_ns, gravity, np.array([0.0, 0.0, rate]))


def scan(stamp_ns: int, ahead: float) -> Scan:
    return Scan(stamp_ns, np.full(91, ahead, np.float32), -math.pi / 4, math.radians(1), range_max=20.0)


def test_a_recording_of_odometry_alone_passes_unchanged() -> None:
    frame = SensorFrame(5, scan(5, 2.0), wheels=(Odometry(5, Pose2(1, 2, 3)),))
    assert DeadReckoning(CHAIR_A).update(frame) is frame


def test_a_frame_gets_one_odometry_at_the_stamp_of_its_scan() -> None:
    per_metre = CHAIR_A.ticks_per_turn / (math.tau * CHAIR_A.wheel_radius)
    reckoning, frames = DeadReckoning(CHAIR_A), []
    for k in range(60):
        ticks = round(0.5 * k * STEP * 1e-9 * per_metre)
        stamp = k * STEP
        frames.append(
            reckoning.update(SensorFrame(stamp + 3, scan(stamp, 2.0), wheels=(WheelTicks(stamp, ticks, ticks),)))
        )
    (last,) = frames[-1].wheels
    assert isinstance(last, Odometry)
    assert last.stamp_ns == 59 * STEP + 3
    assert last.odom_from_base.x == pytest.approx(0.5 * 59 * STEP * 1e-9, abs=0.01)
    assert last.twist.v == pytest.approx(0.5, abs=0.02)


def test_the_gyro_gives_the_turn_where_the_wheels_are_wrong() -> None:
    reckoning, heading = DeadReckoning(CHAIR_A), 0.0
    for k in range(200):
        rate = 0.0 if k < 50 else 0.5
        heading += 1.04 * rate * STEP * 1e-9  # wheels that turn too far
        samples = tuple(imu(k * STEP - back, rate) for back in (15_000_000, 10_000_000, 5_000_000, 0))
        wheels = (Odometry(k * STEP, Pose2(0, 0, heading), Twist(0, 1.04 * rate)),)
        out = reckoning.update(SensorFrame(k * STEP, wheels=wheels, imu=samples))
    (last,) = out.wheels
    assert isinstance(last, Odometry)
    true = 0.5 * 150 * STEP * 1e-9
    assert abs(last.odom_from_base.theta - true) < 0.3 * abs(heading - true)


def test_beams_that_meet_the_floor_beyond_a_ramp_are_removed() -> None:
    pitch, reckoning = math.atan(1 / 12), DeadReckoning(CHAIR_A)
    for k in range(500):
        out = reckoning.update(
            SensorFrame(
                k * STEP, scan(k * STEP, 3.6), wheels=(Odometry(k * STEP, Pose2()),), imu=(imu(k * STEP, pitch=pitch),)
            )
        )
    assert out.scan is not None
    assert np.isnan(out.scan.ranges[45])


def test_a_level_chair_keeps_its_scan() -> None:
    reckoning = DeadReckoning(CHAIR_A)
    frame = SensorFrame(0, scan(0, 3.6), wheels=(Odometry(0, Pose2()),), imu=(imu(0),))
    assert reckoning.update(frame).scan is frame.scan
