"""Calibrate a chair's wheels, inertial unit and camera from simulated drives or from recordings."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.calibration.fits.camera_mount import Extrinsics, PlaneView, extrinsics_from_planes
from waychair.calibration.fits.imu_at_rest import ImuCalibration, imu_at_rest
from waychair.calibration.fits.planes import Plane, planes_from_depth
from waychair.calibration.fits.wheels import WheelCalibration, wheels_from_drive
from waychair.errors import CalibrationError, MissingExtra
from waychair.geometry import arc, pose_from_array, transform_points
from waychair.recordings.recording import read_recording, read_tum
from waychair.simulation.follower import Follower, follow
from waychair.simulation.simulator import Simulator, SimulatorSettings, with_all_sensors
from waychair.slam.localising.localiser import Localiser, LocaliserSettings
from waychair.trials.halls import open_hall
from waychair.trials.measured_speeds import EncoderSpeeds
from waychair.trials.recorded_sensors import imu_samples_of, wheel_ticks_of
from waychair.types import (
    BoolArray,
    FloatArray,
    ImuSample,
    IntArray,
    OccupancyGrid,
    Pose2,
    Pose3,
    RgbdFrame,
    Scan,
    Twist,
    WheelTicks,
)

STRETCH_NS = 500_000_000
"""Time between the poses that the encoders are compared with."""

_MAPPED_STRETCH_NS = 4 * STRETCH_NS  # lidar poses are good to a centimetre: longer stretches reduce the relative error
_TAPE_ERROR = 0.15  # [m]: error of a mount by tape measure
_GREATEST_TILT_SIN = math.sin(math.radians(15.0))
_LEAST_BEAMS = 10
_FLOOR_POINTS = np.array([[1.0, 1.0, 0.0], [1.0, -1.0, 0.0], [3.0, 1.0, 0.0], [3.0, -1.0, 0.0]])
_DIRECTIONS = 8
_REST_DIFFERENCE = 0.05  # [m]: most beams of two scans at rest differ by less
_REST_WITHIN_NS = 500_000_000  # scans farther apart in time cannot show that the chair rested
_VIEWS_APART_NS = 500_000_000
WHEELS_HALL = 14.0
"""Side [m] of a hall that holds the square of `calibrate_wheels` with walls within the lidar's range."""

_SIDE = 3.0  # [m] of the square
_SQUARE_SPEED = 0.5  # [m/s]


def square_both_ways(start: Pose2, side: float = _SIDE) -> FloatArray:
    """Return waypoints (N, 2) [m] of a square left of the start's heading: once anticlockwise, then once clockwise."""
    corners = np.array([[side, 0.0], [side, side], [0.0, side], [0.0, 0.0]])
    back = np.array([[0.0, side], [side, side], [side, 0.0], [0.0, 0.0]])
    return transform_points(start, np.concatenate([corners, back]))


def calibrate_wheels(simulator: Simulator, *, mapped: bool = False, rounds: int = 2) -> WheelCalibration:
    """Drive a square both ways; fit the wheels to the true poses or, if `mapped`, the localiser's poses.

    Raises:
        CalibrationError: see `wheels_from_drive`; or the localiser got lost.
        WorldError: the square does not fit into the world.
    """
    body, start = simulator.body, simulator.truth()
    route = np.concatenate([square_both_ways(start)] * rounds)
    follower = Follower(route, body.track, simulator.settings.plant, speed=_SQUARE_SPEED)
    ticks: list[WheelTicks] = []
    truth: list[tuple[int, Pose2]] = []
    scans: list[Scan] = []
    for message in follow(simulator, follower):
        if isinstance(message, Scan):
            scans.append(message)
        elif isinstance(message, WheelTicks):
            ticks.append(message)
            if message.stamp_ns == simulator.now_ns:  # the truth is taken at the end of the tick
                truth.append((message.stamp_ns, simulator.truth()))
    known = poses_from_scans(simulator.world.grid, body, start, ticks, scans) if mapped else truth
    apart = thinned(known, _MAPPED_STRETCH_NS if mapped else STRETCH_NS)
    stamps = np.array([stamp for stamp, _ in apart], np.int64)
    poses = np.array([pose.array() for _, pose in apart])
    return wheels_from_drive(counts_at(ticks, stamps), poses, body.ticks_per_turn)


