"""The order in which chairs use the spots of a building: chains granted whole, one queue a resource, never a cycle.

A chair's chain is all spots from the one it is in up to a slot of a refuge. Each resource keeps a queue of turns; the
first may enter, and its turn ends when its rear has left. A turn waits for the one before it in its queue and for the
chair's own turn before. As long as these waits have no cycle and each chain ends in a slot, some chair can always move,
however late anybody is, and all arrive. (The waits are the action dependency graph of W. Hönig et al., "Persistent and
robust execution of MAPF schedules in warehouses", RA-L 2019.)
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import NamedTuple

from waychair.errors import TaskError
from waychair.planning.fleet.rules import Priority
from waychair.planning.fleet.sipp import Stay
from waychair.planning.fleet.ways import NEVER, Ways


@dataclass(frozen=True, slots=True)
class Request:
    """A chair's wish to go to a refuge; `number` is unlike that of every other request of the building."""

    number: int
    chair: int
    goal: str
    asked_ms: int
    priority: Priority = Priority.ROUTINE


class Turn(NamedTuple):
    """A chair's use of a resource: the chair, and the place of the spot in all that the chair has been granted."""

    chair: int
    visit: int


@dataclass(frozen=True, slots=True)
class Chain:
    """The spots of a chair, from the one it is in to a slot; `visit` is the number of the first one.

    Attributes:
        spots: the granted spots, of which the chair has entered the first.
        visit: number of the first spot among all that the chair has been granted.
        entered_ms: when the chair entered it.
        ready_ms: when it can leave it, if nobody is in its way.
        behind: numbers of earlier spots, with the spots, that its rear has not left.
        leaves_ms: when the chair says that it will have left these, the earliest first; it may know of some only.
        request: the request that it serves; none when the chair is idle.
        overtaken_by: numbers of the requests that went first though they were made later.
    """

    spots: tuple[int, ...]
    visit: int = 0
    entered_ms: int = 0
    ready_ms: int = 0
    behind: tuple[tuple[int, int], ...] = ()
    leaves_ms: tuple[int, ...] = ()
    request: Request | None = None
    overtaken_by: frozenset[int] = frozenset()

    @property
    def last(self) -> int:
        """The number of the last granted spot."""
        return self.visit + len(self.spots) - 1


@dataclass(frozen=True, slots=True)
class Order:
    """The chains of all chairs by their numbers, the queue of each resource in use, and requests not granted yet."""

    ways: Ways
    chains: Mapping[int, Chain]
    queues: Mapping[int, tuple[Turn, ...]]
    waiting: tuple[Request, ...] = ()
    closed: frozenset[int] = field(default_factory=frozenset)

    def next_spot(self, chair: int) -> int | None:
        """Return the spot that a chair enters next, None at the end of its chain."""
        chain = self.chains[chair]
        return chain.spots[1] if len(chain.spots) > 1 else None

    def in_front(self, chair: int) -> int | None:
        """Return the chair for which a chair has to wait before its next spot; None if it may enter, or has none.

        A chair whose own rear is still in that resource waits for itself.
        """
        spot = self.next_spot(chair)
        if spot is None:
            return None
        chain = self.chains[chair]
        first = self.queues[int(self.ways.resource[spot])][0]
        return None if first == Turn(chair, chain.visit + 1) else first.chair

    def may_enter(self, chair: int) -> bool:
        """Return whether a chair may enter its next spot now."""
        spot = self.next_spot(chair)
        return spot is not None and self.in_front(chair) is None and int(self.ways.resource[spot]) not in self.closed


