"""Readers of encoder and inertial messages in a ROS 1 or ROS 2 bag."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from waychair.errors import RecordingDamaged, RecordingError
from waychair.recordings.bags.rosbag_file import iterate_messages, open_bag
from waychair.recordings.recording_files import find_recording
from waychair.types import ImuSample, WheelTicks

_JOINTS = "sensor_msgs/msg/JointState"
_IMU = "sensor_msgs/msg/Imu"


def wheel_ticks_of(path: Path, ticks_per_turn: int) -> tuple[WheelTicks, ...]:
    """Return the drive wheels' angles as encoder counts in time order, from the joints named ...left... and ...right...

    Raises:
        RecordingNotFound, RecordingDamaged: the bag does not exist or cannot be read.
        RecordingError: the bag holds no such joints.
    """
    per_radian = ticks_per_turn / math.tau
    found: dict[int, WheelTicks] = {}
    for stamp, message in _messages(path, _JOINTS):
        angles = {
            side: angle
            for name, angle in zip(message.name, np.asarray(message.position).tolist(), strict=False)
            for side in ("left", "right")
            if side in name.lower() and "wheel" in name.lower()
        }
        if len(angles) == 2 and all(math.isfinite(angle) for angle in angles.values()):
            found[stamp] = WheelTicks(stamp, *(round(angles[side] * per_radian) for side in ("left", "right")))
    if len(found) < 2:
        raise RecordingError(f"{path} holds no {_JOINTS} of a left and a right wheel: record /joint_states")
    return tuple(found[stamp] for stamp in sorted(found))


def imu_samples_of(path: Path) -> tuple[ImuSample, ...]:
    """Return the readings of the inertial unit in time order.

    Raises:
        RecordingNotFound, RecordingDamaged: the bag does not exist or cannot be read.
        RecordingError: the bag holds no inertial unit.
    """
    found = {stamp: _imu(stamp, message) for stamp, message in _messages(path, _IMU)}
    if len(found) < 2:
        raise RecordingError(f"{path} holds no {_IMU}: record /imu/data")
    return tuple(found[stamp] for stamp in sorted(found))


def _imu(stamp: int, message: Any) -> ImuSample:
    force, rate = message.linear_acceleration, message.angular_velocity
    return ImuSample(stamp, np.array([force.x, force.y, force.z]), np.array([rate.x, rate.y, rate.z]))


def _messages(path: Path, kind: str) -> Iterator[tuple[int, Any]]:
    """Yield (header stamp [ns], message) of all messages of a type."""
    bag_of = find_recording([path]).bag
    if bag_of is None:
        raise RecordingDamaged(f"{path} is not a bag: give a .bag, .mcap or .db3 file, or the folder of a ROS 2 bag")
    with open_bag(bag_of) as bag:
        wanted = [connection for connection in bag.connections if connection.msgtype == kind]
        for _, _, message in iterate_messages(path, bag, wanted):
            stamp = message.header.stamp
            yield int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec), message
