"""Error and consistency of dead reckoning: simulated floors with true poses, and a real robot without."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from evaluation.figures.mapping.logs import DATA
from waychair.calibration.chair_body import ChairBody
from waychair.geometry import arc, rotation, transform_points
from waychair.simulation.follower import Follower, follow
from waychair.simulation.plan.world import load_world
from waychair.simulation.plant.chair_file import load_chair, randomised_chair
from waychair.simulation.plant.plant import PlantSettings
from waychair.simulation.simulator import Simulator, SimulatorSettings
from waychair.slam.odometry.odometry_filter import OdometryFilter
from waychair.slam.odometry.odometry_model import OdometrySettings
from waychair.slam.scan.reference_surfaces import ScanReference, reference_from_points
from waychair.slam.scan.scan_matching import BEAM_SIGMA, MatchSettings, Window, match
from waychair.slam.scan.scan_points import ScanPoints, scan_points
from waychair.topics import IMU
from waychair.types import FloatArray, ImuSample, Json, Odometry, Pose2, Scan, SensorMessage, Twist, WheelTicks

SEEDS = 10
STANDING_NS = 3_000_000_000
"""Rest [s] of a chair after switching on."""

BAND = (16.79 / SEEDS, 46.98 / SEEDS)
"""Band of the mean of ten squared errors of three degrees of freedom: chi-square of 30, 2.5 % and 97.5 %."""

OFF_ROAD = OdometrySettings(slip_speed=0.6, track_scale=0.1, drift_noise=0.02, turn_noise=0.03)
"""Slip of a skid-steered robot on grass."""

_EARTH = 6_371_000.0  # m, radius
_KEY_DISTANCE, _KEY_ANGLE = 0.7, 0.7  # m, rad: a scan this far from the key scan becomes the next key scan


class Fix(NamedTuple):
    """A satellite fix, [m] east and north of the first one."""

    stamp_ns: int
    metres: tuple[float, float]


def run(out: Path) -> Json:
    """Final errors and their NEES on the second floor's route, ten chairs: wheels, wheels and gyro, scans alone."""
    ends: dict[str, list[tuple[float, float, float]]] = {"wheels": [], "wheels_gyro": [], "scans": []}
    microseconds = {"wheels": 0.0, "imu": 0.0}
    for seed in range(SEEDS):
        chair = randomised_chair(load_chair("A"), seed)
        settings = SimulatorSettings(plant=chair.plant, mujoco=chair.mujoco)
        settings = replace(
            settings,
            imu=replace(settings.imu, rate_hz=IMU.rate_hz),
            lidar=replace(settings.lidar, beams=361),
        )
        simulator = Simulator(load_world("second_floor"), chair.body, settings, seed)
        origin = simulator.truth()
        messages = [*simulator.advance(STANDING_NS)]
        messages += follow(simulator, Follower(simulator.world.route(), chair.body.track, PlantSettings()))
        truth = origin.inverse() @ simulator.truth()
        ends["wheels"].append(_end(_reckoned(chair.body, messages, {}, WheelTicks), truth))
        ends["wheels_gyro"].append(_end(_reckoned(chair.body, messages, microseconds, WheelTicks, ImuSample), truth))
        ends["scans"].append(_end(_matched(chair.body, messages), truth))
    figures = {name: _figures(values) for name, values in ends.items()}
    honest = all(BAND[0] <= figures[name]["mean_nees"] <= BAND[1] for name in ("wheels", "wheels_gyro"))
    better = figures["wheels_gyro"]["median_m"] < figures["wheels"]["median_m"]
    costs = {f"cpu_us_per_{name}": round(value / SEEDS, 1) for name, value in microseconds.items()}
    return {"passed": honest and better, "nees_band": [round(limit, 2) for limit in BAND], **costs, **figures}


