"""Writing drives to ROS 2 bags without ROS, for `ros2 bag`, RTAB-Map, Foxglove and `read_recording`."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import FrameType, TracebackType
from typing import Any, Literal, Self

from waychair.errors import RecordingError
from waychair.geometry import in_space
from waychair.recordings.bags import ros_messages, ros_topics
from waychair.recordings.bags.ros_messages import (
    BASE_FRAME,
    CAMERA_FRAME,
    CAMERA_FROM_OPTICAL,
    LASER_FRAME,
    MAP_FRAME,
    ODOM_FRAME,
    OPTICAL_FRAME,
)
from waychair.recordings.bags.ros_topics import RosTopic
from waychair.recordings.bags.rosbag_output import BagOutput
from waychair.types import (
    ImuSample,
    Odometry,
    Pose2,
    Pose3,
    PressureSample,
    RgbdFrame,
    Scan,
    SensorMessage,
    SonarReadings,
    Twist,
    WheelTicks,
)

_STAMP_LIMIT_NS = (1 << 31) * 1_000_000_000  # builtin_interfaces/Time counts seconds in int32


class RecordingWriter:
    """A writer of one drive to a ROS 2 bag; a topic is declared by its first message.

    | written | topics |
    |---|---|
    | `Scan` | /scan |
    | `Odometry` | /odom, and odom -> base_link in /tf |
    | `ImuSample` | /imu/data |
    | `PressureSample` | /pressure |
    | `WheelTicks` | /joint_states: wheel angles; left out unless `ticks_per_turn` is given |
    | `RgbdFrame` | /camera/color/{image_raw,camera_info}, /camera/aligned_depth_to_color/{image_raw,camera_info} |
    | `SonarReadings` | /sonar_0, /sonar_1, ... |
    | `write_truth` | /ground_truth/odom in frame map: for scoring; a driving stack must not subscribe to it |
    | the mounts | /tf_static, before anything else |

    The time of logging is the latest stamp so far, so that it never steps backwards. The header keeps the message's own
    stamp, e.g. that of a scan's first beam.

    A path that ends in .mcap or .db3 becomes a single file, any other path the folder of a bag. mcap chunks are
    compressed (zstd). The bag is written to a hidden folder and moved to the path when the block succeeds. When the disk
    fills up, or the user interrupts, the bag so far is closed properly and kept beside the path, as `drive.part.mcap`.
    Any other exception leaves nothing behind.

        with RecordingWriter(Path("drive.mcap"), {"laser": base_from_laser}) as writer:
            writer.write(odometry)
            writer.write(scan)

    Raises:
        OutputError: the path exists, cannot be written to, or its disk is full.
        RecordingError: nothing was written, or a stamp lies outside the range of ROS (1970 to 2038).
    """

    def __init__(
        self,
        path: Path,
        mounts: Mapping[str, Pose3] | Pose2,
        *,
        ticks_per_turn: int | None = None,
        storage: Literal["mcap", "sqlite3"] | None = None,
    ) -> None:
        """Take the poses of sensor frames in base_link, by frame; a `Pose2` stands for the laser alone.

        The optical frame of `camera_link` is added by REP-103.
        """
        if isinstance(mounts, Pose2):
            mounts = {LASER_FRAME: in_space(mounts)}
        self.path = path
        self._mounts = {(BASE_FRAME, frame): base_from_frame for frame, base_from_frame in mounts.items()}
        if CAMERA_FRAME in mounts:
            self._mounts[CAMERA_FRAME, OPTICAL_FRAME] = CAMERA_FROM_OPTICAL
        self._ticks_per_turn = ticks_per_turn
        self._output = BagOutput(path, storage)
        self._latest_ns = -1

    def __enter__(self) -> Self:
        self._output.open()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if not self._output.is_open:  # closed when the disk was full
            return
        if isinstance(error, KeyboardInterrupt) and self._latest_ns >= 0:
            error.add_note(f"what was recorded so far is in {self._output.keep_part()}")
        elif error is not None:
            self._output.discard()
        elif self._latest_ns < 0:
            self._output.discard()
            raise RecordingError(f"nothing was written to {self.path}: record at least one message")
        else:
            self._output.finish()

    def write(self, message: SensorMessage | Odometry) -> None:
        """Append a measurement of a sensor, or an odometry reading."""
        with self._message(message.stamp_ns):
            _PUTS[type(message)](self, message)

    def write_truth(self, stamp_ns: int, map_from_base: Pose2, twist: Twist) -> None:
        """Append the true pose of the base, and its true twist in its own frame."""
        with self._message(stamp_ns):
            self._put(ros_topics.TRUTH, ros_messages.odometry(stamp_ns, MAP_FRAME, map_from_base, twist))

    @contextmanager
    def _message(self, stamp_ns: int) -> Iterator[None]:
        """Wrap all writes for one stamp, and delay an interrupt until they are complete."""
        if not 0 <= stamp_ns < _STAMP_LIMIT_NS:
            raise RecordingError(f"the stamp {stamp_ns} ns cannot be expressed in ROS; use nanoseconds since 1970")
        with _interrupt_held():
            first, self._latest_ns = self._latest_ns < 0, max(self._latest_ns, stamp_ns)
            if first:
                self._put(ros_topics.TF_STATIC, ros_messages.transforms(stamp_ns, self._mounts))
            yield
            self._output.end_if_full()

    def _put_scan(self, scan: Scan) -> None:
        self._put(ros_topics.SCAN, ros_messages.laser_scan(scan))

    def _put_odometry(self, reading: Odometry) -> None:
        pose = reading.odom_from_base
        self._put(
            ros_topics.ODOMETRY,
            ros_messages.odometry(reading.stamp_ns, ODOM_FRAME, pose, reading.twist, reading.covariance),
        )
        self._put(ros_topics.TF, ros_messages.transforms(reading.stamp_ns, {(ODOM_FRAME, BASE_FRAME): in_space(pose)}))

    def _put_imu(self, sample: ImuSample) -> None:
        self._put(ros_topics.IMU, ros_messages.imu(sample))

    def _put_pressure(self, sample: PressureSample) -> None:
        self._put(ros_topics.PRESSURE, ros_messages.pressure(sample))

    def _put_ticks(self, ticks: WheelTicks) -> None:
        if self._ticks_per_turn is not None:
            self._put(ros_topics.JOINTS, ros_messages.joint_states(ticks, self._ticks_per_turn))

    def _put_frame(self, frame: RgbdFrame) -> None:
        info = ros_messages.camera_info(frame)
        self._put(ros_topics.COLOUR, ros_messages.colour_image(frame))
        self._put(ros_topics.COLOUR_INFO, info)
        self._put(ros_topics.DEPTH, ros_messages.depth_image(frame))
        self._put(ros_topics.DEPTH_INFO, info)

    def _put_sonars(self, readings: SonarReadings) -> None:
        for k, distance in enumerate(readings.ranges.tolist()):
            self._put(ros_topics.sonar(k), ros_messages.sonar_range(readings.stamp_ns, k, distance))

    def _put(self, topic: RosTopic, message: Any) -> None:
        self._output.write(topic.absolute, topic.type, topic.qos, self._latest_ns, ros_messages.serialised(message))


_PUTS: Mapping[type, Callable[[RecordingWriter, Any], None]] = {
    Scan: RecordingWriter._put_scan,
    Odometry: RecordingWriter._put_odometry,
    ImuSample: RecordingWriter._put_imu,
    WheelTicks: RecordingWriter._put_ticks,
    PressureSample: RecordingWriter._put_pressure,
    RgbdFrame: RecordingWriter._put_frame,
    SonarReadings: RecordingWriter._put_sonars,
}


@contextmanager
def _interrupt_held() -> Iterator[None]:
    """Delay a keyboard interrupt until the block ends. Python interrupts only the main thread."""
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
