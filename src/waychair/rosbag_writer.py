"""Scans and odometry written to a ROS 2 bag that `ros2 bag`, Foxglove and `read_recording` open, without ROS."""

from __future__ import annotations

import math
import shutil
import tempfile
from pathlib import Path
from types import TracebackType
from typing import Any, Literal, Self

import numpy as np
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from waychair.errors import OutputError, RecordingError
from waychair.topics import ODOMETRY, SCAN
from waychair.types import FloatArray, Odometry, Pose2, Scan

ODOM_FRAME, BASE_FRAME, LASER_FRAME = "odom", "base_link", "laser"
"""Frames of the headers (REP-105)."""

_STORAGES = {"mcap": StoragePlugin.MCAP, "sqlite3": StoragePlugin.SQLITE3}
_SUFFIXES = {"mcap": ".mcap", "sqlite3": ".db3"}
_STAMP_LIMIT_NS = (1 << 31) * 1_000_000_000  # builtin_interfaces/Time counts seconds in int32
_FOREVER = QosTime(0x7FFFFFFF, 0xFFFFFFFF)
_LATCHED = Qos(
    QosHistory.KEEP_LAST,
    1,
    QosReliability.RELIABLE,
    QosDurability.TRANSIENT_LOCAL,
    _FOREVER,
    _FOREVER,
    QosLiveliness.AUTOMATIC,
    _FOREVER,
    False,
)
"""Static transforms are kept for subscribers that come late (tf2)."""


