"""The messages of VDA 5050, version 3.0.0, as typed values: all fields that the standard requires and those used here.

Names, types, limits and required fields are those of the standard's JSON schemas (VDA5050/VDA5050 on GitHub, json_schemas/).
A field that may be left out is `UNSET` and is then not sent. Unknown fields of a received message are ignored, as the
standard asks; a required field that is missing, or of another type, refuses the message.
"""

from __future__ import annotations

import enum
from datetime import UTC, datetime
from typing import Annotated, Any, TypeVar

import msgspec
from msgspec import UNSET, Meta, Struct, UnsetType

from waychair.errors import VdaError

VERSION = "3.0.0"
MAJOR = VERSION.partition(".")[0]

LARGEST = 1_000_000
"""bytes; a longer message is refused unread."""

Count = Annotated[int, Meta(ge=0, le=2**32 - 1)]
Percent = Annotated[float, Meta(ge=0.0, le=100.0)]
Angle = Annotated[float, Meta(ge=-3.14159265359, le=3.14159265359)]
NotNegative = Annotated[float, Meta(ge=0.0)]


class ConnectionState(enum.Enum):
    """The state of the link between a chair and the broker; the broker sends the last one in the chair's name."""

    ONLINE = "ONLINE"
    OFFLINE = "OFFLINE"
    HIBERNATING = "HIBERNATING"
    CONNECTION_BROKEN = "CONNECTION_BROKEN"


class OperatingMode(enum.Enum):
    """The driver."""

    STARTUP = "STARTUP"
    AUTOMATIC = "AUTOMATIC"
    SEMIAUTOMATIC = "SEMIAUTOMATIC"
    INTERVENED = "INTERVENED"
    MANUAL = "MANUAL"
    SERVICE = "SERVICE"
    TEACH_IN = "TEACH_IN"


class GrantType(enum.Enum):
    """A fleet control's answer to a request."""

    GRANTED = "GRANTED"
    QUEUED = "QUEUED"
    REVOKED = "REVOKED"
    REJECTED = "REJECTED"


class RequestStatus(enum.Enum):
    """A chair's view of its request."""

    REQUESTED = "REQUESTED"
    GRANTED = "GRANTED"
    REVOKED = "REVOKED"
    EXPIRED = "EXPIRED"


class ZoneRequestType(enum.Enum):
    """The kind of a zone that is asked for."""

    ACCESS = "ACCESS"
    REPLANNING = "REPLANNING"


class EmergencyStop(enum.Enum):
    """How an active emergency stop has to be acknowledged."""

    MANUAL = "MANUAL"
    REMOTE = "REMOTE"
    NONE = "NONE"


class ErrorLevel(enum.Enum):
    """Whether the chair goes on with an error."""

    WARNING = "WARNING"
    URGENT = "URGENT"
    CRITICAL = "CRITICAL"
    FATAL = "FATAL"


class ActionStatus(enum.Enum):
    """The progress of an action."""

    WAITING = "WAITING"
    INITIALIZING = "INITIALIZING"
    RUNNING = "RUNNING"
    PAUSED = "PAUSED"
    RETRIABLE = "RETRIABLE"
    FINISHED = "FINISHED"
    FAILED = "FAILED"


class MessagePart(Struct, frozen=True, rename="camel", omit_defaults=True):
    """A part of a message."""


class Header(Struct, frozen=True, rename="camel", omit_defaults=True, kw_only=True):
    """The beginning of every message; `timestamp` is in UTC, ISO 8601 with milliseconds."""

    header_id: Count
    timestamp: str
    version: str
    manufacturer: str
    serial_number: str


class Connection(Header, frozen=True, rename="camel", omit_defaults=True, kw_only=True):
    """The link to the broker, retained."""

    connection_state: ConnectionState


class Reference(MessagePart, frozen=True, rename="camel", omit_defaults=True):
    """What an error refers to, such as `orderId`."""

    reference_key: str
    reference_value: str


