"""State of the bridge node: messages of other nodes with their arrival, the localisation, and the current drive."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from waychair.control.safety.stops import Halt, halt
from waychair.ros.messages.chair import NO_GOAL, DriveReport
from waychair.ros.messages.floor import NO_REVISION, Floor
from waychair.slam.localising.localisation import Localisation
from waychair.types import DriveMode

SILENT_NS = 100_000_000
"""A navigator or localiser that has been silent for so long is treated as dead."""

MAX_CLOCK_DIFFERENCE_NS = 500_000_000
"""A message whose stamp is farther from now was delayed, or is of another clock (F16)."""


@dataclass(slots=True)
class LastMessage:
    """The last message from another node, and its arrival by the steady clock [ns]."""

    value: Any = None
    at_ns: int = field(default=-SILENT_NS * 1000)

    def take(self, value: Any) -> None:
        self.value, self.at_ns = value, time.monotonic_ns()

    def is_silent(self, now_ns: int) -> bool:
        return now_ns - self.at_ns > SILENT_NS


@dataclass(slots=True)
class Localised:
    """The localiser's heartbeat, and its last new localisation with the scan's stamp by ROS's and the steady clock [ns].

    `revision`: of the map on which it localises; `floor`: the map in use, None before it is told.
    """

    heartbeat: LastMessage = field(default_factory=LastMessage)
    last: Localisation | None = None
    stamp_ns: int = 0
    steady_ns: int = -MAX_CLOCK_DIFFERENCE_NS * 1000
    revision: int = NO_REVISION
    floor: Floor | None = None

    def floor_halts(self, navigators: int | None) -> list[Halt]:
        """Return the halts of maps that differ, and of an uncertain storey; `navigators`: revision of its map, None: no goal."""
        own = NO_REVISION if self.floor is None else self.floor.revision
        others = {self.revision} if navigators is None else {self.revision, navigators}
        if others != {own}:
            return [halt("floor_differs")]
        return [] if self.floor is None or self.floor.certain else [halt("floor_uncertain")]


@dataclass(slots=True)
class BridgeDrive:
    """The goal and the last tick: `ended_goal_id` is the last goal that is over, `requested` follows the first request."""

    goal_id: int = NO_GOAL
    ended_goal_id: int = NO_GOAL
    requested: bool = False
    mode: DriveMode = DriveMode.MANUAL
    ticked_ns: int = 0
    report: DriveReport | None = None
    last_stop: str = ""


@dataclass(frozen=True, slots=True)
class BridgePublishers:
    """The functions that publish on the node's topics."""

    odometry: Callable[[Any], None]
    transform: Callable[[Any], None]
    state: Callable[[Any], None]
    pose: Callable[[Any], None]
