"""The messages between the peers of a building: typed, of one layout, bounded in size and value, packed by msgpack.

Each travels in an envelope that names the layout, the building, the sender, its boot and a sequence number. Numbers are
integers: millimetres, milliradians, milliseconds, and nanoseconds of the sender's monotonic clock. A message of another
layout or building, or beyond a bound, is refused with advice; nothing of it is used.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass, field
from typing import Annotated, TypeAlias

import msgspec
from msgspec import Meta, Struct

from waychair.maps.traffic.traffic_graph import TrafficGraph

LARGEST = 65_536
"""bytes; the order of a district with a hundred chairs takes a third of it."""

LARGEST_STATE = 1_024
"""bytes; a State takes about 150, and comes five times a second from everybody."""

MOST_SPOTS = 512
"""Spots of a chain: four kilometres of sections."""

Number = Annotated[int, Meta(ge=0, le=0xFFFF)]
Count = Annotated[int, Meta(ge=0, le=0xFFFF_FFFF)]
Boot = Annotated[int, Meta(ge=1, le=0x7FFF_FFFF_FFFF_FFFF)]
Nanoseconds = Annotated[int, Meta(ge=0, le=0x7FFF_FFFF_FFFF_FFFF)]
Milliseconds = Annotated[int, Meta(ge=0, le=1 << 40)]
Spot = Annotated[int, Meta(ge=0, le=1_000_000)]
Spots = Annotated[tuple[Spot, ...], Meta(max_length=MOST_SPOTS)]
Name = Annotated[str, Meta(max_length=64)]
Sentence = Annotated[str, Meta(max_length=240)]
Millimetres = Annotated[int, Meta(ge=-10_000_000, le=10_000_000)]
Milliradians = Annotated[int, Meta(ge=-3142, le=3142)]
Numbers = Annotated[tuple[Number, ...], Meta(max_length=1024)]

IN_ORDER, ALONE, MANUAL = 0, 1, 2
"""Modes of a chair: it keeps the order; it drives by its own eyes alone; its rider steers."""

GRANTED, QUEUED, REJECTED, REVOKED = "GRANTED", "QUEUED", "REJECTED", "REVOKED"
"""The words of an Answer, which are those of VDA 5050."""


class Term(Struct, frozen=True, array_like=True):
    """A warden's time in office: its number and boot, and its epoch; the higher epoch is the later one."""

    warden: Number
    boot: Boot
    epoch: Count


Version: TypeAlias = tuple[Count, Count]
"""Which of two electorates is the newer one: the epoch of the warden that made it, and how many that one had made before."""


class Electorate(Struct, frozen=True, array_like=True):
    """The peers that are counted: the epoch of the warden that made it, its changes in that epoch before, and the members."""

    epoch: Count
    change: Count
    members: Annotated[tuple[Number, ...], Meta(min_length=1, max_length=1024)]

    @property
    def version(self) -> Version:
        """The newer electorate has the higher one."""
        return self.epoch, self.change


class Wish(Struct, frozen=True, array_like=True):
    """A chair's wish for a refuge: its number among all of this chair, the goal, the priority, and its age."""

    number: Count
    goal: Name
    priority: Annotated[int, Meta(ge=0, le=3)] = 0
    age_ms: Milliseconds = 0


class Place(Struct, frozen=True, array_like=True):
    """Where a chair is: storey, pose, speed, and the section with the way along it, for pages and other chairs."""

    storey: Name = ""
    x_mm: Millimetres = 0
    y_mm: Millimetres = 0
    heading_mrad: Milliradians = 0
    speed_mm_s: Annotated[int, Meta(ge=-5_000, le=5_000)] = 0
    section: Name = ""
    offset_mm: Millimetres = 0


class Hello(Struct, frozen=True, array_like=True, tag="hello"):
    """A peer presents itself, every two seconds: its body's sizes, whether it votes, its program's version, its uptime."""

    length_mm: Count = 0
    width_mm: Count = 0
    votes: bool = True
    version: Name = ""
    up_ms: Milliseconds = 0


