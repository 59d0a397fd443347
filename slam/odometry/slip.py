"""Detection of slip of both drive wheels at once: wheel speed against the accelerometer."""

from __future__ import annotations

LONGEST_S = 1.0
"""Longest slip; later the speed by the accelerometer is too uncertain."""

_PULL_S = 0.4  # time constant of the pull towards the wheels' speed
_LEARN_S = 1.0  # time constant of the accelerometer's offset (its bias, and gravity on a slope)


class SlipDetector:
    """A complementary filter of the speed: integrated from the accelerometer, pulled to the wheels, with an offset.

    The speed of spinning or locked wheels jumps away from it, because the chair's mass does not follow. A slope also
    separates wheels and accelerometer, but more slowly than the pull. The filter is of second order (Mahony et al., IEEE
    TAC 2008, for one axis).
    """

    def __init__(self, limit: float) -> None:
        """`limit` [m/s] is the speed difference beyond which the wheels slip."""
        self._limit = limit
        self._speed: float | None = None
        self._offset = 0.0
        self._slipped_s = 0.0

    def add_acceleration(self, accel: float, seconds: float) -> None:
        """Add the forward acceleration [m/s^2] over some time."""
        if self._speed is not None:
            self._speed += (accel - self._offset) * seconds

    def slip_speed(self, wheels: float, seconds: float) -> float | None:
        """Return the speed [m/s] by the accelerometer if the wheels slip, else None."""
        if self._speed is None:
            self._speed = wheels
        off = wheels - self._speed
        if abs(off) > self._limit and self._slipped_s < LONGEST_S:
            self._slipped_s += seconds
            return self._speed
        if abs(off) > self._limit:
            self._speed, off = wheels, 0.0
        self._slipped_s = 0.0
        part = min(seconds / _PULL_S, 1.0)
        self._speed += part * off
        self._offset -= part * off / _LEARN_S
        return None
