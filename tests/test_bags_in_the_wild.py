"""Bags of other robots: no /odom, two lidars, clouds, pictures, unusual mounts and missing stamps."""

from __future__ import annotations

import math
import struct
import tracemalloc
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from tests.bags import SECOND, Bag, off_the_walls, room_ranges
from waychair.errors import ConfigError, NoScans, RecordingError
from waychair.geometry import transform_points
from waychair.recordings.bags.bag_settings import BagSettings
from waychair.recordings.recording import InputSettings, Recording, read_recording
from waychair.recordings.scans import beam_ends
from waychair.types import Odometry, Pose2, RgbdFrame

LEVEL = (0.0, 0.0, 0.0, 1.0)
START = 1_700_000_000 * SECOND


def yawed(theta: float) -> tuple[float, ...]:
    return (0.0, 0.0, math.sin(theta / 2), math.cos(theta / 2))


def drive(t: float) -> Pose2:
    """Pose in the room after t seconds, on an arc to the left at 0.6 m/s and 0.3 rad/s."""
    return Pose2(2.0, 2.0, 0.1) @ Pose2(2.0 * math.sin(0.3 * t), 2.0 * (1.0 - math.cos(0.3 * t)), 0.3 * t)


def own(recording: Recording) -> list[Odometry]:
    """The odometry at each scan."""
    readings = [frame.wheels[-1] for frame in recording.frames]
    return [reading for reading in readings if isinstance(reading, Odometry)]


