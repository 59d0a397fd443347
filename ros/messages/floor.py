"""Messages of storeys (package waychair_msgs): the map in use, goals of a building, and how a journey fares."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from waychair.recordings.bags.ros_messages import MAP_FRAME, header, make
from waychair.ros.messages.wire import require_finite, stamp_of

NO_REVISION = 0
"""The revision of a map that is no saved one, or of none."""


@dataclass(frozen=True, slots=True)
class Floor:
    """The map in use: its folder, the building and the storey that it is of ("": of none), the storey's height [m].

    `revision` grows with each map that is loaded. `certain`: the chair is certainly on this storey.
    """

    stamp_ns: int
    map_folder: str
    revision: int
    building: str = ""
    storey: str = ""
    height: float = 0.0
    certain: bool = True


@dataclass(frozen=True, slots=True)
class JourneyReport:
    """How a journey to `goal` fares: its phase, a sentence for the rider, the map's storey, and the stops to choose from."""

    stamp_ns: int
    goal: str = ""
    phase: str = ""
    sentence: str = ""
    storey: str = ""
    asks: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class StoreyGoal:
    """A goal of a building: its path, or with a storey's id the name of a place on that storey."""

    goal: str
    storey: str = ""


def floor(known: Floor) -> Any:
    """Return a waychair_msgs/Floor."""
    return make(
        "waychair_msgs/msg/Floor",
        header=header(known.stamp_ns, MAP_FRAME),
        building=known.building,
        storey=known.storey,
        map_folder=known.map_folder,
        height=known.height,
        revision=known.revision,
        certain=known.certain,
    )


def read_floor(message: Any) -> Floor:
    """Return the map in use of a waychair_msgs/Floor.

    Raises:
        MessageError: the height is not finite.
    """
    require_finite("a storey's height", message.height)
    return Floor(
        stamp_ns=stamp_of(message),
        map_folder=str(message.map_folder),
        revision=int(message.revision),
        building=str(message.building),
        storey=str(message.storey),
        height=float(message.height),
        certain=bool(message.certain),
    )


def journey_state(report: JourneyReport) -> Any:
    """Return a waychair_msgs/JourneyState."""
    return make(
        "waychair_msgs/msg/JourneyState",
        header=header(report.stamp_ns, MAP_FRAME),
        goal=report.goal,
        phase=report.phase,
        sentence=report.sentence,
        storey=report.storey,
        asks=list(report.asks),
    )


def read_journey_state(message: Any) -> JourneyReport:
    """Return the report of a waychair_msgs/JourneyState."""
    return JourneyReport(
        stamp_ns=stamp_of(message),
        goal=str(message.goal),
        phase=str(message.phase),
        sentence=str(message.sentence),
        storey=str(message.storey),
        asks=tuple(map(str, message.asks)),
    )


def storey_goal(goal: StoreyGoal) -> Any:
    """Return a waychair_msgs/StoreyGoal."""
    return make("waychair_msgs/msg/StoreyGoal", goal=goal.goal, storey=goal.storey)


def read_storey_goal(message: Any) -> StoreyGoal:
    """Return the goal of a waychair_msgs/StoreyGoal."""
    return StoreyGoal(str(message.goal), str(message.storey))
