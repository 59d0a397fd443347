"""Detection of a chair that is pushed by hand: its wheels turn although nobody drives it.

A chair whose lines were just released rolls out; it can count as pushed only after it has stood.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from waychair.config import Settings, setting
from waychair.control.supervisor import SupervisorSettings, deflection_of
from waychair.types import JoystickInput, Odometry, Pose2


@dataclass(frozen=True, slots=True)
class PushingSettings(Settings):
    """Thresholds for a chair that was moved, and for one that stands."""

    way: float = setting(0.05, "m", "moved by so much from where it stood", low=0.01, high=1.0)
    turn: float = setting(0.1, "rad", "... or turned by so much", low=0.01, high=1.0)
    stands_s: float = setting(1.0, "s", "without moving so far it stands again", low=0.1, high=10.0)


class Pushing:
    """The detection's state. `pushed`: the chair is moved by hand, or was until a moment ago."""

    def __init__(self, settings: PushingSettings | None = None, at_rest: float = SupervisorSettings().at_rest) -> None:
        """`at_rest` is the deflection up to which no hand is on the stick."""
        self._settings, self._at_rest = settings or PushingSettings(), at_rest
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
        s, here = self._settings, wheels.odom_from_base
        if self._stood is None or self._is_away(self._stood, here):
            self.pushed = self.pushed or self._rests
            self._stood, self._since_ns = here, now_ns
            return False
        if now_ns - self._since_ns < s.stands_s * 1e9:
            return False
        stands_again, self.pushed, self._rests = self.pushed, False, True
        return stands_again

    def _is_away(self, stood: Pose2, here: Pose2) -> bool:
        moved = stood.inverse() @ here
        return math.hypot(moved.x, moved.y) > self._settings.way or abs(moved.theta) > self._settings.turn
