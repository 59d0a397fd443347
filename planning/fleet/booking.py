"""Booking: one request is granted behind all plans made before, in a millisecond, for a storey with a hundred chairs.

`granting.granted` looks for the best plan of all chairs; it takes too long where a hundred drive. Here a new request takes the
earliest way between the booked stays of the others, which it never delays. In a well-formed building there always is one
(M. Čáp et al., ICAPS 2015).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import chain as chained
from typing import NamedTuple

from waychair.planning.fleet.order import Chain, Order, Request, Turn
from waychair.planning.fleet.sipp import Stay, earliest, gaps_between
from waychair.planning.fleet.ways import NEVER


class Booking(NamedTuple):
    """The stays that a chair has booked; `visit` is the number of the first one among all that it was granted."""

    visit: int
    stays: tuple[Stay, ...]

    def from_ms(self, visit: int) -> int:
        """Return when the chair enters the spot of a visit."""
        return self.stays[visit - self.visit].from_ms


def booked(
    order: Order, bookings: Mapping[int, Booking], request: Request, now_ms: int, clearing_ms: int
) -> tuple[Order, Booking] | None:
    """Return the order with a request of an idle chair granted, and its booking; None if its goal is full or shut off.

    `bookings` are those of all chairs with a chain, and nobody is later than booked.
    """
    ways = order.ways
    chair = request.chair
    own = order.chains[chair]
    ends = [ways.names[each.spots[-1]] for other, each in order.chains.items() if other != chair]
    if ends.count(request.goal) >= len(ways.slots[request.goal]):
        return None
    idle = [
        Stay(each.spots[0], now_ms, NEVER)
        for other, each in order.chains.items()
        if other != chair and other not in bookings
    ]
    stays = chained(idle, *(each.stays for other, each in bookings.items() if other != chair))
    gaps = gaps_between(ways, stays, now_ms)
    way = earliest(ways, gaps, own.spots[0], max(own.ready_ms, now_ms), request.goal, clearing_ms)
    if not way:
        return None
    booking = Booking(own.visit, way)
    known = {**bookings, chair: booking}
    queues = dict(order.queues)
    for k, stay in enumerate(way[1:], start=1):
        resource = int(ways.resource[stay.spot])
        turn = Turn(chair, own.visit + k)
        queues[resource] = _with_turn(order, known, queues.get(resource, ()), turn, stay.from_ms)
    chain = replace(own, spots=tuple(stay.spot for stay in way), request=request, overtaken_by=frozenset())
    waiting = tuple(each for each in order.waiting if each.number != request.number)
    return replace(order, chains={**order.chains, chair: chain}, queues=queues, waiting=waiting), booking


def _with_turn(
    order: Order, bookings: Mapping[int, Booking], queue: tuple[Turn, ...], turn: Turn, from_ms: int
) -> tuple[Turn, ...]:
    """Return a queue with a turn before the first one that is booked later and has not begun."""
    for k, other in enumerate(queue):
        begun = other.visit <= order.chains[other.chair].visit
        if not begun and bookings[other.chair].from_ms(other.visit) > from_ms:
            return (*queue[:k], turn, *queue[k:])
    return (*queue, turn)


def taken_in(order: Order, chair: int, place: str, now_ms: int) -> Order:
    """Return the order with a chair that has come from another district into a free slot of a refuge."""
    ways = order.ways
    spot = next(spot for spot in ways.slots[place] if int(ways.resource[spot]) not in order.queues)
    queues = {**order.queues, int(ways.resource[spot]): (Turn(chair, 0),)}
    chains = {**order.chains, chair: Chain((spot,), 0, now_ms, now_ms)}
    return replace(order, chains=chains, queues=queues)


def handed_over(order: Order, chair: int) -> Order:
    """Return the order without an idle chair that has left for another district."""
    chains = {other: chain for other, chain in order.chains.items() if other != chair}
    queues = {
        resource: left
        for resource, queue in order.queues.items()
        if (left := tuple(turn for turn in queue if turn.chair != chair))
    }
    return replace(order, chains=chains, queues=queues)
