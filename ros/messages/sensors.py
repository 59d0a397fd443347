"""Decoding messages of sensors and drivers: scans, IMU samples, wheels, sonars, joystick and battery.

Invalid messages raise a `MessageError` that names the defect. `waychair.recordings.bags.ros_messages` encodes the messages that bags hold
too; the other encoders are here.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from waychair.errors import MessageError
from waychair.recordings.bags.ros_decoding import imu_from_message, scan_from_message
from waychair.recordings.bags.ros_messages import IMU_FRAME, LASER_FRAME, UNREPORTED, WHEEL_JOINTS, header, make
from waychair.recordings.bags.ros_transforms import frame_name
from waychair.ros.messages.wire import require_finite, stamp_of
from waychair.types import ChairStatus, ImuSample, JoystickInput, PressureSample, Scan, SonarReadings, WheelTicks

_COUNTS = 2**32
_UNKNOWN, _CHARGING, _DISCHARGING, _NOT_CHARGING, _FULL = range(5)  # BatteryState.power_supply_status
_CONNECTED = {_CHARGING: True, _DISCHARGING: False, _NOT_CHARGING: True, _FULL: True}
"""Whether a charger is connected, by status: without one, the battery is discharging."""


def read_scan(message: Any, frame: str = LASER_FRAME) -> Scan:
    """Return the scan, by ascending angle, of a sensor_msgs/LaserScan (REP-117 codes kept) of the lidar in `frame`.

    Raises:
        MessageError: another frame, no beams, angles that are not finite, or a number of ranges that contradicts the angles.
    """
    stamp_of(message)
    _require_sensor(message, frame, "scan_frame")
    require_finite("a scan's angle", message.angle_min, message.angle_max, message.angle_increment)
    scan = scan_from_message(message)
    if scan is None:
        raise MessageError(f"a scan of {len(message.ranges)} ranges is invalid: check the lidar's driver")
    beams = 1.0 + (message.angle_max - message.angle_min) / message.angle_increment
    if abs(beams - len(scan.ranges)) > 1.5:  # drivers disagree on whether the last angle is that of the last beam
        raise MessageError(
            f"a scan has {len(scan.ranges)} ranges, but {beams:.0f} beams by its angles: check the lidar's driver"
        )
    return scan


def read_pressure(message: Any) -> PressureSample:
    """Return the sample of a sensor_msgs/FluidPressure.

    Raises:
        MessageError: the pressure is not finite.
    """
    stamp_ns = stamp_of(message)
    require_finite("a pressure", message.fluid_pressure)
    return PressureSample(stamp_ns, float(message.fluid_pressure))


def read_imu(message: Any, frame: str = IMU_FRAME) -> ImuSample:
    """Return the sample of a sensor_msgs/Imu in the axes of the sensor in `frame` (REP-145).

    Raises:
        MessageError: another frame, or a rate or an acceleration that is not finite or is marked as not measured.
    """
    stamp_of(message)
    _require_sensor(message, frame, "imu_frame")
    for what, covariance in (
        ("rate", message.angular_velocity_covariance),
        ("acceleration", message.linear_acceleration_covariance),
    ):
        if covariance[0] == UNREPORTED[0]:
            raise MessageError(f"an IMU sample holds no {what}: let the driver send imu/data with both")
    sample = imu_from_message(message)
    if sample is None:
        raise MessageError("an IMU sample holds a value that is not finite: check the IMU's driver")
    return sample


def _require_sensor(message: Any, frame: str, name: str) -> None:
    """Refuse messages of a sensor whose mount is not in the chair's file; `name` is the setting for its frame."""
    found = frame_name(message.header.frame_id)
    if found != frame_name(frame):
        raise MessageError(
            f"a message in the frame '{found}' is not of the sensor in '{frame}', whose mount is in the chair's file: "
            f"set the frame of its driver to '{frame}', or set {name}"
        )


def read_wheels(message: Any, ticks_per_turn: int) -> WheelTicks:
    """Return the counts of the two drive wheels in a sensor_msgs/JointState, which may hold other joints.

    Raises:
        MessageError: a wheel is missing, or its angle is not finite.
    """
    angles = dict(zip(message.name, message.position, strict=False))
    missing = [joint for joint in WHEEL_JOINTS if joint not in angles]
    if missing:
        raise MessageError(f"the joints {', '.join(message.name) or '(none)'} lack {missing[0]}: use this joint name")
    counts = [float(angles[joint]) * ticks_per_turn / math.tau for joint in WHEEL_JOINTS]
    require_finite("a wheel's angle", *counts)
    left, right = (_wrapped(round(count)) for count in counts)
    return WheelTicks(stamp_of(message), left, right)


