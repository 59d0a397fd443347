"""A small fleet on one desk: peers of a T of corridors that hear each other at once, or not at all."""

from __future__ import annotations

from collections.abc import Callable

from tests.planning.fleet.small_traffic import traffic
from waychair.planning.fleet.peers.messages import building_of
from waychair.planning.fleet.peers.peer import Fleet, Own, OwnWish, Peer, PeerStep
from waychair.planning.fleet.ways import Ways, ways_of

TICK_NS = 100_000_000
GRAPH = traffic("T", ["P-a", "a-m", "m-b", "b-Q", "m-c", "c-R"])
WAYS = ways_of(GRAPH, 0.5)


def fleet_of(chairs: int, voters: int = 0, ways: Ways = WAYS) -> Fleet:
    """Return the fleet of chairs 1, 2, … and voters after them."""
    numbers = range(1, chairs + 1)
    return Fleet(
        building_of(ways.graph),
        ways,
        frozenset(numbers),
        frozenset(range(chairs + 1, chairs + voters + 1)),
        clearing_ms=1000,
    )


class Desk:
    """Peers with their chairs in P, Q and R, stepped together; `hears(source, other)` tells which links work."""

    def __init__(self, chairs: int, voters: int = 0, ways: Ways = WAYS) -> None:
        self.fleet = fleet_of(chairs, voters, ways)
        self.peers = {number: Peer(self.fleet, number, 1000 + number) for number in sorted(self.fleet.numbers)}
        homes = [ways.slots[name][0] for name in "PQR"]
        self.own = {number: Own((homes[number - 1],) if number <= chairs else ()) for number in self.peers}
        self.now_ns = 10**12
        self.hears: Callable[[int, int], bool] = lambda source, other: True
        self.steps: dict[int, PeerStep] = {}
        self.bus: list[tuple[int, int | None, bytes]] = []

    def wish(self, number: int, goal: str) -> None:
        own = self.own[number]
        self.own[number] = Own(own.entered, own.visit, wants=2, wish=OwnWish(1, goal, 0, self.now_ns))

    def run(self, seconds: float, until: Callable[[], bool] = lambda: False) -> float:
        """Step until something holds, for some seconds at most; return the seconds."""
        begun = self.now_ns
        while self.now_ns - begun < seconds * 1e9 and not until():
            self.now_ns += TICK_NS
            before, self.bus = self.bus, []
            for number, peer in self.peers.items():
                heard = [
                    (source, data)
                    for source, to, data in before
                    if source != number and to in (None, number) and self.hears(source, number)
                ]
                self.steps[number] = peer.step(self.now_ns, self.own[number], heard)
                self.bus += [(number, to, data) for to, _, data in self.steps[number].send]
        return (self.now_ns - begun) / 1e9

    @property
    def wardens(self) -> list[int]:
        return [number for number, peer in self.peers.items() if peer.grants]
