"""A drive along a route, as a rider would do it, with or without recording it; and how far the wheels alone go astray."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

import numpy as np

from waychair.calibration.chair import ChairBody
from waychair.recording import RecordingWriter
from waychair.simulation.follower import Follower, follow
from waychair.simulation.plant import PlantSettings
from waychair.simulation.simulator import Simulator
from waychair.slam.odometry import WheelOdometry
from waychair.types import FloatArray, Odometry, Pose2, Scan, WheelTicks

EPOCH_NS = 1_700_000_000 * 10**9
"""Bags of a robot carry wall-clock stamps; a simulated drive begins at this one."""

_Stamped = TypeVar("_Stamped", Scan, Odometry)


@dataclass(frozen=True, slots=True)
class RouteDrive:
    """What came of a drive: the way of the axle [m] by the truth, its time [s], scans made, odometry's final error [m]."""

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
) -> RouteDrive:
    """Drives along `route` (N, 2) [m, map] by joystick; scans and wheel odometry go to a ROS 2 bag, if one is given.

    Raises:
        WorldError: the chair touched something on the way, or made no way for a minute.
        OutputError: there is something at the bag's path already, or it cannot be written to.
    """
    odometry, origin = WheelOdometry(body), simulator.truth()
    began_ns, last, believed = simulator.now_ns, origin, Pose2()
    whole, distance, scans = max(route_length(route, origin), 1e-3), 0.0, 0
    with RecordingWriter(bag, body.base_from_laser) if bag else nullcontext() as writer:
        for message in follow(simulator, Follower(route, body.track, PlantSettings())):
            if isinstance(message, WheelTicks):
                reading = odometry.update(message)
                believed = reading.odom_from_base
                if writer:
                    writer.write(_later(reading))
                continue
            if writer:
                writer.write(_later(message))
            scans += 1
            pose = simulator.truth()
            distance, last = distance + math.dist((pose.x, pose.y), (last.x, last.y)), pose
            progress(min(1.0, distance / whole))
    true = origin.inverse() @ simulator.truth()
    error = math.dist((true.x, true.y), (believed.x, believed.y))
    return RouteDrive(distance, (simulator.now_ns - began_ns) * 1e-9, scans, error)


def route_length(route: FloatArray, start: Pose2) -> float:
    """Length [m] of the straight legs from the start along the waypoints (N, 2) [m, map]."""
    points = np.concatenate([[[start.x, start.y]], route])
    return float(np.hypot(*np.diff(points, axis=0).T).sum())


def _later(message: _Stamped) -> _Stamped:
    return replace(message, stamp_ns=message.stamp_ns + EPOCH_NS)
