"""A chair as a mobile robot of VDA 5050, version 3.0.0: its fleet control's words are those of our wardens.

Pure: messages in, messages out; `vda5050_link.py` carries them by MQTT. A node is a node or refuge of the traffic graph, an
edge a section or lift, both by their names. The base of an order is the chain that the chair was granted, the horizon
the way beyond. Each single-file section and lift is a zone of kind RELEASE, whose grants are leases. A zone that the chair
is in stays its own when the lease ends: it drives out. Nothing here stops the rider's joystick.

| VDA 5050 | here |
|---|---|
| order, node, edge | `Order`, node or slot, section: spots of `Ways` |
| base, horizon | the granted chain, the way that is not granted yet |
| orderId, orderUpdateId | the request, and the number of its last change (`Reply.serial`) |
| zone of kind RELEASE | the resource of a single-file section or a lift |
| zoneRequest REQUESTED, GRANTED, REVOKED, EXPIRED | asked; a `Lease` that holds; taken back; a `Lease` that has lapsed |
| response GRANTED, QUEUED, REJECTED, REVOKED | `warden.Answer` of the same name |
| leaseExpiry | `Reply.lease_ms`: a duration, on the chair's own clock |
| newBaseRequest | `RequestWord.QUEUED`: at the end of the chain, and not at the goal |
| INTERVENED, MANUAL | the rider's joystick during an order; without one |
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise
from types import MappingProxyType

from msgspec import UNSET, UnsetType

from waychair.calibration.chair_body import TALLEST, ChairBody
from waychair.errors import VdaError
from waychair.planning.fleet.warden import LEASE_MS, Lease, Reply, RequestWord
from waychair.planning.fleet.ways import MOST_AT_A_NODE, Ways
from waychair.runtime.fleet.vda5050 import vda5050_messages as vda
from waychair.types import Pose2, Twist

ANSWERS: Mapping[vda.GrantType, RequestWord] = MappingProxyType(
    {
        vda.GrantType.GRANTED: RequestWord.GRANTED,
        vda.GrantType.QUEUED: RequestWord.QUEUED,
        vda.GrantType.REJECTED: RequestWord.REJECTED,
        vda.GrantType.REVOKED: RequestWord.REVOKED,
    }
)
"""A fleet control's words, and ours."""

MANUFACTURER = "waychair"
KINEMATICS = "DIFFERENTIAL"

_MOST_NODES = 1000  # of an order; more is no drive through a building
_MOST_FAULTS = 10  # kept in the state
_LEAST_CHARGE = 20.0  # %; the standard's word for an empty battery, where none is measured
_MASS = 160.0  # kg that the chair carries
_STATE_EVERY_S = 0.2  # s; a chair tells its state at most so often


@dataclass(frozen=True, slots=True)
class ChairMoment:
    """The chair's own state: `map_from_base`, its twist, who drives, battery [%] and safety."""

    pose: Pose2 | None
    twist: Twist = field(default_factory=lambda: Twist(0.0, 0.0))
    by_rider: bool = False
    paused: bool = False
    stopped: bool = False
    """whether Stop or an emergency stop holds the chair"""
    blocked: bool = False
    """whether the collision monitor holds it"""
    charge: float | None = None
    charging: bool = False
    sentence: str = ""


@dataclass(frozen=True, slots=True)
class ZoneLease:
    """A request for a zone, and its lease where it was granted: when it was heard [ns] on the chair's clock, how long [ms]."""

    request: str
    status: vda.RequestStatus = vda.RequestStatus.REQUESTED
    queued: bool = False
    heard_ns: int = 0
    lease_ms: int | None = LEASE_MS
    """None: without an end, while the link holds"""

    def told(self, now_ns: int) -> vda.RequestStatus:
        """Return the status for the fleet control."""
        lapsed = self.status is vda.RequestStatus.GRANTED and not self.holds(now_ns)
        return vda.RequestStatus.EXPIRED if lapsed else self.status

    def holds(self, now_ns: int) -> bool:
        """Whether the zone may be entered now. A clock that went backwards ends the lease."""
        if self.status is not vda.RequestStatus.GRANTED:
            return False
        return self.lease_ms is None or len(Lease((0, 1), self.heard_ns, self.lease_ms).usable(now_ns)) == 2


