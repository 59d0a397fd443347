"""Export of a black box's sensor messages as a ROS bag, for `waychair map`, RViz and Foxglove."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

from waychair.calibration.chair_body import ChairBody
from waychair.errors import BoxError
from waychair.recordings.bags.rosbag_writer import RecordingWriter
from waychair.runtime.black_box.box_file import Log
from waychair.runtime.black_box.why_evidence import LogCursor
from waychair.slam.odometry.odometry_filter import OdometryFilter
from waychair.types import ChairStatus, ImuSample, Odometry, Pose3, SensorMessage, WheelTicks


def write_bag(path: Path, log: Log, mounts: Callable[[ChairBody], Mapping[str, Pose3]]) -> None:
    """Write the log's sensor messages, and the odometry of wheels and gyro, with wall-clock stamps.

    `mounts` returns a body's sensor mounts by frame name.

    Raises:
        BoxError: the log holds no sensor message.
        OutputError: the path exists already, cannot be written to, or its disk is full.
    """
    if not any(True for _ in log.messages()):
        raise BoxError(f"this log holds no sensor message: {path} would be empty")
    body = LogCursor(log, 0).calibration().body
    began = log.moments[0].tick
    later_ns, odometry = began.wall_ns - began.stamp_ns, OdometryFilter(body)
    with RecordingWriter(path, mounts(body), ticks_per_turn=body.ticks_per_turn) as writer:
        for message in log.messages():
            if isinstance(message, ChairStatus):
                continue
            writer.write(_later(message, later_ns))
            if isinstance(message, WheelTicks):
                writer.write(_later(odometry.update_wheels(message), later_ns))
            elif isinstance(message, ImuSample):
                odometry.update_imu(message)


def _later(message: SensorMessage | Odometry, by_ns: int) -> SensorMessage | Odometry:
    return replace(message, stamp_ns=message.stamp_ns + by_ns)
