"""The package's types as ROS messages and back, through bytes; and impossible messages."""

from __future__ import annotations

import contextlib
import importlib.util
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from tests.ros.transforms import read_transforms
from waychair.errors import MessageError
from waychair.geometry import in_space
from waychair.recordings.bags import ros_messages
from waychair.ros.messages import camera, maps, motion, reports, sensors, wire
from waychair.types import (
    ChairStatus,
    ImuSample,
    JoystickInput,
    OccupancyGrid,
    Odometry,
    Path,
    Pose2,
    Pose3,
    RgbdFrame,
    Scan,
    SonarReadings,
    Twist,
    WheelTicks,
)

STAMPS = st.integers(0, 2**31 * 10**9 - 1)
METRES = st.floats(-1e4, 1e4)
ANGLES = st.floats(-3.14159, 3.14159)
POSES = st.builds(Pose2, METRES, METRES, ANGLES)
TWISTS = st.builds(Twist, st.floats(-3, 3), st.floats(-3, 3))
RANGES = st.floats(0.0, 100.0, width=32) | st.sampled_from([math.inf, -math.inf, math.nan])


def sent(message: Any) -> Any:
    """Return a message after encoding and decoding."""
    return wire.deserialised(wire.serialised(message), message.__msgtype__)


def same_pose(left: Pose2, right: Pose2) -> bool:
    turn = math.remainder(left.theta - right.theta, math.tau)
    return math.isclose(left.x, right.x) and math.isclose(left.y, right.y) and abs(turn) < 1e-9


@given(STAMPS, st.lists(RANGES, min_size=2, max_size=40), st.floats(-3, 3), st.floats(0.001, 0.5), st.floats(0, 1e-3))
def test_scans_survive_with_their_codes_and_nothing_beyond_their_range(
    stamp_ns: int, ranges: list[float], angle: float, step: float, pause: float
) -> None:
    scan = Scan(stamp_ns, np.array(ranges, np.float32), angle, step, pause, 0.0625, 30.0)
    back = sensors.read_scan(sent(ros_messages.laser_scan(scan)))
    np.testing.assert_array_equal(back.ranges, np.where(scan.ranges > 30.0, np.inf, scan.ranges))
    assert back.stamp_ns == stamp_ns
    np.testing.assert_allclose(
        [back.angle_min, back.angle_step, back.time_step], [angle, step, pause], rtol=1e-6, atol=1e-9
    )


@given(STAMPS, arrays.arrays(np.float64, (2, 3), elements=st.floats(-50, 50)))
def test_imu_samples_survive(stamp_ns: int, values: Any) -> None:
    back = sensors.read_imu(sent(ros_messages.imu(ImuSample(stamp_ns, values[0], values[1]))))
    assert back.stamp_ns == stamp_ns
    np.testing.assert_array_equal([back.accel, back.gyro], values)


@given(
    STAMPS, st.integers(-(2**31), 2**31 - 1), st.integers(-(2**31), 2**31 - 1), st.sampled_from([16, 4096, 1_000_000])
)
def test_encoder_counts_survive_exactly(stamp_ns: int, left: int, right: int, ticks_per_turn: int) -> None:
    ticks = WheelTicks(stamp_ns, left, right)
    assert sensors.read_wheels(sent(ros_messages.joint_states(ticks, ticks_per_turn)), ticks_per_turn) == ticks


@given(STAMPS, POSES, TWISTS, st.none() | st.just(np.diag([0.1, 0.2, 0.3]) + 0.01))
def test_odometry_survives(stamp_ns: int, pose: Pose2, twist: Twist, covariance: Any) -> None:
    back = motion.read_odometry(sent(ros_messages.odometry(stamp_ns, "odom", pose, twist, covariance)))
    assert isinstance(back, Odometry)
    assert (back.stamp_ns, back.twist) == (stamp_ns, twist)
    assert same_pose(back.odom_from_base, pose)
    assert (back.covariance is None) == (covariance is None)
    np.testing.assert_array_equal(
        back.covariance if covariance is not None else 0, 0 if covariance is None else covariance
    )