def _wrapped(count: int) -> int:
    return (count + _COUNTS // 2) % _COUNTS - _COUNTS // 2


def read_range(message: Any) -> float:
    """Return the distance [m] of one sonar's sensor_msgs/Range; distances outside its limits become REP-117 codes.

    Raises:
        MessageError: the limits are impossible.
    """
    stamp_of(message)
    low, high, distance = float(message.min_range), float(message.max_range), float(message.range)
    if not 0.0 <= low < high:
        raise MessageError(f"a sonar measures from {low:g} to {high:g} m, which is impossible: check its driver")
    if distance < low:
        return -math.inf
    return math.inf if distance > high else distance


class SonarRing:
    """Collects the separate messages of the K sonars into readings of one stamp."""

    def __init__(self, count: int) -> None:
        self._stamp_ns = -1
        self._ranges = np.full(count, np.nan, np.float32)
        self._heard = 0

    def hear(self, index: int, message: Any) -> SonarReadings | None:
        """Take one sonar's message; return the readings of a stamp once they are complete, else None.

        A stamp with missing sonars (nan) is complete when the next stamp begins.

        Raises:
            MessageError: see `read_range`.
        """
        distance, stamp_ns = read_range(message), stamp_of(message)
        earlier = None
        if stamp_ns != self._stamp_ns:
            earlier = self._completed() if self._heard else None
            self._stamp_ns = stamp_ns
        self._ranges[index] = distance
        self._heard += 1
        return self._completed() if self._heard == len(self._ranges) else earlier

    def _completed(self) -> SonarReadings:
        readings = SonarReadings(self._stamp_ns, self._ranges)
        self._ranges, self._heard = np.full(len(self._ranges), np.nan, np.float32), 0
        return readings


def joy(stick: JoystickInput) -> Any:
    """Return a sensor_msgs/Joy with the axes of teleop_twist_joy: turn (left positive), forward."""
    axes = np.array([stick.turn, stick.forward], np.float32)
    return make("sensor_msgs/msg/Joy", header(stick.stamp_ns, ""), axes, np.zeros(0, np.int32))


def read_joy(message: Any) -> JoystickInput:
    """Return the first stick of a sensor_msgs/Joy, clipped to [-1, 1].

    Raises:
        MessageError: fewer than two axes, or an axis that is not finite.
    """
    if len(message.axes) < 2:
        raise MessageError(f"a joystick of {len(message.axes)} axes cannot steer: it takes two, turn and forward")
    turn, forward = (float(axis) for axis in message.axes[:2])
    require_finite("a joystick's axis", turn, forward)
    return JoystickInput(stamp_of(message), min(max(forward, -1.0), 1.0), min(max(turn, -1.0), 1.0))


def read_page_joystick(message: Any) -> JoystickInput | None:
    """Return a page's joystick as `read_joy`; None for a message without axes, i.e. a release.

    Raises:
        MessageError: see `read_joy`.
    """
    return read_joy(message) if len(message.axes) else None


def battery(status: ChairStatus) -> Any:
    """Return a sensor_msgs/BatteryState; unmeasured fields are nan."""
    kinds = {None: _UNKNOWN, True: _CHARGING, False: _DISCHARGING}
    nothing, none = math.nan, np.zeros(0, np.float32)
    percentage = nothing if status.battery is None else status.battery
    return make(
        "sensor_msgs/msg/BatteryState",
        header=header(status.stamp_ns, ""),
        voltage=nothing,
        temperature=nothing,
        current=nothing,
        charge=nothing,
        capacity=nothing,
        design_capacity=nothing,
        percentage=percentage,
        power_supply_status=kinds[status.charging],
        power_supply_health=_UNKNOWN,
        power_supply_technology=_UNKNOWN,
        present=status.battery is not None,
        cell_voltage=none,
        cell_temperature=none,
        location="",
        serial_number="",
    )


def read_battery(message: Any) -> ChairStatus:
    """Return the charge and the charger's state of a sensor_msgs/BatteryState; the seat is None.

    Raises:
        MessageError: a charge outside [0, 1].
    """
    charge = float(message.percentage)
    if not math.isnan(charge) and not 0.0 <= charge <= 1.0:
        raise MessageError(f"a battery of charge {charge:g} is impossible: send a fraction from 0 to 1")
    charging = _CONNECTED.get(message.power_supply_status)
    return ChairStatus(stamp_of(message), None, charging, None if math.isnan(charge) else charge)