class State(Struct, frozen=True, array_like=True, tag="state"):
    """All that a peer holds, five times a second, so that any other one can take over the order.

    Attributes:
        entered: spots that the chair's body is in, from its rear to its front; none for a voter without a chair.
        visit: the number of the front one among all that this chair has entered.
        released: spots beyond it that it was allowed to enter.
        ready_ms: time until it can leave the front spot.
        leaves_ms: time until its rear has left each of the others, the rearmost first, as far as it is known.
        wants: spots that it would like to enter now.
        mode: IN_ORDER, ALONE or MANUAL.
        stance: counts the times when the chair gave back all that it had not entered.
        follows: the term that it votes for; none: nobody's.
        echo_ns: when the last State of that warden was sent, by the warden's clock.
        left: the highest epoch that the chair has left, and will not follow again.
        term: the epoch that this peer stands for as a warden; 0: none.
        grants: whether it is granting in that epoch.
        parked: the chair stands in a refuge and is about to be switched off.
        electors: the version of the electorate that it knows.
    """

    entered: Spots = ()
    visit: Count = 0
    released: Spots = ()
    ready_ms: Milliseconds = 0
    leaves_ms: Annotated[tuple[Milliseconds, ...], Meta(max_length=MOST_SPOTS)] = ()
    wants: Annotated[int, Meta(ge=0, le=MOST_SPOTS)] = 0
    mode: Annotated[int, Meta(ge=0, le=2)] = IN_ORDER
    stance: Count = 0
    follows: Term | None = None
    echo_ns: Nanoseconds = 0
    left: Count = 0
    term: Count = 0
    grants: bool = False
    parked: bool = False
    electors: Version = (0, 0)
    wish: Wish | None = None
    place: Place | None = None


class Request(Struct, frozen=True, array_like=True, tag="request"):
    """A wish at once, without waiting for the next State; repeated until it is answered."""

    stance: Count
    wish: Wish


class Why(Struct, frozen=True, array_like=True):
    """The reason for a wait: the chair for which one waits, a sentence for the rider, how long (unknown: -1), and the rule."""

    others: Numbers = ()
    sentence: Sentence = ""
    foreseen_ms: Annotated[int, Meta(ge=-1, le=1 << 50)] = -1
    rule: Name = ""


class Answer(Struct, frozen=True, array_like=True, tag="answer"):
    """The warden's word to one chair.

    Attributes:
        chair, boot, stance: the chair, and the boot and stance for which the word is good.
        epoch: the warden's.
        serial: number of the order.
        word: GRANTED, QUEUED, REJECTED or REVOKED.
        echo_ns: when the State that it answers was sent, by the chair's clock; the lease runs from there.
        lease_ms: for how long released spots may be entered.
        visit: the number of the first of `spots`.
        spots: the chain.
        upto: the number of the last spot that may be entered now.
        look: the chair has to look before it enters a spot, as not all chairs keep this order.
        why: the reason for a wait.
        number: of the request that is answered; 0: none.
    """

    chair: Number
    boot: Boot
    stance: Count
    epoch: Count
    serial: Count
    word: Annotated[str, Meta(max_length=8)]
    echo_ns: Nanoseconds
    lease_ms: Annotated[int, Meta(ge=0, le=10_000)]
    visit: Count = 0
    spots: Spots = ()
    upto: Count = 0
    look: bool = False
    why: Why = Why()
    number: Count = 0


class Blocked(Struct, frozen=True, array_like=True, tag="blocked"):
    """A section that a chair has seen blocked, or free of a chair that was silent, and how long this is believed."""

    section: Name
    cause: Name
    for_ms: Annotated[int, Meta(ge=0, le=3_600_000)]


class Queue(Struct, frozen=True, array_like=True):
    """The turns at a resource in their order: chairs, and the numbers of their visits."""

    resource: Spot
    turns: Annotated[tuple[tuple[Number, Count], ...], Meta(max_length=256)]


class Order(Struct, frozen=True, array_like=True, tag="order"):
    """The queues of a district, every second and on change, with its electorate."""

    district: Name
    epoch: Count
    serial: Count
    electorate: Electorate
    queues: Annotated[tuple[Queue, ...], Meta(max_length=4096)] = ()
    closed: Spots = ()


class Query(Struct, frozen=True, array_like=True, tag="query"):
    """A search of the paper's protocol on its way: from node to node towards a goal, with its label and hops."""

    number: Count
    goal: Name
    node: Name
    label_ms: Milliseconds
    hops: Annotated[int, Meta(ge=0, le=0xFFFF)]
    chair: Number


class Confirm(Struct, frozen=True, array_like=True, tag="confirm"):
    """A path of the paper's protocol on its way back, from the goal to the chair."""

    number: Count
    path: Annotated[tuple[Name, ...], Meta(max_length=MOST_SPOTS)]
    label_ms: Milliseconds


class Commit(Struct, frozen=True, array_like=True, tag="commit"):
    """A node's note of the paper's protocol: a chair is there from an arrival to a departure."""

    chair: Number
    node: Name
    arrival_ms: Milliseconds
    departure_ms: Milliseconds


