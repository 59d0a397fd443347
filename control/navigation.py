"""What a navigator says in a tick: how far the drive has come, and the twist that it asks for."""

from __future__ import annotations

import enum
from dataclasses import dataclass, field

from waychair.planning.dwa import DwaResult
from waychair.planning.legs import Leg
from waychair.types import Path, Twist


class Stage(enum.Enum):
    """How far the drive to a goal has come."""

    IDLE = "idle"
    DRIVING = "driving"
    WAITING = "waiting"
    PAUSED = "paused"
    ARRIVED = "arrived"
    FAILED = "failed"


ACTIVE = (Stage.DRIVING, Stage.WAITING, Stage.PAUSED)
"""While there is a goal still to reach."""


@dataclass(frozen=True, slots=True)
class Navigation:
    """The twist of this tick, the stage, why in a plain sentence, the path that is followed and its present leg.

    `goals`: how many are still to be reached, the present one included. `choice.arc` is in odom.
    """

    stage: Stage
    twist: Twist = field(default_factory=Twist)
    reason: str = ""
    path: Path | None = None
    plans: int = 0
    choice: DwaResult | None = None
    leg: Leg | None = None
    goals: int = 0

    @property
    def driving(self) -> bool:
        """Whether the computer wants the joystick lines, be it to stand still on them."""
        return self.stage in ACTIVE
