"""Drives written to ROS 2 bags that `ros2 bag`, RTAB-Map, Foxglove and `read_recording` open, without ROS."""

from __future__ import annotations

import itertools
import shutil
import signal
import sqlite3
import tempfile
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import FrameType, TracebackType
from typing import Any, Literal, Self

from rosbags.interfaces import Connection, Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag2 import StoragePlugin

from waychair import ros_messages
from waychair.errors import OutputError, RecordingError
from waychair.geometry import in_space
from waychair.ros_messages import (
    BASE_FRAME,
    CAMERA_FRAME,
    CAMERA_FROM_OPTICAL,
    LASER_FRAME,
    MAP_FRAME,
    ODOM_FRAME,
    OPTICAL_FRAME,
)
from waychair.rosbag_storage import BagWriter
from waychair.topics import IMU, ODOMETRY, SCAN, SONAR
from waychair.types import ImuSample, Odometry, Pose2, Pose3, RgbdFrame, Scan, SonarReadings, Twist, WheelTicks

_STORAGES = {"mcap": StoragePlugin.MCAP, "sqlite3": StoragePlugin.SQLITE3}
_SUFFIXES = {"mcap": ".mcap", "sqlite3": ".db3"}
_STAMP_LIMIT_NS = (1 << 31) * 1_000_000_000  # builtin_interfaces/Time counts seconds in int32
_FOREVER = QosTime(0x7FFFFFFF, 0xFFFFFFFF)


def _qos(depth: int, reliability: QosReliability, durability: QosDurability = QosDurability.VOLATILE) -> Qos:
    return Qos(
        QosHistory.KEEP_LAST,
        depth,
        reliability,
        durability,
        _FOREVER,
        _FOREVER,
        QosLiveliness.AUTOMATIC,
        _FOREVER,
        False,
    )


_SENSOR = _qos(5, QosReliability.BEST_EFFORT)
_RELIABLE = _qos(10, QosReliability.RELIABLE)
_TRANSFORMS = _qos(100, QosReliability.RELIABLE)
_LATCHED = _qos(1, QosReliability.RELIABLE, QosDurability.TRANSIENT_LOCAL)
"""What Nav2 and tf2 expect to be offered; static transforms are kept for subscribers that come late."""


@dataclass(frozen=True, slots=True)
class _BagTopic:
    name: str
    msgtype: str
    qos: Qos


_SCAN = _BagTopic(f"/{SCAN.name}", "sensor_msgs/msg/LaserScan", _SENSOR)
_ODOMETRY = _BagTopic(f"/{ODOMETRY.name}", "nav_msgs/msg/Odometry", _RELIABLE)
_TRUTH = _BagTopic("/ground_truth/odom", "nav_msgs/msg/Odometry", _RELIABLE)
_TF = _BagTopic("/tf", "tf2_msgs/msg/TFMessage", _TRANSFORMS)
_TF_STATIC = _BagTopic("/tf_static", "tf2_msgs/msg/TFMessage", _LATCHED)
_IMU = _BagTopic(f"/{IMU.name}", "sensor_msgs/msg/Imu", _SENSOR)
_JOINTS = _BagTopic("/joint_states", "sensor_msgs/msg/JointState", _RELIABLE)
_COLOUR = _BagTopic("/camera/color/image_raw", "sensor_msgs/msg/Image", _SENSOR)
_COLOUR_INFO = _BagTopic("/camera/color/camera_info", "sensor_msgs/msg/CameraInfo", _SENSOR)
_DEPTH = _BagTopic("/camera/aligned_depth_to_color/image_raw", "sensor_msgs/msg/Image", _SENSOR)
_DEPTH_INFO = _BagTopic("/camera/aligned_depth_to_color/camera_info", "sensor_msgs/msg/CameraInfo", _SENSOR)
"""The camera's are the names of RealSense drivers with depth aligned to colour, which RTAB-Map's examples take."""


