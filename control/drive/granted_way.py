"""The way that a chair's authority leaves on the present leg of its drive."""

from __future__ import annotations

import math

from waychair.calibration.chair_body import ChairBody
from waychair.control.authority import FREE, HELD_WITHIN, Authority, fastest_before
from waychair.control.drive.navigator_state import MotionState, PlanState
from waychair.planning.window.motion_limits import DwaSettings


class GrantedWay:
    """The `authority` of a navigator, which the fleet's part of the chair replaces, and what it means for the plan."""

    def __init__(self, body: ChairBody, plan: PlanState, now: MotionState) -> None:
        self.authority: Authority = FREE
        self._body, self._plan, self._now = body, plan, now

    @property
    def holds(self) -> bool:
        """Whether the chair stands, or is about to, because its authority ends."""
        return self.authority.stands or (self.authority.line is not None and self._left() < HELD_WITHIN)

    def fastest(self, limits: DwaSettings) -> float:
        """Return the highest granted speed [m/s] from which the chair still stops in comfort before its stop line."""
        return min(self.authority.speed, fastest_before(self._left(), self._now.command.v, limits))

    def _left(self) -> float:
        if not self._plan.legs:
            return 0.0 if self.authority.stands else math.inf
        return self.authority.way_left(self._body, self._now.pose, self._plan.legs[0].path.poses)
