"""A rider's drive along a route, optionally recorded as a bag, and the final error of its odometry."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path
from typing import TypeVar

import numpy as np

from waychair.calibration.chair_body import ChairBody, sonar_mounts
from waychair.geometry import in_space
from waychair.recordings.bags.bag_settings import BagSettings
from waychair.recordings.bags.ros_messages import CAMERA_FRAME, CAMERA_FROM_OPTICAL, IMU_FRAME, LASER_FRAME, SONAR_FRAME
from waychair.recordings.bags.rosbag_writer import RecordingWriter
from waychair.recordings.recording import InputSettings, read_recording
from waychair.simulation.follower import Follower, follow
from waychair.simulation.pacing import Pacer
from waychair.simulation.plant.plant import PlantSettings
from waychair.simulation.simulator import Simulator
from waychair.slam.odometry.odometry_filter import OdometryFilter
from waychair.types import (
    FloatArray,
    Odometry,
    Pose2,
    Pose3,
    Scan,
    SensorMessage,
    Trajectory,
    WheelTicks,
)

EPOCH_NS = 1_700_000_000 * 10**9
"""Stamp of the start of a simulated drive in a bag: real bags carry wall-clock stamps."""

TRUTH = "/ground_truth/odom"
"""Topic of the true poses in the bag of a simulated drive."""

_Stamped = TypeVar("_Stamped", bound=Odometry | SensorMessage)


@dataclass(frozen=True, slots=True)
class RouteDrive:
    """The result of a drive: true distance of the axle [m], time [s], scans, and the odometry's final error [m]."""

    distance_m: float
    duration_s: float
    scans: int
    odometry_error_m: float


def drive_route(
    simulator: Simulator,
    body: ChairBody,
    route: FloatArray,
    bag: Path | None = None,
    progress: Callable[[float], None] = lambda share: None,
    pacer: Pacer | None = None,
    on_message: Callable[[SensorMessage], None] = lambda message: None,
    drive: Iterator[SensorMessage] | None = None,
) -> RouteDrive:
    """Drive along `route` (N, 2) [m, map] by joystick, at the pace of `pacer` (by default as fast as possible).

    `on_message` is called with each sensor message, stamped as in the bag. `drive` yields the messages of another rider's drive. A ROS 2 `bag` receives all sensor messages, wheel
    odometry and, once a tick, the true pose. If the disk fills up or the user interrupts, the recorded part stays
    beside the bag's path (see `RecordingWriter`).

    Raises:
        WorldError: the chair touched something, or made no progress for a minute.
        OutputError: the bag's path exists already or cannot be written, or the disk is full.
    """
    odometry, origin, pacer = OdometryFilter(body), simulator.truth(), pacer or Pacer()
    began_ns, last, believed = simulator.now_ns, origin, Pose2()
    whole, distance, scans = max(route_length(route, origin), 1e-3), 0.0, 0
    drive = drive or follow(simulator, Follower(route, body.track, PlantSettings()))
    mounts = mounts_of(body, simulator.settings.sonar.height)
    recording = RecordingWriter(bag, mounts, ticks_per_turn=body.ticks_per_turn) if bag else nullcontext()
    with recording as writer:
        # A tick's messages arrive when the simulator is at the tick's end, where the true pose is taken.
        for now_ns, messages in groupby(drive, lambda _: simulator.now_ns):
            pose, twist = simulator.truth(), simulator.twist()
            for message in messages:
                scans += isinstance(message, Scan)
                stamped = _wall_clock(message)
                on_message(stamped)
                if writer:
                    writer.write(stamped)
                if isinstance(message, WheelTicks):
                    reading = odometry.update_wheels(message)
                    believed = reading.odom_from_base
                    if writer:
                        writer.write(_wall_clock(reading))
            if writer:
                writer.write_truth(now_ns + EPOCH_NS, pose, twist)
            distance, last = distance + math.dist((pose.x, pose.y), (last.x, last.y)), pose
            progress(min(1.0, distance / whole))
            pacer.pace(now_ns)
    true = origin.inverse() @ simulator.truth()
    error = math.dist((true.x, true.y), (believed.x, believed.y))
    return RouteDrive(distance, (simulator.now_ns - began_ns) * 1e-9, scans, error)


def route_length(route: FloatArray, start: Pose2) -> float:
    """Return the length [m] of the segments from the start along the waypoints (N, 2) [m, map]."""
    points = np.concatenate([[[start.x, start.y]], route])
    return float(np.hypot(*np.diff(points, axis=0).T).sum())


def mounts_of(body: ChairBody, sonar_height: float) -> dict[str, Pose3]:
    """Return the mounts of a body's sensors in the base frame at floor height, by frame name.

    `sonar_height` [m] is the sonars' height above the floor.
    """
    optical = body.base_from_camera
    return {
        LASER_FRAME: in_space(body.base_from_laser, body.laser_z),
        IMU_FRAME: Pose3(np.eye(3), np.array([body.imu_x, body.imu_y, body.imu_z])),
        CAMERA_FRAME: Pose3(optical.rotation @ CAMERA_FROM_OPTICAL.rotation.T, optical.translation),
        **{SONAR_FRAME.format(k): in_space(at, sonar_height) for k, at in enumerate(sonar_mounts(body))},
    }


def true_trajectory(bag: Path) -> Trajectory:
    """Return the true trajectory of a recorded simulated drive, in the world frame."""
    recording = read_recording(bag, InputSettings(bag=BagSettings(odom_topic=TRUTH)))
    readings = [reading for frame in recording.frames for reading in frame.wheels if isinstance(reading, Odometry)]
    stamps = np.array([reading.stamp_ns for reading in readings], np.int64)
    return Trajectory(stamps, np.array([reading.odom_from_base.array() for reading in readings]))


def _wall_clock(message: _Stamped) -> _Stamped:
    return replace(message, stamp_ns=message.stamp_ns + EPOCH_NS)