def poses_from_scans(
    grid: OccupancyGrid, body: ChairBody, start: Pose2, ticks: Sequence[WheelTicks], scans: Sequence[Scan]
) -> list[tuple[int, Pose2]]:
    """Return (stamp, `map_from_base`) of each scan on a known map, by the localiser and nominal odometry.

    Raises:
        CalibrationError: the localiser got lost.
    """
    stamps, odom_from_base, twists = dead_reckoned(body, ticks)
    localiser = Localiser(grid, body.base_from_laser, start, LocaliserSettings())
    poses = []
    for scan in scans:
        last = max(int(np.searchsorted(stamps, scan.stamp_ns, side="right")) - 1, 0)
        seconds, twist = (scan.stamp_ns - int(stamps[last])) * 1e-9, twists[last]
        found = localiser.process(scan, odom_from_base[last] @ arc(twist.v * seconds, twist.omega * seconds), twist)
        if found.lost:
            raise CalibrationError("localisation by lidar was lost on the map: calibrate where the map is right")
        poses.append((scan.stamp_ns, found.map_from_base))
    return poses


def dead_reckoned(body: ChairBody, ticks: Sequence[WheelTicks]) -> tuple[IntArray, list[Pose2], list[Twist]]:
    """Return stamps (N,), poses since the first reading, and twists: dead reckoning with nominal wheels and track."""
    meter, pose = EncoderSpeeds(body), Pose2()
    stamps, poses, twists = [ticks[0].stamp_ns], [pose], [Twist()]
    for before, reading in pairwise(ticks):
        for sample in meter.add_messages((before, reading)):
            seconds = (reading.stamp_ns - stamps[-1]) * 1e-9
            pose = pose @ arc(sample.v * seconds, sample.omega * seconds)
            stamps.append(reading.stamp_ns)
            poses.append(pose)
            twists.append(Twist(sample.v, sample.omega))
    return np.array(stamps, np.int64), poses, twists


def wheels_from_recording(recording: Path, trajectory: Path, body: ChairBody) -> WheelCalibration:
    """Fit the wheels to the encoders of a recorded drive and to its mapped poses, such as trajectory.tum.

    Raises:
        RecordingError: a file cannot be read, or the recording holds no wheels.
        CalibrationError: see `wheels_from_drive`; or the two files share no time.
    """
    ticks = wheel_ticks_of(recording, body.ticks_per_turn)
    path = read_tum(trajectory)
    order = np.argsort(path.stamps_ns, kind="stable")
    known = [(int(path.stamps_ns[k]), pose_from_array(path.poses[k])) for k in order]
    shared = [(stamp, pose) for stamp, pose in known if ticks[0].stamp_ns <= stamp <= ticks[-1].stamp_ns]
    if len(shared) < 2:
        raise CalibrationError(
            f"{trajectory} and {recording} share no time: give the trajectory made of this recording"
        )
    apart = thinned(shared, _MAPPED_STRETCH_NS)
    stamps = np.array([stamp for stamp, _ in apart], np.int64)
    return wheels_from_drive(
        counts_at(ticks, stamps), np.array([pose.array() for _, pose in apart]), body.ticks_per_turn
    )


def imu_from_recording(recording: Path) -> ImuCalibration:
    """Return bias and noise of the inertial unit from a recording of a chair at rest; its axes must be the base's.

    Raises:
        RecordingError: the file cannot be read, or it holds no inertial unit.
        CalibrationError: see `imu_at_rest`.
    """
    return imu_at_rest(imu_samples_of(recording))


def thinned(known: Sequence[tuple[int, Pose2]], apart_ns: int) -> list[tuple[int, Pose2]]:
    """Return the poses thinned to at least `apart_ns` between two."""
    kept: list[tuple[int, Pose2]] = []
    for stamp, pose in known:
        if not kept or stamp - kept[-1][0] >= apart_ns:
            kept.append((stamp, pose))
    return kept


