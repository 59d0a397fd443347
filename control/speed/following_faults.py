"""Checks that the chair follows its commands (F20) and stands at neutral (F21).

The limits are those of the fault table: 0.3 m/s for 0.5 s, and 0.05 m/s for 0.3 s. Both apply to the faster wheel.
"""

from __future__ import annotations

import math

from waychair.control.speed.axis_response import AxisResponse
from waychair.types import Twist

RESIDUAL, RESIDUAL_S = 0.3, 0.5
"""m/s, s; F20: a wheel speed farther than this from the expected one for so long is a fault."""

STUCK_COMMAND, STUCK_V, STUCK_S = 0.08, 0.02, 2.0
"""m/s, m/s, s; F20: at a wheel speed commanded above the first, a measured one below the second for so long is a fault.
The time includes the parking brake's opening."""

CREEP, CREEP_S = 0.05, 0.3
"""m/s, s; F21: a faster wheel at neutral for so long is a fault."""

COASTING = 0.6
"""m/s^2; F21: every chair slows down at least as fast as this."""


class _Lasting:
    """The time over which a condition has held without a break."""

    def __init__(self) -> None:
        self._since_ns: int | None = None

    def seconds(self, so: bool, now_ns: int) -> float:
        """Return the seconds up to now; 0 if the condition does not hold, or has just begun to."""
        if not so:
            self._since_ns = None
            return 0.0
        if self._since_ns is None:
            self._since_ns = now_ns
        return (now_ns - self._since_ns) * 1e-9


class FollowingWatch:
    """The clocks of F20 and F21; a fault stays until a new watch is made."""

    def __init__(self, forward: AxisResponse, turn: AxisResponse, track: float) -> None:
        """`track` [m] is the distance between the drive wheels."""
        self._half_track = 0.5 * track
        self._settling_s = max(axis.delay_s + 4.0 * axis.lag_s for axis in (forward, turn))
        self._off, self._stuck, self._neutral, self._creeping = (_Lasting() for _ in range(4))
        self._coasting_s = 0.0
        self.stuck = False
        """Whether the fault is that the wheels tell no motion."""
        self.fault = ""

    def driving(self, sent: Twist, expected: Twist | None, measured: Twist, now_ns: int) -> str:
        """Check F20 in one tick of driving; return the fault with its remedy, or "".

        `expected` is the mean twist that the chair should have had since the tick before, None while its brake may
        still be opening.
        """
        self._rest()
        missed = 0.0
        if expected is not None:
            missed = self._at_wheel(Twist(expected.v - measured.v, expected.omega - measured.omega))
        if self._off.seconds(missed > RESIDUAL, now_ns) >= RESIDUAL_S:
            self._found(
                f"the chair does not follow (F20): {measured.v:.2f} m/s, {measured.omega:.2f} rad/s instead of "
                f"{_text(expected)}; check free-wheel levers, slope and speed dial"
            )
        stuck = self._at_wheel(sent) > STUCK_COMMAND and self._at_wheel(measured) < STUCK_V
        if self._stuck.seconds(stuck, now_ns) >= STUCK_S:
            self.stuck = not self.fault
            self._found(
                f"the chair does not move (F20) at a command of {sent.v:.2f} m/s, {sent.omega:.2f} rad/s; "
                "check free-wheel levers, brakes and obstacles"
            )
        return self.fault

    def at_neutral(self, measured: Twist, now_ns: int) -> str:
        """Check F21 in one tick with the lines held at neutral; return the fault with its remedy, or "".

        A moving chair may coast for its delay, four lags and the time to rest at `COASTING`.
        """
        self._off.seconds(False, now_ns)
        self._stuck.seconds(False, now_ns)
        speed = self._at_wheel(measured)
        held_s = self._neutral.seconds(True, now_ns)
        if held_s == 0.0:
            self._coasting_s = self._settling_s + speed / COASTING if speed > CREEP else 0.0
        creeps = speed > CREEP and held_s >= self._coasting_s
        if self._creeping.seconds(creeps, now_ns) >= CREEP_S:
            self._found(
                f"the chair moves at neutral (F21): {measured.v:.2f} m/s, {measured.omega:.2f} rad/s; "
                "check the lines' neutral and calibrate again"
            )
        return self.fault

    def released(self) -> str:
        """Take one tick in which the rider's joystick is live, so that the motion is not judged."""
        self._off, self._stuck = _Lasting(), _Lasting()
        self._rest()
        return self.fault

    def _rest(self) -> None:
        self._neutral, self._creeping = _Lasting(), _Lasting()

    def _found(self, fault: str) -> None:
        self.fault = self.fault or fault

    def _at_wheel(self, twist: Twist) -> float:
        """Return the speed [m/s] of the faster wheel; 0 if it is not finite."""
        speed = abs(twist.v) + abs(twist.omega) * self._half_track
        return speed if math.isfinite(speed) else 0.0


def _text(twist: Twist | None) -> str:
    return "nothing" if twist is None else f"{twist.v:.2f} m/s, {twist.omega:.2f} rad/s"