class RecordingWriter:
    """A ROS 2 bag in the making; a topic is declared by its first message.

    | written | topics |
    |---|---|
    | `Scan` | /scan |
    | `Odometry` | /odom, and odom -> base_link in /tf |
    | `ImuSample` | /imu/data |
    | `WheelTicks` | /joint_states: wheel angles; left out unless `ticks_per_turn` is given |
    | `RgbdFrame` | /camera/color/{image_raw,camera_info}, /camera/aligned_depth_to_color/{image_raw,camera_info} |
    | `SonarReadings` | /sonar/0, /sonar/1, ... |
    | `write_truth` | /ground_truth/odom in frame map: for scores; a stack must not subscribe to it |
    | the mounts | /tf_static, before anything else |

    A message is logged at the latest stamp so far, since it cannot have come before those that came before it; its
    header keeps its own stamp, such as that of a scan's first beam.

    A path that ends in .mcap or .db3 becomes that single file, any other path the folder of a bag; chunks of mcap are
    compressed (zstd). Everything is written aside and moved to the path when the block ends well. When the disk fills
    up, or the user interrupts, what was written so far is closed properly and kept beside the path, as
    `drive.part.mcap`; any other exception leaves nothing behind.

        with RecordingWriter(Path("drive.mcap"), {"laser": base_from_laser}) as writer:
            writer.write(odometry)
            writer.write(scan)

    Raises:
        OutputError: there is something at the path already, it cannot be written to, or its disk is full.
        RecordingError: nothing was written, or a stamp lies outside what ROS can express (1970 to 2038).
    """

    def __init__(
        self,
        path: Path,
        mounts: Mapping[str, Pose3] | Pose2,
        *,
        ticks_per_turn: int | None = None,
        storage: Literal["mcap", "sqlite3"] | None = None,
    ) -> None:
        """`mounts` are the poses of sensor frames in base_link, by frame; a `Pose2` is that of the laser alone.

        The optical frame of `camera_link` need not be given: it follows from REP-103.
        """
        by_suffix = next((name for name, suffix in _SUFFIXES.items() if suffix == path.suffix), None)
        if storage is not None and by_suffix not in (None, storage):
            raise OutputError(f"{path} ends in {path.suffix} but {storage} was asked for; leave one of the two out")
        if isinstance(mounts, Pose2):
            mounts = {LASER_FRAME: in_space(mounts)}
        self.path = path
        self._mounts = {(BASE_FRAME, frame): base_from_frame for frame, base_from_frame in mounts.items()}
        if CAMERA_FRAME in mounts:
            self._mounts[CAMERA_FRAME, OPTICAL_FRAME] = CAMERA_FROM_OPTICAL
        self._ticks_per_turn = ticks_per_turn
        self._storage = storage or by_suffix or "mcap"
        self._single_file = by_suffix is not None
        self._connections: dict[_BagTopic, Connection] = {}
        self._latest_ns = -1

    def __enter__(self) -> Self:
        self._refuse_existing()
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._aside = Path(tempfile.mkdtemp(prefix=f".{self.path.stem}.", dir=self.path.parent))
        except OSError as error:
            raise OutputError(f"cannot write {self.path}: {error.strerror}; choose another folder") from error
        try:
            self._writer = BagWriter(self._aside / self.path.stem, _STORAGES[self._storage])
            self._writer.open()
        except OSError as error:
            shutil.rmtree(self._aside, ignore_errors=True)
            raise OutputError(f"cannot write {self.path}: {error.strerror}; choose another disk") from error
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if self._writer.storage is None:  # closed when the disk was full
                return
            if isinstance(error, KeyboardInterrupt) and self._latest_ns >= 0:
                error.add_note(f"what was recorded so far is in {self._close(self._part())}")
                return
            if error is not None:
                self._writer.abort()
                return
            if self._latest_ns < 0:
                self._writer.abort()
                raise RecordingError(f"nothing was written to {self.path}: record at least one message")
            self._refuse_existing()
            self._close(self.path)
        except (OSError, sqlite3.Error) as failure:
            raise OutputError(f"cannot write {self.path}: {failure}; choose another disk") from failure
        finally:
            shutil.rmtree(self._aside, ignore_errors=True)

    def write(self, message: Scan | Odometry | ImuSample | WheelTicks | RgbdFrame | SonarReadings) -> None:
        """Append what a sensor, or the odometry, has said."""
        with self._message(message.stamp_ns):
            _PUTS[type(message)](self, message)

    def write_truth(self, stamp_ns: int, map_from_base: Pose2, twist: Twist) -> None:
        """Append where the base really is, and how it moves in its own frame."""
        with self._message(stamp_ns):
            self._put(_TRUTH, ros_messages.odometry(stamp_ns, MAP_FRAME, map_from_base, twist))

    @contextmanager
    def _message(self, stamp_ns: int) -> Iterator[None]:
        """Around everything that is put for one stamp, which an interrupt leaves whole."""
        if not 0 <= stamp_ns < _STAMP_LIMIT_NS:
            raise RecordingError(f"the stamp {stamp_ns} ns cannot be expressed in ROS; use nanoseconds since 1970")
        try:
            with _interrupt_held():
                first, self._latest_ns = self._latest_ns < 0, max(self._latest_ns, stamp_ns)
                if first:
                    self._put(_TF_STATIC, ros_messages.transforms(stamp_ns, self._mounts))
                yield
                part = self._close(self._part()) if self._writer.full else None
        except (OSError, sqlite3.Error) as error:
            raise OutputError(f"cannot write {self.path}: {error}; choose another disk") from error
        if part is not None:
            megabytes = self._writer.size / 1e6
            raise OutputError(
                f"the disk of {self.path} is full: the {megabytes:.0f} MB recorded so far are in {part}; make room on it"
            )

    def _put_scan(self, scan: Scan) -> None:
        self._put(_SCAN, ros_messages.laser_scan(scan))

    def _put_odometry(self, reading: Odometry) -> None:
        pose = reading.odom_from_base
        self._put(
            _ODOMETRY,
            ros_messages.odometry(reading.stamp_ns, ODOM_FRAME, pose, reading.twist, reading.covariance),
        )
        self._put(_TF, ros_messages.transforms(reading.stamp_ns, {(ODOM_FRAME, BASE_FRAME): in_space(pose)}))

    def _put_imu(self, sample: ImuSample) -> None:
        self._put(_IMU, ros_messages.imu(sample))

    def _put_ticks(self, ticks: WheelTicks) -> None:
        if self._ticks_per_turn is not None:
            self._put(_JOINTS, ros_messages.joint_states(ticks, self._ticks_per_turn))

    def _put_frame(self, frame: RgbdFrame) -> None:
        info = ros_messages.camera_info(frame)
        self._put(_COLOUR, ros_messages.colour_image(frame))
        self._put(_COLOUR_INFO, info)
        self._put(_DEPTH, ros_messages.depth_image(frame))
        self._put(_DEPTH_INFO, info)

    def _put_sonars(self, readings: SonarReadings) -> None:
        for k, distance in enumerate(readings.ranges.tolist()):
            topic = _BagTopic(f"/{SONAR.name}/{k}", "sensor_msgs/msg/Range", _SENSOR)
            self._put(topic, ros_messages.sonar_range(readings.stamp_ns, k, distance))

    def _put(self, topic: _BagTopic, message: Any) -> None:
        if topic not in self._connections:
            self._connections[topic] = self._writer.add_connection(
                topic.name, topic.msgtype, typestore=ros_messages.TYPES, offered_qos_profiles=(topic.qos,)
            )
        self._writer.write(self._connections[topic], self._latest_ns, ros_messages.serialised(message))

    def _close(self, path: Path) -> Path:
        """Ends the bag and moves it to this path."""
        self._writer.close()
        bag = self._writer.path
        result = bag / f"{bag.name}{_SUFFIXES[self._storage]}" if self._single_file else bag
        return result.rename(path)

    def _part(self) -> Path:
        """A new path beside the bag's for what there is of it, with the same ending, so that programs know it."""
        names = (f"{self.path.stem}.part{k or ''}{self.path.suffix}" for k in itertools.count())
        return next(path for path in map(self.path.with_name, names) if not path.exists())

    def _refuse_existing(self) -> None:
        if self.path.exists():
            raise OutputError(f"{self.path} exists already; remove it or choose another name")


_PUTS: Mapping[type, Callable[[RecordingWriter, Any], None]] = {
    Scan: RecordingWriter._put_scan,
    Odometry: RecordingWriter._put_odometry,
    ImuSample: RecordingWriter._put_imu,
    WheelTicks: RecordingWriter._put_ticks,
    RgbdFrame: RecordingWriter._put_frame,
    SonarReadings: RecordingWriter._put_sonars,
}


@contextmanager
def _interrupt_held() -> Iterator[None]:
    """Within the block an interrupt from the keyboard waits for its end; only the main thread is ever interrupted."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    held: list[tuple[int, FrameType | None]] = []
    before = signal.signal(signal.SIGINT, lambda number, frame: held.append((number, frame)))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
    if held:
        signal.raise_signal(signal.SIGINT)
