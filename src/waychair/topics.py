"""Message streams between the parts of a chair: type, nominal rate, and the age at which a message is stale.

A topic is stale when its last message is older than `patience` periods of its nominal rate. `ros_topics` and
`ros.topics` give these streams their ROS names, types and QoS.
"""

from __future__ import annotations

from dataclasses import dataclass

from waychair.types import (
    ChairStatus,
    Goal,
    ImuSample,
    JoystickInput,
    OccupancyGrid,
    Odometry,
    Path,
    PressureSample,
    RgbdFrame,
    Scan,
    SonarReadings,
    Telemetry,
    Twist,
    WheelTicks,
)


@dataclass(frozen=True, slots=True)
class Topic:
    """One kind of message: its name, type and nominal rate [Hz]; rate 0: sent on change."""

    name: str
    type: type
    rate_hz: float
    patience: float = 3.0

    def max_age_ns(self) -> int | None:
        """Return the age [ns] beyond which the last message is stale; None for topics without a rate."""
        return None if self.rate_hz == 0 else round(self.patience * 1e9 / self.rate_hz)

    def is_stale(self, stamp_ns: int | None, now_ns: int) -> bool:
        """Return whether a message with this stamp (None: never received) is too old, or as far in the future."""
        limit = self.max_age_ns()
        if limit is None:
            return False
        return stamp_ns is None or abs(now_ns - stamp_ns) > limit


SCAN = Topic("scan", Scan, 10.0, patience=5.0)  # the chair slows down from 3 missed periods on (F11)
WHEELS = Topic("wheel_ticks", WheelTicks, 50.0, patience=5.0)
IMU = Topic("imu/data", ImuSample, 200.0, patience=60.0)  # 0.3 s, like the camera (F13)
CAMERA = Topic("camera", RgbdFrame, 15.0, patience=4.5)
SONAR = Topic("sonar", SonarReadings, 20.0)
PRESSURE = Topic("pressure", PressureSample, 10.0)
JOYSTICK = Topic("joystick", JoystickInput, 50.0, patience=5.0)
ODOMETRY = Topic("odom", Odometry, 50.0, patience=5.0)
MAP = Topic("map", OccupancyGrid, 0.0)
GOAL = Topic("goal_pose", Goal, 0.0)
PLAN = Topic("plan", Path, 0.0)
COMMAND = Topic("cmd_vel", Twist, 20.0)
TELEMETRY = Topic("telemetry", Telemetry, 50.0, patience=5.0)
STATUS = Topic("chair_status", ChairStatus, 2.0)
