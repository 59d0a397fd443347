"""Slip of both drive wheels at once: their speed against what the accelerometer makes of it."""

from __future__ import annotations

LONGEST_S = 1.0
"""An accelerometer tells the speed for no longer."""

_PULL_S = 0.4  # the speed follows that of the wheels within this time
_LEARN_S = 1.0  # the accelerometer's offset (its bias, and gravity on a slope) within this


class SpeedWatch:
    """A speed that is led by the accelerometer and pulled to that of the wheels, and the offset that this shows.

    Wheels that spin or lock jump away from it, since the chair's mass does not follow; a slope, which also tells wheels
    and accelerometer apart, comes on more slowly than the pull. It is the complementary filter of second order
    (Mahony et al., IEEE TAC 2008, for one axis).
    """

    def __init__(self, limit: float) -> None:
        """`limit` [m/s] is how far off the wheels must be to slip."""
        self._limit = limit
        self._speed: float | None = None
        self._offset = 0.0
        self._slipped_s = 0.0

    def feel(self, accel: float, seconds: float) -> None:
        """The accelerometer's forward axis [m/s^2] over some time."""
        if self._speed is not None:
            self._speed += (accel - self._offset) * seconds

    def compare(self, wheels: float, seconds: float) -> float | None:
        """The speed [m/s] by the accelerometer if the wheels' speed [m/s] is slip; None where they can be believed."""
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
