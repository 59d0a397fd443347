"""The steps of a driver who is guided by touch: turn on the spot, drive straight, pass a door."""

from __future__ import annotations

import enum
import math
from collections.abc import Sequence
from dataclasses import dataclass

from waychair.errors import PlanningError
from waychair.geometry import wrap_angle
from waychair.planning.route.legs import DoorPassage
from waychair.types import Pose2


class NoSteps(PlanningError):
    """A goal cannot be reached by pivots and straight legs that this driver can steer; the message says where and why.

    `place` [m, m] in map is where the steps end, if that is known.
    """

    def __init__(self, message: str, place: tuple[float, float] | None = None) -> None:
        super().__init__(f"{message}; let the chair drive there by itself, or ask for help")
        self.place = place


class StepKind(enum.StrEnum):
    """The kinds of step."""

    PIVOT = "pivot"
    STRAIGHT = "straight"
    BACK = "back"
    DOOR = "door"
    ARRIVED = "arrived"


@dataclass(frozen=True, slots=True)
class Step:
    """One step from a pose to a pose, both of the drive axle's middle in the frame of the plan.

    A pivot keeps the place, `turn` [rad] is to the left positive. The other kinds keep the heading: `end` lies straight
    ahead of `start`, behind it for BACK. `room` [m] is free beside the outline on both sides of the leg. A door's step
    leads from its pivotal zone to free ground behind it.
    """

    kind: StepKind
    start: Pose2
    end: Pose2
    turn: float = 0.0
    room: float = 0.0
    door: DoorPassage | None = None

    @property
    def length(self) -> float:
        """Way of the drive axle's middle [m]."""
        return math.hypot(self.end.x - self.start.x, self.end.y - self.start.y)

    def words(self) -> str:
        """Return the step for people."""
        side = "left" if self.turn > 0.0 else "right"
        return {
            StepKind.PIVOT: f"turn {side} by {abs(math.degrees(self.turn)):.0f} degrees",
            StepKind.STRAIGHT: f"straight {self.length:.1f} m",
            StepKind.BACK: f"back {self.length:.1f} m",
            StepKind.DOOR: f"through the door, {self.length:.1f} m",
            StepKind.ARRIVED: "arrived",
        }[self.kind]


@dataclass(frozen=True, slots=True)
class StepPlan:
    """Steps in order; the last is ARRIVED. Between two of them the chair stands."""

    steps: tuple[Step, ...]

    @property
    def length(self) -> float:
        """Way of all legs [m]."""
        return sum(step.length for step in self.steps)


LEAST_TURN = math.radians(2.5)
"""rad; a smaller turn between two legs is no step of its own: the driver corrects it on the way."""


def with_pivots(start: Pose2, legs: Sequence[Step], last_heading: float | None) -> StepPlan:
    """Return legs that join each other as a plan, with pivots between them where their headings differ.

    `last_heading` [rad]: the heading to turn to at the end; None: the last leg's.
    """
    steps: list[Step] = []
    here = start
    for leg in legs:
        steps += _pivot(here, leg.start.theta)
        steps.append(leg)
        here = leg.end
    if last_heading is not None:
        steps += _pivot(here, last_heading)
        here = Pose2(here.x, here.y, last_heading)
    return StepPlan((*steps, Step(StepKind.ARRIVED, here, here)))


def _pivot(here: Pose2, heading: float) -> list[Step]:
    turn = wrap_angle(heading - here.theta)
    if abs(turn) < LEAST_TURN:
        return []
    return [Step(StepKind.PIVOT, here, Pose2(here.x, here.y, heading), turn)]
