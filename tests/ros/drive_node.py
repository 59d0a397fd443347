"""A navigator's end of navigate_to_pose, as a process for tests: it "drives" 0.5 m a tick without a chair.

Goals beyond 50 m lie in a wall.
"""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass

from waychair.config import Settings
from waychair.errors import GoalOccupied
from waychair.ros.nodes.navigator_parts.navigate_action import DriveFeedback, NavigateAction
from waychair.ros.nodes.node import ChairNode, run_node
from waychair.types import Pose2

STEP_M, RATE_HZ = 0.5, 20.0


@dataclass(frozen=True, slots=True)
class DriveSettings(Settings):
    """None."""


class DriveNode(ChairNode[DriveSettings]):
    """Moves straight to its goal."""

    def __init__(self) -> None:
        super().__init__("drive", DriveSettings)
        self._left_m = 0.0
        self._goal = Pose2()
        self._cancelled = False
        self._action = NavigateAction(self, self)
        self.every(RATE_HZ, self._tick)

    def begin(self, goal: Pose2, goal_id: int) -> None:
        """See `GoalDriver`."""
        if abs(goal.x) > 50.0:
            raise GoalOccupied(f"the goal ({goal.x:g}, {goal.y:g}) lies in a wall")
        self._goal, self._left_m, self._cancelled = goal, math.hypot(goal.x, goal.y), False

    def refuse(self, reason: str) -> None:
        """See `GoalDriver`."""
        self.get_logger().error(f"a goal was refused: {reason}")

    def cancel(self) -> None:
        """See `GoalDriver`."""
        self._cancelled = True

    def _tick(self) -> None:
        if not self._action.active:
            return
        if self._cancelled:
            self._action.end(reached=False, reason="a client has canceled the goal")
            return
        self._left_m = max(self._left_m - STEP_M, 0.0)
        self._action.tell(DriveFeedback(self._goal, 1.5, self._left_m, 2, self._left_m))
        if self._left_m == 0.0:
            self._action.end(reached=True)


if __name__ == "__main__":
    sys.exit(run_node(DriveNode))