def run_husky(out: Path) -> Json:
    """Innovations, slip and gyro bias on a real robot's recording, and its tracks compared with satellite fixes.

    The fixes are good to metres only, but reveal a drifted heading.
    """
    odometry, wheels = OdometryFilter(None, OFF_ROAD), OdometryFilter(None, OFF_ROAD)
    innovations, tracks, slipped = [], [], 0
    for reading in _husky(DATA / "ros_bags" / "husky_imu_odom_gps.bag"):
        if isinstance(reading, ImuSample):
            odometry.update_imu(reading)
        elif isinstance(reading, Odometry):
            odometry.update_wheels(reading)
            wheels.update_wheels(reading)
            slipped += odometry.slipping
            innovations += [odometry.innovation] if odometry.innovation is not None else []
        else:
            both = (each.predict(reading.stamp_ns).odom_from_base for each in (odometry, wheels))
            tracks.append([*reading.metres, *(value for pose in both for value in (pose.x, pose.y))])
    fixes, fused, alone = np.split(np.array(tracks), 3, axis=1)
    residuals = {"fused": _misfit(fused, fixes), "wheels": _misfit(alone, fixes)}
    bias, sigma = odometry.gyro_bias
    share = slipped / len(innovations)
    calm = share < 0.02 and 0.2 < np.std(innovations) < 1.2 and abs(np.mean(innovations)) < 0.2
    return {
        "passed": bool(calm and residuals["fused"] < residuals["wheels"]),
        "innovations": len(innovations),
        "innovation_sigmas": round(float(np.std(innovations)), 2),
        "innovation_mean": round(float(np.mean(innovations)), 3),
        "slipping_share": round(share, 4),
        "gyro_bias_rad_s": round(bias, 6),
        "gyro_bias_sigma": round(sigma, 6),
        "rms_to_fixes_m": {name: round(value, 2) for name, value in residuals.items()},
    }


def _misfit(track: FloatArray, fixes: FloatArray) -> float:
    """Return the root mean square distance [m] of a track (N, 2) from fixes (N, 2) after rigid alignment."""
    a, b = track - track.mean(axis=0), fixes - fixes.mean(axis=0)
    theta = math.atan2(float(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])), float(np.sum(a * b)))
    return float(np.sqrt(np.mean(np.sum((a @ _turn(theta)[:2, :2].T - b) ** 2, axis=1))))


def nees_of(odometry: Odometry, truth: Pose2) -> float:
    """Return the normalised squared error in the coordinates of the motion group (Long et al., RSS 2012)."""
    assert odometry.covariance is not None
    gap = odometry.odom_from_base.inverse() @ truth
    half = gap.theta / 2
    k = half / math.tan(half) if half else 1.0
    error = np.array([k * gap.x + half * gap.y, k * gap.y - half * gap.x, gap.theta])
    turn = _turn(-odometry.odom_from_base.theta)
    return float(error @ np.linalg.solve(turn @ odometry.covariance @ turn.T, error))


def _reckoned(body: ChairBody, messages: list[SensorMessage], microseconds: dict[str, float], *kinds: type) -> Odometry:
    odometry, spent, count = OdometryFilter(body), {"wheels": 0.0, "imu": 0.0}, {"wheels": 1, "imu": 1}
    for message in messages:
        if not isinstance(message, kinds):
            continue
        started = time.thread_time()
        if isinstance(message, ImuSample):
            last, kind = odometry.update_imu(message), "imu"
        else:
            assert isinstance(message, WheelTicks)
            last, kind = odometry.update_wheels(message), "wheels"
        spent[kind], count[kind] = spent[kind] + time.thread_time() - started, count[kind] + 1
    for kind in microseconds:
        microseconds[kind] += 1e6 * spent[kind] / count[kind]
    return last


