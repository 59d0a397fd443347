"""The order of a district made from the chairs' own words: where each one is, and what it may still enter.

A warden that takes over knows nothing else, and one whose chairs gave something back begins again from here. All chains end
where the chairs certainly are; their wishes are then planned anew.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from waychair.planning.fleet.order import Chain, Order, Turn
from waychair.planning.fleet.peers.messages import State
from waychair.planning.fleet.ways import Ways


@dataclass(frozen=True, slots=True)
class Claim:
    """The spots that a chair is in or may enter, from the rear on, with the number of the last one's visit.

    `ready_ms` is the time until the chair can leave the last one.
    """

    spots: tuple[int, ...]
    visit: int
    ready_ms: int = 0


def claim_of(state: State, with_released: bool) -> Claim | None:
    """Return the claim of a chair by its State, with the spots that it was allowed to enter or without; None for no chair."""
    if not state.entered:
        return None
    released = state.released if with_released else ()
    return Claim((*state.entered, *released), state.visit + len(released), state.ready_ms)


def kept(order: Order, chair: int, now_ms: int) -> Claim:
    """Return the claim of a chair that follows an order: all that it may enter, or has not left."""
    chain = order.chains[chair]
    spots = (*(spot for _, spot in chain.behind), chain.spots[0])
    return Claim(spots, chain.visit, max(chain.ready_ms - now_ms, 0))


def is_known(ways: Ways, claim: Claim) -> bool:
    """Return whether all spots of a claim are in the building."""
    return all(spot < len(ways.names) for spot in claim.spots)


def order_of(ways: Ways, claims: Mapping[int, Claim], now_ms: int) -> Order:
    """Return the order in which every chair is where it says, and has no way before it.

    Where two chairs claim one resource, as can only be where they drive by their own eyes, the one that has it as its last
    spot is first.
    """
    chains: dict[int, Chain] = {}
    held: dict[int, list[tuple[bool, Turn]]] = {}
    for chair, claim in sorted(claims.items()):
        visits = range(claim.visit - len(claim.spots) + 1, claim.visit + 1)
        numbered = list(zip(visits, claim.spots, strict=True))
        last = claim.spots[-1]
        behind = tuple((visit, spot) for visit, spot in numbered[:-1])
        chains[chair] = Chain((last,), claim.visit, now_ms, now_ms + claim.ready_ms, behind)
        for visit, spot in numbered:
            turns = held.setdefault(int(ways.resource[spot]), [])
            turns.append((visit != claim.visit, Turn(chair, visit)))
    queues = {resource: tuple(turn for _, turn in sorted(turns)) for resource, turns in held.items()}
    return Order(ways, chains, queues)
