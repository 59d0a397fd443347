"""The warden of a district: hears its chairs, keeps their order, and answers with grants on lease.

Pure: `decided` goes from the state and the messages heard to a new state and the answers. A lease is a duration on the
clock of the chair that holds it, so that no clocks need to agree. It lapses for spots that the chair has not entered; a
spot that a chair is in stays taken until the chair says that it has left.
"""

from __future__ import annotations

import enum
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from waychair.errors import TaskError
from waychair.planning.fleet.granting import grantable, granted
from waychair.planning.fleet.order import Order, Request, asked, cleared, entered, foreseen, held_up, parked, stopped
from waychair.planning.fleet.rules import Priority
from waychair.planning.fleet.waits import Wait, waits
from waychair.planning.fleet.ways import Ways

LEASE_MS = 3_000
"""ms for which a grant holds without a renewal."""

SILENT_MS = LEASE_MS + 500
"""ms of silence after which a chair has certainly stopped by its lapsed lease: clocks drift 200 ppm, messages take time."""

ROUNDS = 80
"""Rounds of improvement of a plan; about 20 ms with eight chairs."""

_LATE_MS = 10_000
"""ms that a chair may fall behind the time foreseen before the order is planned anew."""

_TRIED_AGAIN_MS, _MOST_DOUBLED = 1_000, 5
"""ms after which a search for ways is repeated by other random choices where it left all chairs standing, twice as long after
each one, and how often that is doubled: a search that goes on in vain takes 0.1 s.
"""


class RequestWord(enum.Enum):
    """The words of VDA 5050 for the state of a request."""

    GRANTED = "granted"
    QUEUED = "queued"
    REJECTED = "rejected"
    REVOKED = "revoked"


@dataclass(frozen=True, slots=True)
class Reply:
    """The answer to a chair: the spots it may use in their order (the first is where it is), for how long, and why not."""

    chair: int
    answer: RequestWord
    serial: int
    spots: tuple[int, ...] = ()
    lease_ms: int = LEASE_MS
    sentence: str = ""


@dataclass(frozen=True, slots=True)
class ChairReport:
    """A chair's word: it has entered so many spots in all, its rear still uses the last `behind` before, ready when.

    Attributes:
        visits: number of the spot that it is in, among all that it was granted.
        behind: spots before that one that its rear has not left.
        ready_in_ms: time until it can leave the spot.
        leaves_in_ms: time until its rear has left each of those behind, the earliest first, as far as the chair knows.
    """

    chair: int
    visits: int
    behind: int = 0
    ready_in_ms: int = 0
    leaves_in_ms: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class Heard:
    """Messages of one step: reports, new requests, and sections seen blocked with the time for which that is believed."""

    reports: tuple[ChairReport, ...] = ()
    requests: tuple[Request, ...] = ()
    blocked_ms: Mapping[str, int] = field(default_factory=dict)


@dataclass(frozen=True)
class WardenState:
    """The state of a warden.

    Attributes:
        order: the chairs' order.
        clearing_ms: time that a chair's rear takes to leave a spot.
        seed: of the random choices of plans.
        serial: number of the last order that differed from the one before.
        heard_ms: when each chair was last heard.
        blocked_until_ms: resources that are closed, and until when.
        expected_ms: the arrivals that were foreseen with the last plan.
        priorities: of the requests in the last order, by their numbers; where one differs, all is planned anew.
        tries: searches repeated since some chair had a way, and `tried_ms`, when ways were searched for last.
    """

    order: Order
    clearing_ms: int
    seed: int = 0
    serial: int = 0
    heard_ms: Mapping[int, int] = field(default_factory=dict)
    blocked_until_ms: Mapping[int, int] = field(default_factory=dict)
    expected_ms: Mapping[int, int] = field(default_factory=dict)
    priorities: Mapping[int, Priority] = field(default_factory=dict)
    tries: int = 0
    tried_ms: int = 0


def warm_up(ways: Ways) -> None:
    """Load the planner's compiled parts, by plans for two chairs that want each other's places."""
    places = list(ways.slots)[:2]
    state = WardenState(parked(ways, dict(enumerate(places))), 1)
    requests = (Request(1 + chair, chair, place, 0) for chair, place in enumerate(reversed(places)))
    decided(state, Heard(requests=tuple(requests)), 0)


def decided(state: WardenState, heard: Heard, now_ms: int) -> tuple[WardenState, tuple[Reply, ...], tuple[Wait, ...]]:
    """Return the state after the messages of a step, the answers to all chairs, and all present waits."""
    before = state.order
    order, times, refused = _with_messages(state, heard, now_ms)
    blocked = _blocked(state, heard.blocked_ms, now_ms)
    silent = [
        chair
        for chair, chain in order.chains.items()
        if len(chain.spots) > 1 and now_ms - times.get(chair, now_ms) > SILENT_MS
    ]
    for chair in silent:
        order = stopped(order, chair)
    order = replace(order, closed=frozenset(blocked))
    changed = bool(heard.requests or silent) or order.closed != before.closed
    priorities = _priorities(order)
    changed |= any(priorities.get(number, priority) is not priority for number, priority in state.priorities.items())
    came_free = bool(order.waiting) and any(
        len(chain.spots) == 1 < len(before.chains[chair].spots) for chair, chain in order.chains.items()
    )
    differs, stuck = changed or came_free or _is_late(state, order, now_ms), _is_stuck(order)
    tries, tried_ms = state.tries if stuck else 0, state.tried_ms
    again = stuck and not differs and now_ms - tried_ms >= _TRIED_AGAIN_MS << min(tries, _MOST_DOUBLED)
    if differs or again:
        tries, tried_ms = tries + again, now_ms
        rng = np.random.default_rng([state.seed, state.serial, tries])
        order = granted(order, now_ms, state.clearing_ms, rng, ROUNDS)
        expected = _arrivals(order, now_ms, state.clearing_ms)
    else:
        expected = dict(state.expected_ms)
    replanned = any(order.chains[chair].spots[1:] != before.chains[chair].spots[1:] for chair in order.chains)
    new = replace(
        state,
        order=order,
        serial=state.serial + replanned,
        heard_ms=times,
        blocked_until_ms=blocked,
        expected_ms=expected,
        priorities=priorities,
        tries=tries,
        tried_ms=tried_ms,
    )
    present = waits(order, now_ms, state.clearing_ms)
    return new, (*refused, *_replies(new, before, present)), present