def parked(ways: Ways, places: Mapping[int, str]) -> Order:
    """Return the order of chairs that stand idle in refuges, by their names.

    Raises:
        TaskError: a refuge is unknown, or has fewer slots than chairs.
    """
    chains: dict[int, Chain] = {}
    queues: dict[int, tuple[Turn, ...]] = {}
    for chair, place in places.items():
        check_refuge(ways, place)
        free = [spot for spot in ways.slots[place] if int(ways.resource[spot]) not in queues]
        if not free:
            slots = len(ways.slots[place])
            raise TaskError(
                f"{place} has {slots} slot{'s' * (slots > 1)}, too few for chair {chair}: park it elsewhere"
            )
        chains[chair] = Chain((free[0],))
        queues[int(ways.resource[free[0]])] = (Turn(chair, 0),)
    return Order(ways, chains, queues)


def check_refuge(ways: Ways, place: str) -> None:
    """Refuse a goal that is no refuge.

    Raises:
        TaskError: the message names some that are.
    """
    if place not in ways.slots:
        known = ", ".join(list(ways.slots)[:5])
        raise TaskError(f"no chair can wait at '{place}': give one of {known or 'its refuges (the graph has none)'}")


def with_priorities(order: Order, wanted: Mapping[int, Priority]) -> Order:
    """Return the order with these priorities of requests, by their numbers; all others keep theirs."""

    def renewed(request: Request) -> Request:
        priority = wanted.get(request.number, request.priority)
        return request if priority is request.priority else replace(request, priority=priority)

    chains = {
        chair: chain if chain.request is None else replace(chain, request=renewed(chain.request))
        for chair, chain in order.chains.items()
    }
    waiting = tuple(map(renewed, order.waiting))
    same = waiting == order.waiting and chains == dict(order.chains)
    return order if same else replace(order, chains=chains, waiting=waiting)


def asked(order: Order, request: Request) -> Order:
    """Return the order with a request added behind all others; an earlier one of the same chair is replaced.

    Raises:
        TaskError: the chair or the place is unknown, or the chair cannot get there at all.
    """
    if request.chair not in order.chains:
        raise TaskError(f"chair {request.chair} is not in this building: park it in a refuge first")
    check_refuge(order.ways, request.goal)
    at = order.chains[request.chair].spots[0]
    if order.ways.least_ms(request.goal)[at] >= NEVER:
        raise TaskError(
            f"no way leads chair {request.chair} from {order.ways.names[at]} to {request.goal}: give another goal"
        )
    others = tuple(each for each in order.waiting if each.chair != request.chair)
    return replace(order, waiting=(*others, request))


def entered(order: Order, chair: int, now_ms: int) -> Order:
    """Return the order after a chair has entered its next spot; the spot before is used until `cleared`.

    Raises:
        TaskError: it is not its turn.
    """
    if not order.may_enter(chair):
        raise TaskError(f"chair {chair} entered out of turn: let it back out and stop all others near it")
    chain = order.chains[chair]
    new = replace(
        chain,
        spots=chain.spots[1:],
        visit=chain.visit + 1,
        entered_ms=now_ms,
        ready_ms=now_ms + int(order.ways.passing_ms[chain.spots[1]]),
        behind=(*chain.behind, (chain.visit, chain.spots[0])),
    )
    if len(new.spots) == 1:
        new = replace(new, request=None, overtaken_by=frozenset())
    return replace(order, chains={**order.chains, chair: new})


def cleared(order: Order, chair: int) -> Order:
    """Return the order after a chair's rear has left the earliest spot that it still used behind itself."""
    chain = order.chains[chair]
    (visit, spot), *others = chain.behind
    resource = int(order.ways.resource[spot])
    queues = dict(order.queues)
    queues[resource] = tuple(turn for turn in queues[resource] if turn != Turn(chair, visit))
    if not queues[resource]:
        del queues[resource]
    left = replace(chain, behind=tuple(others), leaves_ms=chain.leaves_ms[1:])
    return replace(order, chains={**order.chains, chair: left}, queues=queues)


def held_up(order: Order, chair: int, ready_ms: int, leaves_ms: tuple[int, ...] = ()) -> Order:
    """Return the order with new times at which a chair can leave its spot, and has left those behind, see `Chain`."""
    chain = replace(order.chains[chair], ready_ms=ready_ms, leaves_ms=leaves_ms)
    return replace(order, chains={**order.chains, chair: chain})