class StateError(MessagePart, frozen=True, rename="camel", omit_defaults=True, kw_only=True):
    """An error in a state."""

    error_type: str
    error_level: ErrorLevel
    error_references: tuple[Reference, ...] | UnsetType = UNSET
    error_description: str | UnsetType = UNSET
    error_hint: str | UnsetType = UNSET


class RemainingNode(MessagePart, frozen=True, rename="camel", omit_defaults=True):
    """A node that is still to be reached."""

    node_id: str
    sequence_id: Count
    released: bool


class EdgeState(MessagePart, frozen=True, rename="camel", omit_defaults=True):
    """An edge that is still to be driven."""

    edge_id: str
    sequence_id: Count
    released: bool


class RobotPosition(MessagePart, frozen=True, rename="camel", omit_defaults=True):
    """The chair's pose [m, rad] on the map of its storey; not to be trusted unless `localized`."""

    x: float
    y: float
    theta: Angle
    map_id: str
    localized: bool


class Velocity(MessagePart, frozen=True, rename="camel", omit_defaults=True):
    """The chair's speed ahead [m/s], sideways, and turning [rad/s]."""

    vx: float
    vy: float
    omega: float


class ZoneRequest(MessagePart, frozen=True, rename="camel", omit_defaults=True):
    """The wish to use a zone of a zone set."""

    request_id: str
    request_type: ZoneRequestType
    zone_id: str
    zone_set_id: str
    request_status: RequestStatus


class ActionState(MessagePart, frozen=True, rename="camel", omit_defaults=True):
    """The progress of an action."""

    action_id: str
    action_status: ActionStatus
    action_type: str | UnsetType = UNSET
    action_result: str | UnsetType = UNSET


class PowerSupply(MessagePart, frozen=True, rename="camel", omit_defaults=True):
    """The battery: its charge [%], and whether it is being charged."""

    state_of_charge: Percent
    charging: bool


class Information(MessagePart, frozen=True, rename="camel", omit_defaults=True):
    """A sentence for people, never for control; the level is INFO or DEBUG."""

    info_type: str
    info_level: str
    info_descriptor: str | UnsetType = UNSET


class SafetyState(MessagePart, frozen=True, rename="camel", omit_defaults=True):
    """The emergency stop, and whether something is within the protected field."""

    active_emergency_stop: EmergencyStop
    field_violation: bool


class VdaState(Header, frozen=True, rename="camel", omit_defaults=True, kw_only=True):
    """The whole state of a chair."""

    order_id: str
    order_update_id: Count
    last_node_id: str
    last_node_sequence_id: Count
    node_states: tuple[RemainingNode, ...]
    edge_states: tuple[EdgeState, ...]
    driving: bool
    action_states: tuple[ActionState, ...]
    instant_action_states: tuple[ActionState, ...]
    power_supply: PowerSupply
    operating_mode: OperatingMode
    errors: tuple[StateError, ...]
    safety_state: SafetyState
    mobile_robot_position: RobotPosition | UnsetType = UNSET
    velocity: Velocity | UnsetType = UNSET
    paused: bool | UnsetType = UNSET
    new_base_request: bool | UnsetType = UNSET
    zone_requests: tuple[ZoneRequest, ...] | UnsetType = UNSET
    information: tuple[Information, ...] | UnsetType = UNSET


class VdaAction(MessagePart, frozen=True, rename="camel", omit_defaults=True):
    """A deed other than driving."""

    action_type: str
    action_id: str
    blocking_type: str


class OrderNode(MessagePart, frozen=True, rename="camel", omit_defaults=True):
    """A node of an order: base where released, else horizon."""

    node_id: str
    sequence_id: Count
    released: bool
    actions: tuple[VdaAction, ...]


class OrderEdge(MessagePart, frozen=True, rename="camel", omit_defaults=True):
    """An edge of an order between the nodes before and after it in the sequence."""

    edge_id: str
    sequence_id: Count
    released: bool
    actions: tuple[VdaAction, ...]


class VdaOrder(Header, frozen=True, rename="camel", omit_defaults=True, kw_only=True):
    """An order of a fleet control, or an update of it."""

    order_id: str
    order_update_id: Count
    nodes: tuple[OrderNode, ...]
    edges: tuple[OrderEdge, ...]