@pytest.mark.parametrize(("ros", "name"), [(1, "drive.bag"), (2, "drive")])
def test_without_odom_the_motion_and_the_mounts_come_from_tf(tmp_path: Path, ros: int, name: str) -> None:
    bag = Bag(tmp_path / name, ros)
    bag.mount(START, ("base_link", "mast", (0.3, 0.0, 0.5), yawed(0.5)))
    for k in range(41):
        now, pose = START + k * SECOND // 20, drive(k / 20)
        odom = ("/odom", "/base_footprint", (pose.x, pose.y, 0.0), yawed(pose.theta))
        # As in ROS 1: transforms that never change come on /tf, too, and a localiser above odom jumps.
        fixed = ("base_footprint", "base_link", (0.0, 0.0, 0.1), LEVEL), ("mast", "laser", (0.2, 0.1, 0.0), LEVEL)
        jump = ("map", "odom", (float(k % 7), -3.0, 0.0), yawed(0.2 * (k % 5)))
        bag.mount(now, odom, *fixed, jump, topic="/tf")
        if k % 4 == 1:
            bag.room(now + SECOND // 40, drive((k + 0.5) / 20), "/scan", "laser")
    bag.close()
    recording = read_recording(tmp_path / name)
    assert recording.warnings == ()
    assert recording.source == f"ROS {ros} bag, scans /scan, odometry /tf from odom to base_link"
    mount = Pose2(0.3, 0.0, 0.5) @ Pose2(0.2, 0.1, 0.0)
    np.testing.assert_allclose(recording.base_from_laser.array(), mount.array(), atol=1e-9)
    assert len(recording.frames) == 10
    for k, reading in enumerate(own(recording)):
        truth = drive((4 * k + 1.5) / 20)
        np.testing.assert_allclose(reading.odom_from_base.array(), truth.array(), atol=1e-3)
        assert reading.twist.omega == pytest.approx(0.3, abs=1e-3)
        assert reading.twist.v == pytest.approx(0.6, abs=0.005)


def test_a_base_with_a_pose_in_the_map_only_has_no_odometry(tmp_path: Path) -> None:
    bag = Bag(tmp_path / "drive")
    for k in range(5):
        bag.mount(k * SECOND, ("map", "base_link", (0.1 * k, 0.0, 0.0), LEVEL), topic="/tf")
        bag.room(k * SECOND, Pose2(2.0 + 0.1 * k, 2.0), "/scan", "base_link")
    bag.close()
    recording = read_recording(tmp_path / "drive")
    assert [frame.wheels for frame in recording.frames] == [()] * 5
    assert any("no nav_msgs/msg/Odometry and no /tf that moves the base" in warning for warning in recording.warnings)


def two_lidars(path: Path, *, mounted: bool = True, rear_upside_down: bool = False) -> tuple[Pose2, Pose2]:
    """A drive with one lidar in front and one behind that measures between the front one's scans."""
    front, rear = Pose2(0.5, 0.1, 0.1), Pose2(-0.4, 0.0, math.pi)
    bag = Bag(path)
    if mounted:
        bag.mount(
            START,
            ("base_link", "front", (front.x, front.y, 0.3), yawed(front.theta)),
            ("base_link", "rear", (rear.x, rear.y, 0.3), yawed(rear.theta)),
        )
    for k in range(101):
        now, pose = START + k * SECOND // 50, drive(k / 50)
        bag.mount(now, ("odom", "base_link", (pose.x, pose.y, 0.0), yawed(pose.theta)), topic="/tf")
        if k % 5 == 2:
            bag.room(now, pose @ front, "/front/scan", "front")
        if k % 5 == 4:
            bag.room(now, pose @ rear, "/rear/scan", "rear", upside_down=rear_upside_down)
    bag.close()
    return front, rear


def both(*mounts: str) -> InputSettings:
    return InputSettings(mounts=mounts, bag=BagSettings(scan_topics=("/front/scan", "/rear/scan")))


def test_two_lidars_are_merged_into_one_round_view_from_the_base(tmp_path: Path) -> None:
    two_lidars(tmp_path / "drive")
    recording = read_recording(tmp_path / "drive", both())
    assert recording.base_from_laser == Pose2()
    assert len(recording.frames) == 20
    for frame, reading in zip(recording.frames, own(recording), strict=True):
        assert frame.scan is not None
        seen = np.isfinite(frame.scan.ranges)
        points = transform_points(reading.odom_from_base, beam_ends(frame.scan)[0][seen])
        assert off_the_walls(points).max() < 0.03, "the rear scan is corrected to the front scan's time"
        behind = np.abs(frame.scan.angles()[seen]) > 2.5
        assert 40 < behind.sum() < 240


def test_without_a_named_lidar_one_is_used_and_the_other_mentioned(tmp_path: Path) -> None:
    front, _ = two_lidars(tmp_path / "drive")
    recording = read_recording(tmp_path / "drive")
    assert any("there are also" in warning for warning in recording.warnings)
    assert recording.frames[0].scan is not None
    assert len(recording.frames[0].scan.ranges) == 241
    assert "/rear/scan" in recording.source or recording.base_from_laser.x == pytest.approx(front.x)


def test_lidars_without_tf_are_merged_by_the_given_mounts(tmp_path: Path) -> None:
    front, rear = two_lidars(tmp_path / "drive", mounted=False, rear_upside_down=True)
    unknown = read_recording(tmp_path / "drive", both())
    assert sum("--base-from-laser" in warning for warning in unknown.warnings) == 2
    mounts = f"{front.x},{front.y},{front.theta}", f"{rear.x},{rear.y},{rear.theta},upside-down"
    recording = read_recording(tmp_path / "drive", both(*mounts))
    assert recording.warnings == ()
    for frame, reading in zip(recording.frames, own(recording), strict=True):
        assert frame.scan is not None
        points = transform_points(reading.odom_from_base, beam_ends(frame.scan)[0])
        assert off_the_walls(points[np.isfinite(points[:, 0])]).max() < 0.03
    with pytest.raises(RecordingError, match="3 mounts are given for the 2 scan topics"):
        read_recording(tmp_path / "drive", both(*mounts, "0,0,0"))


@pytest.mark.parametrize("text", ["", "1", "1,2,3,4,5", "a,b", "1,2,nan", "0,0,0,upsidedown", "upside-down"])
def test_an_invalid_mount_is_refused_with_an_example(tmp_path: Path, text: str) -> None:
    two_lidars(tmp_path / "drive", mounted=False)
    with pytest.raises(ConfigError, match=r"X,Y,YAW,upside-down .*such as 0\.6,0,0"):
        read_recording(tmp_path / "drive", both(text))


@pytest.mark.parametrize("big_endian", [False, True])
def test_the_band_of_a_cloud_becomes_a_level_scan(tmp_path: Path, big_endian: bool) -> None:
    angles = np.linspace(-math.pi, math.pi, 721)[:-1]
    sensor, tilt = Pose2(0.2, -0.1, 0.7), 0.1
    bag = Bag(tmp_path / "drive")
    half = (math.sin(tilt / 2), math.cos(tilt / 2))
    turn = np.array([[math.cos(0.7), -math.sin(0.7), 0], [math.sin(0.7), math.cos(0.7), 0], [0, 0, 1]])
    lean = np.array([[1, 0, 0], [0, math.cos(tilt), -math.sin(tilt)], [0, math.sin(tilt), math.cos(tilt)]])
    yaw = yawed(0.7)
    rotation = (yaw[3] * half[0], yaw[2] * half[0], yaw[2] * half[1], yaw[3] * half[1])
    for k in range(3):
        pose = drive(0.5 * k)
        at = pose @ Pose2(sensor.x, sensor.y, 0.0)
        ranges = room_ranges(at, angles)
        walls = np.stack([ranges * np.cos(angles), ranges * np.sin(angles)], axis=1)
        heights = [np.column_stack([walls * 0.999, np.full(len(walls), z)]) for z in (0.4, 1.0)]
        floor = np.column_stack([0.5 * walls, np.full(len(walls), 0.02)])
        lamp = np.column_stack([0.3 * walls, np.full(len(walls), 2.0)])
        broken = np.full((5, 3), np.nan)
        in_base = np.concatenate([*heights, floor, lamp, broken]) - (0.0, 0.0, 0.8)
        bag.cloud(k * SECOND + 1, in_base @ turn @ lean, big_endian=big_endian)
        bag.mount(k * SECOND, ("odom", "base_link", (pose.x, pose.y, 0.0), yawed(pose.theta)), topic="/tf")
    bag.mount(3 * SECOND, ("odom", "base_link", (3.0, 3.0, 0.0), yawed(1.0)), topic="/tf")
    bag.mount(4 * SECOND, ("base_link", "velodyne", (sensor.x, sensor.y, 0.8), rotation))
    bag.close()
    recording = read_recording(tmp_path / "drive")
    np.testing.assert_allclose(recording.base_from_laser.array(), [sensor.x, sensor.y, 0.0], atol=1e-9)
    for k, frame in enumerate(recording.frames):
        assert frame.scan is not None
        assert np.isfinite(frame.scan.ranges).sum() >= 700
        at = drive(0.5 * k) @ Pose2(sensor.x, sensor.y, 0.0)
        points = transform_points(at, beam_ends(frame.scan)[0])
        assert off_the_walls(points[np.isfinite(points[:, 0])]).max() < 0.05


def test_imu_samples_are_in_the_frames_of_scans_in_the_axes_of_the_base(tmp_path: Path) -> None:
    bag = Bag(tmp_path / "drive")
    bag.mount(START, ("base_link", "imu_link", (0.1, 0.0, 0.2), (1.0, 0.0, 0.0, 0.0)))  # upside down
    for k in range(40):
        now = START + k * SECOND // 40
        bag.imu(now, (0.0, 0.0, -0.1 * k), (1.0, 2.0, -9.81))
        if k % 10 == 5:
            bag.room(now, drive(k / 40), "/scan", "base_link")
    bag.close()
    recording = read_recording(tmp_path / "drive")
    assert [len(frame.imu) for frame in recording.frames] == [6, 10, 10, 10]
    samples = [sample for frame in recording.frames for sample in frame.imu]
    np.testing.assert_allclose([sample.gyro[2] for sample in samples], 0.1 * np.arange(36), atol=1e-9)
    np.testing.assert_allclose(samples[0].accel, [1.0, -2.0, 9.81], atol=1e-9)
    assert recording.source.endswith("IMU /imu/data")


def test_messages_without_a_stamp_take_the_time_of_their_recording(tmp_path: Path) -> None:
    bag = Bag(tmp_path / "drive")
    for k in range(4):
        scan = bag.types["sensor_msgs/msg/LaserScan"](
            bag.header(0, "laser"), 0.0, 0.3, 0.1, 0.0, 0.1, 0.1, 8.0, np.ones(4, np.float32), np.zeros(0, np.float32)
        )
        bag.put("/scan", START + k * SECOND, scan)
    bag.close()
    recording = read_recording(tmp_path / "drive")
    assert [frame.stamp_ns for frame in recording.frames] == [START + k * SECOND for k in range(4)]
    assert any("messages have no stamp" in warning and "(4 times" in warning for warning in recording.warnings)


def test_empty_scans_are_reported_and_a_bag_of_empty_scans_is_refused(tmp_path: Path) -> None:
    for name, rows in {
        "some": [[math.nan] * 3, [math.inf] * 3, [1.0, math.nan, math.inf]],
        "none": [[math.nan] * 3],
    }.items():
        bag = Bag(tmp_path / name)
        for k, ranges in enumerate(rows):
            bag.scan((k + 1) * SECOND, ranges)
        bag.close()
    some = read_recording(tmp_path / "some")
    assert len(some.frames) == 3
    assert any(warning.startswith("2 of 3 scans hold no distance at all") for warning in some.warnings)
    with pytest.raises(NoScans, match=r"none of the 1 scans .* holds a distance"):
        read_recording(tmp_path / "none")


def test_scans_of_a_bag_are_sorted_by_stamp(tmp_path: Path) -> None:
    bag = Bag(tmp_path / "drive")
    for k, second in enumerate((1, 2, 5, 3, 4)):
        bag.odometry((k + 1) * SECOND, float(k))
        bag.scan(second * SECOND, [1.0, 2.0], logged_ns=(k + 1) * SECOND)
    bag.close()
    recording = read_recording(tmp_path / "drive")
    assert [frame.stamp_ns // SECOND for frame in recording.frames] == [1, 2, 3, 4, 5]
    assert any("3 scans are not recorded in the order of their stamps" in warning for warning in recording.warnings)
    assert [reading.odom_from_base.x for reading in own(recording)] == [0.0, 1.0, 2.0, 3.0, 4.0]


K = np.array([[500.0, 0.0, 320.0], [0.0, 501.0, 240.0], [0.0, 0.0, 1.0]])


def pictures(recording: Recording) -> list[RgbdFrame]:
    return list(recording.pictures())


def test_real_pictures_compressed_like_in_ros_are_read_unchanged(data_dir: Path, tmp_path: Path) -> None:
    folder = data_dir / "rgbd_tsdf_sample50"
    bag = Bag(tmp_path / "drive.bag", ros=1)
    bag.room(START, drive(0.0), "/scan", "laser")
    header = struct.pack("<iff", 0, 0.0, 0.0)
    for k in range(3):
        name, now = folder / f"frame-{150 + k:06d}", START + k * SECOND // 30
        bag.camera_info("/camera/rgb/camera_info", now, K, (480, 640))
        jpeg, png = name.with_suffix(".color.jpg").read_bytes(), name.with_suffix(".depth.png").read_bytes()
        bag.compressed("/camera/rgb/image_raw/compressed", now, jpeg, "rgb8; jpeg compressed bgr8")
        bag.compressed("/camera/depth_registered/image_raw/compressedDepth", now + 9_000_000, header + png, "16UC1; compressedDepth png")  # fmt: skip
    bag.close()
    frames = pictures(read_recording(tmp_path / "drive.bag"))
    assert [frame.stamp_ns for frame in frames] == [START + k * SECOND // 30 for k in range(3)]
    for k, frame in enumerate(frames):
        name = folder / f"frame-{150 + k:06d}"
        colour = cv2.imread(str(name.with_suffix(".color.jpg")))
        depth = cv2.imread(str(name.with_suffix(".depth.png")), cv2.IMREAD_UNCHANGED)
        assert colour is not None
        assert depth is not None
        np.testing.assert_array_equal(frame.image, colour[..., ::-1])
        np.testing.assert_array_equal(np.isnan(frame.depth), depth == 0)
        np.testing.assert_allclose(frame.depth[depth > 0], depth[depth > 0] / 1000, rtol=1e-6)
        np.testing.assert_array_equal(frame.camera_matrix, K)


DEPTH = np.linspace(0.4, 8.0, 48, dtype=np.float32).reshape(6, 8)
COLOUR = np.arange(6 * 8 * 3, dtype=np.uint8).reshape(6, 8, 3)


def quantised() -> tuple[bytes, np.ndarray]:
    """32FC1 as compressed_depth stores it: inverse depths in 16 bits, and their decoded values."""
    a, b = 1000.0, 1.0
    stored = np.rint(a / DEPTH + b).astype(np.uint16)
    stored[0, 0] = 0
    png = cv2.imencode(".png", stored)[1].tobytes()
    said = np.where(stored > 0, a / (stored.astype(float) - b), np.nan)
    return struct.pack("<iff", 0, a, b) + png, said


@pytest.mark.parametrize("encoding", ["rgb8", "bgr8", "rgba8", "bgra8", "mono8"])
@pytest.mark.parametrize("depth", ["16UC1", "32FC1", "quantised"])
def test_pictures_and_depth_of_every_usual_encoding_are_decoded(tmp_path: Path, encoding: str, depth: str) -> None:
    order = {"rgb8": [0, 1, 2], "bgr8": [2, 1, 0], "rgba8": [0, 1, 2, 0], "bgra8": [2, 1, 0, 0], "mono8": 0}[encoding]
    bag = Bag(tmp_path / "drive")
    bag.room(START, drive(0.0), "/scan", "laser")
    bag.camera_info("/camera/color/camera_info", START, K, (6, 8))
    bag.image("/camera/color/image_raw", START, COLOUR[..., order], encoding, padding=4)
    said: Any = DEPTH
    if depth == "16UC1":
        said = np.rint(DEPTH * 1000) / 1000
        bag.image("/camera/depth/image_raw", START, np.rint(DEPTH * 1000).astype("<u2"), depth, padding=2)
    elif depth == "32FC1":
        bag.image("/camera/depth/image_raw", START, np.where(DEPTH > 7.9, np.inf, DEPTH), depth)
        said = np.where(DEPTH > 7.9, np.nan, DEPTH)
    else:
        data, said = quantised()
        bag.compressed("/camera/depth/image_raw/compressedDepth", START, data, "32FC1; compressedDepth")
    bag.close()
    (frame,) = pictures(read_recording(tmp_path / "drive"))
    np.testing.assert_array_equal(frame.image, COLOUR[..., 0] if encoding == "mono8" else COLOUR)
    np.testing.assert_allclose(frame.depth, said, rtol=1e-5)


def test_pictures_are_neither_decoded_nor_kept_if_only_scans_are_read(tmp_path: Path) -> None:
    bag = Bag(tmp_path / "drive")
    picture = np.random.default_rng(0).integers(0, 255, (480, 640, 3), np.uint8)
    for k in range(30):
        bag.room(START + k * SECOND, drive(0.1 * k), "/scan", "laser")
        bag.image("/camera/color/image_raw", START + k * SECOND, picture, "rgb8")
    bag.image("/camera/color/image_raw", START + 40 * SECOND, picture[:1, :1], "nonsense")
    bag.close()
    read_recording(tmp_path / "drive")  # so that imports and caches are not counted
    tracemalloc.start()
    recording = read_recording(tmp_path / "drive")
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert len(recording.frames) == 30
    assert peak < 5 * picture.nbytes < 30 * picture.nbytes
    assert pictures(recording) == [], "there is no depth"


def test_an_unknown_camera_or_a_depth_of_another_size_is_refused(tmp_path: Path) -> None:
    for name, info, shape in (("unknown", False, (6, 8)), ("unaligned", True, (3, 4))):
        bag = Bag(tmp_path / name)
        bag.room(START, drive(0.0), "/scan", "laser")
        if info:
            bag.camera_info("/camera/color/camera_info", START, K, (6, 8))
        bag.image("/camera/color/image_raw", START, COLOUR, "rgb8")
        bag.image("/camera/depth/image_raw", START, np.ones(shape, np.float32), "32FC1")
        bag.close()
    with pytest.raises(RecordingError, match="holds no sensor_msgs/msg/CameraInfo"):
        pictures(read_recording(tmp_path / "unknown"))
    with pytest.raises(RecordingError, match="4 x 3 pixels, its pictures 8 x 6"):
        pictures(read_recording(tmp_path / "unaligned"))