def stopped(order: Order, chair: int) -> Order:
    """Return the order after a chair gave back all that it has not entered: it is idle, or dead, where it is."""
    chain = order.chains[chair]
    kept = {Turn(chair, visit) for visit in (*(visit for visit, _ in chain.behind), chain.visit)}
    queues = {
        resource: tuple(turn for turn in queue if turn.chair != chair or turn in kept)
        for resource, queue in order.queues.items()
    }
    idle = replace(chain, spots=chain.spots[:1], request=None, overtaken_by=frozenset())
    return replace(
        order,
        chains={**order.chains, chair: idle},
        queues={resource: queue for resource, queue in queues.items() if queue},
        waiting=tuple(each for each in order.waiting if each.chair != chair),
    )


def _left_behind(order: Order, chair: int, now_ms: int, clearing_ms: int) -> dict[Turn, int]:
    """Return when a chair will have left the spots in which its rear is, by its word where it gave it.

    It may have entered several at once, and drives through them until it is ready to go on.
    """
    chain = order.chains[chair]
    entered_ms = chain.ready_ms - int(order.ways.passing_ms[chain.spots[0]])
    found: dict[Turn, int] = {}
    for visit, spot in reversed(chain.behind):
        found[Turn(chair, visit)] = max(now_ms, max(entered_ms, chain.entered_ms) + clearing_ms)
        entered_ms -= int(order.ways.passing_ms[spot])
    for (visit, _), left_ms in zip(chain.behind, chain.leaves_ms, strict=False):
        found[Turn(chair, visit)] = max(now_ms, left_ms)
    return found


def foreseen(order: Order, now_ms: int, clearing_ms: int) -> dict[Turn, Stay] | None:
    """Return all turns with the times [ms] that follow if nobody is held up from now on; None if they have a cycle.

    A turn that never ends, in the last spot of a chain, is until `NEVER`.
    """
    passing_ms, chains = order.ways.passing_ms, order.chains
    turns = (pair for queue in order.queues.values() for pair in pairwise(queue))
    before = {(later.chair, later.visit): earlier for earlier, later in turns}
    left: dict[Turn, int] = {}
    for chair in chains:
        left |= _left_behind(order, chair, now_ms, clearing_ms)
    enters = {chair: [chain.entered_ms] for chair, chain in chains.items()}
    held_up_by: dict[tuple[int, int], list[int]] = {}  # by the chair and its spot that has to be entered before
    going = list(chains)
    while going:
        chair = going.pop()
        chain, own = chains[chair], enters[chair]
        for k in range(len(own), len(chain.spots)):
            time = max(chain.ready_ms, now_ms) if k == 1 else own[-1] + int(passing_ms[chain.spots[k - 1]])
            earlier = before.get((chair, chain.visit + k))
            if earlier is not None:
                free = left.get(earlier)
                if free is None:
                    other, theirs = chains[earlier.chair], enters[earlier.chair]
                    if earlier.visit >= other.last:
                        return None  # its holder never leaves
                    onward = earlier.visit + 1 - other.visit
                    if onward >= len(theirs):
                        held_up_by.setdefault((earlier.chair, onward), []).append(chair)
                        break
                    free = theirs[onward] + clearing_ms
                time = max(time, free)
            own.append(time)
            going += held_up_by.pop((chair, k), ())
    if any(len(enters[chair]) < len(chain.spots) for chair, chain in chains.items()):
        return None
    found: dict[Turn, Stay] = {}
    for chair, chain in chains.items():
        until = [time + clearing_ms for time in enters[chair][1:]] + [NEVER]
        for k, spot in enumerate(chain.spots):
            found[Turn(chair, chain.visit + k)] = Stay(spot, enters[chair][k], until[k])
    for chair, chain in chains.items():
        for visit, spot in chain.behind:
            found[Turn(chair, visit)] = Stay(spot, chain.entered_ms, left[Turn(chair, visit)])
    return found
