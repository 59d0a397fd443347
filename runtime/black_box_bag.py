"""A bag of what a chair's sensors said, from its black box: for `waychair map`, RViz and Foxglove."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

from waychair.calibration.chair import ChairBody
from waychair.errors import BoxError
from waychair.recording import RecordingWriter
from waychair.runtime.black_box_file import Log
from waychair.runtime.why_evidence import Scene
from waychair.slam.odometry import OdometryFilter
from waychair.types import ChairStatus, ImuSample, Odometry, Pose3, RgbdFrame, Scan, SonarReadings, WheelTicks


def write_bag(path: Path, log: Log, mounts: Callable[[ChairBody], Mapping[str, Pose3]]) -> None:
    """Write what the sensors said, and the odometry of wheels and gyro, with stamps of the clock on the wall.

    `mounts`: where a body carries its sensors, by the names of their frames.

    Raises:
        BoxError: there is not one message in the log.
        OutputError: there is something at the path already, it cannot be written to, or its disk is full.
    """
    if not any(True for _ in log.messages()):
        raise BoxError(f"no sensor has said anything in this log: {path} would be empty")
    body = Scene(log, 0).calibration().body
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


def _later(
    message: Scan | WheelTicks | ImuSample | SonarReadings | RgbdFrame | Odometry, by_ns: int
) -> Scan | WheelTicks | ImuSample | SonarReadings | RgbdFrame | Odometry:
    return replace(message, stamp_ns=message.stamp_ns + by_ns)
