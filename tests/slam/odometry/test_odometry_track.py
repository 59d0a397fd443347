"""The odometry of the last second: the chair's pose at a stamp, and restarts of the odometry."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from waychair.geometry import arc
from waychair.slam.odometry.odometry_track import OdometryTrack
from waychair.types import Odometry, Pose2, Twist

MS = 1_000_000
SPEED = Twist(0.8, 0.4)
START = Pose2(3.0, 2.0, 1.0)


def reading(ms: int, pose: Pose2, twist: Twist = SPEED) -> Odometry:
    return Odometry(ms * MS, pose, twist)


def on_arc(ms: float) -> Pose2:
    return START @ arc(SPEED.v * ms * 1e-3, SPEED.omega * ms * 1e-3)


def driven(until_ms: int = 1000) -> OdometryTrack:
    track = OdometryTrack()
    for ms in range(0, until_ms + 1, 20):
        assert not track.take(reading(ms, on_arc(ms)))
    return track


@given(st.floats(0.0, 1100.0))
def test_between_two_readings_and_a_little_beyond_the_pose_is_on_the_arc(ms: float) -> None:
    found = driven().odom_from_base(round(ms * MS))
    assert found is not None
    np.testing.assert_allclose(found.array(), on_arc(ms).array(), atol=1e-6)


@pytest.mark.parametrize("ms", [1101, 5000, -101, -5000])
def test_far_from_known_readings_no_pose_is_given(ms: int) -> None:
    assert driven().odom_from_base(ms * MS) is None


def test_an_empty_track_has_no_pose_and_no_motion() -> None:
    assert OdometryTrack().odom_from_base(0) is None
    assert OdometryTrack().twist == Twist()


def test_a_silence_leaves_a_gap_without_poses() -> None:
    track = driven(200)
    assert not track.take(reading(600, on_arc(600)))
    assert track.odom_from_base(450 * MS) is None
    assert track.odom_from_base(600 * MS) is not None


def test_a_clock_that_goes_back_restarts_with_the_same_odometry() -> None:
    track = driven()
    assert not track.take(reading(-3_600_000, on_arc(1020)))
    assert track.odom_from_base(1000 * MS) is None
    assert track.odom_from_base(-3_600_000 * MS) == on_arc(1020)


@pytest.mark.parametrize("later_ms", [1101, 3000, -3_600_000])
def test_a_restarted_source_of_odometry_is_noticed(later_ms: int) -> None:
    track = driven()
    assert track.take(reading(later_ms, Pose2(0.01, 0.0, 0.002)))
    assert track.odom_from_base(1000 * MS) is None


def test_driving_through_the_origin_or_standing_there_does_not_count_as_a_restart() -> None:
    track = OdometryTrack()
    for ms in range(0, 3000, 20):
        assert not track.take(reading(ms, Pose2(-1.0 + 0.8e-3 * ms)))
    standing = OdometryTrack()
    standing.take(reading(0, Pose2()))
    assert not standing.take(reading(5000, Pose2(0.01)))


def test_over_a_silence_and_a_restart_the_chair_goes_on_from_where_it_stood() -> None:
    track = driven(1000)
    assert track.continued.array() == pytest.approx(on_arc(1000).array())
    assert track.take(reading(6000, Pose2(0.001, 0.0)))
    assert track.continued.array() == pytest.approx(on_arc(1000).array())
    track.take(reading(6050, Pose2(0.501, 0.0)))
    assert track.continued.array() == pytest.approx((on_arc(1000) @ Pose2(0.5, 0.0)).array())
