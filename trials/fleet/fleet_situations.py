"""Short situations over a seeded network, each of which tries some rules hard.

Voters that hear only some of each other, or are parked, switched off and on again; a chair that is cut off for long; and a chair that is cut off just as another one is
about to be let in before it. `evaluation/fleet/network_runs.py` has the long runs with everything.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from waychair.maps.traffic.corridors import corridor_graph, load_corridors
from waychair.planning.fleet.peers.messages import Electorate, building_of
from waychair.planning.fleet.peers.peer import Fleet, Own, Peer
from waychair.planning.fleet.ways import ways_of
from waychair.simulation.network import NetworkFaults, SeededNetwork
from waychair.trials.fleet.fleet_invariants import Invariants
from waychair.trials.fleet.fleet_networked import SPEED, TICK_MS, NetworkedChairs, NetworkTrouble

_PLANS = ("T", "I", "9cube", "4cross")

_RINGS = ("9cube", "4cross", "Rectangle")
"""Plans with a way round most sections."""

_LAST_WISH_MS, _ARRIVED_MS, _LONG_PASSING_MS = 90_000, 420_000, 3_000
"""ms until the last wishes where sections are shut, and until all have arrived; ms that a section takes that is no door."""

_VOTE_MS, _WHOLE_MS = 40_000, 12_000
"""ms for which the voters' links change, and ms from then on within which all have to have a warden."""

_POWER_LOST, _PARKED_MS = 0.2, 4_000
"""Share of voters that are switched off without being parked before, and ms for which others are parked before."""

_HALVES_MS, _ROUNDS = 8_000, 4
"""ms for which the voters are in two halves, and how often they are after half of them were parked."""

_CHAIRS_MS, _CHAIRS_BEGIN_MS = 240_000, 15_000
"""Length of a situation with chairs, and ms from which on chairs are cut off."""

_LONG_MS, _BETWEEN_MS = (15_000, 60_000), (8_000, 15_000)
"""ms for which a chair is cut off so long that it drives by its own eyes, and between two of them."""

_SHORT_MS = (2_000, 8_000)
"""ms for which a chair is cut off at the worst moment: it may not drive by its own eyes in that time."""

_SOON_MS = (1_500, 4_500)
"""ms until another chair can go on, which lie in the time in which nobody has noticed yet who was cut off."""


def voters_in_halves(seed: int) -> list[str]:
    """Return the faults of voters that are switched on in two halves, and then hear only some of each other.

    Links are cut in both directions, so that a voter often stands between two that do not hear each other.
    """
    rng = np.random.default_rng([seed, 0x0737])
    numbers = range(1, int(rng.integers(3, 8)) + 1)
    faults = NetworkFaults(float(rng.uniform(0.0, 0.2)), 0.1, float(rng.uniform(1.0, 200.0)), 0.05, drift_ppm=200.0)
    voters = _Voters(numbers, seed, faults)
    voters.network.part([list(numbers)[::2], list(numbers)[1::2]])
    voters.run(_HALVES_MS)
    voters.network.heal()
    voters.agree()
    until_ms = voters.now_ms + _VOTE_MS
    while voters.now_ms < until_ms:
        share = float(rng.uniform(0.1, 0.6))
        cut = [pair for pair in combinations(numbers, 2) if rng.random() < share]
        voters.network.deafen([*cut, *((b, a) for a, b in cut)])
        voters.run(int(rng.integers(500, 4_000)))
    voters.network.heal()
    voters.agree()
    return voters.faults


def voters_parked(seed: int) -> list[str]:
    """Return the faults of voters that are parked and switched off, lose their power, and are switched on again, while some hear
    only some of each other; at the end all but one are parked, and that one has to be the warden.
    """
    rng = np.random.default_rng([seed, 0x9A4C])
    numbers = range(1, int(rng.integers(4, 8)) + 1)
    faults = NetworkFaults(float(rng.uniform(0.0, 0.2)), 0.1, float(rng.uniform(1.0, 100.0)), 0.02, drift_ppm=200.0)
    voters = _Voters(numbers, seed, faults)
    voters.agree()
    until_ms = voters.now_ms + _VOTE_MS
    while voters.now_ms < until_ms:
        number = int(rng.integers(1, len(numbers) + 1))
        if number not in voters.peers:
            voters.switch_on(number)
        elif number in voters.parked or rng.random() < _POWER_LOST:
            voters.switch_off(number)
        else:
            voters.parked.add(number)
        voters.network.heal()
        if rng.random() < 0.7:
            halves = rng.permutation(list(numbers)).tolist()
            cut = int(rng.integers(1, len(numbers)))
            voters.network.part([halves[:cut], halves[cut:]])
        voters.run(int(rng.integers(300, 5_000)))
    voters.network.heal()
    for number in numbers:
        if number not in voters.peers:
            voters.switch_on(number)
    voters.parked.clear()
    voters.agree()
    for number in rng.permutation(list(numbers)).tolist()[1:]:
        voters.parked.add(number)
        voters.run(_PARKED_MS)
        voters.switch_off(number)
    voters.agree()
    return voters.faults


