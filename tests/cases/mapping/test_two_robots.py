"""Two robots in one bag: scans, odometry, IMU and camera are of one of them, or the choice is left to the user."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin

from tests.bags import SECOND, Bag
from waychair.errors import RecordingError
from waychair.recordings.bags.bag_settings import BagSettings
from waychair.recordings.recording import InputSettings, Recording, read_recording
from waychair.types import Odometry, Pose2

START = 1_700_000_000 * SECOND
LEVEL = (0.0, 0.0, 0.0, 1.0)
SCANS = {"red": 30, "blue": 24}


def odometry(bag: Bag, topic: str, at_ns: int, x: float, frame: str, base: str) -> None:
    """Write the odometry of a base on its way along x."""
    make = bag.types
    vector = make["geometry_msgs/msg/Vector3"]
    turn = make["geometry_msgs/msg/Quaternion"](*LEVEL)
    pose = make["geometry_msgs/msg/Pose"](make["geometry_msgs/msg/Point"](x, 0.0, 0.0), turn)
    twist = make["geometry_msgs/msg/Twist"](vector(0.5, 0.0, 0.0), vector(0.0, 0.0, 0.0))
    bag.put(
        topic,
        at_ns,
        make["nav_msgs/msg/Odometry"](
            bag.header(at_ns, frame),
            base,
            make["geometry_msgs/msg/PoseWithCovariance"](pose, np.zeros(36)),
            make["geometry_msgs/msg/TwistWithCovariance"](twist, np.zeros(36)),
        ),
    )


def robots(
    path: Path,
    counts: dict[str, int] = SCANS,
    *,
    topics: str = "/{0}/",
    frames: str = "{0}/",
    tf: str = "/tf",
    mounts: bool = True,
    shared_map: bool = False,
) -> Path:
    """Write a bag of robots; red, whose lidar is 0.3 m ahead, drives to +x, and blue, whose lidar is 0.1 m ahead, to -x.

    `topics` and `frames` are the prefixes of a robot's topics and frames. Blue has more odometry and IMU.
    """
    bag = Bag(path, storage=StoragePlugin.MCAP)
    for name, count in counts.items():
        sign, ahead, rate = (1.0, 0.3, 10) if name == "red" else (-1.0, 0.1, 25)
        space, frame = topics.format(name), frames.format(name)
        static = tf.format(name) + "_static"
        if mounts:
            bag.mount(START, (f"{frame}base_link", f"{frame}laser", (ahead, 0.0, 0.2), LEVEL), topic=static)
            bag.mount(START, (f"{frame}base_link", f"{frame}imu", (0.0, 0.0, 0.2), LEVEL), topic=static)
        if shared_map:
            bag.mount(START, ("map", f"{frame}odom", (1.0, 0.0, 0.0), LEVEL), topic=static)
        for k in range(count * rate // 10 + rate):
            now = START + k * SECOND // rate
            x = sign * 0.5 * k / rate
            odometry(bag, f"{space}odom", now, x, f"{frame}odom", f"{frame}base_link")
            if mounts:
                moving = (f"{frame}odom", f"{frame}base_link", (x, 0.0, 0.0), LEVEL)
                bag.mount(now, moving, topic=tf.format(name))
        for k in range(count):
            now = START + k * SECOND // 10
            bag.room(now, Pose2(5.0 + sign * 0.05 * k, 3.0, math.pi / 2), f"{space}scan", f"{frame}laser")
    bag.close()
    return path


def robot_of(recording: Recording) -> str:
    """Return the robot whose scans, odometry and mount the recording has, an empty name for a mixture."""
    readings = [frame.wheels[-1] for frame in recording.frames]
    xs = [reading.odom_from_base.x for reading in readings if isinstance(reading, Odometry)]
    forward, ahead, count = xs[-1] > 0.0, round(recording.base_from_laser.x, 3), len(recording.frames)
    for name, told in (("red", (True, 0.3, SCANS["red"])), ("blue", (False, 0.1, SCANS["blue"]))):
        if (forward, ahead, count) == told:
            return name
    return ""


def chosen(**topics: str | tuple[str, ...]) -> InputSettings:
    return InputSettings(bag=BagSettings(**topics))  # type: ignore[arg-type]


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("topics", "frames", "tf"),
    [
        ("/{0}/", "{0}/", "/tf"),  # both prefixed
        ("/{0}/", "", "/{0}/tf"),  # each robot with its own /tf, as ROS 2 name spaces are
        ("/{0}_", "{0}_", "/tf"),  # only /tf tells
        ("/robots/{0}/", "{0}/", "/tf"),  # a common first name
    ],
)
def test_scan_odometry_and_mount_are_of_the_robot_with_the_most_scans(
    tmp_path: Path, topics: str, frames: str, tf: str
) -> None:
    path = robots(tmp_path / "bag", topics=topics, frames=frames, tf=tf)
    recording = read_recording(path)
    assert robot_of(recording) == "red"
    (warning,) = [each for each in recording.warnings if "holds 2 robots" in each]
    other = topics.format("blue") + "scan"
    assert f"name another by --scan {other}" in warning
    assert robot_of(read_recording(path, chosen(scan_topics=(other,)))) == "blue"
    assert robot_of(read_recording(path, chosen(odom_topic=topics.format("blue") + "odom"))) == "blue"


def test_a_map_above_both_robots_connects_nothing(tmp_path: Path) -> None:
    recording = read_recording(robots(tmp_path / "bag", topics="/{0}_", frames="{0}_", shared_map=True))
    assert robot_of(recording) == "red"


def test_without_tf_the_names_tell(tmp_path: Path) -> None:
    recording = read_recording(robots(tmp_path / "bag", mounts=False))
    assert "scans /red/scan, odometry /red/odom" in recording.source
    assert len(recording.frames) == SCANS["red"]


def test_robots_with_as_many_scans_are_listed_with_the_options(tmp_path: Path) -> None:
    path = robots(tmp_path / "bag", {"red": 30, "blue": 30})
    with pytest.raises(RecordingError) as caught:
        read_recording(path)
    told = str(caught.value)
    assert "holds 2 robots: blue (/blue/scan, /blue/odom) and red (/red/scan, /red/odom)" in told
    assert "--scan /blue/scan" in told
    assert "--scan /red/scan" in told
    assert len(read_recording(path, chosen(scan_topics=("/red/scan",))).frames) == 30


def test_the_imu_is_of_the_robot_too(tmp_path: Path) -> None:
    bag = Bag(tmp_path / "bag", storage=StoragePlugin.MCAP)
    for name, sign in (("red", 1.0), ("blue", -1.0)):
        for k in range(20 if name == "red" else 10):
            now = START + k * SECOND // 10
            odometry(bag, f"/{name}/odom", now, sign * 0.05 * k, f"{name}/odom", f"{name}/base_link")
            bag.room(now, Pose2(5.0, 3.0), f"/{name}/scan", f"{name}/laser")
    make = bag.types
    vector, zeros = make["geometry_msgs/msg/Vector3"], np.zeros(9)
    for k in range(80):
        now = START + k * SECOND // 40
        for name, rate in (("red", 0.25), ("blue", -0.5)):
            if name == "red" and k % 4:
                continue
            bag.put(
                f"/{name}/imu",
                now,
                make["sensor_msgs/msg/Imu"](
                    bag.header(now, f"{name}/imu"), make["geometry_msgs/msg/Quaternion"](*LEVEL), zeros,
                    vector(0.0, 0.0, rate), zeros, vector(0.0, 0.0, 9.81), zeros,
                ),
            )  # fmt: skip
    bag.close()
    recording = read_recording(tmp_path / "bag")
    assert "IMU /red/imu" in recording.source
    rates = {float(sample.gyro[2]) for frame in recording.frames for sample in frame.imu}
    assert rates == {0.25}


def test_odometry_that_fits_nothing_is_refused_where_it_is_of_several_robots(tmp_path: Path) -> None:
    bag = Bag(tmp_path / "bag", storage=StoragePlugin.MCAP)
    for k in range(10):
        now = START + k * SECOND // 10
        for name in ("red", "blue"):
            odometry(bag, f"/{name}/odom", now, 0.05 * k, f"{name}/odom", f"{name}/base_link")
        bag.room(now, Pose2(5.0, 3.0), "/scan", "laser")
    bag.close()
    with pytest.raises(RecordingError, match=r"odometry of 2 robots.*--odom /blue/odom or --odom /red/odom"):
        read_recording(tmp_path / "bag")
    assert len(read_recording(tmp_path / "bag", chosen(odom_topic="/red/odom")).frames) == 10


def test_two_sensors_of_one_robot_are_no_two_robots(tmp_path: Path) -> None:
    """Wheels and a filter tell odometry of one base; a lidar in front and one behind have name spaces of their own."""
    bag = Bag(tmp_path / "bag", storage=StoragePlugin.MCAP)
    for name, x, theta in (("front", 0.4, 0.0), ("rear", -0.4, math.pi)):
        turn = (0.0, 0.0, math.sin(theta / 2), math.cos(theta / 2))
        bag.mount(START, ("base_link", name, (x, 0.0, 0.2), turn))
    for k in range(20):
        now = START + k * SECOND // 10
        for topic in ("/front/odom", "/rear/odom", "/odometry/filtered"):
            odometry(bag, topic, now, 0.05 * k, "odom", "base_link")
        bag.room(now, Pose2(5.0, 3.0), "/front/scan", "front")
        bag.room(now, Pose2(5.0, 3.0), "/rear/scan", "rear")
    bag.close()
    recording = read_recording(tmp_path / "bag")
    assert len(recording.frames) == 20
    assert not any("robots" in warning for warning in recording.warnings)
    both = read_recording(tmp_path / "bag", chosen(scan_topics=("/front/scan", "/rear/scan")))
    assert both.base_from_laser == Pose2()


@pytest.mark.parametrize("topics", ["/{0}/", "/{0}_"])
def test_the_camera_is_of_the_robot_too(tmp_path: Path, topics: str) -> None:
    bag = Bag(tmp_path / "bag", storage=StoragePlugin.MCAP)
    matrix = np.array([[50.0, 0.0, 16.0], [0.0, 50.0, 12.0], [0.0, 0.0, 1.0]])
    for name, scans, images, grey in (("red", 20, 4, 200), ("blue", 10, 8, 90)):
        space = topics.format(name)
        ahead = 0.4 if name == "red" else 0.7
        bag.mount(START, (f"{name}_base_link", f"{name}_laser", (0.3, 0.0, 0.2), LEVEL))
        bag.mount(START, (f"{name}_base_link", "camera" if name == "red" else "other", (ahead, 0.0, 0.5), LEVEL))
        for k in range(scans):
            now = START + k * SECOND // 10
            odometry(bag, f"{space}odom", now, 0.05 * k, f"{name}_odom", f"{name}_base_link")
            bag.room(now, Pose2(5.0, 3.0), f"{space}scan", f"{name}_laser")
        for k in range(images):
            now = START + k * SECOND // 10
            bag.camera_info(f"{space}camera/camera_info", now, matrix, (24, 32))
            bag.image(f"{space}camera/image", now, np.full((24, 32), grey, np.uint8), "mono8")
            bag.image(f"{space}camera/depth", now, np.full((24, 32), 1500, np.uint16), "16UC1")
    bag.close()
    recording = read_recording(tmp_path / "bag")
    assert {int(frame.image.max()) for frame in recording.pictures()} == {200}
    mount = recording.camera_mount()
    assert mount is not None
    assert mount.translation[0] == pytest.approx(0.4)


def test_a_robot_without_odometry_of_its_own_does_not_get_that_of_another(tmp_path: Path) -> None:
    """Red tells its motion by /tf alone, and has more scans; blue has a topic."""
    bag = Bag(tmp_path / "bag", storage=StoragePlugin.MCAP)
    for name, sign, scans in (("red", 1.0, 30), ("blue", -1.0, 24)):
        bag.mount(START, (f"{name}/base_link", f"{name}/laser", (0.3 if sign > 0 else 0.1, 0.0, 0.2), LEVEL))
        for k in range(scans):
            now, x = START + k * SECOND // 10, sign * 0.05 * k
            bag.mount(now, (f"{name}/odom", f"{name}/base_link", (x, 0.0, 0.0), LEVEL), topic="/tf")
            if name == "blue":
                odometry(bag, "/blue/odom", now, x, "blue/odom", "blue/base_link")
            bag.room(now, Pose2(5.0 + x, 3.0, math.pi / 2), f"/{name}/scan", f"{name}/laser")
    bag.close()
    assert robot_of(read_recording(tmp_path / "bag")) == "blue"
    asked = read_recording(tmp_path / "bag", chosen(scan_topics=("/red/scan",)))
    assert robot_of(asked) == "red"
    assert "odometry /tf from red/odom to red/base_link" in asked.source
