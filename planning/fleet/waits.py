"""Waits of chairs for others, with reason and length; the audit of these waits, and how evenly delay is spread.

Chairs are numbers; there are no names of people anywhere.
"""

from __future__ import annotations

import enum
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from waychair.maps.traffic.traffic_graph import RefugeKind
from waychair.planning.fleet.order import Chain, Order, Request, Turn, foreseen
from waychair.planning.fleet.rules import Priority, aged
from waychair.planning.fleet.sipp import Stay
from waychair.planning.fleet.ways import NEVER
from waychair.types import Json

IDLE_MS = 300_000
"""ms after which a chair that others wait for is asked to make room."""

LATE_MS = 1_000
"""A wait that is foreseen to end within so many ms goes on for an unknown time: the chair ahead is late, or turns where it is."""


class Reason(enum.Enum):
    """The rule by which the other chair goes first."""

    FIRST = "first in the queue"
    PRIORITY = "higher priority"
    AGE = "asked earlier"
    TAKEN = "the place is taken"
    CLOSED = "the way is closed"
    NO_ROOM = "no room to pass"


@dataclass(frozen=True, slots=True)
class Wait:
    """A chair that waits before a place, for another chair or for none; `foreseen_ms` is None where no end is foreseen."""

    chair: int
    other: int | None
    place: str
    reason: Reason
    priorities: tuple[Priority, Priority | None]
    waited_ms: int
    foreseen_ms: int | None

    @property
    def sentence(self) -> str:
        """The wait in words, with its foreseen time, for the rider."""
        if self.other is None or self.foreseen_ms is None or self.reason is Reason.NO_ROOM:
            return self.why
        return f"{self.why.removesuffix('.')}: about {max(round(self.foreseen_ms / 5000) * 5, 5)} s."

    @property
    def why(self) -> str:
        """The wait in words, without its time."""
        if self.other is None:
            return f"Waits: {self.place} is closed." if self.reason is Reason.CLOSED else f"Waits before {self.place}."
        if self.reason is Reason.NO_ROOM:
            return f"Waits: chair {self.other} wants the way here, and there is no room to pass. Ask for help."
        if self.reason is Reason.PRIORITY:
            return f"Lets chair {self.other} go first: it has priority."
        if self.reason is Reason.AGE:
            return f"Lets chair {self.other} go first: it has waited longer."
        return f"Waits for chair {self.other} to leave {self.place}."


def waits(order: Order, now_ms: int, clearing_ms: int) -> tuple[Wait, ...]:
    """Return the waits of all chairs that could go on, or have asked for a goal, but may not go now."""
    held = [chair for chair in order.chains if _is_held(order, chair, now_ms)]
    times = foreseen(order, now_ms, clearing_ms) if held else None
    found = [_wait(order, chair, now_ms, times) for chair in held]
    for request in order.waiting:
        holder = _holder(order, request)
        before = _under_way(order, request) if holder is None else None
        if before is not None:
            other, spot = before
            theirs = _priority(order.chains[other], now_ms)
            age_ms = now_ms - request.asked_ms
            place = order.ways.names[spot]
            found.append(Wait(request.chair, other, place, Reason.FIRST, (request.priority, theirs), age_ms, None))
            continue
        behind = holder is not None and any(each.chair == holder for each in order.waiting)
        found.append(
            Wait(
                request.chair,
                holder,
                request.goal if holder is None else order.ways.names[order.chains[holder].spots[-1]],
                Reason.NO_ROOM if behind else Reason.TAKEN,
                (request.priority, None),
                now_ms - request.asked_ms,
                None,
            )
        )
    return tuple(found)


def wait_of(order: Order, chair: int, now_ms: int, clearing_ms: int) -> Wait | None:
    """Return the wait of a chair that could go on along its chain but may not; None if it may, or is not ready.

    A chair whose own rear has not left yet waits for nobody.
    """
    if not _is_held(order, chair, now_ms):
        return None
    return _wait(order, chair, now_ms, foreseen(order, now_ms, clearing_ms))


def _is_held(order: Order, chair: int, now_ms: int) -> bool:
    """Return whether a chair could go on along its chain but may not, for another one or as its way is closed."""
    on_its_way = order.next_spot(chair) is not None and order.chains[chair].ready_ms <= now_ms
    return on_its_way and not order.may_enter(chair) and order.in_front(chair) != chair


def _wait(order: Order, chair: int, now_ms: int, times: Mapping[Turn, Stay] | None) -> Wait:
    """Return the wait of a chair that is held, with the foreseen times of all turns."""
    chain, other, spot = order.chains[chair], order.in_front(chair), order.next_spot(chair)
    assert spot is not None
    theirs = None if other is None else _priority(order.chains[other], now_ms)
    left_ms = None if times is None else times[Turn(chair, chain.visit + 1)].from_ms - now_ms
    return Wait(
        chair,
        other,
        order.ways.names[spot],
        Reason.CLOSED if other is None else _reason(chain, order.chains[other], now_ms),
        (_priority(chain, now_ms) or Priority.ROUTINE, theirs),
        now_ms - chain.ready_ms,
        None if left_ms is None or left_ms < LATE_MS else left_ms,
    )


def in_the_way(order: Order, now_ms: int) -> dict[int, tuple[int, ...]]:
    """Return the chairs that have long been idle in places for which others wait, with those chairs, oldest request first.

    The rider is asked to make room; a chair without a rider goes by itself where the site allows it.
    """
    found: dict[int, tuple[int, ...]] = {}
    asking = {request.chair for request in order.waiting}
    for request in order.waiting:
        holder = _holder(order, request)
        if holder is None or holder in asking or len(order.chains[holder].spots) > 1:
            continue
        if now_ms - order.chains[holder].entered_ms > IDLE_MS:
            found[holder] = (*found.get(holder, ()), request.chair)
    return found


