"""Granting: waiting requests become chains, and the chains of all chairs are planned anew where that saves time.

Chairs are planned one after the other by safe intervals, in several orders; where none of these succeeds, LaCAM finds a way
over the spots for all together (two chairs that exchange their places, or a corridor that has just closed). Then CBS looks
for the best plan of up to eight chairs; where it is not proven in a few steps, rounds of large neighbourhood search plan a
few chairs anew each. Only the order of the result is kept: no chair has to keep times.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain as chained

import numpy as np

from waychair.errors import TaskError
from waychair.planning.fleet.cbs import Constraint, barred_entries, barred_uses, best_ways
from waychair.planning.fleet.joint_ways import joint_ways
from waychair.planning.fleet.order import Chain, Order, Request, Turn, foreseen, stopped
from waychair.planning.fleet.rules import MOST_OVERTAKINGS, aged, weight
from waychair.planning.fleet.sipp import ANY_ENTRY, Stay, earliest, gaps_between
from waychair.planning.fleet.ways import NEVER, Ways
from waychair.types import IntArray

_ORDERS = 6
"""Orders of chairs that are tried before all are planned together."""

_LARGEST = 4
"""Chairs that a round plans anew at most."""

_LATER_MS = 500
"""A delay of less is none."""

_MOST_FOR_CBS = 8
"""Chairs under way for which the best plan is tried to be proven."""

CBS_STEPS = 24
"""Steps of that search; most conflicts of a few chairs need fewer, and the others are left to the rounds."""

NOBODY = -1
"""Stands for constraints among the chairs."""

Plan = dict[int, tuple[Stay, ...]]
"""The stays of each chair from the spot it is in, in the order of time."""


@dataclass(frozen=True, slots=True)
class Granting:
    """The circumstances of a plan.

    Attributes:
        order: the order so far.
        now_ms: the time.
        clearing_ms: the time that a rear takes to leave.
        rng: the random stream.
        fixed: the stays that no plan changes: rears that have not left yet, and closed resources.
    """

    order: Order
    now_ms: int
    clearing_ms: int
    rng: np.random.Generator
    fixed: tuple[Stay, ...]

    @property
    def ways(self) -> Ways:
        return self.order.ways


def granted(
    order: Order,
    now_ms: int,
    clearing_ms: int,
    rng: np.random.Generator,
    rounds: int,
    proof_steps: int = CBS_STEPS,
) -> Order:
    """Return the order with all requests granted that can be, and the chains of least weighted delay that were found.

    A request for a taken place stays in `waiting`, unless the place's holder leaves by this order. `rounds` is the number
    of rounds of improvement where the best plan is not proven in `proof_steps` steps of CBS.

    Raises:
        TaskError: the clearing time is not above 0, without which two chairs could exchange their spots in no time.
    """
    if clearing_ms < 1:
        raise TaskError(f"a chair's rear cannot have left {clearing_ms} ms after its front: give 1 ms or more")
    state = Granting(order, now_ms, clearing_ms, rng, _fixed(order, now_ms, clearing_ms))
    requests = grantable(order)
    old = _current(order, now_ms, clearing_ms)
    plan = _first(state, old, requests)
    while plan is None and requests:
        last = max(requests, key=lambda chair: (-requests[chair].priority, requests[chair].asked_ms))
        requests = _without(order, requests, last)
        plan = _first(state, old, requests)
    if plan is None:
        return _retreated(state)
    wishes = _wishes(order, requests)
    best = _best(state, plan, wishes, proof_steps)
    if best is not None and not _overtakes_too_often(state, best, old or {}, wishes):
        plan = best
    else:
        plan = _improved(state, plan, old or {}, wishes, rounds)
    return _order_of(state, plan, old or {}, wishes, requests)


def _wishes(order: Order, requests: Mapping[int, Request]) -> dict[int, Request]:
    """Return the requests of the chairs under way, and these."""
    return {chair: chain.request for chair, chain in order.chains.items() if chain.request is not None} | dict(requests)


def _first(state: Granting, old: Plan | None, requests: Mapping[int, Request]) -> Plan | None:
    """Return a plan with ways for the requests; None if there is none, or only one that overtakes a chair too often."""
    if old is None:
        return _together(state, requests)
    plan = _extended(state, old, requests)
    if plan is None or _overtakes_too_often(state, plan, old, _wishes(state.order, requests)):
        return None
    return plan


def grantable(order: Order) -> dict[int, Request]:
    """Return the waiting requests whose goals are free or become free by chains or by requests that can be granted."""
    ways = order.ways
    ready = {each.chair: each for each in order.waiting}
    while True:
        left = {name: len(slots) for name, slots in ways.slots.items()}
        for chair, chain in order.chains.items():
            spot = chain.spots[-1]
            if chair not in ready and ways.at_home[spot]:
                left[ways.names[spot]] -= 1
        refused = []
        for chair, request in sorted(ready.items(), key=lambda item: (-item[1].priority, item[1].asked_ms)):
            left[request.goal] -= 1
            if left[request.goal] < 0:
                refused.append(chair)
        if not refused:
            return ready
        for chair in refused:
            del ready[chair]


def _without(order: Order, requests: Mapping[int, Request], chair: int) -> dict[int, Request]:
    """Return the requests that can be granted without that of one chair."""
    kept = {each.chair for each in requests.values()} - {chair}
    fewer = replace(order, waiting=tuple(each for each in order.waiting if each.chair in kept))
    return grantable(fewer)


def _current(order: Order, now_ms: int, clearing_ms: int) -> Plan | None:
    """Return the foreseen stays of the chains as granted; None if a closed resource or a cycle is before some chair."""
    times = foreseen(order, now_ms, clearing_ms)
    if times is None:
        return None
    plan = {
        chair: tuple(times[Turn(chair, chain.visit + k)] for k in range(len(chain.spots)))
        for chair, chain in order.chains.items()
    }
    resource = order.ways.resource
    blocked = any(int(resource[stay.spot]) in order.closed for stays in plan.values() for stay in stays[1:])
    return None if blocked else plan


def _fixed(order: Order, now_ms: int, clearing_ms: int) -> tuple[Stay, ...]:
    """Return the stays that no plan changes: rears that have not left yet, and closed resources."""
    rears = [
        Stay(spot, now_ms, max(now_ms, chain.entered_ms + clearing_ms))
        for chain in order.chains.values()
        for _, spot in chain.behind
    ]
    resource = order.ways.resource.tolist() if order.closed else []
    return (*rears, *(Stay(resource.index(each), now_ms, NEVER) for each in order.closed))


def _way(state: Granting, chair: int, goal: str, others: Plan, barred: IntArray = ANY_ENTRY) -> tuple[Stay, ...]:
    """Return the earliest stays of a chair among those of others, empty if there are none."""
    chain = state.order.chains[chair]
    held = int(state.ways.resource[chain.spots[0]])
    fixed = [stay for stay in state.fixed if state.ways.resource[stay.spot] != held]
    stays = chained(fixed, *(each for other, each in others.items() if other != chair))
    gaps = gaps_between(state.ways, stays, state.now_ms)
    if gaps.first[held] == gaps.first[held + 1] or gaps.gaps[gaps.first[held], 0] > state.now_ms:
        return ()  # another one would be where the chair is now
    ready_ms = max(chain.ready_ms, state.now_ms)
    return earliest(state.ways, gaps, chain.spots[0], ready_ms, goal, state.clearing_ms, NEVER, barred)


def _extended(state: Granting, plan: Plan, requests: Mapping[int, Request]) -> Plan | None:
    """Return the plan with ways for the requests, planned one after the other or all together; None if there is none."""
    if not requests:
        return plan
    by_age = sorted(requests, key=lambda chair: (-_rank(state, requests[chair]), requests[chair].asked_ms))
    for attempt in range(_ORDERS):
        chairs: list[int] = by_age if attempt == 0 else state.rng.permutation(by_age).tolist()
        found: Plan | None = {chair: stays for chair, stays in plan.items() if chair not in requests}
        for chair in chairs:
            stays = _way(state, chair, requests[chair].goal, found or {})
            if not stays or found is None:
                found = None
                break
            found[chair] = stays
        if found is not None:
            return found
        if len(requests) == 1:
            break
    return _together(state, requests)


def _rank(state: Granting, request: Request) -> int:
    return int(aged(request.priority, state.now_ms - request.asked_ms))


def _together(state: Granting, requests: Mapping[int, Request]) -> Plan | None:
    """Return a plan for all chairs at once, those under way as well; None if none was found."""
    order = state.order
    goals = {
        chair: requests[chair].goal if chair in requests else state.ways.names[chain.spots[-1]]
        for chair, chain in order.chains.items()
    }
    for spots, turns in joint_ways(order, goals, state.rng):
        plan = _current(with_chains(order, spots, turns), state.now_ms, state.clearing_ms)
        if plan is not None:
            return plan
    return None


def _retreated(state: Granting) -> Order:
    """Return the order in which the chairs under way go to free refuges that they can still reach; their requests wait.

    A chair that reaches none stays where it is, and so do all where no way for all together was found.
    """
    order, ways = state.order, state.ways
    moving = [chair for chair, chain in order.chains.items() if not ways.at_home[chain.spots[0]]]
    again = tuple(chain.request for chain in order.chains.values() if chain.request is not None)
    still = order
    for chair in order.chains:
        still = stopped(still, chair)
    still = replace(still, waiting=(*again, *order.waiting))
    plan: Plan = {chair: (Stay(chain.spots[0], state.now_ms, NEVER),) for chair, chain in still.chains.items()}
    calm = replace(state, order=still, fixed=_fixed(still, state.now_ms, state.clearing_ms))
    for chair in sorted(moving, key=lambda chair: -order.chains[chair].visit):
        taken = {ways.names[stays[-1].spot] for stays in plan.values()}
        options = [name for name in ways.slots if name not in taken]
        found = [way for name in options if (way := _way(calm, chair, name, plan))]
        if found:
            plan[chair] = min(found, key=_arrival)
    return _order_of(calm, plan, {}, {}, {})


def with_chains(order: Order, spots: Mapping[int, tuple[int, ...]], turns: Mapping[int, Sequence[Turn]]) -> Order:
    """Return the order with new chains from where the chairs are, and new queues behind the rears that have not left."""
    chains = {chair: replace(chain, spots=spots[chair]) for chair, chain in order.chains.items()}
    queues: dict[int, list[Turn]] = {}
    for chair, chain in order.chains.items():
        for visit, spot in chain.behind:
            queues.setdefault(int(order.ways.resource[spot]), []).append(Turn(chair, visit))
    for resource, later in turns.items():
        queues.setdefault(resource, []).extend(later)
    return replace(order, chains=chains, queues={resource: tuple(queue) for resource, queue in queues.items()})


def _best(state: Granting, plan: Plan, wishes: Mapping[int, Request], steps: int) -> Plan | None:
    """Return the plan of least weighted sum of arrivals for a few chairs; None if there are many, or no proof in time."""
    weights = _weights(state, plan, wishes)
    if steps < 1 or len(weights) > _MOST_FOR_CBS:
        return None
    rest = {chair: stays for chair, stays in plan.items() if chair not in weights}

    def way_of(chair: int, constraints: tuple[Constraint, ...]) -> tuple[Stay, ...]:
        others = {**rest, NOBODY: tuple(barred_uses(state.ways, constraints))}
        return _way(state, chair, wishes[chair].goal, others, barred=barred_entries(constraints))

    found = best_ways(state.ways, weights, way_of, state.clearing_ms, steps)
    return None if found is None else rest | dict(found.ways)


def _weights(state: Granting, plan: Plan, wishes: Mapping[int, Request]) -> dict[int, float]:
    """Return how much the arrival of each chair that has a way before it counts."""
    return {
        chair: weight(wish.priority, state.now_ms - wish.asked_ms)
        for chair, wish in wishes.items()
        if len(plan[chair]) > 1
    }


def _improved(state: Granting, plan: Plan, old: Plan, wishes: Mapping[int, Request], rounds: int) -> Plan:
    """Return the plan after rounds in which a few chairs are planned anew and the better plan is kept."""
    weights = _weights(state, plan, wishes)
    movers = list(weights)
    least = {chair: _undisturbed_ms(state, chair, wishes[chair].goal) for chair in movers}
    for _ in range(rounds):
        late = [chair for chair in movers if _arrival(plan[chair]) > least[chair]]
        if not late or len(movers) < 2:
            break
        count = min(len(movers), int(state.rng.integers(2, _LARGEST + 1)))
        first = int(state.rng.choice(late))
        others = [chair for chair in movers if chair != first]
        chosen = [first, *state.rng.choice(others, min(count - 1, len(others)), replace=False).tolist()]
        new = {chair: stays for chair, stays in plan.items() if chair not in chosen}
        allowed = sum(weights[chair] * _arrival(plan[chair]) for chair in chosen)
        for chair in state.rng.permutation(chosen).tolist():
            stays = _way(state, chair, wishes[chair].goal, new)
            if not stays:
                break
            new[chair] = stays
        if len(new) < len(plan):
            continue
        price = sum(weights[chair] * _arrival(new[chair]) for chair in chosen)
        if price < allowed and not _overtakes_too_often(state, new, old, wishes):
            plan = new
    return plan


def _undisturbed_ms(state: Granting, chair: int, goal: str) -> int:
    """Return the earliest time at which a chair could be in its goal alone."""
    chain = state.order.chains[chair]
    ready = max(chain.ready_ms, state.now_ms)
    spot = chain.spots[0]
    return ready + int(state.ways.least_ms(goal)[spot]) - int(state.ways.passing_ms[spot])


def _arrival(stays: tuple[Stay, ...]) -> int:
    return stays[-1].from_ms


def _overtakes_too_often(state: Granting, plan: Plan, old: Plan, wishes: Mapping[int, Request]) -> bool:
    found = overtaken(state, plan, old, wishes)
    return any(len(numbers) > MOST_OVERTAKINGS for numbers in found.values())


def overtaken(state: Granting, plan: Plan, old: Plan, wishes: Mapping[int, Request]) -> dict[int, frozenset[int]]:
    """Return for each chair the numbers of later requests of no higher rank that delay it by going first.

    A chair is delayed if its arrival by the plan is later than by the old one; the old numbers are kept.
    """
    chains = state.order.chains
    found = {
        chair: chains[chair].overtaken_by if chains[chair].request == wish else frozenset()
        for chair, wish in wishes.items()
    }
    resource = state.ways.resource
    first_use = {
        chair: {int(resource[stay.spot]): stay.from_ms for stay in reversed(stays)} for chair, stays in plan.items()
    }
    for chair, request in wishes.items():
        # the spots that a chair holds without its request, as after another warden, end before its goal
        if chair not in old or chains[chair].request != request:
            continue
        if _arrival(plan[chair]) <= _arrival(old[chair]) + _LATER_MS:
            continue
        for other, later in wishes.items():
            if later.asked_ms <= request.asked_ms or later.number in found[chair]:
                continue
            if _rank(state, later) > _rank(state, request):
                continue
            shared = first_use[chair].keys() & first_use[other].keys()
            if any(first_use[other][each] < first_use[chair][each] for each in shared):
                found[chair] |= {later.number}
    return found


def _order_of(
    state: Granting, plan: Plan, old: Plan, wishes: Mapping[int, Request], requests: Mapping[int, Request]
) -> Order:
    """Return the order in which the stays of a plan use each resource."""
    order = state.order
    counted = overtaken(state, plan, old, wishes)
    uses: dict[int, list[tuple[int, Turn]]] = {}
    chains: dict[int, Chain] = {}
    for chair, chain in order.chains.items():
        stays = plan[chair]
        for k, stay in enumerate(stays):
            turn = Turn(chair, chain.visit + k)
            uses.setdefault(int(state.ways.resource[stay.spot]), []).append((-1 if k == 0 else stay.from_ms, turn))
        chains[chair] = replace(
            chain,
            spots=tuple(stay.spot for stay in stays),
            request=wishes.get(chair) if len(stays) > 1 else None,
            overtaken_by=counted.get(chair, frozenset()) if len(stays) > 1 else frozenset(),
        )
    turns = {resource: [turn for _, turn in sorted(each)] for resource, each in uses.items()}
    done = {request.number for request in requests.values()}
    new = with_chains(order, {chair: chain.spots for chair, chain in chains.items()}, turns)
    return replace(new, chains=chains, waiting=tuple(each for each in order.waiting if each.number not in done))
