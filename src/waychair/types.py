"""Data types that packages exchange: poses, scans, pictures, odometry, maps, goals and reports, as frozen dataclasses.

Units are metres, radians in (-pi, pi] and volts; times are integer nanoseconds (`stamp_ns`). The base frame is x
forward, y left, z up (REP-103) with its origin in the middle of the drive axle; frames are map -> odom -> base_link ->
sensors (REP-105). A transform is named `a_from_b` and takes coordinates in b to coordinates in a. Arrays are not
copied: a receiver must not write to them.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

FloatArray: TypeAlias = NDArray[np.float64]
Float32Array: TypeAlias = NDArray[np.float32]
IntArray: TypeAlias = NDArray[np.int64]
BoolArray: TypeAlias = NDArray[np.bool_]
Bytes: TypeAlias = NDArray[np.uint8]
Cells: TypeAlias = NDArray[np.int8]

UNKNOWN = -1
"""The value of an unknown cell in `OccupancyGrid.cells` (nav_msgs/OccupancyGrid)."""


@dataclass(frozen=True, slots=True)
class Pose2:
    """A pose in the plane: x, y [m], theta [rad]."""

    x: float = 0.0
    y: float = 0.0
    theta: float = 0.0

    def __matmul__(self, other: Pose2) -> Pose2:
        """Return the composition `a_from_c = a_from_b @ b_from_c`, theta wrapped to (-pi, pi]."""
        c, s = math.cos(self.theta), math.sin(self.theta)
        theta = math.remainder(self.theta + other.theta, math.tau)
        return Pose2(
            self.x + c * other.x - s * other.y,
            self.y + s * other.x + c * other.y,
            math.pi if theta == -math.pi else theta,
        )

    def inverse(self) -> Pose2:
        """`b_from_a` of `a_from_b`."""
        c, s = math.cos(self.theta), math.sin(self.theta)
        return Pose2(-c * self.x - s * self.y, s * self.x - c * self.y, -self.theta)

    def array(self) -> FloatArray:
        """(3,) float64: x, y, theta."""
        return np.array([self.x, self.y, self.theta])


@dataclass(frozen=True, slots=True)
class Pose3:
    """A pose in space: rotation (3, 3), translation (3,) [m]."""

    rotation: FloatArray
    translation: FloatArray

    def __matmul__(self, other: Pose3) -> Pose3:
        """Return the composition `a_from_c = a_from_b @ b_from_c`."""
        return Pose3(self.rotation @ other.rotation, self.rotation @ other.translation + self.translation)

    def inverse(self) -> Pose3:
        """`b_from_a` of `a_from_b`."""
        return Pose3(self.rotation.T, -self.rotation.T @ self.translation)

    def planar(self) -> Pose2:
        """Return its x, y and yaw."""
        yaw = math.atan2(self.rotation[1, 0], self.rotation[0, 0])
        return Pose2(float(self.translation[0]), float(self.translation[1]), yaw)


@dataclass(frozen=True, slots=True)
class Trajectory:
    """Poses over time, in recording order: stamps_ns (N,) int64, poses (N, 3) [m, m, rad]."""

    stamps_ns: IntArray
    poses: FloatArray


@dataclass(frozen=True, slots=True)
class Trajectory3:
    """Poses in space over time: stamps_ns (N,) int64, rotations (N, 3, 3), positions (N, 3) [m]."""

    stamps_ns: IntArray
    rotations: FloatArray
    positions: FloatArray


@dataclass(frozen=True, slots=True)
class Twist:
    """Velocity of the base in its own frame: v [m/s] forward, omega [rad/s] to the left."""

    v: float = 0.0
    omega: float = 0.0


@dataclass(frozen=True, slots=True)
class WheelSpeeds:
    """Ground speed of the drive wheels [m/s], forward positive."""

    left: float = 0.0
    right: float = 0.0


@dataclass(frozen=True, slots=True)
class WheelTicks:
    """Encoder counts of the drive wheels (32 bit, wrapping), forward positive."""

    stamp_ns: int
    left: int
    right: int


@dataclass(frozen=True, slots=True)
class Scan:
    """One planar laser scan; `stamp_ns` is the time of its first beam.

    Beam i points at `angle_min + i * angle_step` [rad] in the laser frame, `i * time_step` [s] after the stamp.
    `ranges` is (N,) float32 [m] by REP-117: +inf nothing seen, -inf too close, nan invalid.
    """

    stamp_ns: int
    ranges: Float32Array
    angle_min: float
    angle_step: float
    time_step: float = 0.0
    range_min: float = 0.0
    range_max: float = math.inf

    def angles(self) -> FloatArray:
        """(N,) beam angles [rad] in the laser frame."""
        return self.angle_min + self.angle_step * np.arange(len(self.ranges), dtype=np.float64)


@dataclass(frozen=True, slots=True)
class RgbdFrame:
    """Registered colour and depth: rgb (H, W, 3) or gray (H, W) u8, depth (H, W) f32 [m] (nan none), camera (3, 3).

    `stamp_ns` is the time of the middle row; each row is exposed `row_step` [s] after the one above (rolling shutter).
    """

    stamp_ns: int
    image: Bytes
    depth: Float32Array
    camera_matrix: FloatArray
    row_step: float = 0.0


@dataclass(frozen=True, slots=True)
class ImuSample:
    """REP-145: accel (3,) [m/s^2] with +g upwards at rest, nan where it is unknown; gyro (3,) [rad/s]."""

    stamp_ns: int
    accel: FloatArray
    gyro: FloatArray


@dataclass(frozen=True, slots=True)
class SonarReadings:
    """Ranges of the K sonars, (K,) f32 [m]."""

    stamp_ns: int
    ranges: Float32Array


@dataclass(frozen=True, slots=True)
class PressureSample:
    """A barometer's reading: the pressure of the air [Pa]."""

    stamp_ns: int
    pascal: float