class Filter(Struct, frozen=True, array_like=True, tag="filter"):
    """A Bloom filter of the goals that a node reaches over a neighbour."""

    node: Name
    neighbour: Name
    bits: Annotated[bytes, Meta(max_length=4096)]


Body: TypeAlias = Hello | State | Request | Answer | Blocked | Order | Query | Confirm | Commit | Filter

BODIES: tuple[type[Struct], ...] = (
    *(Hello, State, Request, Answer, Blocked, Order, Query, Confirm, Commit, Filter),
    *(Term, Electorate, Wish, Place, Queue, Why),
)

LAYOUT = zlib.crc32(
    ";".join(
        f"{kind.__name__}({', '.join(f'{each.name}: {each.type}' for each in msgspec.structs.fields(kind))})"
        for kind in BODIES
    ).encode()
)
"""Differs with the fields of any message, so that two versions that would misread each other do not talk."""


class Envelope(Struct, frozen=True, array_like=True):
    """A message with its circumstances; `body` is packed by itself, so that a foreign layout is never looked into."""

    layout: Annotated[int, Meta(ge=0, le=0xFFFF_FFFF)]
    building: Name
    sender: Number
    boot: Boot
    seq: Count
    sent_ns: Nanoseconds
    body: msgspec.Raw


@dataclass(frozen=True, slots=True)
class Letter:
    """A message that was understood: the sender's number, boot, sequence number and clock [ns], and the message."""

    sender: int
    boot: int
    seq: int
    sent_ns: int
    body: Body


_pack = msgspec.msgpack.Encoder()
_open = msgspec.msgpack.Decoder(Envelope)
_read = msgspec.msgpack.Decoder(Body)


def building_of(graph: TrafficGraph) -> str:
    """Return the name under which the chairs of one building find each other: a hash of its traffic graph."""
    return graph.fingerprint


def packed(building: str, sender: int, boot: int, seq: int, sent_ns: int, body: Body) -> bytes:
    """Return a message as bytes."""
    return _pack.encode(Envelope(LAYOUT, building, sender, boot, seq, sent_ns, msgspec.Raw(_pack.encode(body))))


@dataclass(slots=True)
class Reader:
    """Opens messages for one building, and counts those that it refuses.

    Attributes:
        building: as `building_of` tells it.
        refused: the number of messages refused, by the reason.
        told: senders and reasons for which the advice was given already.
    """

    building: str
    refused: dict[str, int] = field(default_factory=dict)
    told: set[tuple[int, str]] = field(default_factory=set)

    def read(self, data: bytes, source: int | None = None) -> tuple[Letter | None, str]:
        """Return the message, or None with a sentence of advice; each sentence comes once for each sender.

        `source` is the sender that the transport tells; a message in another's name is refused.
        """
        if len(data) > LARGEST:
            return None, self._refuse(-1, "size", f"a message of {len(data)} bytes is too large: find its sender")
        try:
            envelope = _open.decode(data)
        except (msgspec.MsgspecError, RecursionError, UnicodeDecodeError):
            return None, self._refuse(-1, "form", "a message is no message of waychair: keep others off this network")
        who = envelope.sender
        if source is not None and source != who:
            advice = f"chair {source} sends in the name of chair {who}: take it off the network"
            return None, self._refuse(source, "forged", advice)
        if envelope.layout != LAYOUT:
            advice = f"chair {who} runs another version of waychair: install the same version on all chairs"
            return None, self._refuse(who, "version", advice)
        if envelope.building != self.building:
            advice = f"chair {who} has the map of another building ({envelope.building}): give all chairs one map"
            return None, self._refuse(who, "building", advice)
        try:
            body = _read.decode(envelope.body)
        except (msgspec.MsgspecError, RecursionError, UnicodeDecodeError):
            return None, self._refuse(who, "values", f"chair {who} sends impossible values: update or repair it")
        if isinstance(body, State) and len(data) > LARGEST_STATE:
            return None, self._refuse(
                who, "size", f"chair {who} sends a State of {len(data)} bytes: update or repair it"
            )
        return Letter(who, envelope.boot, envelope.seq, envelope.sent_ns, body), ""

    def count(self, reason: str, messages: int) -> None:
        """Count messages that were not read."""
        self.refused[reason] = self.refused.get(reason, 0) + messages

    def _refuse(self, who: int, reason: str, sentence: str) -> str:
        self.count(reason, 1)
        if (who, reason) in self.told or len(self.told) >= 1000:
            return ""
        self.told.add((who, reason))
        return sentence[0].upper() + sentence[1:] + "."