class Response(MessagePart, frozen=True, rename="camel", omit_defaults=True):
    """The answer to a request; a grant may expire."""

    request_id: str
    grant_type: GrantType
    lease_expiry: str | UnsetType = UNSET


class Responses(Header, frozen=True, rename="camel", omit_defaults=True, kw_only=True):
    """A fleet control's answers to a chair's requests."""

    responses: tuple[Response, ...]


class InstantActions(Header, frozen=True, rename="camel", omit_defaults=True, kw_only=True):
    """Actions to be done at once."""

    actions: tuple[VdaAction, ...]


class TypeSpecification(MessagePart, frozen=True, rename="camel", omit_defaults=True, kw_only=True):
    """The kind of a chair."""

    series_name: str
    mobile_robot_class: str
    maximum_load_mass: NotNegative
    localization_types: tuple[str, ...]
    navigation_types: tuple[str, ...]
    mobile_robot_kinematics: str | UnsetType = UNSET
    supported_zones: tuple[str, ...] | UnsetType = UNSET


class PhysicalParameters(MessagePart, frozen=True, rename="camel", omit_defaults=True, kw_only=True):
    """A chair's speeds [m/s], accelerations [m/s2] and sizes [m]."""

    minimum_speed: float
    maximum_speed: float
    maximum_acceleration: float
    maximum_deceleration: float
    minimum_height: float
    maximum_height: float
    width: float
    length: float


class Timing(MessagePart, frozen=True, rename="camel", omit_defaults=True):
    """Least times [s] between two orders and between two states."""

    minimum_order_interval: float
    minimum_state_interval: float


class ProtocolLimits(MessagePart, frozen=True, rename="camel", omit_defaults=True):
    """Limits of messages; a name that is missing in a mapping has none."""

    maximum_string_lengths: dict[str, int]
    maximum_array_lengths: dict[str, int]
    timing: Timing


class Factsheet(Header, frozen=True, rename="camel", omit_defaults=True, kw_only=True):
    """The facts of a chair that do not change."""

    type_specification: TypeSpecification
    physical_parameters: PhysicalParameters
    protocol_limits: ProtocolLimits
    protocol_features: dict[str, tuple[dict[str, Any], ...]]
    mobile_robot_geometry: dict[str, Any]
    load_specification: dict[str, Any]


M = TypeVar("M", bound=Header)


def text_of(message: Header) -> bytes:
    """Return the JSON of a message."""
    return msgspec.json.encode(message)


def utc(ms: int) -> str:
    """Return a time since 1970 [ms] as a timestamp, such as 2017-04-15T11:40:03.123Z."""
    return datetime.fromtimestamp(ms // 1000, UTC).strftime("%Y-%m-%dT%H:%M:%S") + f".{ms % 1000:03d}Z"


def ms_of(timestamp: str) -> int:
    """Return a timestamp as time since 1970 [ms].

    Raises:
        VdaError: it is none, or has no time zone.
    """
    try:
        time = datetime.fromisoformat(timestamp)
    except ValueError:
        raise VdaError(f"'{timestamp[:40]}' is no timestamp: send one such as 2017-04-15T11:40:03.123Z") from None
    if time.tzinfo is None:
        raise VdaError(f"the timestamp '{timestamp}' has no time zone: end it with Z")
    return round(time.timestamp() * 1e3)


def message_of(kind: type[M], data: bytes) -> M:
    """Return a received message.

    Raises:
        VdaError: it is too long, no JSON, lacks a required field, has one of another type, or is of another version.
    """
    if len(data) > LARGEST:
        raise VdaError(f"a message of {len(data)} bytes is too long: send at most {LARGEST}")
    try:
        message = msgspec.json.decode(data, type=kind)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise VdaError(f"the message does not fit VDA 5050 {VERSION} ({kind.__name__}): {error}") from None
    if message.version.partition(".")[0] != MAJOR:
        raise VdaError(f"the message is of VDA 5050 {message.version}: send {VERSION}")
    return message