def voters_parked_at_worst(seed: int) -> list[str]:
    """Return the faults of voters of which half are parked, and of the rest all that the warden just needs are cut off with it.

    The others, who may not know that the electorate has changed, would be a majority of the one before. They are cut off while the
    warden changes the electorate; or later, and then some have been switched off and on again.
    """
    rng = np.random.default_rng([seed, 0x3A9C])
    numbers = range(1, int(rng.choice([5, 7])) + 1)
    voters = _Voters(numbers, seed, NetworkFaults(0.02, 0.0, float(rng.uniform(1.0, 50.0)), drift_ppm=200.0))
    voters.agree()
    for _ in range(_ROUNDS):
        warden = [number for number, peer in voters.peers.items() if peer.grants][:1]
        others = rng.permutation([number for number in numbers if number not in warden]).tolist()
        half = len(numbers) // 2
        parked, needed, rest = others[:half], others[half : half + (half + 1) // 2], others[half + (half + 1) // 2 :]
        voters.parked.update(parked)
        voters.run(int(rng.integers(1, 5)) * TICK_MS)
        again: list[int] = []
        if rng.random() < 0.5:
            for number in parked:
                voters.switch_off(number)
            voters.run(_PARKED_MS)
            again = [*parked, *(rest if rng.random() < 0.5 else ())]
        voters.network.part([[*warden, *needed], [*parked, *rest]])
        for number in again:
            if number in voters.peers:
                voters.switch_off(number)
            voters.switch_on(number)
        voters.run(_HALVES_MS)
        voters.network.heal()
        voters.parked.clear()
        voters.agree()
    return voters.faults


class _Voters:
    """Peers without chairs: a majority orders at once, so that nothing but their votes keeps two from ordering.

    `parked` are those that say so; the electorate that each one told to remember outlives its start.
    """

    def __init__(self, numbers: Sequence[int], seed: int, faults: NetworkFaults) -> None:
        graph = corridor_graph(load_corridors("T"), rooms=True)
        self._fleet = Fleet(building_of(graph), ways_of(graph, SPEED), frozenset(), frozenset(numbers))
        self._rng = np.random.default_rng([seed, 0xB007])
        self._remembered: dict[int, Electorate] = {}
        self.parked: set[int] = set()
        self.peers: dict[int, Peer] = {}
        for number in numbers:
            self.switch_on(number)
        self.network = SeededNetwork(seed, faults)
        self.now_ms = 0
        self.faults: list[str] = []

    def switch_on(self, number: int) -> None:
        """Start a peer, which knows of an earlier one only what that told it to remember."""
        boot = int(self._rng.integers(1, 1 << 62))
        self.peers[number] = Peer(self._fleet, number, boot, electorate=self._remembered.get(number))
        self.parked.discard(number)

    def switch_off(self, number: int) -> None:
        """End a peer."""
        del self.peers[number]
        self.network.forget(number)

    def run(self, for_ms: int) -> None:
        """Let time pass."""
        until_ms = self.now_ms + for_ms
        while self.now_ms < until_ms:
            self.now_ms += TICK_MS
            now_ns = self.now_ms * 1_000_000
            for number, peer in self.peers.items():
                heard = self.network.received(now_ns, number)
                own = Own(parked=number in self.parked)
                step = peer.step(self.network.clock_ns(now_ns, number), own, heard)
                if step.electorate is not None:
                    self._remembered[number] = step.electorate
                for to, _, data in step.send:
                    others = [to] if to is not None else [other for other in self.peers if other != number]
                    self.network.send(now_ns, number, others, data)
            granting = [number for number, peer in self.peers.items() if peer.grants]
            if len(granting) > 1:
                self.faults.append(f"{self.now_ms / 1e3:.1f} s: {granting[0]} and {granting[1]} grant at the same time")

    def agree(self) -> None:
        """Let time pass without cuts, and note each voter that then has no warden at any moment of the second half."""
        self.run(_WHOLE_MS // 2)
        until_ms = self.now_ms + _WHOLE_MS // 2
        alone = set(self.peers)
        while alone and self.now_ms < until_ms:
            self.run(TICK_MS)
            alone -= {number for number, peer in self.peers.items() if peer.has_warden()}
        said = f"{self.now_ms / 1e3:.1f} s: voter {{}} has no warden {_WHOLE_MS / 1e3:.0f} s after all was whole"
        self.faults += [said.format(number) for number in sorted(alone)]


def cut_off(seed: int) -> list[str]:
    """Return the faults of chairs of which one after the other is cut off, so long that it drives by its own eyes."""
    rng = np.random.default_rng([seed, 0xC075])
    world = _chairs(seed)
    at_ms = _CHAIRS_BEGIN_MS
    while at_ms < _CHAIRS_MS:
        for_ms = int(rng.integers(*_LONG_MS))
        world.troubles.append(NetworkTrouble(at_ms, for_ms, "part", ((int(rng.integers(1, len(world.chairs) + 1)),),)))
        at_ms += for_ms + int(rng.integers(*_BETWEEN_MS))
    watch = Invariants()
    world.run(_CHAIRS_MS, watch)
    return watch.faults


def cut_off_at_worst(seed: int) -> list[str]:
    """Return the faults of chairs that are cut off for a while just before another one is let in where they wait."""
    rng = np.random.default_rng([seed, 0x3057])
    watch = Invariants()

    def surprise(world: NetworkedChairs) -> None:
        watch(world)
        if world.now_ms < _CHAIRS_BEGIN_MS or not world.is_whole or rng.random() < 0.5:
            return
        number = _about_to_be_passed(world)
        if number is not None:
            world.troubles.insert(0, NetworkTrouble(world.now_ms, int(rng.integers(*_SHORT_MS)), "part", ((number,),)))

    _chairs(seed).run(_CHAIRS_MS, surprise)
    return watch.faults


def sections_shut(seed: int) -> list[str]:
    """Return the faults of chairs that find sections shut, on a plan with ways round them, while peers crash."""
    rng = np.random.default_rng([seed, 0x5807])
    graph = corridor_graph(load_corridors(_RINGS[seed % len(_RINGS)]), rooms=True)
    faults = NetworkFaults(loss=0.1, delay_ms=20.0, drift_ppm=200.0)
    world = NetworkedChairs(graph, int(rng.integers(3, 7)), seed, faults, last_wish_ms=_LAST_WISH_MS)
    resources = sorted(
        {int(world.ways.resource[spot]) for spot in np.flatnonzero(world.ways.passing_ms > _LONG_PASSING_MS)}
    )
    for at_ms in range(_CHAIRS_BEGIN_MS, _LAST_WISH_MS, 20_000):
        world.troubles.append(
            NetworkTrouble(at_ms, 30_000, "shut", (tuple(rng.permutation(resources)[: len(resources) // 6].tolist()),))
        )
        crashed = int(rng.integers(1, len(world.chairs) + 1))
        world.troubles.append(NetworkTrouble(at_ms + 9_000, 2_000, "crash", ((crashed,),)))
    watch = Invariants()
    world.run(_LAST_WISH_MS, watch)
    while world.now_ms < _ARRIVED_MS and any(chair.wish is not None for chair in world.chairs.values()):
        world.run(world.now_ms + 1_000, watch)
    watch.end(world)
    return watch.faults


def _chairs(seed: int) -> NetworkedChairs:
    rng = np.random.default_rng([seed, 5])
    graph = corridor_graph(load_corridors(_PLANS[seed % len(_PLANS)]), rooms=True)
    faults = NetworkFaults(loss=0.05, delay_ms=10.0, drift_ppm=200.0)
    return NetworkedChairs(graph, int(rng.integers(5, 9)), seed, faults, last_wish_ms=_CHAIRS_MS)


def _about_to_be_passed(world: NetworkedChairs) -> int | None:
    """Return a chair that waits for a spot which another one will be let into within the next seconds."""
    resource = world.ways.resource
    for chair in world.chairs.values():
        waits = chair.wish is not None and chair.authority.chain and not chair.authority.spots
        if not waits or world.now_ms < chair.ready_ms or chair.peer is None or chair.peer.grants:
            continue
        place = resource[chair.authority.chain[0]]
        for other in world.chairs.values():
            soon = _SOON_MS[0] < other.ready_ms - world.now_ms < _SOON_MS[1]
            if other is not chair and soon and place in resource[list(other.authority.chain[:2])]:
                return chair.number
    return None


SITUATIONS = (voters_in_halves, voters_parked, voters_parked_at_worst, sections_shut, cut_off_at_worst, cut_off)
"""All situations, the cheapest first."""
