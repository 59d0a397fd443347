"""The sound drive as ROS messages that can be changed one by one, and the bags that are written of them."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cache, reduce
from pathlib import Path
from typing import Any, Literal

import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from evaluation.corruptions.sound_drive import LEAST_M, MOUNT, PERIOD_S, REACH_M, SECOND, START_NS, sound_drive
from waychair.types import FloatArray

Storage = Literal["mcap", "db3", "bag"]
STORAGES: tuple[Storage, ...] = ("mcap", "db3", "bag")
SCAN, ODOM, IMU, STATIC = "/scan", "/odom", "/imu/data", "/tf_static"
_STORES = {1: get_typestore(Stores.ROS1_NOETIC), 2: get_typestore(Stores.ROS2_JAZZY)}
_STORES[1].register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf2_msgs/msg/TFMessage"))


@dataclass(slots=True)
class BagMessage:
    """A message in a bag, in the order of recording.

    `true_ns` is the time at which it was measured, whatever its stamp becomes; `raw` replaces its bytes, `kind` its type.
    """

    topic: str
    log_ns: int
    body: Any
    true_ns: int
    raw: Callable[[bytes], bytes] | None = None
    kind: str = ""


@dataclass(slots=True)
class Messages:
    """All messages of a drive, which a fault changes in place."""

    ros: Literal[1, 2]
    events: list[BagMessage]

    @property
    def store(self) -> Any:
        """Return the types of messages of this version of ROS."""
        return _STORES[self.ros]

    def of(self, topic: str) -> list[BagMessage]:
        """Return the messages of a topic, in the order of recording."""
        return [event for event in self.events if event.topic == topic]

    def make(self, kind: str, *fields: Any) -> Any:
        """Return a message of a kind."""
        return self.store.types[kind](*fields)

    def remove(self, gone: Iterable[BagMessage]) -> None:
        """Take messages out."""
        left_out = {id(event) for event in gone}
        self.events = [event for event in self.events if id(event) not in left_out]

    def header(self, stamp_ns: int, frame: str) -> Any:
        """Return a header."""
        stamp = self.make("builtin_interfaces/msg/Time", *divmod(stamp_ns, SECOND))
        return self.make("std_msgs/msg/Header", *([0] if self.ros == 1 else []), stamp, frame)


def sound_messages(ros: Literal[1, 2], *, clouds: bool = False) -> Messages:
    """Return the messages of the sound drive, whose scans are LaserScans or, as `clouds`, flat PointCloud2s."""
    return copy.deepcopy(_sound(ros, clouds))  # pickle cannot tell apart the classes of two stores of message types


def stamp_of(body: Any) -> int:
    """Return the stamp of a message [ns]."""
    return int(body.header.stamp.sec) * SECOND + int(body.header.stamp.nanosec)


def set_stamp(body: Any, stamp_ns: int) -> None:
    """Change the stamp of a message [ns]; no clock of ROS counts below zero."""
    body.header.stamp.sec, body.header.stamp.nanosec = divmod(max(0, stamp_ns), SECOND)


def change(body: Any, path: str, by: Callable[[Any], Any]) -> None:
    """Change a field of a message, named with points."""
    *way, last = path.split(".")
    holder = reduce(getattr, way, body)
    setattr(holder, last, by(getattr(holder, last)))


def quaternion(body_type: Callable[..., Any], yaw: float, roll: float = 0.0) -> Any:
    """Return the rotation by roll, then yaw, as a message."""
    cy, sy, cr, sr = math.cos(yaw / 2), math.sin(yaw / 2), math.cos(roll / 2), math.sin(roll / 2)
    return body_type(cy * sr, sy * sr, sy * cr, cy * cr)


def set_yaw(body: Any, yaw: float) -> None:
    """Change the heading of an odometry message."""
    turn = body.pose.pose.orientation
    turn.x = turn.y = 0.0
    turn.z, turn.w = math.sin(yaw / 2), math.cos(yaw / 2)


def yaw_of(body: Any) -> float:
    """Return the heading of an odometry message."""
    turn = body.pose.pose.orientation
    return 2.0 * math.atan2(float(turn.z), float(turn.w))


def write_messages(path: Path, messages: Messages, storage: Storage) -> None:
    """Write a bag: a folder with metadata.yaml of mcap or db3, or a ROS 1 file."""
    store = messages.store
    writer: Any
    if storage == "bag":
        writer = Writer1(path)
    else:
        plugin = StoragePlugin.MCAP if storage == "mcap" else StoragePlugin.SQLITE3
        writer = Writer2(path, version=9, storage_plugin=plugin)
    connections: dict[tuple[str, str], Any] = {}
    with writer:
        for event in messages.events:
            kind = event.kind or event.body.__msgtype__
            if (event.topic, kind) not in connections:
                connections[event.topic, kind] = writer.add_connection(event.topic, kind, typestore=store)
            own = event.body.__msgtype__
            packed = (
                store.serialize_ros1(event.body, own) if messages.ros == 1 else store.serialize_cdr(event.body, own)
            )
            data = bytes(packed) if event.raw is None else event.raw(bytes(packed))
            writer.write(connections[event.topic, kind], event.log_ns, data)


@cache
def _sound(ros: Literal[1, 2], clouds: bool) -> Messages:
    messages = Messages(ros, [])
    drive = sound_drive()
    later_ns = round(1.05 * PERIOD_S * SECOND)
    for name, xyz in (("laser", (*MOUNT, 0.3)), ("imu_link", (0.0, 0.0, 0.2))):
        messages.events.append(BagMessage(STATIC, START_NS, mount_message(messages, "base_link", name, xyz), START_NS))
    events = []
    for seconds, pose, speed in zip(drive.wheel_times, drive.wheel_poses, drive.wheel_speeds, strict=True):
        stamp = START_NS + round(float(seconds) * SECOND)
        events.append(BagMessage(ODOM, stamp + SECOND // 500, _odometry(messages, stamp, pose, speed), stamp))
    for seconds, gyro, accel in zip(drive.imu_times, drive.gyro, drive.accel, strict=True):
        stamp = START_NS + round(float(seconds) * SECOND)
        events.append(BagMessage(IMU, stamp + SECOND // 1000, _imu(messages, stamp, gyro, accel), stamp))
    for seconds, ranges in zip(drive.scan_times, drive.scans, strict=True):
        stamp = START_NS + round(float(seconds) * SECOND)
        body = _cloud(messages, stamp, ranges) if clouds else _scan(messages, stamp, ranges)
        events.append(BagMessage("/cloud" if clouds else SCAN, stamp + later_ns, body, stamp))
    messages.events += sorted(events, key=lambda event: event.log_ns)
    return messages


def mount_message(
    messages: Messages, parent: str, child: str, xyz: tuple[float, float, float], yaw: float = 0.0, roll: float = 0.0
) -> Any:
    """Return a TFMessage with the mount of one frame."""
    vector = messages.make("geometry_msgs/msg/Vector3", *xyz)
    turn = quaternion(lambda *xyzw: messages.make("geometry_msgs/msg/Quaternion", *xyzw), yaw, roll)
    transform = messages.make("geometry_msgs/msg/Transform", vector, turn)
    header = messages.header(START_NS, parent)
    stamped = messages.make("geometry_msgs/msg/TransformStamped", header, child, transform)
    return messages.make("tf2_msgs/msg/TFMessage", [stamped])


def _odometry(messages: Messages, stamp: int, pose: FloatArray, speed: FloatArray) -> Any:
    make = messages.make
    x, y, yaw = pose.tolist()
    turn = quaternion(lambda *xyzw: make("geometry_msgs/msg/Quaternion", *xyzw), yaw)
    at = make("geometry_msgs/msg/Pose", make("geometry_msgs/msg/Point", x, y, 0.0), turn)
    ahead = make("geometry_msgs/msg/Vector3", float(speed[0]), 0.0, 0.0)
    twist = make("geometry_msgs/msg/Twist", ahead, make("geometry_msgs/msg/Vector3", 0.0, 0.0, float(speed[1])))
    nothing = np.zeros(36)
    return make(
        "nav_msgs/msg/Odometry",
        messages.header(stamp, "odom"),
        "base_link",
        make("geometry_msgs/msg/PoseWithCovariance", at, nothing),
        make("geometry_msgs/msg/TwistWithCovariance", twist, nothing),
    )


def _imu(messages: Messages, stamp: int, gyro: FloatArray, accel: FloatArray) -> Any:
    make, nothing = messages.make, np.zeros(9)
    turn = make("geometry_msgs/msg/Quaternion", 0.0, 0.0, 0.0, 1.0)
    rate, force = (make("geometry_msgs/msg/Vector3", *values.tolist()) for values in (gyro, accel))
    return make("sensor_msgs/msg/Imu", messages.header(stamp, "imu_link"), turn, nothing, rate, nothing, force, nothing)


def _scan(messages: Messages, stamp: int, ranges: FloatArray) -> Any:
    drive = sound_drive()
    last = drive.first_angle + drive.step * (len(ranges) - 1)
    return messages.make(
        "sensor_msgs/msg/LaserScan", messages.header(stamp, "laser"), drive.first_angle, last, drive.step,
        PERIOD_S / len(ranges), PERIOD_S, LEAST_M, REACH_M, ranges.astype(np.float32), np.zeros(0, np.float32),
    )  # fmt: skip


def _cloud(messages: Messages, stamp: int, ranges: FloatArray) -> Any:
    drive = sound_drive()
    seen = np.isfinite(ranges)
    angles, far = (drive.first_angle + drive.step * np.arange(len(ranges)))[seen], ranges[seen]
    later = (PERIOD_S / len(ranges) * np.arange(len(ranges)))[seen]
    points = np.stack([far * np.cos(angles), far * np.sin(angles), 0.0 * far, later], axis=1).astype("<f4")
    names = ("x", "y", "z", "time")
    fields = [messages.make("sensor_msgs/msg/PointField", name, 4 * k, 7, 1) for k, name in enumerate(names)]
    data = np.frombuffer(points.tobytes(), np.uint8).copy()
    return messages.make(
        "sensor_msgs/msg/PointCloud2", messages.header(stamp, "laser"), 1, len(points), fields, False, 16,
        16 * len(points), data, True,
    )  # fmt: skip