def counts_at(ticks: Sequence[WheelTicks], stamps: IntArray) -> IntArray:
    """Return unwrapped encoder counts (N, 2) at these stamps, by linear interpolation."""
    known = np.array([reading.stamp_ns for reading in ticks], np.int64)
    counts = np.array([(reading.left, reading.right) for reading in ticks], np.int64)
    steps = (np.diff(counts, axis=0, prepend=counts[:1]) + 2**31) % 2**32 - 2**31
    whole = np.cumsum(steps, axis=0)
    at = [np.interp(stamps, known, whole[:, wheel]) for wheel in (0, 1)]
    return np.round(np.stack(at, axis=1)).astype(np.int64)


def calibrate_imu(simulator: Simulator, seconds: float = 60.0) -> ImuCalibration:
    """Record a simulated chair's inertial unit at rest and return its bias and noise.

    Raises:
        CalibrationError: see `imu_at_rest`; the time is too short, or there is no inertial unit.
    """
    simulator.release()
    messages = simulator.advance(round(seconds * 100) * 10_000_000)
    return imu_at_rest([message for message in messages if isinstance(message, ImuSample)])


def views_of_planes(
    frame: RgbdFrame, scan: Scan, body: ChairBody, nominal: Pose3, seed: int = 0
) -> tuple[PlaneView, ...]:
    """Return the planes that camera and lidar both see: walls with the beams that hit them, and the floor.

    `nominal` is `camera_from_laser` by tape measure. A beam belongs to a wall if it ends near the part that the camera
    saw of it, and near no other wall. No beam ends on the floor, but the laser's height above it is known.
    """
    points = _beam_ends(scan)
    planes = planes_from_depth(frame.depth, frame.camera_matrix, np.random.default_rng(seed))
    upright = [abs(float(plane.normal @ nominal.rotation[:, 2])) for plane in planes]
    walls = [plane for plane, up in zip(planes, upright, strict=True) if up < _GREATEST_TILT_SIN]
    on = np.array([_near_plane(points, plane, nominal) for plane in walls]).reshape(len(walls), len(points))
    alone = on.sum(axis=0) == 1  # in a corner a beam may belong to either wall
    views = [
        PlaneView(plane.normal, plane.distance, points[mine & alone])
        for plane, mine in zip(walls, on, strict=True)
        if (mine & alone).sum() >= _LEAST_BEAMS
    ]
    floor = _FLOOR_POINTS - (0.0, 0.0, body.laser_z)
    floors = [plane for plane, up in zip(planes, upright, strict=True) if up > math.sqrt(1.0 - _GREATEST_TILT_SIN**2)]
    return (*views, *(PlaneView(plane.normal, plane.distance, floor) for plane in floors))


def _beam_ends(scan: Scan) -> FloatArray:
    """Return the end points (N, 3) [m] of all beams with a hit, in the laser frame."""
    hit = np.isfinite(scan.ranges) & (scan.ranges > max(scan.range_min, 0.05))
    ranges, angles = scan.ranges[hit].astype(float), scan.angles()[hit]
    return np.stack([ranges * np.cos(angles), ranges * np.sin(angles), np.zeros(len(ranges))], axis=1)


def _near_plane(points: FloatArray, plane: Plane, camera_from_laser: Pose3) -> BoolArray:
    """Return (N,) whether points (N, 3) lie near the part of a plane that the camera saw, by the nominal mount."""
    there = points @ camera_from_laser.rotation.T + camera_from_laser.translation
    between = (there > plane.extent[0] - _TAPE_ERROR) & (there < plane.extent[1] + _TAPE_ERROR)
    near: BoolArray = (np.abs(there @ plane.normal - plane.distance) < _TAPE_ERROR) & between[:, 0] & between[:, 2]
    return near


def nominal_mount(body: ChairBody) -> Pose3:
    """Return `camera_from_laser` by tape measure."""
    laser = body.base_from_laser
    c, s = math.cos(laser.theta), math.sin(laser.theta)
    rotation = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    origin = np.array([laser.x, laser.y, body.laser_z])
    camera = body.base_from_camera
    back = camera.rotation.T
    return Pose3(back @ rotation, back @ (origin - camera.translation))


