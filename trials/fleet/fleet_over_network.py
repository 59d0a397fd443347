"""Whole chairs whose order is kept by their own peers over a seeded network, instead of one warden beside them."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from waychair.planning.fleet.peers.messages import building_of
from waychair.planning.fleet.peers.peer import Fleet, OwnWish, Peer
from waychair.planning.fleet.rules import Priority
from waychair.planning.fleet.waits import Reason, Wait
from waychair.planning.fleet.ways import Ways
from waychair.runtime.fleet.peer_driving import PeerDriver
from waychair.simulation.network import NetworkFaults, SeededNetwork
from waychair.trials.fleet.fleet_drive import CLEARING_MS, FleetScene, Keeper, Rider

_FIRST_BOOT = 1_000
"""Boots of the peers are numbers from here on; in life they are random."""


def over_network(faults: NetworkFaults | None = None) -> Keeper:
    """Return a keeper for `drive_fleet` that gives every chair a peer, joined by a network with these faults."""

    def keeper(scene: FleetScene, ways: Ways, riders: Sequence[Rider]) -> Callable[[int], tuple[Wait, ...]]:
        return NetworkedRiders(scene, ways, riders, faults or NetworkFaults()).keep

    return keeper


class NetworkedRiders:
    """The riders of a scene with their peers."""

    def __init__(self, scene: FleetScene, ways: Ways, riders: Sequence[Rider], faults: NetworkFaults) -> None:
        fleet = Fleet(
            building_of(scene.graph), ways, frozenset(rider.number for rider in riders), clearing_ms=CLEARING_MS
        )
        self.network = SeededNetwork(scene.seed, faults)
        self.riders = riders
        self.drivers = {
            rider.number: PeerDriver(
                ways, Peer(fleet, rider.number, _FIRST_BOOT + rider.number), rider.driver, scene.starts[rider.number]
            )
            for rider in riders
        }
        self.notices: list[str] = []
        self._ways = ways
        self._wishes: dict[int, OwnWish] = {}
        self._numbers = iter(range(1, 1 << 30))

    def keep(self, now_ms: int) -> tuple[Wait, ...]:
        """Let every chair and its peer take a step; give the chairs their authorities, and return the present waits."""
        now_ns = now_ms * 1_000_000
        waits = []
        for rider in self.riders:
            number, driver = rider.number, self.drivers[rider.number]
            clock_ns = self.network.clock_ns(now_ns, number)
            request = rider.wish(now_ms, self._numbers)
            if request is not None:
                self._wishes[number] = OwnWish(request.number, request.goal, request.priority, clock_ns)
            assert rider.state is not None
            steps = driver.step(
                clock_ns,
                rider.state.map_from_base,
                rider.count_goals(),
                self.network.received(now_ns, number),
                self._wishes.get(number),
                is_free=self._sight(number),
            )
            rider.line = steps.driven.authority.line
            rider.chair.navigator.granted.authority = steps.driven.authority
            rider.keep_on_chain(steps.driven)
            before = rider.run.reached
            rider.follow(steps.driven.goals, now_ms)
            if rider.run.reached > before:
                self._wishes.pop(number, None)
            self.notices += steps.peer.notices
            for to, _, data in steps.peer.send:
                others = [to] if to is not None else [other for other in self.drivers if other != number]
                self.network.send(now_ns, number, others, data)
            wait = self._wait(number)
            if wait is not None:
                waits.append(wait)
        return tuple(waits)

    def _sight(self, number: int) -> Callable[[int], bool]:
        """Return whether a chair's sensors see nobody in a spot."""
        resource = self._ways.resource
        taken = {
            int(resource[spot]) for other, driver in self.drivers.items() if other != number for spot in driver.entered
        }
        return lambda spot: int(resource[spot]) not in taken

    def _wait(self, number: int) -> Wait | None:
        """Return the wait that a chair's peer tells."""
        authority, wish = self.drivers[number].authority, self._wishes.get(number)
        if wish is None or authority.spots or not authority.sentence:
            return None
        place = self._ways.names[authority.chain[0]] if authority.chain else wish.goal
        return Wait(
            number,
            authority.others[0] if authority.others else None,
            place,
            Reason.FIRST,
            (Priority(wish.priority), None),
            0,
            authority.foreseen_ms if authority.foreseen_ms >= 0 else None,
        )
