"""Messages of any kind into bags of ROS 1 or 2, as other programs write them."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from waychair.types import FloatArray, Pose2

SECOND = 1_000_000_000
TYPES = {1: get_typestore(Stores.ROS1_NOETIC), 2: get_typestore(Stores.ROS2_JAZZY)}
TYPES[1].register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf2_msgs/msg/TFMessage"))


class Bag:
    """A bag being written; a topic is declared by its first message."""

    def __init__(self, path: Path, ros: int = 2, storage: StoragePlugin = StoragePlugin.SQLITE3) -> None:
        self.types = TYPES[ros].types
        self._ros = ros
        self._writer: Any = Writer1(path) if ros == 1 else Writer2(path, version=9, storage_plugin=storage)
        self._writer.open()
        self._connections: dict[str, Any] = {}

    def put(self, topic: str, stamp_ns: int, message: Any) -> None:
        kind = message.__msgtype__
        if topic not in self._connections:
            self._connections[topic] = self._writer.add_connection(topic, kind, typestore=TYPES[self._ros])
        store = TYPES[self._ros]
        data = store.serialize_ros1(message, kind) if self._ros == 1 else store.serialize_cdr(message, kind)
        self._writer.write(self._connections[topic], stamp_ns, data)

    def header(self, stamp_ns: int, frame: str) -> Any:
        stamp = self.types["builtin_interfaces/msg/Time"](*divmod(stamp_ns, SECOND))
        return self.types["std_msgs/msg/Header"](*([0] if self._ros == 1 else []), stamp, frame)

    def scan(
        self, stamp_ns: int, ranges: list[float], topic: str = "/scan", *, step: float = 0.1, logged_ns: int = 0
    ) -> None:
        message = self.types["sensor_msgs/msg/LaserScan"](
            self.header(stamp_ns, "/laser"), 0.5, 0.5 + step * (len(ranges) - 1), step, 0.01, 0.1, 0.1, 8.0,
            np.array(ranges, np.float32), np.zeros(0, np.float32),
        )  # fmt: skip
        self.put(topic, logged_ns or stamp_ns, message)

    def odometry(self, stamp_ns: int, x: float, theta: float = 0.0, topic: str = "/odom") -> None:
        make = self.types
        vector = make["geometry_msgs/msg/Vector3"]
        turn = make["geometry_msgs/msg/Quaternion"](0.0, 0.0, math.sin(theta / 2), math.cos(theta / 2))
        pose = make["geometry_msgs/msg/Pose"](make["geometry_msgs/msg/Point"](x, 0.0, 0.0), turn)
        twist = make["geometry_msgs/msg/Twist"](vector(x, 0.0, 0.0), vector(0.0, 0.0, theta))
        message = make["nav_msgs/msg/Odometry"](
            self.header(stamp_ns, "odom"),
            "base_link",
            make["geometry_msgs/msg/PoseWithCovariance"](pose, np.zeros(36)),
            make["geometry_msgs/msg/TwistWithCovariance"](twist, np.zeros(36)),
        )
        self.put(topic, stamp_ns, message)

    def mount(
        self,
        stamp_ns: int,
        *chain: tuple[str, str, tuple[float, float, float], tuple[float, ...]],
        topic: str = "/tf_static",
    ) -> None:
        make = self.types
        transforms = [
            make["geometry_msgs/msg/TransformStamped"](
                self.header(stamp_ns, parent),
                child,
                make["geometry_msgs/msg/Transform"](
                    make["geometry_msgs/msg/Vector3"](*xyz), make["geometry_msgs/msg/Quaternion"](*xyzw)
                ),
            )
            for parent, child, xyz, xyzw in chain
        ]
        self.put(topic, stamp_ns, make["tf2_msgs/msg/TFMessage"](transforms))

    def close(self) -> None:
        self._writer.close()

    def room(self, stamp_ns: int, map_from_laser: Pose2, topic: str, frame: str, *, upside_down: bool = False) -> None:
        """Return the scan of a lidar of 240 degrees in the room."""
        angles = np.linspace(-2.0, 2.0, 241)
        ranges = room_ranges(map_from_laser, -angles if upside_down else angles)
        message = self.types["sensor_msgs/msg/LaserScan"](
            self.header(stamp_ns, frame), -2.0, 2.0, 4.0 / 240, 0.0, 0.1, 0.1, 20.0,
            ranges.astype(np.float32), np.zeros(0, np.float32),
        )  # fmt: skip
        self.put(topic, stamp_ns, message)

    def imu(self, stamp_ns: int, gyro: tuple[float, ...], accel: tuple[float, ...], frame: str = "imu_link") -> None:
        make = self.types
        vector = make["geometry_msgs/msg/Vector3"]
        turn = make["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
        nothing = np.zeros(9)
        message = make["sensor_msgs/msg/Imu"](
            self.header(stamp_ns, frame), turn, nothing, vector(*gyro), nothing, vector(*accel), nothing
        )
        self.put("/imu/data", stamp_ns, message)

    def cloud(self, stamp_ns: int, points: FloatArray, frame: str = "velodyne", *, big_endian: bool = False) -> None:
        """Points (N, 3), each followed by an intensity and padding, as spinning lidars send them."""
        order = ">" if big_endian else "<"
        layout = np.dtype({"names": ["x", "y", "z", "i"], "formats": [order + "f4"] * 4, "offsets": [0, 4, 8, 16], "itemsize": 24})  # fmt: skip
        records = np.zeros(len(points), layout)
        records["x"], records["y"], records["z"] = points.T
        make = self.types["sensor_msgs/msg/PointField"]
        fields = [make(name, offset, 7, 1) for name, offset in (("x", 0), ("y", 4), ("z", 8), ("intensity", 16))]
        message = self.types["sensor_msgs/msg/PointCloud2"](
            self.header(stamp_ns, frame), 1, len(points), fields, big_endian, 24, 24 * len(points),
            records.view(np.uint8).ravel(), False,
        )  # fmt: skip
        self.put("/points", stamp_ns, message)

    def image(self, topic: str, stamp_ns: int, pixels: Any, encoding: str, *, padding: int = 0) -> None:
        height, width = pixels.shape[:2]
        rows = np.ascontiguousarray(pixels).view(np.uint8).reshape(height, -1)
        rows = np.pad(rows, ((0, 0), (0, padding)))
        message = self.types["sensor_msgs/msg/Image"](
            self.header(stamp_ns, "camera"), height, width, encoding, 0, rows.shape[1], rows.ravel()
        )
        self.put(topic, stamp_ns, message)

    def compressed(self, topic: str, stamp_ns: int, data: bytes, what: str) -> None:
        header = self.header(stamp_ns, "camera")
        message = self.types["sensor_msgs/msg/CompressedImage"](header, what, np.frombuffer(data, np.uint8))
        self.put(topic, stamp_ns, message)

    def camera_info(self, topic: str, stamp_ns: int, matrix: FloatArray, shape: tuple[int, int]) -> None:
        projection = np.hstack([matrix, np.zeros((3, 1))]).ravel()
        region = self.types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
        message = self.types["sensor_msgs/msg/CameraInfo"](
            self.header(stamp_ns, "camera"), *shape, "plumb_bob", np.zeros(5), matrix.ravel(), np.eye(3).ravel(),
            projection, 0, 0, region,
        )  # fmt: skip
        self.put(topic, stamp_ns, message)


ROOM = (10.0, 6.0)
"""Size [m] of a room with a corner at the origin and a pillar of 0.4 m radius at (7, 2)."""


def room_ranges(pose: Pose2, angles: FloatArray) -> FloatArray:
    """Distances from a pose inside the room along angles (N,) to a wall or the pillar."""
    c, s = np.cos(angles + pose.theta), np.sin(angles + pose.theta)
    width, depth = ROOM
    with np.errstate(divide="ignore"):
        x = np.where(c > 0, (width - pose.x) / c, -pose.x / c)
        y = np.where(s > 0, (depth - pose.y) / s, -pose.y / s)
    along = c * (7.0 - pose.x) + s * (2.0 - pose.y)
    beside = np.abs(c * (2.0 - pose.y) - s * (7.0 - pose.x))
    pillar = np.where((along > 0) & (beside < 0.4), along - np.sqrt(np.maximum(0.16 - beside**2, 0)), np.inf)
    ranges: FloatArray = np.minimum(np.minimum(x, y), pillar)
    return ranges


def off_the_walls(points: FloatArray) -> FloatArray:
    """Distance (N,) [m] of points (N, 2) in the room's frame to its nearest wall or pillar."""
    x, y = points.T
    walls = np.min(np.abs([x, x - ROOM[0], y, y - ROOM[1]]), axis=0)
    distances: FloatArray = np.minimum(walls, np.abs(np.hypot(x - 7.0, y - 2.0) - 0.4))
    return distances
