"""The first frame of a map, by the chair's first motion in wheels and IMU."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from waychair.slam.frames.first_motion import rests, start_index
from waychair.types import ImuSample, Odometry, Pose2, Scan, SensorFrame, Twist, WheelTicks

IMU = (ImuSample(0, np.array([0.0, 0.0, 9.81]), np.zeros(3)),)
SCAN = Scan(0, np.ones(9, np.float32), -1.0, 0.25, 0.0, 0.1, 10.0)


def frame(v: float = 0.0, omega: float = 0.0, imu: bool = True, scan: bool = True) -> SensorFrame:
    return SensorFrame(
        0, scan=SCAN if scan else None, wheels=(Odometry(0, Pose2(), Twist(v, omega)),), imu=IMU if imu else ()
    )


@given(st.integers(1, 40), st.integers(1, 5))
def test_an_earlier_recording_begins_with_the_same_scan(resting: int, moving: int) -> None:
    frames = [frame() for _ in range(resting)] + [frame(0.3) for _ in range(moving)]
    assert start_index(frames) == resting - 1


@given(st.integers(0, 4), st.integers(1, 9))
def test_an_imu_that_starts_later_than_the_wheels_gives_the_same_first_scan(deaf: int, resting: int) -> None:
    frames = [frame(imu=False)] * deaf + [frame()] * resting + [frame(0.3)]
    assert start_index(frames) == deaf + resting - 1
    assert start_index([SensorFrame(0, scan=SCAN), *frames]) == deaf + resting


def test_motion_before_the_first_imu_message_starts_the_map() -> None:
    assert start_index([frame(imu=False), frame(0.3, imu=False), frame(), frame(), frame(0.3)]) == 0


def test_a_frame_without_a_scan_does_not_start_the_map() -> None:
    assert start_index([frame(), frame(), frame(scan=False), frame(0.3)]) == 1


def test_noise_is_no_motion_and_a_turn_on_the_spot_is_motion() -> None:
    assert rests(frame(0.02, -0.05))
    assert not rests(frame(0.021))
    assert not rests(frame(-0.3))
    assert not rests(frame(0.0, 0.06))


def test_a_recording_without_motion_or_imu_or_with_counts_alone_loses_no_frame() -> None:
    assert start_index([frame()] * 9) == 0
    assert start_index([frame(imu=False)] * 9 + [frame(0.3, imu=False)]) == 0
    counts = SensorFrame(0, scan=SCAN, wheels=(WheelTicks(0, 0, 0),), imu=IMU)
    assert start_index([counts] * 9 + [frame(0.3)]) == 0


def test_late_readings_at_rest_do_not_start_the_map() -> None:
    late = SensorFrame(0, scan=SCAN, imu=IMU)
    assert start_index([frame(), late, frame(), frame(0.3)]) == 2
