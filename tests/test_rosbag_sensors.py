"""Every message type in a bag: topic, type, frame, quality of service, rates and values, read back with rosbags
alone."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosbags.highlevel import AnyReader
from rosbags.interfaces import QosDurability, QosReliability
from scipy.spatial.transform import Rotation

from waychair.geometry import in_space
from waychair.recordings.bags.bag_settings import BagSettings
from waychair.recordings.bags.ros_messages import depth_image, transforms
from waychair.recordings.bags.rosbag_writer import RecordingWriter
from waychair.recordings.recording import InputSettings, read_recording
from waychair.types import ImuSample, Odometry, Pose2, Pose3, RgbdFrame, Scan, SonarReadings, Twist, WheelTicks

SECOND = 1_000_000_000
START_NS = 1_700_000_000 * SECOND
TILTED = Pose3(Rotation.from_euler("xyz", [0.0, 0.05, 0.3]).as_matrix(), np.array([0.4, 0.2, 0.95]))
MOUNTS = {
    "laser": in_space(Pose2(0.6, 0.0, 0.0), 0.3),
    "imu_link": in_space(Pose2(0.1, 0.0, 0.0), 0.35),
    "camera_link": TILTED,
    "sonar_0": in_space(Pose2(0.7, 0.2, 0.1), 0.4),
}
FRAME = RgbdFrame(
    START_NS,
    np.arange(6 * 8 * 3, dtype=np.uint8).reshape(6, 8, 3),
    np.linspace(0.3, 8.0, 48, dtype=np.float32).reshape(6, 8),
    np.array([[5.0, 0.0, 3.5], [0.0, 5.5, 2.5], [0.0, 0.0, 1.0]]),
)


@contextmanager
def opened(path: Path) -> Iterator[AnyReader]:
    with AnyReader([path]) as reader:
        yield reader


def messages(path: Path, topic: str) -> list[Any]:
    with opened(path) as reader:
        connections = [c for c in reader.connections if c.topic == topic]
        return [reader.deserialize(data, c.msgtype) for c, _, data in reader.messages(connections)]


def write_second(path: Path) -> None:
    """One second of everything at its nominal rate, each scan handed over at the end of its sweep."""
    with RecordingWriter(path, MOUNTS, ticks_per_turn=4096) as writer:
        for ms in range(0, 1000, 5):
            now = START_NS + ms * 1_000_000
            writer.write(ImuSample(now, np.array([0.1, 0.2, 9.81]), np.array([0.01, 0.02, 0.3])))
            if ms % 20 == 0:
                writer.write(WheelTicks(now, 2 * ms, (1 << 32) - ms))
                writer.write(Odometry(now, Pose2(ms / 1000, 0.0, 0.1), Twist(1.0, 0.0)))
                writer.write_truth(now, Pose2(10.0, 2.0, 0.5), Twist(0.9, 0.1))
            if ms % 50 == 0:
                writer.write(SonarReadings(now, np.array([1.0, np.inf, -np.inf], np.float32)))
            if ms % 100 == 75:
                writer.write(Scan(now - 75_000_000, np.full(90, 2.0, np.float32), -1.5, 3.0 / 90, 8e-4, 0.05, 12.0))
            if ms * 15 // 1000 != (ms + 5) * 15 // 1000:
                writer.write(FRAME)


@pytest.fixture(scope="module", params=["drive.mcap", "drive.db3"])
def bag(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("bag") / str(request.param)
    write_second(path)
    return path


def test_every_topic_has_its_type_rate_and_offered_quality(bag: Path) -> None:
    best_effort, reliable = QosReliability.BEST_EFFORT, QosReliability.RELIABLE
    expected = {
        "/scan": ("sensor_msgs/msg/LaserScan", 10, best_effort),
        "/odom": ("nav_msgs/msg/Odometry", 50, reliable),
        "/tf": ("tf2_msgs/msg/TFMessage", 50, reliable),
        "/tf_static": ("tf2_msgs/msg/TFMessage", 1, reliable),
        "/imu/data": ("sensor_msgs/msg/Imu", 200, best_effort),
        "/joint_states": ("sensor_msgs/msg/JointState", 50, reliable),
        "/ground_truth/odom": ("nav_msgs/msg/Odometry", 50, reliable),
        "/camera/color/image_raw": ("sensor_msgs/msg/Image", 15, best_effort),
        "/camera/color/camera_info": ("sensor_msgs/msg/CameraInfo", 15, best_effort),
        "/camera/aligned_depth_to_color/image_raw": ("sensor_msgs/msg/Image", 15, best_effort),
        "/camera/aligned_depth_to_color/camera_info": ("sensor_msgs/msg/CameraInfo", 15, best_effort),
        **{f"/sonar_{k}": ("sensor_msgs/msg/Range", 20, best_effort) for k in range(3)},
    }
    with opened(bag) as reader:
        qos = {c.topic: c.ext.offered_qos_profiles[0] for c in reader.connections}  # type: ignore[union-attr]
        found = {c.topic: (c.msgtype, c.msgcount, qos[c.topic].reliability) for c in reader.connections}
    assert found == expected
    latched = [topic for topic, offered in qos.items() if offered.durability == QosDurability.TRANSIENT_LOCAL]
    assert latched == ["/tf_static"]


def test_messages_are_logged_in_order_of_arrival_and_keep_their_own_stamps(bag: Path) -> None:
    with opened(bag) as reader:
        logged = [(stamp, connection.topic) for connection, stamp, _ in reader.messages()]
    stamps = [stamp for stamp, _ in logged]
    assert stamps == sorted(stamps)
    assert logged[0] == (START_NS, "/tf_static")
    assert next(stamp for stamp, topic in logged if topic == "/scan") == START_NS + 75_000_000
    header = messages(bag, "/scan")[0].header
    assert (header.stamp.sec * SECOND + header.stamp.nanosec, header.frame_id) == (START_NS, "laser")


def test_an_imu_reports_specific_force_upwards_and_no_orientation(bag: Path) -> None:
    message = messages(bag, "/imu/data")[0]
    assert message.header.frame_id == "imu_link"
    assert (message.linear_acceleration.z, message.angular_velocity.z) == (9.81, 0.3)
    assert message.orientation_covariance[0] == -1.0
    assert not message.angular_velocity_covariance.any()
    assert not message.linear_acceleration_covariance.any()


def test_pictures_are_complete_and_depth_is_registered_in_millimetres(bag: Path) -> None:
    colour = messages(bag, "/camera/color/image_raw")[0]
    assert (colour.height, colour.width, colour.step, colour.encoding) == (6, 8, 24, "rgb8")
    assert colour.header.frame_id == "camera_color_optical_frame"
    np.testing.assert_array_equal(colour.data.reshape(6, 8, 3), FRAME.image)
    depth = messages(bag, "/camera/aligned_depth_to_color/image_raw")[0]
    assert (depth.encoding, depth.step, depth.is_bigendian) == ("16UC1", 16, 0)
    assert depth.header.frame_id == "camera_color_optical_frame"
    np.testing.assert_allclose(depth.data.view("<u2").reshape(6, 8) / 1000.0, FRAME.depth, atol=0.00051)
    info = messages(bag, "/camera/color/camera_info")[0]
    assert (info.header.frame_id, info.height, info.width) == ("camera_color_optical_frame", 6, 8)
    np.testing.assert_array_equal(info.k.reshape(3, 3), FRAME.camera_matrix)
    np.testing.assert_array_equal(info.p.reshape(3, 4)[:, :3], FRAME.camera_matrix)


def test_missing_depth_or_depth_beyond_16_bit_millimetres_is_zero() -> None:
    depth = np.array([[np.nan, np.inf, -np.inf, -1.0, 65.536, 65.535, 0.0004, 0.0006]], np.float32)
    message = depth_image(RgbdFrame(START_NS, np.zeros((1, 8), np.uint8), depth, np.eye(3)))
    assert message.data.view("<u2").tolist() == [0, 0, 0, 0, 0, 65535, 0, 1]


def test_a_grey_picture_is_mono8(tmp_path: Path) -> None:
    grey = RgbdFrame(START_NS, FRAME.image[:, :, 0], FRAME.depth, FRAME.camera_matrix)
    with RecordingWriter(tmp_path / "drive.mcap", MOUNTS) as writer:
        writer.write(grey)
    (message,) = messages(tmp_path / "drive.mcap", "/camera/color/image_raw")
    assert (message.encoding, message.step) == ("mono8", 8)
    np.testing.assert_array_equal(message.data.reshape(6, 8), grey.image)


def test_each_sonar_has_its_topic_and_frame_and_keeps_the_codes_of_rep_117(bag: Path) -> None:
    readings = [messages(bag, f"/sonar_{k}")[0] for k in range(3)]
    assert [reading.range for reading in readings] == [1.0, math.inf, -math.inf]
    assert [reading.header.frame_id for reading in readings] == ["sonar_0", "sonar_1", "sonar_2"]
    assert {reading.radiation_type for reading in readings} == {0}


def test_wheel_angles_unwrap_counts_below_zero(bag: Path) -> None:
    message = messages(bag, "/joint_states")[1]
    assert message.name == ["left_wheel_joint", "right_wheel_joint"]
    assert message.position.tolist() == pytest.approx([40 * math.tau / 4096, -20 * math.tau / 4096])


def test_without_counts_per_turn_no_wheel_angles_are_written(tmp_path: Path) -> None:
    with RecordingWriter(tmp_path / "drive.mcap", MOUNTS) as writer:
        writer.write(WheelTicks(START_NS, 0, 0))
        writer.write(Odometry(START_NS, Pose2()))
    with opened(tmp_path / "drive.mcap") as reader:
        assert {connection.topic for connection in reader.connections} == {"/tf_static", "/odom", "/tf"}


def test_the_base_moves_in_odom_and_the_sensors_are_mounted_on_it(bag: Path) -> None:
    moving = messages(bag, "/tf")[10].transforms[0]
    assert (moving.header.frame_id, moving.child_frame_id) == ("odom", "base_link")
    assert moving.transform.translation.x == 0.2
    (static,) = messages(bag, "/tf_static")
    mounts = {transform.child_frame_id: transform for transform in static.transforms}
    assert {name: transform.header.frame_id for name, transform in mounts.items()} == {
        **dict.fromkeys(MOUNTS, "base_link"),
        "camera_color_optical_frame": "camera_link",
    }
    assert mounts["laser"].transform.translation.z == 0.3
    turn = mounts["camera_link"].transform.rotation
    np.testing.assert_allclose(
        Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]).as_matrix(), TILTED.rotation, atol=1e-12
    )
    optical = mounts["camera_color_optical_frame"].transform.rotation
    forward = Rotation.from_quat([optical.x, optical.y, optical.z, optical.w]).apply([0.0, 0.0, 1.0])
    np.testing.assert_allclose(forward, [1.0, 0.0, 0.0], atol=1e-12)


def test_the_true_pose_is_in_map_and_never_read_as_odometry(tmp_path: Path, bag: Path) -> None:
    truth = messages(bag, "/ground_truth/odom")[0]
    assert (truth.header.frame_id, truth.child_frame_id, truth.pose.pose.position.x) == ("map", "base_link", 10.0)
    path = tmp_path / "drive.mcap"
    with RecordingWriter(path, MOUNTS) as writer:
        for k in range(5):
            stamp = START_NS + k * SECOND // 10
            writer.write_truth(stamp, Pose2(1.0, 2.0, 0.0), Twist())
            writer.write(Scan(stamp, np.full(90, 2.0, np.float32), -1.5, 3.0 / 90))
    assert [frame.wheels for frame in read_recording(path).frames] == [()] * 5
    asked = read_recording(path, InputSettings(bag=BagSettings(odom_topic="/ground_truth/odom")))
    assert all(frame.wheels for frame in asked.frames)


@given(st.lists(st.floats(-1.0, 1.0), min_size=4, max_size=4).filter(lambda q: float(np.linalg.norm(q)) > 0.01))
def test_any_rotation_becomes_the_quaternion_of_the_same_rotation(xyzw: list[float]) -> None:
    rotation = Rotation.from_quat(xyzw).as_matrix()
    turn = transforms(0, {("a", "b"): Pose3(rotation, np.zeros(3))}).transforms[0].transform.rotation
    assert turn.w >= 0.0
    assert math.hypot(turn.x, turn.y, turn.z, turn.w) == pytest.approx(1.0, abs=1e-12)
    np.testing.assert_allclose(Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]).as_matrix(), rotation, atol=1e-9)