@dataclass(frozen=True, slots=True)
class AcceptedOrder:
    """An accepted order: names along the way, nodes and edges in turn, how many are released, and their spots."""

    order: str
    update: int
    names: tuple[str, ...]
    first: int
    """sequence number of the first name"""
    released: int
    spots: tuple[int, ...]


class VdaChair:
    """One chair under a fleet control: it takes orders and answers, and tells its state."""

    def __init__(self, ways: Ways, serial_number: str, at: str) -> None:
        """`at`: the node or refuge in which the chair stands.

        Raises:
            VdaError: the graph has no such place, or the serial number cannot be part of a topic.
        """
        if not serial_number or set(serial_number) & set("/+#$ "):
            raise VdaError(f"'{serial_number}' is no serial number for a topic: use letters, digits, - and _")
        self.serial_number = serial_number
        self._ways = ways
        self._way = AcceptedOrder("", 0, (at,), 0, 1, (_spot_of(ways, at),))
        self._entered = 0  # place in the way of the spot that the chair is in
        self._zones: dict[str, ZoneLease] = {}  # by resource
        self._faults: tuple[vda.StateError, ...] = ()
        self._actions: tuple[vda.ActionState, ...] = ()
        self._headers: dict[str, int] = {}
        self._requests = 0
        self._cancelled = False

    @property
    def goal(self) -> str:
        """The name of the last node of the order, horizon included."""
        return self._way.names[-1]

    def header(self, topic: str, now_ms: int) -> dict[str, object]:
        """Return the fields of the next header of a topic; `now_ms` since 1970."""
        number = self._headers[topic] = self._headers.get(topic, -1) + 1
        return {
            "header_id": number % 2**32,
            "timestamp": vda.utc(now_ms),
            "version": vda.VERSION,
            "manufacturer": MANUFACTURER,
            "serial_number": self.serial_number,
        }

    def receive(self, topic: str, data: bytes, now_ns: int) -> None:
        """Take a message of the fleet control; one that cannot be followed becomes an error of the state.

        `now_ns`: the chair's monotonic clock.
        """
        takers: dict[str, Callable[[bytes, int], None]] = {
            "order": self._take_order,
            "responses": self._take_responses,
            "instantActions": self._take_actions,
        }
        try:
            takers[topic](data, now_ns)
        except VdaError as error:
            self._report(f"{topic.upper()}_REFUSED", str(error))
        except KeyError:
            self._report("UNKNOWN_TOPIC", f"the chair takes no message on {topic[:40]}")

    def ask(self, now_ns: int) -> None:
        """Ask for the zones of the released way from the chair on, and again for those that lapsed; give the others back."""
        wanted = [name for k in range(self._entered, self._way.released) if (name := self._zone_at(k)) is not None]
        zones: dict[str, ZoneLease] = {}
        for name in wanted:
            zone = self._zones.get(name)
            if zone is None or zone.told(now_ns) is vda.RequestStatus.EXPIRED:
                self._requests += 1
                zone = ZoneLease(f"{self.serial_number}-{self._requests}")
            zones[name] = zone
        self._zones = zones

    def reply(self, now_ns: int) -> Reply:
        """Return the fleet control's will in a warden's words: the spots up to which the chair may drive now.

        The first spot is the one it is in. A zone without a lease that holds ends the chain at the node before it.
        """
        way, last = self._way, self._entered
        for k in range(self._entered + 1, way.released):
            name = self._zone_at(k)
            if name is not None and not (name in self._zones and self._zones[name].holds(now_ns)):
                break
            last = k
        if last > self._entered and last % 2 == 1:  # nobody stops in a section
            last -= 1
        if last > self._entered:
            answer = RequestWord.GRANTED
        elif self._cancelled or any(zone.status is vda.RequestStatus.REVOKED for zone in self._zones.values()):
            answer = RequestWord.REVOKED
        else:
            answer = RequestWord.GRANTED if self.arrived else RequestWord.QUEUED
        return Reply(0, answer, way.update, way.spots[self._entered : last + 1])

    @property
    def arrived(self) -> bool:
        """Whether the chair is at the end of its order, horizon included."""
        return self._entered == len(self._way.names) - 1

    def enter(self, spot: int) -> None:
        """Note that the chair has entered the next spot of its way.

        Raises:
            VdaError: it is not the next one.
        """
        if self._entered + 1 >= self._way.released or self._way.spots[self._entered + 1] != spot:
            raise VdaError(
                f"{self._ways.names[spot]} is not next on the way: stop, and ask the fleet control for an order"
            )
        self._entered += 1

    def link_lost(self) -> None:
        """Give up the grants without an end: nobody could take them back."""
        self._zones = {
            name: replace(zone, status=vda.RequestStatus.EXPIRED) if zone.lease_ms is None else zone
            for name, zone in self._zones.items()
        }

    def _take_order(self, data: bytes, now_ns: int) -> None:
        order = vda.message_of(vda.VdaOrder, data)
        self._check_receiver(order)
        way, base = self._way, self._way.released - 1
        first = _checked_sequence(order)
        same = order.order_id == way.order
        if same and order.order_update_id == way.update:
            return  # sent twice
        if same and order.order_update_id < way.update:
            raise VdaError(
                f"update {order.order_update_id} of order {order.order_id} is older than {way.update}, which holds"
            )
        if same and (first != way.first + base or order.nodes[0].node_id != way.names[base]):
            raise VdaError(
                f"the update of order {order.order_id} begins at {order.nodes[0].node_id}, not at {way.names[base]}, where its "
                "base ends"
            )
        if not same and self._entered < base:
            raise VdaError(f"the chair is still on order {way.order}: cancel it first")
        if not same and order.nodes[0].node_id != way.names[self._entered]:
            raise VdaError(
                f"the order begins at {order.nodes[0].node_id}, but the chair is at {way.names[self._entered]}"
            )
        if any(part.actions for part in _parts(order)):
            raise VdaError("the chair does nothing but drive: send no actions")
        names = [part.node_id for part in order.nodes]
        for k, edge in enumerate(order.edges):
            names.insert(2 * k + 1, edge.edge_id)
        released = 2 * sum(node.released for node in order.nodes) - 1
        kept = base if same else 0  # places before the first node that stay
        spots = _spots_along(self._ways, way.spots[base if same else self._entered], names)
        self._way = AcceptedOrder(
            order.order_id,
            order.order_update_id,
            (*(way.names[:kept]), *names),
            way.first if same else first,
            kept + released,
            (*way.spots[:kept], *spots),
        )
        self._entered = self._entered if same else 0
        self._zones = {name: zone for name, zone in self._zones.items() if zone.holds(now_ns)}
        self._faults, self._cancelled = (), False

    def _take_responses(self, data: bytes, now_ns: int) -> None:
        message = vda.message_of(vda.Responses, data)
        self._check_receiver(message)
        names = {zone.request: name for name, zone in self._zones.items()}
        for response in message.responses:
            name = names.get(response.request_id)
            if name is None:
                continue  # of a request that was given up meanwhile
            zone, answer = self._zones[name], ANSWERS[response.grant_type]
            if answer is RequestWord.GRANTED:
                lease_ms = None  # both times are of the sender's clock, whatever it shows
                if response.lease_expiry is not UNSET:
                    lease_ms = max(vda.ms_of(response.lease_expiry) - vda.ms_of(message.timestamp), 0)
                zone = replace(zone, status=vda.RequestStatus.GRANTED, queued=False, heard_ns=now_ns, lease_ms=lease_ms)
            elif answer is RequestWord.QUEUED:
                zone = replace(zone, queued=True)
            else:
                zone = replace(zone, status=vda.RequestStatus.REVOKED, queued=False)
            self._zones[name] = zone

    def _take_actions(self, data: bytes, now_ns: int) -> None:
        message = vda.message_of(vda.InstantActions, data)
        self._check_receiver(message)
        for action in message.actions:
            status = vda.ActionStatus.FINISHED
            if action.action_type == "cancelOrder" and not self.arrived:
                self._cancel()
            elif action.action_type not in ("stateRequest", "factsheetRequest"):
                why = "there is no order to cancel" if action.action_type == "cancelOrder" else "the chair cannot do it"
                status = vda.ActionStatus.FAILED
                self._report("ACTION_REFUSED", f"{action.action_type[:40]}: {why}", ("actionId", action.action_id))
            state = vda.ActionState(action.action_id, status, action.action_type)
            self._actions = (*self._actions, state)[-_MOST_FAULTS:]

    def _cancel(self) -> None:
        """Give up the way beyond the spot that the chair is in; from a section it drives on to the node at its end."""
        end = self._entered + 1 + self._entered % 2
        way = self._way
        self._way = replace(way, names=way.names[:end], released=end, spots=way.spots[:end])
        self._cancelled = True

    def _check_receiver(self, message: vda.Header) -> None:
        if (message.manufacturer, message.serial_number) != (MANUFACTURER, self.serial_number):
            raise VdaError(
                f"the message is for {message.manufacturer[:40]} {message.serial_number[:40]}, not for {MANUFACTURER} "
                f"{self.serial_number}"
            )

    def _report(self, kind: str, sentence: str, about: tuple[str, str] | None = None) -> None:
        references = UNSET if about is None else (vda.Reference(*about),)
        fault = vda.StateError(
            error_type=kind,
            error_level=vda.ErrorLevel.WARNING,
            error_references=references,
            error_description=sentence,
        )
        others = tuple(each for each in self._faults if each != fault)
        self._faults = (*others, fault)[-_MOST_FAULTS:]

    def _zone_at(self, k: int) -> str | None:
        """Return the zone of the k-th spot of the way; None for nodes and for sections where chairs pass each other."""
        name = self._way.names[k]
        return name if k % 2 == 1 and name in _release_zones(self._ways) else None

    def state(self, moment: ChairMoment, now_ns: int, now_ms: int) -> vda.VdaState:
        """Return the state of the chair; `now_ns` on its own clock, `now_ms` since 1970."""
        way, entered = self._way, self._entered
        node = entered - entered % 2
        ahead = [(k, way.names[k], way.first + k, k < way.released) for k in range(entered, len(way.names))]
        pose: vda.RobotPosition | UnsetType = UNSET
        if moment.pose is not None:
            storey = self._ways.graph.nodes[0].storey
            pose = vda.RobotPosition(moment.pose.x, moment.pose.y, _angle(moment.pose.theta), storey, localized=True)
        told = UNSET if not moment.sentence else (vda.Information("WAIT", "INFO", moment.sentence),)
        return vda.VdaState(
            **self.header("state", now_ms),  # type: ignore[arg-type]
            order_id=way.order,
            order_update_id=way.update,
            last_node_id=way.names[node],
            last_node_sequence_id=way.first + node,
            node_states=tuple(
                vda.RemainingNode(name, at, base) for k, name, at, base in ahead if k % 2 == 0 and k > entered
            ),
            edge_states=tuple(vda.EdgeState(name, at, base) for k, name, at, base in ahead if k % 2 == 1),
            driving=moment.twist.v != 0.0 or moment.twist.omega != 0.0,
            action_states=(),
            instant_action_states=self._actions,
            power_supply=vda.PowerSupply(_LEAST_CHARGE if moment.charge is None else moment.charge, moment.charging),
            operating_mode=self._mode(moment),
            errors=self._faults,
            safety_state=vda.SafetyState(
                vda.EmergencyStop.MANUAL if moment.stopped else vda.EmergencyStop.NONE, moment.blocked
            ),
            mobile_robot_position=pose,
            velocity=vda.Velocity(moment.twist.v, 0.0, moment.twist.omega),
            paused=moment.paused,
            new_base_request=self.reply(now_ns).answer is RequestWord.QUEUED and self._entered >= way.released - 1,
            zone_requests=tuple(
                vda.ZoneRequest(
                    zone.request, vda.ZoneRequestType.ACCESS, name, self._ways.graph.name, zone.told(now_ns)
                )
                for name, zone in self._zones.items()
            ),
            information=told,
        )

    def _mode(self, moment: ChairMoment) -> vda.OperatingMode:
        if moment.pose is None:
            return vda.OperatingMode.STARTUP
        if moment.by_rider:
            return vda.OperatingMode.MANUAL if self.arrived else vda.OperatingMode.INTERVENED
        return vda.OperatingMode.AUTOMATIC

    def connection(self, state: vda.ConnectionState, now_ms: int) -> vda.Connection:
        """Return the message about the link to the broker."""
        return vda.Connection(**self.header("connection", now_ms), connection_state=state)  # type: ignore[arg-type]

    def factsheet(self, body: ChairBody, fastest: float, acceleration: float, now_ms: int) -> vda.Factsheet:
        """Return the facts of a chair with a body, a highest speed [m/s] and an acceleration and braking [m/s2]."""
        vertices = [{"x": x, "y": y} for x, y in body.outline().round(4).tolist()]
        return vda.Factsheet(
            **self.header("factsheet", now_ms),  # type: ignore[arg-type]
            type_specification=vda.TypeSpecification(
                series_name=f"waychair {body.chair_id}",
                mobile_robot_class="CARRIER",
                maximum_load_mass=_MASS,
                localization_types=("NATURAL",),
                navigation_types=("AUTONOMOUS",),
                mobile_robot_kinematics=KINEMATICS,
                supported_zones=("RELEASE",),
            ),
            physical_parameters=vda.PhysicalParameters(
                minimum_speed=0.0,
                maximum_speed=fastest,
                maximum_acceleration=acceleration,
                maximum_deceleration=acceleration,
                minimum_height=TALLEST,
                maximum_height=TALLEST,
                width=body.width,
                length=body.length,
            ),
            protocol_limits=vda.ProtocolLimits(
                {"maximumMessageLength": vda.LARGEST},
                {"order.nodes": _MOST_NODES, "order.edges": _MOST_NODES - 1, "node.actions": 0, "edge.actions": 0},
                vda.Timing(_STATE_EVERY_S, _STATE_EVERY_S),
            ),
            protocol_features={"optionalParameters": (), "mobileRobotActions": ()},
            mobile_robot_geometry={
                "envelopes2d": [
                    {"envelope2dId": "outline", "vertices": vertices, "description": "chair with its rider"}
                ]
            },
            load_specification={},
        )