def _matched(body: ChairBody, messages: list[SensorMessage]) -> Odometry:
    """Return dead reckoning by scans alone, each matched to a recent key scan."""
    settings, odometry = MatchSettings(), OdometryFilter()
    key: ScanReference | None = None
    key_from_base, before_ns, last = Pose2(), 0, Odometry(0, Pose2())
    for scan in messages:
        if not isinstance(scan, Scan):
            continue
        twist, at_ns = last.twist, scan.stamp_ns + round(0.5e9 * scan.time_step * len(scan.ranges))
        points = _at_the_middle(scan, scan_points(scan, body.base_from_laser, settings.range_max, twist), twist)
        if key is not None:
            seconds = (at_ns - before_ns) * 1e-9
            guess = key_from_base @ arc(twist.v * seconds, twist.omega * seconds)
            found = match(points.thinned(180), key, guess, np.eye(3), Window(0.08, 0.06), settings)
            back = _turn(-key_from_base.theta)
            motion = key_from_base.inverse() @ found.pose
            last = odometry.update_motion(before_ns, at_ns, motion, back @ found.covariance @ back.T)
            key_from_base = found.pose
        if (
            key is None
            or math.hypot(key_from_base.x, key_from_base.y) > _KEY_DISTANCE
            or abs(key_from_base.theta) > _KEY_ANGLE
        ):
            key = reference_from_points(points.points, points.normals, settings.resolution, BEAM_SIGMA)
            key_from_base = Pose2()
        before_ns = at_ns
    return last


def _at_the_middle(scan: Scan, points: ScanPoints, twist: Twist) -> ScanPoints:
    """Return the scan in the base frame at the middle of its sweep, where a twist error does not shift it as a whole.

    In the frame of the first beam it would, and the next twist, computed from the shift, would have a larger opposite
    error.
    """
    half = 0.5 * scan.time_step * len(scan.ranges)
    middle_from_first = arc(twist.v * half, twist.omega * half).inverse()
    turned = points.normals @ rotation(middle_from_first.theta).T
    return ScanPoints(np.ascontiguousarray(transform_points(middle_from_first, points.points)), turned)


def _end(odometry: Odometry, truth: Pose2) -> tuple[float, float, float]:
    """Error [m], [deg], and NEES (normalised estimation error squared)."""
    gap = odometry.odom_from_base.inverse() @ truth
    return math.hypot(gap.x, gap.y), abs(math.degrees(gap.theta)), nees_of(odometry, truth)


def _figures(ends: list[tuple[float, float, float]]) -> Json:
    metres, degrees, nees = zip(*ends, strict=True)
    return {
        "median_m": round(statistics.median(metres), 2),
        "worst_m": round(max(metres), 2),
        "median_deg": round(statistics.median(degrees), 2),
        "worst_deg": round(max(degrees), 2),
        "mean_nees": round(statistics.mean(nees), 2),
        "ends": [[round(value, 3) for value in end] for end in ends],
    }


def _turn(theta: float) -> FloatArray:
    """Return the rotation (3, 3) of x, y and theta."""
    c, s = math.cos(theta), math.sin(theta)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _husky(bag: Path) -> Iterator[ImuSample | Odometry | Fix]:
    """Yield IMU, odometry and fixes; the IMU (x right, y up, z back) is turned to the base's axes."""
    with AnyReader([bag], default_typestore=get_typestore(Stores.ROS1_NOETIC)) as reader:
        topics = ("/imu/data", "/husky_velocity_controller/odom", "/fix")
        first: tuple[float, float] | None = None
        for connection, _, raw in reader.messages([c for c in reader.connections if c.topic in topics]):
            message: Any = reader.deserialize(raw, connection.msgtype)
            stamp_ns = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
            if connection.topic == "/imu/data":
                accel, gyro = message.linear_acceleration, message.angular_velocity
                yield ImuSample(stamp_ns, np.array([-accel.z, -accel.x, accel.y]), np.array([-gyro.z, -gyro.x, gyro.y]))
            elif connection.topic == "/fix":
                first = first or (message.latitude, message.longitude)
                north = math.radians(message.latitude - first[0]) * _EARTH
                east = math.radians(message.longitude - first[1]) * _EARTH * math.cos(math.radians(first[0]))
                yield Fix(stamp_ns, (east, north))
            else:
                at, q, speed = message.pose.pose.position, message.pose.pose.orientation, message.twist.twist
                yaw = math.atan2(2 * (q.w * q.z + q.x * q.y), 1 - 2 * (q.y * q.y + q.z * q.z))
                yield Odometry(stamp_ns, Pose2(at.x, at.y, yaw), Twist(speed.linear.x, speed.angular.z))
