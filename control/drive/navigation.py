"""The navigator's output in a tick: the stage of the drive and the wanted twist."""

from __future__ import annotations

import enum
from dataclasses import dataclass, field

from waychair.planning.route.legs import PathLeg
from waychair.planning.window.dwa import DwaResult
from waychair.types import Path, Twist


class Stage(enum.Enum):
    """The stages of a drive to a goal."""

    IDLE = "idle"
    DRIVING = "driving"
    WAITING = "waiting"
    OFFERING = "offering"  # waits at a doorway, and offers another way, which `Navigator.resume` takes
    PAUSED = "paused"
    ARRIVED = "arrived"
    FAILED = "failed"


ACTIVE = (Stage.DRIVING, Stage.WAITING, Stage.OFFERING, Stage.PAUSED)
"""The stages in which there still is a goal to reach."""


@dataclass(frozen=True, slots=True)
class Navigation:
    """The navigator's output: stage, twist, the reason as a sentence, the followed path and its present leg.

    `goals` counts the goals still to reach, the present one included. `choice.arc` is in odom.
    """

    stage: Stage
    twist: Twist = field(default_factory=Twist)
    reason: str = ""
    path: Path | None = None
    plans: int = 0
    choice: DwaResult | None = None
    leg: PathLeg | None = None
    goals: int = 0

    @property
    def driving(self) -> bool:
        """Whether the computer wants the joystick lines, even to stand still."""
        return self.stage in ACTIVE
