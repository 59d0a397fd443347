"""One movement of a way as people are told it: along to the next corner, a turn, through the door, into the lift.

The noun of ways over a building's graph (`building/movements.py`, `building/guided_ways.py`). The steps of one
storey's map (`steps/step.py`) are finer: a hand that feels each of them follows them. A movement begins with a pose, in which the chair faces the way that it then goes.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass

from waychair.maps.building.hgraph import NodeRef
from waychair.types import Pose2


class MovementKind(enum.StrEnum):
    """The kinds of movement."""

    STRAIGHT = "straight"
    BACK = "back"
    LEFT = "left"
    RIGHT = "right"
    TURN_ROUND = "turn round"
    DOOR = "door"
    WAIT = "wait"
    INTO_LIFT = "into the lift"
    PRESS = "press"
    LEAVE_LIFT = "leave the lift"
    ARRIVED = "arrived"


TURNS = (MovementKind.LEFT, MovementKind.RIGHT, MovementKind.TURN_ROUND)
"""The movements on one spot."""


@dataclass(frozen=True, slots=True)
class Movement:
    """One movement.

    `at`, `cost` [mm]: the node of a building's graph at which it begins, and its cost there; None and 0 for others.
    `distance` [m] of driving, `angle` [rad] of a turn, left positive. `lift` and `storey` are the names for people of
    the lift and of the storey to press. `start` and `end`: the chair's poses in the storey's map before and after it,
    None where only the graph is known. `landmark`: where it ends, as `at the second door on the left`.
    """

    kind: MovementKind
    at: NodeRef | None = None
    cost: int = 0
    distance: float = 0.0
    lift: str = ""
    storey: str = ""
    start: Pose2 | None = None
    end: Pose2 | None = None
    angle: float = 0.0
    landmark: str = ""

    def sentence(self) -> str:
        """Return it in words, without its landmark."""
        return {
            MovementKind.STRAIGHT: f"straight {self.distance:.0f} m" if self.distance >= 1.0 else "straight, a little",
            MovementKind.BACK: f"back {self.distance:.0f} m" if self.distance >= 1.0 else "back, a little",
            MovementKind.LEFT: "turn left",
            MovementKind.RIGHT: "turn right",
            MovementKind.TURN_ROUND: "turn round",
            MovementKind.DOOR: "through the door",
            MovementKind.WAIT: f"wait for {self.lift}",
            MovementKind.INTO_LIFT: f"drive into {self.lift}",
            MovementKind.PRESS: f"{self.lift} to {self.storey}",
            MovementKind.LEAVE_LIFT: "leave the lift",
            MovementKind.ARRIVED: "arrived",
        }[self.kind]