def place_to_wait(order: Order, chair: int) -> str | None:
    """Return where a chair that makes room should go: its dock, else the nearest free dock or bay; None if there is none."""
    ways = order.ways
    at = order.chains[chair].spots[0]
    taken = [ways.names[chain.spots[-1]] for chain in order.chains.values()]
    taken += [request.goal for request in order.waiting]
    options = [
        (refuge.owner != chair, int(ways.least_ms(refuge.name)[at]), refuge.name)
        for refuge in ways.graph.refuges
        if (refuge.waiting or refuge.kind is RefugeKind.DOCK)
        and refuge.owner in (None, chair)
        and taken.count(refuge.name) < refuge.slots
        and ways.least_ms(refuge.name)[at] < NEVER
    ]
    return min(options)[2] if options else None


def _holder(order: Order, request: Request) -> int | None:
    """Return a chair that is, or will be, in the place asked for, or else one that stands idle on the shortest way there."""
    ways = order.ways
    ends = {chair: chain.spots[-1] for chair, chain in order.chains.items() if chair != request.chair}
    for chair, spot in ends.items():
        if ways.names[spot] == request.goal:
            return chair
    on_the_way = {int(ways.resource[spot]) for spot in _shortest_way(order, request)}
    return next((chair for chair, spot in ends.items() if int(ways.resource[spot]) in on_the_way), None)


def _under_way(order: Order, request: Request) -> tuple[int, int] | None:
    """Return a chair that will drive through the shortest way to the place asked for, and the first spot it needs there."""
    on_the_way = [int(order.ways.resource[spot]) for spot in _shortest_way(order, request)]
    for resource in on_the_way:
        for turn in order.queues.get(resource, ()):
            chain = order.chains[turn.chair]
            if turn.chair != request.chair and turn.visit >= chain.visit:
                return turn.chair, chain.spots[turn.visit - chain.visit]
    return None


def _shortest_way(order: Order, request: Request) -> list[int]:
    """Return the spots of the shortest way to the place asked for."""
    ways = order.ways
    left = ways.least_ms(request.goal)
    spot = order.chains[request.chair].spots[0]
    found = []
    while left[spot] > 0:
        after = ways.after[ways.first[spot] : ways.first[spot + 1]]
        spot = int(after[left[after].argmin()])
        found.append(spot)
    return found


def _priority(chain: Chain, now_ms: int) -> Priority | None:
    request = chain.request
    return None if request is None else aged(request.priority, now_ms - request.asked_ms)


def _reason(own: Chain, other: Chain, now_ms: int) -> Reason:
    if own.request is None or other.request is None:
        return Reason.FIRST
    mine, theirs = _priority(own, now_ms), _priority(other, now_ms)
    if mine is not None and theirs is not None and theirs > mine:
        return Reason.PRIORITY
    return Reason.AGE if other.request.asked_ms < own.request.asked_ms else Reason.FIRST


@dataclass(slots=True)
class Audit:
    """The waits as they begin and end, one record each; `ended` are records with foreseen and real wait."""

    begun: dict[int, tuple[int, Wait]] = field(default_factory=dict)
    ended: list[Json] = field(default_factory=list)

    def note(self, now: Iterable[Wait], now_ms: int) -> None:
        """Take down all waits of this moment: new ones begin, those that are missing have ended."""
        present = {wait.chair: wait for wait in now}
        for chair, (_, wait) in list(self.begun.items()):
            if chair not in present or present[chair].place != wait.place:
                self.end(chair, now_ms)
        for wait in present.values():
            self.begin(wait, now_ms)

    def begin(self, wait: Wait | None, now_ms: int) -> None:
        """Take down that a chair waits, unless it did already."""
        if wait is not None:
            self.begun.setdefault(wait.chair, (now_ms, wait))

    def end(self, chair: int, now_ms: int) -> Json | None:
        """Take down that a chair does not wait any more, and return the record; None if it did not wait."""
        if chair not in self.begun:
            return None
        begun_ms, wait = self.begun.pop(chair)
        self.ended.append(_record(wait, begun_ms, now_ms))
        return self.ended[-1]

    def foreseen_right(self) -> float | None:
        """Return the share of ended waits that were foreseen within 5 s or a quarter of the real wait; None if none was."""
        told = [each for each in self.ended if each["foreseen_s"] is not None]
        if not told:
            return None
        right = [abs(each["foreseen_s"] - each["real_s"]) <= max(5.0, 0.25 * each["real_s"]) for each in told]
        return right.count(True) / len(right)


def _record(wait: Wait, begun_ms: int, now_ms: int) -> Json:
    return {
        "begun_ms": begun_ms,
        "place": wait.place,
        "waits": wait.chair,
        "first": wait.other,
        "rule": wait.reason.value,
        "priorities": [None if each is None else each.name.lower() for each in wait.priorities],
        "age_s": wait.waited_ms / 1e3,
        "foreseen_s": None if wait.foreseen_ms is None or wait.foreseen_ms >= NEVER // 2 else wait.foreseen_ms / 1e3,
        "real_s": (now_ms - begun_ms) / 1e3,
    }


def jain(values: Sequence[float]) -> float:
    """Return Jain's index of fairness of non-negative values: 1 if all are equal, 1/n if one has all; 1 without any.

    (R. Jain et al., DEC-TR-301, 1984.)
    """
    squares = sum(value * value for value in values)
    return 1.0 if squares == 0.0 else sum(values) ** 2 / (len(values) * squares)
