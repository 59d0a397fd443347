"""Detection of a chair that is pushed by hand: its wheels turn although nobody drives it.

A chair whose lines were just released rolls out; it can count as pushed only after it has stood.
"""

from __future__ import annotations

import math

from waychair.control.safety.supervisor import SupervisorSettings, deflection_of
from waychair.types import JoystickInput, Odometry, Pose2

MOVED_M, MOVED_RAD = 0.05, 0.1
"""m, rad; a chair displaced or turned farther than this from where it stood has moved."""

STANDS_S = 1.0
"""s; a chair that has not moved for so long stands."""


class Pushing:
    """The detection's state. `pushed`: the chair is moved by hand, or was until a moment ago."""

    def __init__(self, at_rest: float = SupervisorSettings().at_rest) -> None:
        """`at_rest` is the deflection up to which no hand is on the stick."""
        self._at_rest = at_rest
        self._stood: Pose2 | None = None  # odom_from_base
        self._since_ns = 0
        self._rests = False
        self.pushed = False

    def update(self, now_ns: int, released: bool, stick: JoystickInput | None, wheels: Odometry | None) -> bool:
        """Take in the rider's stick, the wheels' odometry and whether the lines are released.

        Return True once when the chair stands again after a push.
        """
        if not released or stick is None or wheels is None or not deflection_of(stick) <= self._at_rest:
            self._stood, self._rests, self.pushed = None, False, False
            return False
        here = wheels.odom_from_base
        if self._stood is None or self._is_away(self._stood, here):
            self.pushed = self.pushed or self._rests
            self._stood, self._since_ns = here, now_ns
            return False
        if now_ns - self._since_ns < STANDS_S * 1e9:
            return False
        stands_again, self.pushed, self._rests = self.pushed, False, True
        return stands_again

    def _is_away(self, stood: Pose2, here: Pose2) -> bool:
        moved = stood.inverse() @ here
        return math.hypot(moved.x, moved.y) > MOVED_M or abs(moved.theta) > MOVED_RAD
