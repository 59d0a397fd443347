"""Detection of a chair that is pushed by hand: its wheels turn although nobody drives it.

A chair whose lines were just released rolls out; it can count as pushed only after it has stood. The wheels' own counts tell it:
an estimated pose creeps while the chair stands, as its estimate of the past improves.
"""

from __future__ import annotations

from waychair.calibration.chair_body import ChairBody
from waychair.control.safety.supervisor import SupervisorSettings, deflection_of
from waychair.slam.odometry.wheel_counts import wheel_paths
from waychair.types import JoystickInput, WheelTicks

MOVED_M, MOVED_RAD = 0.05, 0.1
"""m, rad; a chair whose wheels drove or turned it farther than this from where it stood has moved."""

STANDS_S = 1.0
"""s; a chair that has not moved for so long stands."""


class Pushing:
    """The detection's state.

    `pushed`: the chair is moved by hand, or was until a moment ago. `stands_again`: it came to rest after a push at the
    last update.
    """

    def __init__(self, body: ChairBody, at_rest: float = SupervisorSettings().at_rest) -> None:
        """`at_rest` is the deflection up to which no hand is on the stick."""
        self._body, self._at_rest = body, at_rest
        self._stood: WheelTicks | None = None
        self._since_ns = 0
        self._rests = False
        self.pushed = self.stands_again = False

    def update(self, now_ns: int, released: bool, stick: JoystickInput | None, wheels: WheelTicks | None) -> bool:
        """Take in the rider's stick, the wheels' latest counts and whether the lines are released.

        Return `stands_again`.
        """
        self.stands_again = self._has_come_to_rest(now_ns, released, stick, wheels)
        return self.stands_again

    def _has_come_to_rest(
        self, now_ns: int, released: bool, stick: JoystickInput | None, wheels: WheelTicks | None
    ) -> bool:
        if not released or stick is None or wheels is None or not deflection_of(stick) <= self._at_rest:
            self._stood, self._rests, self.pushed = None, False, False
            return False
        if self._stood is None or self._is_away(self._stood, wheels):
            self.pushed = self.pushed or self._rests
            self._stood, self._since_ns = wheels, now_ns
            return False
        if now_ns - self._since_ns < STANDS_S * 1e9:
            return False
        stands_again, self.pushed, self._rests = self.pushed, False, True
        return stands_again

    def _is_away(self, stood: WheelTicks, here: WheelTicks) -> bool:
        left, right = wheel_paths(stood, here, self._body)
        return abs(left + right) / 2 > MOVED_M or abs(right - left) / self._body.track > MOVED_RAD