class RecordingWriter:
    """A ROS 2 bag in the making: /scan, /odom and the laser's mount in /tf_static.

    A path that ends in .mcap or .db3 becomes that single file, any other path the folder of a bag. Everything is
    written aside and moved to the path when the block ends well; nothing is left behind when it does not.

        with RecordingWriter(Path("drive.mcap"), base_from_laser) as writer:
            writer.write(odometry)
            writer.write(scan)

    Raises:
        OutputError: there is something at the path already, or it cannot be written to.
        RecordingError: nothing was written, or a stamp lies outside what ROS can express (1970 to 2038).
    """

    def __init__(
        self, path: Path, base_from_laser: Pose2, *, storage: Literal["mcap", "sqlite3"] | None = None
    ) -> None:
        by_suffix = next((name for name, suffix in _SUFFIXES.items() if suffix == path.suffix), None)
        if storage is not None and by_suffix not in (None, storage):
            raise OutputError(f"{path} ends in {path.suffix} but {storage} was asked for; leave one of the two out")
        self.path = path
        self._base_from_laser = base_from_laser
        self._storage = storage or by_suffix or "mcap"
        self._single_file = by_suffix is not None
        self._types = get_typestore(Stores.ROS2_JAZZY)
        self._written = False

    def __enter__(self) -> Self:
        self._refuse_existing()
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._aside = Path(tempfile.mkdtemp(prefix=f".{self.path.stem}.", dir=self.path.parent))
        except OSError as error:
            raise OutputError(f"cannot write {self.path}: {error.strerror}; choose another folder") from error
        self._writer = Writer(self._aside / self.path.stem, version=9, storage_plugin=_STORAGES[self._storage])
        self._writer.open()
        self._connections = {
            topic: self._writer.add_connection(topic, msgtype, typestore=self._types, offered_qos_profiles=qos)
            for topic, msgtype, qos in (
                ("/tf_static", "tf2_msgs/msg/TFMessage", (_LATCHED,)),
                (f"/{SCAN.name}", "sensor_msgs/msg/LaserScan", ()),
                (f"/{ODOMETRY.name}", "nav_msgs/msg/Odometry", ()),
            )
        }
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if error is not None:
                self._writer.abort()
                return
            self._writer.close()
            if not self._written:
                raise RecordingError(f"nothing was written to {self.path}: record at least one scan or odometry")
            bag = self._writer.path
            self._refuse_existing()
            result = bag / f"{bag.name}{_SUFFIXES[self._storage]}" if self._single_file else bag
            result.rename(self.path)
        except OSError as failure:
            raise OutputError(f"cannot write {self.path}: {failure.strerror or failure}") from failure
        finally:
            shutil.rmtree(self._aside, ignore_errors=True)

    def write(self, message: Scan | Odometry) -> None:
        """Append a scan or an odometry reading, at its own stamp."""
        if not 0 <= message.stamp_ns < _STAMP_LIMIT_NS:
            raise RecordingError(
                f"the stamp {message.stamp_ns} ns cannot be expressed in ROS; use nanoseconds since 1970"
            )
        if not self._written:
            self._put("/tf_static", message.stamp_ns, self._transforms(message.stamp_ns))
            self._written = True
        if isinstance(message, Scan):
            self._put(f"/{SCAN.name}", message.stamp_ns, self._laser_scan(message))
        else:
            self._put(f"/{ODOMETRY.name}", message.stamp_ns, self._odometry(message))

    def _refuse_existing(self) -> None:
        if self.path.exists():
            raise OutputError(f"{self.path} exists already; remove it or choose another name")

    def _put(self, topic: str, stamp_ns: int, message: Any) -> None:
        connection = self._connections[topic]
        self._writer.write(connection, stamp_ns, self._types.serialize_cdr(message, connection.msgtype))

    def _make(self, name: str, *fields: Any) -> Any:
        """A message of the given type from its fields in their order."""
        return self._types.types[name](*fields)

    def _header(self, stamp_ns: int, frame: str) -> Any:
        stamp = self._make("builtin_interfaces/msg/Time", *divmod(stamp_ns, 1_000_000_000))
        return self._make("std_msgs/msg/Header", stamp, frame)

    def _vector(self, x: float, y: float, z: float, kind: str = "Vector3") -> Any:
        return self._make(f"geometry_msgs/msg/{kind}", x, y, z)

    def _turn(self, theta: float) -> Any:
        return self._make("geometry_msgs/msg/Quaternion", 0.0, 0.0, math.sin(theta / 2), math.cos(theta / 2))

    def _transforms(self, stamp_ns: int) -> Any:
        mount = self._base_from_laser
        transform = self._make(
            "geometry_msgs/msg/Transform", self._vector(mount.x, mount.y, 0.0), self._turn(mount.theta)
        )
        header = self._header(stamp_ns, BASE_FRAME)
        stamped = self._make("geometry_msgs/msg/TransformStamped", header, LASER_FRAME, transform)
        return self._make("tf2_msgs/msg/TFMessage", [stamped])

    def _laser_scan(self, scan: Scan) -> Any:
        angle_max = scan.angle_min + scan.angle_step * (len(scan.ranges) - 1)
        angles = (scan.angle_min, angle_max, scan.angle_step)
        sweep_time = abs(scan.time_step) * len(scan.ranges)
        return self._make(
            "sensor_msgs/msg/LaserScan",
            self._header(scan.stamp_ns, LASER_FRAME),
            *angles,
            scan.time_step,
            sweep_time,
            scan.range_min,
            scan.range_max,
            scan.ranges.astype(np.float32, copy=False),
            np.zeros(0, np.float32),
        )

    def _odometry(self, odometry: Odometry) -> Any:
        at, speed = odometry.odom_from_base, odometry.twist
        pose = self._make("geometry_msgs/msg/Pose", self._vector(at.x, at.y, 0.0, "Point"), self._turn(at.theta))
        twist = self._make(
            "geometry_msgs/msg/Twist", self._vector(speed.v, 0.0, 0.0), self._vector(0.0, 0.0, speed.omega)
        )
        return self._make(
            "nav_msgs/msg/Odometry",
            self._header(odometry.stamp_ns, ODOM_FRAME),
            BASE_FRAME,
            self._make("geometry_msgs/msg/PoseWithCovariance", pose, _in_space(odometry.covariance)),
            self._make("geometry_msgs/msg/TwistWithCovariance", twist, _in_space(None)),
        )


def _in_space(covariance: FloatArray | None) -> FloatArray:
    """(36,) covariance of x, y, z, roll, pitch, yaw from that of x, y, yaw (3, 3); zeros when none is known."""
    full = np.zeros((6, 6))
    if covariance is not None:
        full[np.ix_([0, 1, 5], [0, 1, 5])] = covariance
    return full.ravel()