def with_displaced_camera(body: ChairBody, seed: int) -> ChairBody:
    """Return the body with a camera that is mounted up to 3 cm and 2 degrees off its nominal place."""
    rng = np.random.default_rng(seed)
    x, y, z = (float(value) for value in rng.uniform(-0.03, 0.03, 3))
    yaw, pitch = (float(value) for value in rng.uniform(-0.035, 0.035, 2))
    return dataclasses.replace(
        body,
        camera_x=body.camera_x + x,
        camera_y=body.camera_y + y,
        camera_z=body.camera_z + z,
        camera_yaw=body.camera_yaw + yaw,
        camera_pitch=body.camera_pitch + pitch,
    )


def calibrate_camera(
    body: ChairBody, nominal: Pose3, settings: SimulatorSettings, seed: int = 0, room: float = 6.0
) -> Extrinsics:
    """Return camera extrinsics from the views of a simulated chair in a bare room, in eight directions.

    `body` carries the camera at its true place; `nominal` is `camera_from_laser` by tape measure.

    Raises:
        MissingExtra: this machine cannot render pictures.
        CalibrationError: see `extrinsics_from_planes`.
    """
    world = open_hall(room, 0.05)
    views: list[PlaneView] = []
    for direction in range(_DIRECTIONS):
        pose = Pose2(world.start.x, world.start.y, math.tau * (direction + 0.5) / _DIRECTIONS)
        simulator = Simulator(dataclasses.replace(world, start=pose), body, with_all_sensors(settings), seed)
        if simulator.camera_problem:
            raise MissingExtra(f"pictures cannot be rendered: {simulator.camera_problem}")
        views += views_of_planes(*frame_and_scan(simulator), body, nominal)
    return extrinsics_from_planes(views, nominal)


def camera_from_recording(path: Path, body: ChairBody) -> Extrinsics:
    """Return camera extrinsics from a recording of a chair that turned and rested by turns between bare walls.

    `body` gives the places of lidar and camera by tape measure. A picture counts if the chair rested: the scans before
    and after it agree.

    Raises:
        RecordingError: the recording cannot be read.
        CalibrationError: it holds no depth pictures, or none of a chair at rest; see `extrinsics_from_planes`.
    """
    recording = read_recording(path)
    scans = sorted((frame.scan for frame in recording.frames if frame.scan), key=lambda scan: scan.stamp_ns)
    stamps = np.array([scan.stamp_ns for scan in scans], np.int64)
    nominal = nominal_mount(body)
    views: list[PlaneView] = []
    pictures = next_ns = 0
    for picture in recording.pictures():
        pictures += 1
        at = int(np.searchsorted(stamps, picture.stamp_ns, side="right")) - 1
        if picture.stamp_ns < next_ns or not 0 <= at < len(scans) - 1 or not _at_rest(scans[at], scans[at + 1]):
            continue
        next_ns = picture.stamp_ns + _VIEWS_APART_NS
        views += views_of_planes(picture, scans[at], body, nominal)
    if not views:
        raise CalibrationError(
            f"none of the {pictures} pictures with depth in {path} shows a wall or the floor from a chair at rest: "
            "in a room with bare walls, turn the chair, let it rest for a second, and repeat"
        )
    return extrinsics_from_planes(views, nominal)


def _at_rest(before: Scan, after: Scan) -> bool:
    """Return whether two successive scans show a chair at rest."""
    if len(before.ranges) != len(after.ranges) or after.stamp_ns - before.stamp_ns > _REST_WITHIN_NS:
        return False
    both = np.isfinite(before.ranges) & np.isfinite(after.ranges)
    off = np.abs(after.ranges[both] - before.ranges[both])
    return bool(both.sum() >= _LEAST_BEAMS and np.percentile(off, 80.0) < _REST_DIFFERENCE)


def frame_and_scan(simulator: Simulator) -> tuple[RgbdFrame, Scan]:
    """Return the last picture and scan of half a second at rest.

    Raises:
        CalibrationError: there was no picture or no scan.
    """
    simulator.release()
    messages = simulator.advance(500_000_000)
    frames = [message for message in messages if isinstance(message, RgbdFrame)]
    scans = [message for message in messages if isinstance(message, Scan)]
    if not (frames and scans):
        raise CalibrationError("no picture or no scan came in half a second at rest: switch camera and lidar on")
    return frames[-1], scans[-1]
