"""A simulated chair as a calibration drives it, with the speeds that its own sensors see."""

from __future__ import annotations

import dataclasses
from itertools import pairwise

import numpy as np

from waychair.calibration.chair import ChairBody
from waychair.calibration.sweep import Sample
from waychair.errors import CalibrationError, WorldError
from waychair.simulation.simulator import SensorMessage, Simulator, SimulatorSettings
from waychair.slam.odometry import WheelOdometry, arc
from waychair.slam.reference import Reference, reference_from_points
from waychair.slam.scan_matching import MatchSettings, Window, match
from waychair.slam.scan_points import MIN_POINTS, ScanPoints, scan_points
from waychair.topics import COMMAND, IMU
from waychair.types import ImuSample, Pose2, Scan, Twist, WheelTicks

TICK_NS = round(1e9 / COMMAND.rate_hz)
"""Commands are held for whole numbers of ticks."""

_BIAS_S = 3.0
_KEY_DISTANCE = 0.7  # [m]: a scan this far from the key scan becomes the next one
_KEY_ANGLE = 0.7  # [rad]
_LEAST_INLIERS = 0.5
_MOST_POINTS = 360


def with_few_beams(settings: SimulatorSettings) -> SimulatorSettings:
    """The same chair with a lidar that nobody looks at, which is most of the simulator's work."""
    return dataclasses.replace(settings, lidar=dataclasses.replace(settings.lidar, beams=2))


def with_gyro(settings: SimulatorSettings) -> SimulatorSettings:
    """The same chair with its IMU switched on."""
    return dataclasses.replace(settings, imu=dataclasses.replace(settings.imu, rate_hz=IMU.rate_hz))


class EncoderDrive:
    """A `Drive` whose speeds are those of the encoders, on the nominal wheels and track."""

    def __init__(self, simulator: Simulator, body: ChairBody) -> None:
        self._simulator = simulator
        self._odometry = WheelOdometry(body)
        self._last_ns = simulator.now_ns

    @property
    def now_ns(self) -> int:
        """The simulator's time."""
        return self._simulator.now_ns

    def hold(self, forward_volts: float, turn_volts: float, seconds: float) -> list[Sample]:
        """Hold the lines; one sample for each reading of the encoders, stamped in the middle of its interval."""
        samples = []
        for message in held(self._simulator, forward_volts, turn_volts, seconds):
            if not isinstance(message, WheelTicks):
                continue
            twist = self._odometry.update(message).twist
            samples.append(Sample((message.stamp_ns + self._last_ns) // 2, twist.v, twist.omega))
            self._last_ns = message.stamp_ns
        return samples


class ScanDrive:
    """A `Drive` for a chair without encoders: v from scan matching, omega from the gyro, whose bias is taken at rest.

    Each scan is matched to a key scan that is not far back, from where the last speeds lead; so errors do not add up
    within a hold, and a corridor that looks the same everywhere would show as a failure to match.
    """

    def __init__(self, simulator: Simulator, body: ChairBody) -> None:
        """Stands still for three seconds first."""
        self._simulator = simulator
        self._mount = body.base_from_laser
        self._settings = MatchSettings()
        self._gyro: list[ImuSample] = []
        self._key: Reference | None = None
        self._key_from_base = Pose2()
        self._twist = Twist()
        self._last_ns = 0
        simulator.release()
        still = simulator.advance(round(_BIAS_S * 1e9))
        self._bias = float(np.mean([message.gyro[2] for message in still if isinstance(message, ImuSample)]))

    @property
    def now_ns(self) -> int:
        """The simulator's time."""
        return self._simulator.now_ns

    def hold(self, forward_volts: float, turn_volts: float, seconds: float) -> list[Sample]:
        """Hold the lines; one sample for each scan, stamped in the middle since the scan before.

        Raises:
            CalibrationError: a scan fits nowhere.
        """
        samples = []
        for message in held(self._simulator, forward_volts, turn_volts, seconds):
            if isinstance(message, ImuSample):
                self._gyro.append(message)
            elif isinstance(message, Scan):
                before_ns, self._last_ns = self._last_ns, message.stamp_ns
                if self._take_in(message, before_ns):
                    middle_ns = (message.stamp_ns + before_ns) // 2
                    samples.append(Sample(middle_ns, self._twist.v, self._twist.omega))
        return samples

    def _take_in(self, scan: Scan, before_ns: int) -> bool:
        """Pose and twist at a scan's stamp; False for the first scan, which has nothing to be compared with."""
        points = scan_points(scan, self._mount, self._settings.range_max, self._twist)
        if len(points) < MIN_POINTS:
            raise CalibrationError("a scan shows nothing to match: calibrate in a room whose walls the lidar sees")
        if self._key is None:
            self._become_key(points)
            return False
        seconds = (scan.stamp_ns - before_ns) * 1e-9
        turn = self._turn(before_ns, scan.stamp_ns)
        guess = self._key_from_base @ arc(self._twist.v * seconds, turn)
        window = Window(0.25, 0.05)
        # The gyro knows the turn better than a scan does; the way is the scan's to find.
        trust = np.diag([1.0, 1.0, 1.0 / 0.01**2])
        found = match(points.thinned(_MOST_POINTS), self._key, guess, trust, window, self._settings)
        if found.inliers < _LEAST_INLIERS:
            raise CalibrationError("a scan does not fit the one before it: calibrate in a room that stands still")
        moved = self._key_from_base.inverse() @ found.pose
        self._twist = Twist(_arc_length(moved) / seconds, turn / seconds)
        self._key_from_base = found.pose
        if np.hypot(found.pose.x, found.pose.y) > _KEY_DISTANCE or abs(found.pose.theta) > _KEY_ANGLE:
            self._become_key(points)
        return True

    def _become_key(self, points: ScanPoints) -> None:
        settings = self._settings
        self._key = reference_from_points(points.points, points.normals, settings.resolution, settings.sigma)
        self._key_from_base = Pose2()

    def _turn(self, begin_ns: int, end_ns: int) -> float:
        """Turn [rad] between two moments by the gyro; readings that are older than both are forgotten."""
        self._gyro = [reading for reading in self._gyro if reading.stamp_ns >= begin_ns - 20_000_000]
        turn = 0.0
        for before, after in pairwise(self._gyro):
            overlap = min(after.stamp_ns, end_ns) - max(before.stamp_ns, begin_ns)
            turn += max(overlap, 0) * 1e-9 * (float(after.gyro[2]) - self._bias)
        return turn


def held(simulator: Simulator, forward_volts: float, turn_volts: float, seconds: float) -> tuple[SensorMessage, ...]:
    """The messages of a whole number of ticks with the lines at these volts.

    Raises:
        WorldError: the chair touched something meanwhile, which spoils what is measured.
    """
    before = simulator.contacts
    simulator.drive(forward_volts, turn_volts)
    messages = simulator.advance(round(seconds * 1e9 / TICK_NS) * TICK_NS)
    if simulator.contacts > before or simulator.in_contact:
        pose = simulator.truth()
        raise WorldError(f"the chair touched something at ({pose.x:.1f}, {pose.y:.1f}): calibrate in a larger hall")
    return messages


def _arc_length(moved: Pose2) -> float:
    """Signed length [m] of the arc to a pose: its chord's part along the mean heading, lengthened by the bend."""
    half = 0.5 * moved.theta
    chord = moved.x * np.cos(half) + moved.y * np.sin(half)
    return float(chord / np.sinc(half / np.pi))