@given(STAMPS, st.booleans(), st.integers(1, 12), st.integers(1, 12), st.integers(0, 2**32 - 1))
def test_pictures_survive_with_depth_to_the_millimetre(
    stamp_ns: int, colour: bool, height: int, width: int, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    depth = rng.uniform(0.3, 60.0, (height, width)).astype(np.float32)
    depth[rng.random((height, width)) < 0.2] = np.nan
    pixels = rng.integers(0, 256, (height, width, 3) if colour else (height, width), np.uint8)
    frame = RgbdFrame(stamp_ns, pixels, depth, np.array([[500.0, 0, 6], [0, 510.0, 5], [0, 0, 1]]))
    back = camera.read_rgbd(
        sent(ros_messages.colour_image(frame)),
        sent(ros_messages.depth_image(frame)),
        sent(ros_messages.camera_info(frame)),
    )
    np.testing.assert_array_equal(back.image, pixels)
    np.testing.assert_array_equal(back.camera_matrix, frame.camera_matrix)
    np.testing.assert_allclose(back.depth, depth, atol=0.00051)


@given(st.permutations(range(6)))
def test_picture_and_depth_are_paired_in_any_order_of_arrival(order: list[int]) -> None:
    pairing = camera.CameraPairing()
    frames = [
        RgbdFrame(stamp, np.zeros((2, 2), np.uint8), np.ones((2, 2), np.float32), np.eye(3)) for stamp in (10, 20, 30)
    ]
    pairing.calibrated(ros_messages.camera_info(frames[0]))
    takes = [(pairing.colour, ros_messages.colour_image(frame)) for frame in frames]
    takes += [(pairing.depth, ros_messages.depth_image(frame)) for frame in frames]
    completed = [frame for k in order if (frame := takes[k][0](takes[k][1])) is not None]
    assert sorted(frame.stamp_ns for frame in completed) == [10, 20, 30]


def test_pictures_without_a_partner_are_dropped() -> None:
    pairing = camera.CameraPairing()
    frame = RgbdFrame(0, np.zeros((2, 2), np.uint8), np.ones((2, 2), np.float32), np.eye(3))
    pairing.calibrated(ros_messages.camera_info(frame))
    for stamp in range(100):
        assert pairing.colour(ros_messages.colour_image(replace(frame, stamp_ns=stamp))) is None
    assert pairing.depth(ros_messages.depth_image(replace(frame, stamp_ns=5))) is None
    assert pairing.depth(ros_messages.depth_image(replace(frame, stamp_ns=99))) is not None


def test_sonars_of_one_stamp_are_combined_and_a_silent_one_is_nan() -> None:
    ring = sensors.SonarRing(3)

    def hear(k: int, stamp_ns: int, distance: float) -> SonarReadings | None:
        return ring.hear(k, sent(ros_messages.sonar_range(stamp_ns, k, distance)))

    assert [hear(0, 5, 1.0), hear(2, 5, math.inf)] == [None, None]
    whole = hear(1, 5, -math.inf)
    assert whole is not None
    np.testing.assert_array_equal(whole.ranges, [1.0, -math.inf, math.inf])
    assert hear(0, 9, 2.0) is None
    partial = hear(0, 12, 3.0)
    assert partial is not None
    assert partial.stamp_ns == 9
    np.testing.assert_array_equal(partial.ranges, [2.0, math.nan, math.nan])


@given(STAMPS, st.integers(1, 9), st.integers(1, 9), st.floats(0.001, 1.0), POSES, st.integers(0, 2**32 - 1))
def test_maps_survive_with_their_resolution(
    stamp_ns: int, height: int, width: int, resolution: float, origin: Pose2, seed: int
) -> None:
    cells = np.random.default_rng(seed).integers(-1, 101, (height, width)).astype(np.int8)
    grid = OccupancyGrid(cells, float(f"{resolution:.4g}"), origin)
    back = maps.read_occupancy_grid(sent(maps.occupancy_grid(stamp_ns, grid)))
    np.testing.assert_array_equal(back.cells, cells)
    assert back.resolution == grid.resolution
    assert same_pose(back.map_from_grid, origin)


@given(STAMPS, arrays.arrays(np.float64, st.tuples(st.integers(0, 9), st.just(3)), elements=ANGLES))
def test_paths_survive(stamp_ns: int, poses: Any) -> None:
    back = motion.read_path(sent(motion.path(stamp_ns, Path(poses))))
    np.testing.assert_allclose(back.poses, poses, atol=1e-9)


@given(STAMPS, POSES, TWISTS)
def test_poses_twists_and_transforms_survive(stamp_ns: int, pose: Pose2, twist: Twist) -> None:
    assert same_pose(motion.read_pose_stamped(sent(motion.pose_stamped(stamp_ns, pose))), pose)
    at, covariance = motion.read_pose_with_covariance(sent(motion.pose_with_covariance(stamp_ns, pose, np.eye(3))))
    assert same_pose(at, pose)
    assert covariance is not None
    assert (covariance == np.eye(3)).all()
    assert motion.read_twist(sent(motion.twist(twist))) == twist
    assert motion.read_twist_stamped(sent(motion.twist_stamped(stamp_ns, twist))) == (stamp_ns, twist)
    back = read_transforms(sent(motion.transform(stamp_ns, "odom", "base_link", in_space(pose, 0.3))))
    told_ns, odom_from_base = back["odom", "base_link"]
    assert told_ns == stamp_ns
    assert same_pose(odom_from_base.planar(), pose)
    assert odom_from_base.translation[2] == 0.3


@given(st.floats(0.01, 3.0))
def test_speed_limits_survive_in_either_unit(limit: float) -> None:
    message = sent(motion.speed_limit(0, limit))
    assert motion.read_speed_limit(message, 1.5) == limit
    message.percentage, message.speed_limit = True, 40.0
    assert motion.read_speed_limit(message, 1.5) == pytest.approx(0.6)
    assert motion.read_speed_limit(sent(motion.speed_limit(0, math.inf)), 1.5) == math.inf


@given(STAMPS, st.floats(-1, 1, width=32), st.floats(-1, 1, width=32))
def test_the_riders_stick_survives(stamp_ns: int, forward: float, turn: float) -> None:
    stick = JoystickInput(stamp_ns, forward, turn)
    assert sensors.read_joy(sent(sensors.joy(stick))) == stick


@given(STAMPS, st.sampled_from([None, True, False]), st.none() | st.floats(0, 1, width=32))
def test_the_battery_survives(stamp_ns: int, charging: bool | None, charge: float | None) -> None:
    status = ChairStatus(stamp_ns, None, charging, charge)
    assert sensors.read_battery(sent(sensors.battery(status))) == status


@pytest.mark.parametrize(("status", "connected"), [(0, None), (1, True), (2, False), (3, True), (4, True)])
def test_f24_a_full_or_waiting_battery_has_a_connected_charger(status: int, connected: bool | None) -> None:
    message = broken(sensors.battery(ChairStatus(5)), power_supply_status=status)
    assert sensors.read_battery(message).charging is connected


def test_reports_survive_unchanged() -> None:
    report = reports.Report(
        "bridge: board", reports.DiagnosticLevel.WARN, "low battery", (("state", "armed"), ("", "{}"))
    )
    assert reports.read_diagnostics(sent(reports.diagnostics(7, [report], "A"))) == (report,)


@pytest.mark.skipif(importlib.util.find_spec("rclpy") is None, reason="ROS is not installed (no rclpy)")
@pytest.mark.parametrize(
    "message",
    [
        ros_messages.laser_scan(Scan(5, np.ones(3, np.float32), 0.0, 0.1)),
        motion.path(5, Path(np.ones((2, 3)))),
        motion.transform(5, "odom", "base_link", Pose3(np.eye(3), np.ones(3))),
        maps.occupancy_grid(5, OccupancyGrid(np.array([[-1, 100]], np.int8), 0.05)),
        reports.diagnostics(5, [reports.Report("a", reports.DiagnosticLevel.ERROR, "b", (("c", "d"),))]),
        motion.speed_limit(5, 0.5),
    ],
    ids=lambda message: str(message.__msgtype__),
)
def test_rclpys_own_objects_are_read_alike(message: Any) -> None:
    native = wire.native(message)
    back = wire.plain(native)
    assert wire.serialised(back) == wire.serialised(message)
    readers = {"LaserScan": sensors.read_scan, "Path": motion.read_path}
    readers |= {"OccupancyGrid": maps.read_occupancy_grid, "DiagnosticArray": reports.read_diagnostics}
    if read := readers.get(type(native).__name__):
        assert repr(read(native)) == repr(read(back))


def broken(message: Any, **fields: Any) -> Any:
    """A message with some fields changed, nested ones by `a__b`."""
    copy = sent(message)
    for name, value in fields.items():
        *above, last = name.split("__")
        place = copy
        for part in above:
            place = place[int(part)] if part.isdecimal() else getattr(place, part)
        setattr(place, last, value)
    return copy


SCAN = ros_messages.laser_scan(Scan(5, np.ones(11, np.float32), -0.5, 0.1))
IMU = ros_messages.imu(ImuSample(5, np.zeros(3), np.zeros(3)))
JOINTS = ros_messages.joint_states(WheelTicks(5, 1, 2), 4096)
ODOMETRY = ros_messages.odometry(5, "odom", Pose2(), Twist())
GOAL = motion.pose_stamped(5, Pose2(1.0, 2.0))
ESTIMATE = motion.pose_with_covariance(5, Pose2(), np.eye(3))
GRID = maps.occupancy_grid(5, OccupancyGrid(np.zeros((2, 3), np.int8), 0.05))
RANGE = ros_messages.sonar_range(5, 0, 1.0)
ARRAY = reports.diagnostics(5, [reports.Report("a")])

BAD: list[tuple[Any, Any, dict[str, Any], str]] = [
    (sensors.read_scan, SCAN, {"header__stamp__sec": -1}, "stamp -1 s"),
    (sensors.read_scan, SCAN, {"header__stamp__nanosec": 10**9}, "stamp .* is impossible"),
    (sensors.read_scan, SCAN, {"angle_min": math.nan}, "angle is not finite"),
    (sensors.read_scan, SCAN, {"angle_increment": math.inf}, "angle is not finite"),
    (sensors.read_scan, SCAN, {"angle_increment": 0.0}, "a scan of 11 ranges is invalid"),
    (sensors.read_scan, SCAN, {"ranges": np.zeros(0, np.float32)}, "a scan of 0 ranges is invalid"),
    (sensors.read_scan, SCAN, {"ranges": np.ones(7, np.float32)}, "7 ranges, but 11 beams"),
    (sensors.read_scan, SCAN, {"header__frame_id": "base_link"}, "'base_link' is not of the sensor in 'laser'.*scan_frame"),
    (sensors.read_scan, SCAN, {"header__frame_id": "rear_laser"}, "'rear_laser' is not of the sensor in 'laser'"),
    (sensors.read_imu, IMU, {"header__frame_id": "camera_imu"}, "'camera_imu' is not of the sensor in 'imu_link'.*imu_"),
    (sensors.read_imu, IMU, {"angular_velocity__z": math.nan}, "not finite"),
    (sensors.read_imu, IMU, {"linear_acceleration_covariance": ros_messages.UNREPORTED}, "holds no acceleration"),
    (sensors.read_range, RANGE, {"max_range": 0.0}, "from 0.02 to 0 m"),
    (motion.read_odometry, ODOMETRY, {"header__frame_id": "map"}, "frame 'map' is not accepted: send it in odom"),
    (motion.read_odometry, ODOMETRY, {"child_frame_id": "cart"}, "odometry is of 'cart'"),
    (motion.read_odometry, ODOMETRY, {"pose__pose__position__x": math.nan}, "a pose is not finite"),
    (motion.read_odometry, ODOMETRY, {"pose__pose__position__x": 1e308}, "impossibly far away"),
    (motion.read_odometry, ODOMETRY, {"twist__twist__angular__z": math.inf}, "twist is not finite"),
    (motion.read_pose_stamped, GOAL, {"header__frame_id": "moon"}, "frame 'moon' is not accepted: send it in map"),
    (motion.read_pose_stamped, GOAL, {"pose__orientation__w": 0.0}, "quaternion has length 0"),
    (motion.read_pose_stamped, GOAL, {"pose__position__x": 1e300}, "1e\\+300, 2.* m is too far away"),
    (motion.read_pose_with_covariance, ESTIMATE, {"pose__covariance": -np.ones(36)}, "covariance"),
    (motion.read_twist, motion.twist(Twist()), {"linear__x": math.nan}, "a twist is not finite"),
    (maps.read_occupancy_grid, GRID, {"data": np.zeros(5, np.int8)}, "a map of 3 x 2 cells holds 5"),
    (maps.read_occupancy_grid, GRID, {"data": np.full(6, 101, np.int8)}, "cells lie in 101..101"),
    (maps.read_occupancy_grid, GRID, {"info__resolution": math.nan}, "resolution of nan"),
    (maps.read_occupancy_grid, GRID, {"header__frame_id": "odom"}, "frame 'odom'"),
    (sensors.read_joy, sensors.joy(JoystickInput(5)), {"axes": np.zeros(1, np.float32)}, "1 axes cannot steer"),
    (sensors.read_battery, sensors.battery(ChairStatus(5)), {"percentage": 80.0}, "charge 80 is impossible"),
    (reports.read_diagnostics, ARRAY, {"status__0__level": 9}, "unknown level 9"),
]  # fmt: skip


@pytest.mark.parametrize(("read", "message", "fields", "sentence"), BAD)
def test_an_impossible_message_is_refused_by_name(
    read: Any, message: Any, fields: dict[str, Any], sentence: str
) -> None:
    read(sent(message))
    with pytest.raises(MessageError, match=sentence):
        read(broken(message, **fields))


@pytest.mark.parametrize(
    ("part", "fields", "sentence"),
    [
        (0, {"encoding": "yuv9"}, "encoding 'yuv9' cannot be read"),
        (0, {"data": np.zeros(5, np.uint8)}, "has only 5 bytes"),
        (0, {"header__stamp__nanosec": 2_000_005}, "depth is -2.0 ms later than its picture"),
        (1, {"encoding": "rgb8"}, "cannot be read"),
        (1, {"width": 2}, r"\(4 x 3, 2 x 3\) differ from the camera's 4 x 3"),
        (2, {"k": np.zeros(9)}, "not calibrated"),
        (2, {"k": np.full(9, math.nan)}, "matrix is not finite"),
        (2, {"k": np.diag([300.0, 0.0, 1.0]).ravel()}, "no focal lengths"),
        (2, {"k": np.diag([300.0, 300.0, 0.0]).ravel()}, "no focal lengths"),
        (2, {"height": 480}, "differ from the camera's 4 x 480"),
    ],
)
def test_pictures_that_do_not_match_are_refused(part: int, fields: dict[str, Any], sentence: str) -> None:
    frame = RgbdFrame(5, np.zeros((3, 4, 3), np.uint8), np.ones((3, 4), np.float32), np.diag([5.0, 5.0, 1.0]))
    three = [ros_messages.colour_image(frame), ros_messages.depth_image(frame), ros_messages.camera_info(frame)]
    three[part] = broken(three[part], **fields)
    with pytest.raises(MessageError, match=sentence):
        camera.read_rgbd(*three)


@given(st.binary(max_size=200))
def test_any_bytes_give_a_message_or_are_refused(data: bytes) -> None:
    for name in ("sensor_msgs/msg/LaserScan", "nav_msgs/msg/Path", "tf2_msgs/msg/TFMessage"):
        with contextlib.suppress(MessageError):
            assert wire.deserialised(b"\x00\x01\x00\x00" + data, name).__msgtype__ == name


@given(st.integers(0, 600))
def test_truncated_messages_are_refused(length: int) -> None:
    whole = wire.serialised(ros_messages.laser_scan(Scan(5, np.ones(150, np.float32), 0.0, 0.01)))
    with pytest.raises(MessageError):
        wire.deserialised(whole[:length], "sensor_msgs/msg/LaserScan")


def test_wheels_with_other_names_are_refused() -> None:
    message = sent(JOINTS)
    message.name = ["left_wheel_joint", "caster"]
    with pytest.raises(MessageError, match="lack right_wheel_joint"):
        sensors.read_wheels(message, 4096)


def test_infinite_wheel_angles_are_refused() -> None:
    message = sent(JOINTS)
    message.position = np.array([1e306, 0.0])
    with pytest.raises(MessageError, match="a wheel's angle is not finite"):
        sensors.read_wheels(message, 4096)


def test_a_picture_that_the_decoder_refuses_is_refused_by_name() -> None:
    odd = RgbdFrame(5, np.zeros((4, 5), np.uint8), np.ones((4, 5), np.float32), np.diag([5.0, 5.0, 1.0]))
    colour = ros_messages.colour_image(odd)
    colour.encoding, colour.step, colour.data = "yuv422_yuy2", 10, np.zeros(40, np.uint8)
    with pytest.raises(MessageError, match="a picture cannot be read"):
        camera.read_rgbd(colour, ros_messages.depth_image(odd), ros_messages.camera_info(odd))


def test_a_sensor_may_have_its_own_frame_name() -> None:
    assert sensors.read_scan(broken(SCAN, header__frame_id="/front"), "front").stamp_ns == 5
    assert sensors.read_imu(broken(IMU, header__frame_id="imu"), "imu").stamp_ns == 5


def test_frames_may_begin_with_the_old_slash() -> None:
    assert motion.read_pose_stamped(broken(GOAL, header__frame_id="/map")) == Pose2(1.0, 2.0)
