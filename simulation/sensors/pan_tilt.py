"""Two hobby servos that turn a camera: rate, settling, limits, backlash, and faults for tests.

A pan servo does not wrap: from 350 to 10 degrees it turns back through all directions between. The report comes from
the motor's side; the camera follows it with the play of the gears.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from waychair.calibration.servo_camera_mount import PAN_LIMITS, TILT_LIMITS
from waychair.types import PanTiltAngles, PanTiltCommand

RATE = math.radians(60.0) / 0.17
"""rad/s; a hobby servo turns by 60 degrees in 0.15 to 0.2 s."""

SETTLING_NS = 150_000_000
"""The camera shakes for this time after its servos have come to rest."""

BACKLASH = math.radians(0.5)
"""rad; play of the gears: the camera follows only after the motor has turned by this the other way."""


@dataclass(frozen=True, slots=True)
class ServoCameraFaults:
    """Defects of a servo camera, for tests: a covered lens, a laser without light, servos that lie.

    `pan_stuck`: the pan servo stays where it is. `pan_error` [rad]: its report is off by this. `echoes`: the report is the
    order, whatever the servo does.
    """

    dark: bool = False
    laser_off: bool = False
    pan_stuck: bool = False
    pan_error: float = 0.0
    echoes: bool = False


class _Servo:
    """One servo: the order, the motor's angle and the camera's, which lags by the play."""

    def __init__(self, low: float, high: float) -> None:
        self._low, self._high = low, high
        self.wanted = self.motor = self.camera = min(max(0.0, low), high)

    def order(self, angle: float) -> None:
        """Take an order; the servo stops at its limits."""
        self.wanted = min(max(angle, self._low), self._high)

    def step(self, seconds: float) -> bool:
        """Turn for a time; return whether the motor turns."""
        away = self.wanted - self.motor
        if away == 0.0:
            return False
        most = RATE * seconds
        self.motor = self.wanted if abs(away) <= most else self.motor + math.copysign(most, away)
        self.camera = min(max(self.camera, self.motor - BACKLASH / 2), self.motor + BACKLASH / 2)
        return True


class PanTilt:
    """The servos of one camera; angles [rad] as in `PanTiltCommand`. They begin at 0, level and straight ahead."""

    def __init__(self) -> None:
        self._pan, self._tilt = _Servo(*PAN_LIMITS), _Servo(*TILT_LIMITS)
        self._still_ns = SETTLING_NS
        self._stuck = False
        self.laser = False
        """Whether the laser is ordered on."""

    @property
    def angles(self) -> tuple[float, float]:
        """The camera's true pan and tilt [rad]."""
        return self._pan.camera, self._tilt.camera

    @property
    def turning(self) -> bool:
        """Whether a motor turns."""
        return self._still_ns == 0

    def order(self, command: PanTiltCommand) -> None:
        """Take an order.

        Raises:
            ValueError: an angle is not finite; the servos keep their last order.
        """
        if not (math.isfinite(command.pan) and math.isfinite(command.tilt)):
            raise ValueError(f"the camera cannot turn to ({command.pan}, {command.tilt}) rad: give finite angles")
        self._pan.order(command.pan)
        self._tilt.order(command.tilt)
        self.laser = command.laser

    def step(self, step_ns: int, faults: ServoCameraFaults) -> None:
        """Let time pass."""
        self._stuck = faults.pan_stuck
        turns = [self._tilt.step(step_ns * 1e-9)]
        if not self._stuck:
            turns.append(self._pan.step(step_ns * 1e-9))
        self._still_ns = 0 if any(turns) else self._still_ns + step_ns

    def report(self, stamp_ns: int, faults: ServoCameraFaults) -> PanTiltAngles:
        """Return the angles that the servos report."""
        pan = self._pan.wanted if faults.echoes else self._pan.motor + faults.pan_error
        return PanTiltAngles(stamp_ns, pan, self._tilt.motor, self._still_ns >= SETTLING_NS)
