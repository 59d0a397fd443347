"""Messages of lifts as Open-RMF defines them (package rmf_lift_msgs): requests to a lift's adapter, and its states."""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import Any

import numpy as np

from waychair.errors import MessageError
from waychair.recordings.bags.ros_messages import header, make
from waychair.recordings.bags.ros_transforms import stamp_ns as nanoseconds


class RequestType(enum.IntEnum):
    """What a request asks for; AGV keeps the door open while the car stands."""

    END_SESSION = 0
    AGV = 1
    HUMAN = 2


class DoorState(enum.IntEnum):
    """A lift's door."""

    CLOSED = 0
    MOVING = 1
    OPEN = 2


class MotionState(enum.IntEnum):
    """A lift's car."""

    STOPPED = 0
    UP = 1
    DOWN = 2
    UNKNOWN = 3


class LiftMode(enum.IntEnum):
    """The mode of a lift; only HUMAN and AGV may be asked for."""

    UNKNOWN = 0
    HUMAN = 1
    AGV = 2
    FIRE = 3
    OFFLINE = 4
    EMERGENCY = 5


@dataclass(frozen=True, slots=True)
class LiftRequest:
    """A request of a session: the lift, the floor to which it shall go, and the door there."""

    stamp_ns: int
    lift: str
    session: str
    kind: RequestType
    floor: str
    door: DoorState = DoorState.OPEN


@dataclass(frozen=True, slots=True)
class LiftState:
    """The state of a lift: the floors where it stops, the one where it is or that it passes, its next one, door and mode.

    `session` is the one that it serves, "" for none.
    """

    stamp_ns: int
    lift: str
    floors: tuple[str, ...]
    floor: str
    destination: str = ""
    door: DoorState = DoorState.CLOSED
    motion: MotionState = MotionState.STOPPED
    mode: LiftMode = LiftMode.HUMAN
    session: str = ""


def lift_request(request: LiftRequest) -> Any:
    """Return an rmf_lift_msgs/LiftRequest."""
    return make(
        "rmf_lift_msgs/msg/LiftRequest",
        lift_name=request.lift,
        request_time=header(request.stamp_ns, "").stamp,
        session_id=request.session,
        request_type=int(request.kind),
        destination_floor=request.floor,
        door_state=int(request.door),
    )


def read_lift_request(message: Any) -> LiftRequest:
    """Return the request of an rmf_lift_msgs/LiftRequest.

    Raises:
        MessageError: an unknown kind of request or state of the door.
    """
    return LiftRequest(
        stamp_ns=nanoseconds(message.request_time),
        lift=str(message.lift_name),
        session=str(message.session_id),
        kind=_value(RequestType, message.request_type),
        floor=str(message.destination_floor),
        door=_value(DoorState, message.door_state),
    )


def lift_state(state: LiftState) -> Any:
    """Return an rmf_lift_msgs/LiftState."""
    return make(
        "rmf_lift_msgs/msg/LiftState",
        lift_time=header(state.stamp_ns, "").stamp,
        lift_name=state.lift,
        available_floors=list(state.floors),
        current_floor=state.floor,
        destination_floor=state.destination,
        door_state=int(state.door),
        motion_state=int(state.motion),
        available_modes=np.array([LiftMode.HUMAN, LiftMode.AGV], np.uint8),
        current_mode=int(state.mode),
        session_id=state.session,
    )


def read_lift_state(message: Any) -> LiftState:
    """Return the state of an rmf_lift_msgs/LiftState.

    Raises:
        MessageError: an unknown state of door or car, or an unknown mode.
    """
    return LiftState(
        stamp_ns=nanoseconds(message.lift_time),
        lift=str(message.lift_name),
        floors=tuple(map(str, message.available_floors)),
        floor=str(message.current_floor),
        destination=str(message.destination_floor),
        door=_value(DoorState, message.door_state),
        motion=_value(MotionState, message.motion_state),
        mode=_value(LiftMode, message.current_mode),
        session=str(message.session_id),
    )


def _value(kind: type[Any], number: int) -> Any:
    """Return the member of an enumeration.

    Raises:
        MessageError: the enumeration has no such value.
    """
    try:
        return kind(int(number))
    except ValueError as error:
        raise MessageError(f"{number} is no {kind.__name__} of a lift: check its adapter") from error
