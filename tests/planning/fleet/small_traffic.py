"""Small traffic graphs, and plain references of the coordinator: ways among windows, and which exchanges are possible."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Mapping

from waychair.maps.traffic.traffic_graph import Refuge, Section, TrafficGraph, TrafficNode
from waychair.planning.fleet.order import Chain, Order, cleared, entered
from waychair.planning.fleet.sipp import Stay
from waychair.planning.fleet.ways import NEVER, Ways

METRES = 3.0


def traffic(name: str, joined: Iterable[str], bays: str = "") -> TrafficGraph:
    """Return a graph of sections such as "a-P"; nodes in capitals are refuges, those named in `bays` for everybody."""
    ends = [tuple(pair.split("-")) for pair in joined]
    nodes = dict.fromkeys(node for pair in ends for node in pair)
    return TrafficGraph(
        name,
        tuple(TrafficNode(node, 0.0, 0.0) for node in nodes),
        tuple(Section(f"{a}-{b}", a, b, METRES, 1.2) for a, b in ends),
        tuple(Refuge(node, node, waiting=node in bays) for node in nodes if node.isupper()),
    )


SMALL = (
    traffic("line", ["P-a", "a-b", "b-Q", "a-R"]),
    traffic("star", ["P-a", "Q-a", "R-a"]),
    traffic("star with a bay", ["P-a", "Q-a", "R-a", "a-B"], bays="B"),
    traffic("T", ["P-a", "a-m", "m-b", "b-Q", "m-c", "c-R"]),
    traffic("ring", ["P-a", "Q-b", "R-c", "a-b", "b-c", "c-a"]),
    traffic("loop on a stalk", ["P-a", "a-b", "b-Q", "b-c", "c-a", "c-R"]),
)
"""Graphs of at most six sections."""

RING = traffic("large ring", ["P-a", "Q-b", "R-c", "S-d", "a-b", "b-c", "c-d", "d-a"])
TEE = traffic("large T", ["P-a", "R-a2", "a-a2", "a2-m", "m-b2", "b2-b", "b-Q", "b2-S", "m-c", "c-c2", "c2-T", "c-U"])


def plain_earliest(
    ways: Ways, stays: Iterable[Stay], start: int, ready_ms: int, goal: str, clearing_ms: int, until_ms: int
) -> int | None:
    """Return the earliest arrival in a free slot for good, trying every millisecond; None if there is none in time."""
    used: dict[int, list[Stay]] = {}
    for stay in stays:
        used.setdefault(int(ways.resource[stay.spot]), []).append(stay)

    def is_free(spot: int, from_ms: int, to_ms: int) -> bool:
        return not any(
            stay.from_ms < to_ms and from_ms < stay.until_ms for stay in used.get(int(ways.resource[spot]), ())
        )

    known = {(start, 0)}
    for time in range(until_ms):
        for spot, since in sorted(each for each in known if each[1] <= time):
            ready = ready_ms if (spot, since) == (start, 0) else since + int(ways.passing_ms[spot])
            if time < ready or not is_free(spot, since, time + clearing_ms):
                continue
            for other in ways.after[ways.first[spot] : ways.first[spot + 1]].tolist():
                if not ways.is_barred(goal)[other] and is_free(
                    other, time, time + int(ways.passing_ms[other]) + clearing_ms
                ):
                    known.add((other, time))
                    if ways.names[other] == goal and is_free(other, time, NEVER):
                        return time
    return None


def next_orders(order: Order) -> Iterator[Order]:
    """Yield the order after each event that can come next: a rear that leaves, a chair that enters its next spot."""
    for chair, chain in order.chains.items():
        if chain.behind:
            yield cleared(order, chair)
        if order.may_enter(chair):
            yield entered(order, chair, 0)


def progress(order: Order) -> tuple[tuple[int, int], ...]:
    return tuple((chain.visit, len(chain.behind)) for chain in order.chains.values())


def is_under_way(chain: Chain) -> bool:
    return len(chain.spots) > 1


def can_be_reached(ways: Ways, places: Mapping[int, str], goals: Mapping[int, str]) -> bool:
    """Return whether chairs that move one at a time, into empty resources, reach their goals; tries all ways."""
    chairs = list(places)
    beside: dict[int, set[int]] = {}
    for spot in range(len(ways.names)):
        for other in ways.after[ways.first[spot] : ways.first[spot + 1]].tolist():
            beside.setdefault(int(ways.resource[spot]), set()).add(int(ways.resource[other]))
    doors = {
        room: {f"{a}-{room}" for a in "abcm"} | {f"{room}-{a}" for a in "abcm"} | {room}
        for room in ways.slots
        if ways.reserved[ways.slots[room][0]] >= 0
    }
    names = {int(resource): ways.names[spot] for spot, resource in enumerate(ways.resource)}
    room_of = {resource: room for resource, name in names.items() for room, parts in doors.items() if name in parts}
    start = tuple(int(ways.resource[ways.slots[places[chair]][0]]) for chair in chairs)
    end = tuple(int(ways.resource[ways.slots[goals[chair]][0]]) for chair in chairs)
    known, queue = {start}, deque([start])
    while queue:
        now = queue.popleft()
        if now == end:
            return True
        for k, resource in enumerate(now):
            for other in beside[resource]:
                then = (*now[:k], other, *now[k + 1 :])
                own = (room_of.get(start[k]), room_of.get(end[k]), None)
                if other in now or then in known or room_of.get(other) not in own:
                    continue
                known.add(then)
                queue.append(then)
    return False