def _release_zones(ways: Ways) -> frozenset[str]:
    """Return the resources in which one chair goes at a time: sections of one lane, and lifts."""
    return frozenset(each.resource for each in ways.graph.sections if each.lanes == 1 or each.lift is not None)


def _spot_of(ways: Ways, name: str) -> int:
    found = [spot for spot, each in enumerate(ways.names[: _node_spots(ways)]) if each == name]
    if not found:
        raise VdaError(f"{ways.graph.name} has no node or place '{name[:40]}'")
    return found[0]


def _node_spots(ways: Ways) -> int:
    """Return the number of the spots that are nodes and slots; those of sections follow."""
    return sum(min(ways.graph.capacity(node.name), MOST_AT_A_NODE) for node in ways.graph.nodes)


def _spots_along(ways: Ways, start: int, names: list[str]) -> tuple[int, ...]:
    """Return the spots of a way by its names, from a spot of the first name.

    Raises:
        VdaError: the way is none of the building.
    """
    layers: list[dict[int, int]] = [{start: start}]
    for before, name in pairwise(names):
        found = {
            after: spot
            for spot in layers[-1]
            for after in ways.after[ways.first[spot] : ways.first[spot + 1]].tolist()
            if ways.names[after] == name
        }
        if not found:
            raise VdaError(f"no way leads from {before[:40]} to {name[:40]} in {ways.graph.name}")
        layers.append(found)
    spots = [next(iter(layers[-1]))]
    for layer in reversed(layers[1:]):
        spots.append(layer[spots[-1]])
    return tuple(reversed(spots))