@dataclass(frozen=True, slots=True)
class PanTiltCommand:
    """An order to the servo camera: pan to the left in [0, 2 pi) and tilt up [rad] from base's x axis, and the laser."""

    stamp_ns: int
    pan: float
    tilt: float
    laser: bool = False


@dataclass(frozen=True, slots=True)
class PanTiltAngles:
    """The angles [rad] that the servos report, as in `PanTiltCommand`; `settled`: the camera is at rest there."""

    stamp_ns: int
    pan: float
    tilt: float
    settled: bool


@dataclass(frozen=True, slots=True)
class Picture:
    """A colour picture of the servo camera: image (H, W, 3) u8, camera (3, 3); `laser`: its line was ordered on."""

    stamp_ns: int
    image: Bytes
    camera_matrix: FloatArray
    laser: bool = False


SensorMessage: TypeAlias = WheelTicks | Scan | ImuSample | RgbdFrame | SonarReadings | PressureSample
"""A message of a chair's sensors."""

ServoMessage: TypeAlias = PanTiltAngles | Picture
"""A message of the camera on servos, which only perceives for a rider: nothing that drives the chair hears it."""


@dataclass(frozen=True, slots=True)
class Odometry:
    """Dead reckoning: pose in odom, twist in base, covariance (3, 3) of x, y, theta [m^2, m rad, rad^2]."""

    stamp_ns: int
    odom_from_base: Pose2
    twist: Twist = Twist()
    covariance: FloatArray | None = None


@dataclass(frozen=True, slots=True)
class SensorFrame:
    """The measurements at the stamp of one scan (or image), and all wheel and IMU readings since the previous frame."""

    stamp_ns: int
    scan: Scan | None = None
    rgbd: RgbdFrame | None = None
    sonar: SonarReadings | None = None
    wheels: tuple[WheelTicks | Odometry, ...] = ()
    imu: tuple[ImuSample, ...] = ()


class DriveMode(enum.Enum):
    """The party in control of the motors: the rider's joystick, the rider with limits, the computer, nobody, or the rider's
    joystick within the caps of the board's guard."""

    MANUAL = "manual"
    ASSISTED = "assisted"
    AUTONOMOUS = "autonomous"
    STOPPED = "stopped"
    GUARDED = "guarded"


