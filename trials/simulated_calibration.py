"""Drives of simulated chairs in halls for `waychair calibrate --chair-sim`, and their calibration."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from waychair.calibration.calibration_file import JoystickFamily
from waychair.calibration.chair_body import ChairBody
from waychair.calibration.drives.camera_views import views_of_planes
from waychair.calibration.drives.dac_and_stops import ChairUnderTest
from waychair.calibration.drives.measured_speeds import EncoderSpeeds, ScanSpeeds
from waychair.calibration.drives.recorded_drives import MAPPED_STRETCH_NS, counts_at, thinned
from waychair.calibration.fits.camera_mount import Extrinsics, PlaneView, extrinsics_from_planes
from waychair.calibration.fits.imu_at_rest import ImuCalibration, imu_at_rest
from waychair.calibration.fits.wheels import WheelCalibration, wheels_from_drive
from waychair.errors import CalibrationError, MissingExtra
from waychair.geometry import arc, transform_points
from waychair.simulation.follower import Follower, follow
from waychair.simulation.plant.plant import PlantSettings, volts_from_joystick, volts_from_twist
from waychair.simulation.simulator import Simulator, SimulatorSettings, with_all_sensors
from waychair.slam.localising.localiser import Localiser, LocaliserSettings
from waychair.topics import COMMAND
from waychair.trials.drive import DrivenWay
from waychair.trials.open_hall import open_hall
from waychair.trials.simulated_drive import SimulatedDrive, hold_lines, with_few_beams, with_gyro
from waychair.types import (
    FloatArray,
    ImuSample,
    IntArray,
    OccupancyGrid,
    Pose2,
    Pose3,
    RgbdFrame,
    Scan,
    SensorMessage,
    Twist,
    WheelTicks,
)

SIMULATED_FAMILY: JoystickFamily = "eight_pin_3v3"
"""The joystick family of the simulated chairs, whose lines rest at 1.65 V."""

WHEELS_HALL = 14.0
"""Side [m] of a hall that holds the square of `calibrate_wheels` with walls within the lidar's range."""

TIME_HALL = 6.0
"""Side [m] of a hall in which a chair can turn and the camera gets depth from the walls."""

MASK_HALL = 8.0
"""Side [m] of a hall with space for a chair to turn."""

STRETCH_NS = 500_000_000
"""Time between the poses that the encoders are compared with."""

_READING_SIGMA = 0.003  # [V] noise of one reading of the stick's lines
_READINGS = 50
_SIDE = 3.0  # [m] of the square
_SQUARE_SPEED = 0.5  # [m/s]
_DIRECTIONS = 8
_RATES = (0.4, 0.8)  # [rad/s] of the turns left and right
_HOLDS = (0.5, 1.2)  # [s] of one such turn
_TURN_RATE = 0.6  # [rad/s] for the self-mask
_STRETCH = 20  # steps of a long simulation, after which its progress is told


def measured_neutral(plant: PlantSettings, seed: int) -> tuple[float, float]:
    """Return neutral (forward, turn) [V] as a voltmeter reads it on the original stick at rest."""
    readings = np.random.default_rng(seed).normal(volts_from_joystick(plant, 0.0, 0.0), _READING_SIGMA, (_READINGS, 2))
    forward, turn = readings.mean(axis=0).tolist()
    return forward, turn


def chair_in_hall(settings: SimulatorSettings, body: ChairBody, seed: int, *, encoders: bool = True) -> ChairUnderTest:
    """Return a simulated chair in an open hall. Its speeds come from encoders or, without them, from lidar and gyro."""
    if encoders:
        drive = SimulatedDrive(Simulator(open_hall(), body, with_few_beams(settings), seed), EncoderSpeeds(body))
    else:
        drive = SimulatedDrive(Simulator(open_hall(24.0), body, with_gyro(settings), seed), ScanSpeeds(body))
    return ChairUnderTest(drive, measured_neutral(settings.plant, seed), body)


def square_both_ways(start: Pose2, side: float = _SIDE) -> FloatArray:
    """Return waypoints (N, 2) [m] of a square left of the start's heading: once anticlockwise, then once clockwise."""
    corners = np.array([[side, 0.0], [side, side], [0.0, side], [0.0, 0.0]])
    back = np.array([[0.0, side], [side, side], [side, 0.0], [0.0, 0.0]])
    return transform_points(start, np.concatenate([corners, back]))


