"""Whole chairs whose order is kept by their own peers over a seeded network, instead of one warden beside them."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from waychair.firmware_bridge.protocol import HelloReply
from waychair.planning.fleet.peers.messages import building_of
from waychair.planning.fleet.peers.peer import Fleet, OwnWish, Peer
from waychair.planning.fleet.rules import Priority
from waychair.planning.fleet.waits import Reason, Wait
from waychair.planning.fleet.ways import Ways
from waychair.runtime.chair import Chair, ChairState
from waychair.runtime.drive_base import ChairMessage
from waychair.runtime.fleet.peer_driving import PeerDriver
from waychair.runtime.fleet.spot_sight import SpotSight
from waychair.simulation.network import NetworkFaults, SeededNetwork
from waychair.trials.fleet.fleet_drive import CLEARING_MS, FleetScene, Keeper, Rider
from waychair.types import Goal, Scan

_FIRST_BOOT = 1_000
"""Boots of the peers are numbers from here on; in life they are random."""

Cut = Callable[[int, SeededNetwork], None]
"""Changes the network before each step of the peers, at a time [ms]."""


def over_network(
    faults: NetworkFaults | None = None,
    cut: Cut = lambda now_ms, network: None,
    watch: Callable[[int, NetworkedRiders], None] = lambda now_ms, riders: None,
) -> Keeper:
    """Return a keeper for `drive_fleet` that gives every chair a peer, joined by a network with these faults.

    `cut` parts and heals the network, `watch` sees the riders after each step, both with the time [ms].
    """

    def keeper(scene: FleetScene, ways: Ways, riders: Sequence[Rider]) -> Callable[[int], tuple[Wait, ...]]:
        networked = NetworkedRiders(scene, ways, riders, faults or NetworkFaults())

        def keep(now_ms: int) -> tuple[Wait, ...]:
            cut(now_ms, networked.network)
            present = networked.keep(now_ms)
            watch(now_ms, networked)
            return present

        return keep

    return keeper


class SightWatch:
    """A chair's sight of the spots of its building, with each scan of it."""

    def __init__(self, chair: Chair, sight: SpotSight) -> None:
        self.sight = sight
        chair.add_watcher(self)

    def note_request(self, what: str, goals: tuple[Goal, ...] = ()) -> None:
        """See `ChairWatcher`."""

    def note_tick(self, heard: tuple[ChairMessage, ...], state: ChairState, board: HelloReply | None) -> None:
        """Look at the scan of a tick, if there was one."""
        for scan in [each for each in heard if isinstance(each, Scan)][-1:]:
            self.sight.look(scan, state.map_from_base)


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
        self._sights = {
            rider.number: SightWatch(rider.chair, SpotSight(ways, scene.mapped, scene.body)).sight for rider in riders
        }
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
                sight=self._sights[number],
            )
            rider.line = steps.driven.authority.line
            rider.chair.navigator.granted.authority = steps.driven.authority
            rider.keep_on_chain(steps.driven)
            before = rider.run.reached
            rider.follow(steps.driven.goals, now_ms)
            if rider.run.reached > before:
                self._wishes.pop(number, None)
            self._note_shut(rider, now_ms)
            self.notices += steps.peer.notices
            for to, _, data in steps.peer.send:
                others = [to] if to is not None else [other for other in self.drivers if other != number]
                self.network.send(now_ns, number, others, data)
            wait = self._wait(number)
            if wait is not None:
                waits.append(wait)
        return tuple(waits)

    def _note_shut(self, rider: Rider, now_ms: int) -> None:
        """Let a chair tell the others of a section that it finds shut."""
        others = [each.state.map_from_base for each in self.riders if each is not rider and each.state is not None]
        found = rider.blocked(now_ms, others)
        if found and not self.drivers[rider.number].authority.alone:
            self.drivers[rider.number].note_shut(found)

    def wishes(self, number: int) -> bool:
        """Return whether a chair has a goal."""
        return number in self._wishes

    def _wait(self, number: int) -> Wait | None:
        """Return the wait that a chair's peer tells."""
        driver, wish = self.drivers[number], self._wishes.get(number)
        authority = driver.authority
        if wish is None or not driver.waits or not authority.sentence:
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
