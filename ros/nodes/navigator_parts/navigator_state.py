"""State of the navigator node: the latest inputs, and the current drive."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from waychair.ros.messages.chair import NO_GOAL, DriveReport
from waychair.ros.nodes.navigator_parts.building_routes import BuildingRoutes
from waychair.ros.nodes.navigator_parts.journeys import Journeys
from waychair.slam.localising.localisation import Localisation
from waychair.types import Pose2, Scan


@dataclass(slots=True)
class Latest:
    """The latest inputs, and the times [ns] of the last ones by the steady clock; `scan_ns` is a scan's stamp."""

    scan: Scan | None = None  # waits for its localisation
    located: tuple[int, Localisation] | None = None
    state: DriveReport | None = None
    limit: float = math.inf
    bridge_ns: int | None = None
    scan_ns: int = 0  # of the last scan that was used
    pose_ns: int | None = None  # when the chair's pose was last known


@dataclass(slots=True)
class CurrentDrive:
    """The current goal, the start of its drive by the steady clock, and the number of recoveries before it."""

    goal: Pose2 = field(default_factory=Pose2)
    goal_id: int = NO_GOAL
    began_ns: int = 0
    recoveries: int = 0
    ticks: int = 0
    is_open: bool = False  # until its end was noted
    was_driven: bool = False  # the computer has driven to it


@dataclass(frozen=True, slots=True)
class NavigatorPublishers:
    """The functions that publish on the node's topics."""

    command: Callable[[Any], None]
    request: Callable[[Any], None]
    places: Callable[[Any], None]
    layout: Callable[[Any], None]


@dataclass(frozen=True, slots=True)
class NavigatedBuilding:
    """The building round the map: its routes, and journeys over its storeys."""

    routes: BuildingRoutes
    journeys: Journeys