def _with_messages(state: WardenState, heard: Heard, now_ms: int) -> tuple[Order, dict[int, int], list[Reply]]:
    """Return the order after the messages of a step, when each chair was last heard, and the refusals."""
    order, times, refused = state.order, dict(state.heard_ms), []
    for report in heard.reports:
        if report.chair not in order.chains:
            refused.append(_refusal(report.chair, f"chair {report.chair} is not in this building: park it in a refuge"))
            continue
        times[report.chair] = now_ms
        try:
            order = _followed(order, report, now_ms)
        except TaskError as error:
            refused.append(_refusal(report.chair, str(error)))
    for request in heard.requests:
        try:
            order = asked(order, request)
        except TaskError as error:
            refused.append(_refusal(request.chair, str(error)))
    return order, times, refused


def _blocked(state: WardenState, seen_ms: Mapping[str, int], now_ms: int) -> dict[int, int]:
    """Return until when which resources are closed, with the sections that are seen blocked now, for some ms each."""
    ways = state.order.ways
    blocked = {resource: until for resource, until in state.blocked_until_ms.items() if until > now_ms}
    for name, for_ms in seen_ms.items():
        for spot in np.flatnonzero(np.array(ways.names) == name).tolist():
            blocked[int(ways.resource[spot])] = now_ms + for_ms
    return blocked


def _priorities(order: Order) -> dict[int, Priority]:
    """Return the priorities of all requests by their numbers."""
    requests = (*order.waiting, *(chain.request for chain in order.chains.values() if chain.request is not None))
    return {request.number: request.priority for request in requests}


def _followed(order: Order, report: ChairReport, now_ms: int) -> Order:
    """Return the order after all that a chair's report says it has done since the last one.

    Raises:
        TaskError: it entered a spot out of turn.
    """
    while order.chains[report.chair].visit < report.visits:
        order = entered(order, report.chair, now_ms)
    while len(order.chains[report.chair].behind) > max(report.behind, 0):
        order = cleared(order, report.chair)
    leaves_ms = tuple(now_ms + each for each in report.leaves_in_ms)
    return held_up(order, report.chair, now_ms + report.ready_in_ms, leaves_ms)


def _is_stuck(order: Order) -> bool:
    """Return whether all chairs stand, though some could be granted their goals if a way was found."""
    stand = all(len(chain.spots) < 2 for chain in order.chains.values())
    return stand and bool(order.waiting) and bool(grantable(order))


def _is_late(state: WardenState, order: Order, now_ms: int) -> bool:
    """Return whether some chair will arrive much later than was foreseen with the last plan."""
    arrivals = _arrivals(order, now_ms, state.clearing_ms)
    return any(arrival > state.expected_ms.get(chair, arrival) + _LATE_MS for chair, arrival in arrivals.items())


def _arrivals(order: Order, now_ms: int, clearing_ms: int) -> dict[int, int]:
    times = foreseen(order, now_ms, clearing_ms) or {}
    last = {chair: chain.last for chair, chain in order.chains.items() if len(chain.spots) > 1}
    return {turn.chair: stay.from_ms for turn, stay in times.items() if last.get(turn.chair) == turn.visit}


def _refusal(chair: int, sentence: str) -> Reply:
    return Reply(chair, RequestWord.REJECTED, 0, (), 0, sentence)


def _replies(state: WardenState, before: Order, present: tuple[Wait, ...]) -> tuple[Reply, ...]:
    """Return an answer to each chair that has a chain, or had one, or waits for one."""
    why = {wait.chair: wait.sentence for wait in present}
    asking = {request.chair for request in state.order.waiting}
    found = []
    for chair, chain in state.order.chains.items():
        sentence = why.get(chair, "")
        if len(chain.spots) > 1:
            found.append(Reply(chair, RequestWord.GRANTED, state.serial, chain.spots, LEASE_MS, sentence))
        elif chair in asking:
            found.append(Reply(chair, RequestWord.QUEUED, state.serial, chain.spots, LEASE_MS, sentence))
        elif len(before.chains[chair].spots) > 1 and chain.visit == before.chains[chair].visit:
            found.append(Reply(chair, RequestWord.REVOKED, state.serial, chain.spots, LEASE_MS, sentence))
    return tuple(found)


@dataclass(frozen=True, slots=True)
class Lease:
    """A grant as the chair holds it: its spots, and when and for how long it was heard, on the chair's own clock [ns]."""

    spots: tuple[int, ...]
    heard_ns: int
    lease_ms: int

    def usable(self, now_ns: int) -> tuple[int, ...]:
        """Return the spots that the chair may be in now: all while the lease holds, else the one it is in.

        A clock that went backwards, or a computer that slept, ends the lease.
        """
        age_ns = now_ns - self.heard_ns
        return self.spots if 0 <= age_ns <= self.lease_ms * 1_000_000 else self.spots[:1]