class HelpLevel(enum.Enum):
    """The help that a rider has chosen while driving by the chair's own joystick.

    INFORM: told of things, nothing touches the motion. GUARD: slowed or stopped, never steered. GUIDE: guarded, and led to
    a place by steps.
    """

    INFORM = "inform"
    GUARD = "guard"
    GUIDE = "guide"


@dataclass(frozen=True, slots=True)
class JoystickInput:
    """The joystick's deflection: forward and turn (left positive), each in [-1, 1]."""

    stamp_ns: int
    forward: float = 0.0
    turn: float = 0.0


@dataclass(frozen=True, slots=True)
class SentCommand:
    """The values written to the joystick lines: DAC counts and volts of the forward and turn axes.

    `active` is false when the computer has released the lines (the rider's joystick is live); `reason` says why.
    """

    stamp_ns: int
    wheel_speeds: WheelSpeeds
    forward_counts: int
    turn_counts: int
    forward_volts: float
    turn_volts: float
    active: bool
    reason: str = ""


@dataclass(frozen=True, slots=True)
class GuardReport:
    """The board's guard over the rider's own joystick: its `caps` in force to the front, the rear, the left and the right,
    in [0, 1] of the swing.

    `capped`: a cap holds the stick back. `warns`: an override by a long push is about to begin; `overridden`: it lasts.
    `lost`: the computer was lost, and the caps stay narrow until the stick was at rest.
    """

    caps: tuple[float, float, float, float]
    capped: bool = False
    warns: bool = False
    overridden: bool = False
    lost: bool = False


@dataclass(frozen=True, slots=True)
class Telemetry:
    """The board's report: read-back volts of the lines, the rider's joystick, fault names, state, line holder.

    `round_trip_ns` is the time from the last echoed command to its echo, None before the first. `guard`: the board's guard
    over the rider's joystick, None without one.
    """

    stamp_ns: int
    forward_volts: float
    turn_volts: float
    joystick: JoystickInput
    faults: tuple[str, ...] = ()
    state: str = ""
    holder: str = ""
    round_trip_ns: int | None = None
    guard: GuardReport | None = None


@dataclass(frozen=True, slots=True)
class ChairStatus:
    """The chair's contacts: seat occupied, charger connected, charge in [0, 1]; None: not reported."""

    stamp_ns: int
    seated: bool | None = None
    charging: bool | None = None
    battery: float | None = None


@dataclass(frozen=True, slots=True)
class Place:
    """A named place: its pose in map, and the tolerances of reaching it [m], [rad]."""

    name: str
    pose: Pose2
    tolerance_m: float = 0.15
    tolerance_rad: float = math.radians(5.0)


@dataclass(frozen=True, slots=True)
class OccupancyGrid:
    """A grid map: cells (H, W) int8, -1 unknown or 0..100 % occupied, `cells[row=y, col=x]`; resolution [m].

    `map_from_grid` is the pose of the lower-left corner of cell (0, 0) (nav_msgs/MapMetaData origin).
    """

    cells: Cells
    resolution: float
    map_from_grid: Pose2 = field(default_factory=Pose2)


@dataclass(frozen=True, slots=True)
class Path:
    """Poses (N, 3) float64 [m, m, rad] in map, from the start to the goal."""

    poses: FloatArray

    def length(self) -> float:
        """Return the sum of the straight steps [m]."""
        return float(np.hypot(*np.diff(self.poses[:, :2], axis=0).T).sum())


@dataclass(frozen=True, slots=True)
class Goal:
    """A goal: a pose in map or the name of a place, and the tolerances [m], [rad].

    `waiting`: circles x, y, radius [m] in map in which people stand and wait, such as a lift and the ground before it.
    """

    target: Pose2 | str
    tolerance_m: float = 0.15
    tolerance_rad: float = math.radians(5.0)
    waiting: tuple[tuple[float, float, float], ...] = ()


Json: TypeAlias = dict[str, Any]
"""A JSON object, as in a report."""