def _parts(order: vda.VdaOrder) -> list[vda.OrderNode | vda.OrderEdge]:
    return [*order.nodes, *order.edges]


def _checked_sequence(order: vda.VdaOrder) -> int:
    """Return the first sequence number of an order.

    Raises:
        VdaError: nodes and edges do not alternate, are too many, or are released behind one that is not.
    """
    if not order.nodes or len(order.edges) != len(order.nodes) - 1:
        raise VdaError(
            f"{len(order.nodes)} nodes and {len(order.edges)} edges are no way: send an edge between any two nodes"
        )
    if len(order.nodes) > _MOST_NODES:
        raise VdaError(f"an order of {len(order.nodes)} nodes is too long: send at most {_MOST_NODES}")
    first = order.nodes[0].sequence_id
    parts = sorted(_parts(order), key=lambda part: part.sequence_id)
    numbers = [part.sequence_id for part in parts]
    ordered = [part.sequence_id for part in order.nodes] == numbers[::2]
    if not ordered or numbers != list(range(first, first + len(parts))):
        raise VdaError("the sequence numbers do not lead from node to edge to node: number them one after the other")
    base = [part.released for part in parts]
    if not base[0] or base != sorted(base, reverse=True) or sum(base) % 2 == 0:
        raise VdaError("the base is not the first part of the way, from a node to a node: release it so")
    return first


def _angle(theta: float) -> float:
    return math.remainder(theta, math.tau)
