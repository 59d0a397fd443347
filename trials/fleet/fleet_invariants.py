"""The rules that chairs over a network must keep at every moment, checked from outside; and the troubles that try them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from graphlib import CycleError, TopologicalSorter
from itertools import pairwise

import numpy as np

from waychair.planning.fleet.order import Order
from waychair.planning.fleet.peers.claims import Claim
from waychair.trials.fleet.fleet_networked import NetworkedChair, NetworkedChairs, NetworkTrouble

WHOLE_MS = 30_000
"""ms after the last trouble within which every chair has to have a warden again."""

MOST_OVERTAKINGS = 2

MOST_FAULTS = 20
"""Faults that are kept."""

FIRST_MS, LAST_MS = 20_000, 380_000
"""ms between which troubles begin."""

LONGEST_PART_MS = 60_000
"""ms of the longest partition."""


@dataclass
class Invariants:
    """A watch over a run: call it after every tick; `faults` are sentences."""

    faults: list[str] = field(default_factory=list)
    without_warden: int = 0
    grants: int = 0
    _told: set[str] = field(default_factory=set)
    _led_ms: dict[int, int] = field(default_factory=dict)
    _serials: dict[int, int] = field(default_factory=dict)

    def __call__(self, world: NetworkedChairs) -> None:
        self._bodies(world)
        self._authorities(world)
        self._wardens(world)
        for chair in world.chairs.values():
            if not world.is_whole or (chair.peer is not None and (chair.peer.has_warden() or chair.peer.refused)):
                self._led_ms[chair.number] = world.now_ms
            elif world.now_ms - self._led_ms.get(chair.number, 0) > WHOLE_MS:
                self._say(world, f"chair {chair.number} has no warden {WHOLE_MS / 1e3:.0f} s after all was whole")
        for said in world.unseen:
            self._say(world, said)

    def end(self, world: NetworkedChairs) -> None:
        """Check the end of a run: everybody has arrived."""
        for chair in world.chairs.values():
            if chair.wish is not None:
                since_s = (world.now_ms - chair.wish[2]) / 1e3
                self._say(world, f"chair {chair.number} has not arrived in {chair.wish[1]} since {since_s:.0f} s")

    def _say(self, world: NetworkedChairs, sentence: str) -> None:
        if sentence not in self._told and len(self.faults) < MOST_FAULTS:
            self._told.add(sentence)
            self.faults.append(f"{world.now_ms / 1e3:.1f} s: {sentence}")

    def _bodies(self, world: NetworkedChairs) -> None:
        """One chair in each resource."""
        users: dict[int, int] = {}
        for chair in world.chairs.values():
            for spot, _ in chair.body:
                resource = int(world.ways.resource[spot])
                if users.setdefault(resource, chair.number) != chair.number:
                    self._say(world, f"chairs {users[resource]} and {chair.number} are in {world.ways.names[spot]}")

    def _authorities(self, world: NetworkedChairs) -> None:
        """No chair that does not look may enter where another one is or may enter."""
        resource = world.ways.resource
        held = {
            chair.number: (
                {int(resource[spot]) for spot, _ in chair.body},
                {int(resource[spot]) for spot in chair.authority.spots},
            )
            for chair in world.chairs.values()
        }
        for chair in world.chairs.values():
            released = held[chair.number][1] - held[chair.number][0]
            if not released or chair.authority.look:
                continue
            for other in world.chairs.values():
                if other is chair:
                    continue
                both = released & (held[other.number][0] | held[other.number][1])
                if both:
                    self._say(world, f"chairs {chair.number} and {other.number} may both enter resource {min(both)}")

    def _wardens(self, world: NetworkedChairs) -> None:
        """At most one warden grants; its order has no cycle, ends in slots, overtakes nobody thrice and leads into no chair."""
        awake = [chair for chair in world.chairs.values() if chair.peer is not None and not chair.sleeps]
        granting = [chair for chair in awake if chair.peer is not None and chair.peer.grants]
        if len(granting) > 1:
            self._say(world, f"chairs {granting[0].number} and {granting[1].number} grant at the same time")
        self.without_warden += not granting
        for chair in granting:
            office = chair.peer.office if chair.peer is not None else None
            if office is None or office.district is None:
                continue
            self.grants += 1
            order = office.district.order
            if self._serials.get(chair.number) != office.district.serial:
                self._serials[chair.number] = office.district.serial
                for said in (*order_faults(order), *_open_to_others(order, office.absent)):
                    self._say(world, said)
            for other in awake:
                self._within(world, order, chair, other)

    def _within(self, world: NetworkedChairs, order: Order, warden: NetworkedChair, other: NetworkedChair) -> None:
        """A chair that follows a warden may enter only what the warden holds for it."""
        if other.peer is None or warden.peer is None or other.number not in order.chains:
            return
        if other.peer.allegiance.term != warden.peer.allegiance.term or not other.authority.spots:
            return
        chain = order.chains[other.number]
        allowed = {spot for _, spot in chain.behind} | {chain.spots[0]}
        if not set(other.authority.spots) <= allowed:
            self._say(world, f"chair {other.number} may enter more than chair {warden.number} has granted")


def _open_to_others(order: Order, absent: Mapping[int, Claim]) -> list[str]:
    """Return the spots that an order leaves open though a chair is there, or may be, that does not keep it."""
    ways = order.ways
    return [
        f"{ways.names[spot]} is open to others, though chair {number} is there and keeps no order"
        for number, claim in absent.items()
        for spot in claim.spots
        if int(ways.resource[spot]) not in order.closed
    ]


def order_faults(order: Order) -> list[str]:
    """Return the rules that an order breaks."""
    said = []
    after: dict[tuple[int, int], set[tuple[int, int]]] = {}
    for chair, chain in order.chains.items():
        for k in range(1, len(chain.spots)):
            after.setdefault((chair, chain.visit + k), set()).add((chair, chain.visit + k - 1))
    for queue in order.queues.values():
        for earlier, later in pairwise(queue):
            if earlier.visit >= order.chains[earlier.chair].visit and later.visit > order.chains[later.chair].visit:
                after.setdefault(tuple(later), set()).add((earlier.chair, earlier.visit + 1))  # type: ignore[arg-type]
    try:
        TopologicalSorter(after).prepare()
    except CycleError:
        said.append("the order has a cycle")
    ends: dict[int, int] = {}
    for chair, chain in order.chains.items():
        if len(chain.spots) < 2:
            continue
        if chain.request is not None and not order.ways.at_home[chain.spots[-1]]:
            said.append(f"chair {chair} is granted a way that ends in no slot")
        resource = int(order.ways.resource[chain.spots[-1]])
        if resource in ends:
            said.append(f"chairs {ends[resource]} and {chair} are sent to one slot")
        ends[resource] = chair
        if len(chain.overtaken_by) > MOST_OVERTAKINGS:
            said.append(f"chair {chair} has been overtaken {len(chain.overtaken_by)} times")
    return said


def troubles(chairs: int, seed: int, last_ms: int = LAST_MS) -> list[NetworkTrouble]:
    """Return troubles of all kinds that follow each other, so that each has an end before the next of its kind."""
    rng = np.random.default_rng([seed, 0x7E0B])
    found: list[NetworkTrouble] = []
    at_ms = FIRST_MS
    while True:
        at_ms += int(rng.integers(1_000, 40_000))
        if at_ms > last_ms:
            return found
        kind = str(rng.choice(["part", "part", "deaf", "crash", "crash", "crash", "sleep"]))
        numbers = rng.permutation(np.arange(1, chairs + 1)).tolist()
        if kind == "part":
            cut = int(rng.integers(1, chairs))
            for_ms = int(rng.integers(500, LONGEST_PART_MS))
            found.append(NetworkTrouble(at_ms, for_ms, kind, (tuple(numbers[:cut]), tuple(numbers[cut:]))))
            at_ms += for_ms
        elif kind == "deaf":
            links = [(a, b) for a in numbers for b in numbers if a != b and rng.random() < 0.3]
            for_ms = int(rng.integers(500, 30_000))
            found.append(NetworkTrouble(at_ms, for_ms, kind, tuple(links)))
            at_ms += for_ms
        elif kind == "crash":
            for_ms = int(rng.integers(100, 15_000))
            found.append(NetworkTrouble(at_ms, for_ms, kind, ((numbers[0],),)))
        else:
            found.append(NetworkTrouble(at_ms, 10_000, kind, ((numbers[0],),)))


def storm(chairs: int, seed: int, last_ms: int) -> list[NetworkTrouble]:
    """Return troubles in which some links are deaf at any time, others every few seconds: wardens change all the time."""
    rng = np.random.default_rng([seed, 0x5708])
    found: list[NetworkTrouble] = []
    at_ms = FIRST_MS
    while at_ms < last_ms:
        share = float(rng.uniform(0.1, 0.6))
        links = [(a, b) for a in range(1, chairs + 1) for b in range(1, chairs + 1) if a != b and rng.random() < share]
        for_ms = int(rng.integers(500, 8_000))
        found.append(NetworkTrouble(at_ms, for_ms, "deaf", tuple(links)))
        at_ms += for_ms + int(rng.integers(100, 1_500))
    return found


def summary(world: NetworkedChairs, watch: Invariants) -> Mapping[str, float]:
    """Return the figures of a run."""
    took = [each[1] for chair in world.chairs.values() for each in chair.done]
    return {
        "arrivals": len(took),
        "mean_s": float(np.mean(took)) / 1e3 if took else 0.0,
        "without_warden_s": watch.without_warden / 10,
        "messages": world.network.sent,
        "lost": world.network.lost,
    }