def calibrate_wheels(
    simulator: Simulator,
    *,
    mapped: bool = False,
    rounds: int = 2,
    progress: Callable[[float], None] = lambda metres: None,
) -> WheelCalibration:
    """Drive a square both ways; fit the wheels to the true poses or, if `mapped`, the localiser's poses.

    `progress` is called during the drive with the way driven [m].

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
    way = DrivenWay(simulator, progress)
    for message in follow(simulator, follower):
        if isinstance(message, Scan):
            scans.append(message)
        elif isinstance(message, WheelTicks):
            ticks.append(message)
            if message.stamp_ns == simulator.now_ns:  # the truth is taken at the end of the tick
                truth.append((message.stamp_ns, simulator.truth()))
                way.step()
    known = poses_from_scans(simulator.world.grid, body, start, ticks, scans) if mapped else truth
    apart = thinned(known, MAPPED_STRETCH_NS if mapped else STRETCH_NS)
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


def calibrate_imu(
    simulator: Simulator, seconds: float = 60.0, progress: Callable[[float], None] = lambda share: None
) -> ImuCalibration:
    """Record a simulated chair's inertial unit at rest and return its bias and noise.

    `progress` is called with the share of the time that has passed.

    Raises:
        CalibrationError: see `imu_at_rest`; the time is too short, or there is no inertial unit.
    """
    simulator.release()
    steps = round(seconds * 100)  # of 10 ms
    samples: list[ImuSample] = []
    for done in range(0, steps, _STRETCH):
        count = min(_STRETCH, steps - done)
        samples += [each for each in simulator.advance(count * 10_000_000) if isinstance(each, ImuSample)]
        progress((done + count) / steps)
    return imu_at_rest(samples)


def with_displaced_camera(body: ChairBody, seed: int) -> ChairBody:
    """Return the body with a camera that is mounted up to 3 cm and 2 degrees off its nominal place."""
    rng = np.random.default_rng(seed)
    x, y, z = (float(value) for value in rng.uniform(-0.03, 0.03, 3))
    yaw, pitch = (float(value) for value in rng.uniform(-0.035, 0.035, 2))
    return replace(
        body,
        camera_x=body.camera_x + x,
        camera_y=body.camera_y + y,
        camera_z=body.camera_z + z,
        camera_yaw=body.camera_yaw + yaw,
        camera_pitch=body.camera_pitch + pitch,
    )


def calibrate_camera(
    body: ChairBody,
    nominal: Pose3,
    settings: SimulatorSettings,
    seed: int = 0,
    room: float = 6.0,
    progress: Callable[[float], None] = lambda share: None,
) -> Extrinsics:
    """Return camera extrinsics from the views of a simulated chair in a bare room, in eight directions.

    `body` carries the camera at its true place; `nominal` is `camera_from_laser` by tape measure. `progress` is called with
    the share of the directions that is done.

    Raises:
        MissingExtra: this machine cannot render pictures.
        CalibrationError: see `extrinsics_from_planes`.
    """
    world = open_hall(room, 0.05)
    views: list[PlaneView] = []
    for direction in range(_DIRECTIONS):
        pose = Pose2(world.start.x, world.start.y, math.tau * (direction + 0.5) / _DIRECTIONS)
        simulator = Simulator(replace(world, start=pose), body, with_all_sensors(settings), seed)
        if simulator.camera_problem:
            raise MissingExtra(f"pictures cannot be rendered: {simulator.camera_problem}")
        views += views_of_planes(*frame_and_scan(simulator), body, nominal)
        progress((direction + 1) / _DIRECTIONS)
    return extrinsics_from_planes(views, nominal)


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


def turns_to_and_fro(simulator: Simulator, seconds: float, seed: int = 0) -> Iterator[SensorMessage]:
    """Yield the messages of a chair that rests for a second, then turns left and right at irregular intervals.

    Raises:
        WorldError: the chair touched something.
    """
    rng = np.random.default_rng(seed)
    plant, track = simulator.settings.plant, simulator.body.track
    neutral = volts_from_twist(plant, track, Twist())
    until_ns, side = simulator.now_ns + round(seconds * 1e9), 1.0
    yield from hold_lines(simulator, *neutral, 1.0)
    while simulator.now_ns < until_ns:
        rate = side * float(rng.uniform(*_RATES))
        yield from hold_lines(simulator, *volts_from_twist(plant, track, Twist(0.0, rate)), float(rng.uniform(*_HOLDS)))
        side = -side
    yield from hold_lines(simulator, *neutral, 1.0)


def with_legs(settings: SimulatorSettings) -> SimulatorSettings:
    """Return the settings with the rider's legs and the leg rests in the lidar's view."""
    return replace(settings, lidar=replace(settings.lidar, legs=True))


def scans_while_turning(
    simulator: Simulator, turns: float = 1.2, progress: Callable[[float], None] = lambda share: None
) -> list[Scan]:
    """Return the scans of a chair that turns on the spot, `turns` times; `progress` is called with the share that is done.

    Raises:
        WorldError: the chair touched something.
    """
    plant, track = simulator.settings.plant, simulator.body.track
    volts = volts_from_twist(plant, track, Twist(0.0, _TURN_RATE))
    messages: list[SensorMessage] = []
    ticks = round(turns * math.tau / _TURN_RATE * COMMAND.rate_hz)
    for done in range(0, ticks, _STRETCH):
        count = min(_STRETCH, ticks - done)
        messages += hold_lines(simulator, *volts, count / COMMAND.rate_hz)
        progress((done + count) / ticks)
    simulator.release()
    return [message for message in messages if isinstance(message, Scan)]
