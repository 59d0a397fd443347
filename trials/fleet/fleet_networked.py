"""Chairs on a traffic graph whose peers keep the order over a network that loses, parts and forgets; all from one seed.

Each chair has a peer of its own, with a clock of its own. The chairs stop now and then, as people make them do. The world knows
where everybody is; a chair knows that only as far as it looks.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from waychair.maps.traffic.traffic_graph import RefugeKind, TrafficGraph
from waychair.maps.traffic.well_formed import pieces, well_formed
from waychair.planning.fleet.order import parked
from waychair.planning.fleet.peers.alone import ALONE_SPEED, Standing, backs_out, way_by_eye
from waychair.planning.fleet.peers.messages import building_of
from waychair.planning.fleet.peers.peer import Fleet, Own, OwnWish, Peer, SpotAuthority
from waychair.planning.fleet.ways import Ways, ways_of
from waychair.simulation.network import NetworkFaults, SeededNetwork

SPEED = 0.45
"""m/s of an undisturbed chair."""

CLEARING_MS = 3_000
"""ms until a chair's rear has left a spot."""

TICK_MS = 100
"""Ten steps of the peers a second."""

_NEAR_MS = 1_500
"""ms before a chair can leave its spot it asks for the next ones."""

_WANTED = 2
"""Spots that it asks for: a node, and the section behind it."""

_FACES_MS = 8_000
"""ms that a chair without a warden stands before somebody until one of the two backs out."""

_SHUT_MS = 40_000
"""ms for which a chair's word that a section is shut is believed."""

STOP_SHARE, STOP_MEAN_S = 0.10, 12.0
"""Share of sections in which people stop a chair, and for how long in the mean."""


@dataclass(frozen=True, slots=True)
class NetworkTrouble:
    """Something that befalls the network or a peer, from a time on, for a duration [ms].

    `kind` is "part" (groups of chairs), "deaf" (links), "crash" (a peer, in the middle of its sending), "sleep" (a computer) or
    "shut" (resources that nobody can enter).
    """

    at_ms: int
    for_ms: int
    kind: str
    who: tuple[tuple[int, ...], ...]


@dataclass
class NetworkedChair:
    """A chair in the world: the spots in which its body is, with the time at which its rear leaves each, and its peer."""

    number: int
    home: int
    body: list[list[int]]
    visit: int = 0
    ready_ms: int = 0
    wish: tuple[int, str, int] | None = None
    wishes: int = 0
    rests_ms: int = 0
    stands_ms: int = 0
    done: list[tuple[int, int]] = field(default_factory=list)
    retreat: str = ""
    peer: Peer | None = None
    sleeps: bool = False
    sees_shut: str = ""
    authority: SpotAuthority = field(default_factory=SpotAuthority)

    @property
    def front(self) -> int:
        """The spot in which its front is."""
        return self.body[-1][0]


class NetworkedChairs:
    """All chairs of a run; `watch` is called after every tick."""

    def __init__(
        self,
        graph: TrafficGraph,
        chairs: int,
        seed: int,
        faults: NetworkFaults | None = None,
        troubles: Sequence[NetworkTrouble] = (),
        last_wish_ms: int = 400_000,
    ) -> None:
        self.ways: Ways = ways_of(graph, SPEED)
        self.network = SeededNetwork(seed, faults or NetworkFaults())
        self.rng = np.random.default_rng([seed, 0xC4A1])
        self.troubles = sorted(troubles, key=lambda each: each.at_ms)
        self.last_wish_ms = last_wish_ms
        self.places = quiet_places(graph)
        numbers = range(1, chairs + 1)
        starts = self.rng.permutation(self.places)[:chairs].tolist()
        order = parked(self.ways, dict(zip(numbers, starts, strict=True)))
        self.fleet = Fleet(building_of(graph), self.ways, frozenset(numbers), clearing_ms=CLEARING_MS)
        self.chairs = {
            number: NetworkedChair(number, order.chains[number].spots[0], [[order.chains[number].spots[0], -1]])
            for number in numbers
        }
        self.now_ms = 0
        self.unseen: list[str] = []
        self.shut: set[int] = set()
        self.sent = hashlib.sha256()
        self._ends: list[tuple[int, NetworkTrouble]] = []
        self._boots = 0
        for chair in self.chairs.values():
            self._boot(chair)

    def run(self, until_ms: int, watch: Callable[[NetworkedChairs], None] = lambda world: None) -> None:
        """Let time pass."""
        while self.now_ms < until_ms:
            self.now_ms += TICK_MS
            crashing = self._befall()
            for chair in self.chairs.values():
                self._wish(chair)
                self._think(chair, chair.number in crashing)
                self._move(chair)
            watch(self)

    @property
    def is_whole(self) -> bool:
        """Whether no trouble is going on."""
        return not self._ends

    def taken(self, chair: int) -> dict[int, int]:
        """Return the resources in which other chairs' bodies are, with the chair."""
        resource = self.ways.resource
        return {
            int(resource[spot]): other.number
            for other in self.chairs.values()
            if other.number != chair
            for spot, _ in other.body
        }

    def _boot(self, chair: NetworkedChair) -> None:
        """Start a chair's peer, which knows nothing of an earlier one."""
        self._boots += 1
        boot = int(self.rng.integers(1, 1 << 62))
        chair.peer, chair.visit, chair.authority = Peer(self.fleet, chair.number, boot), 0, SpotAuthority()

    def _befall(self) -> set[int]:
        """Begin and end troubles; return the peers that crash in this tick."""
        crashing: set[int] = set()
        while self.troubles and self.troubles[0].at_ms <= self.now_ms:
            trouble = self.troubles.pop(0)
            self._ends.append((self.now_ms + trouble.for_ms, trouble))
            if trouble.kind == "part":
                self.network.part(trouble.who)
            elif trouble.kind == "deaf":
                self.network.deafen((link[0], link[1]) for link in trouble.who)
            elif trouble.kind == "crash":
                crashing.update(trouble.who[0])
            elif trouble.kind == "shut":
                self.shut.update(trouble.who[0])
            else:
                self.chairs[trouble.who[0][0]].sleeps = True
        for end_ms, trouble in [each for each in self._ends if each[0] <= self.now_ms]:
            self._ends.remove((end_ms, trouble))
            if trouble.kind in ("part", "deaf"):
                self.network.heal()
            elif trouble.kind == "crash":
                chair = self.chairs[trouble.who[0][0]]
                if chair.peer is None:
                    self._boot(chair)
            elif trouble.kind == "shut":
                self.shut.difference_update(trouble.who[0])
            else:
                self.chairs[trouble.who[0][0]].sleeps = False
        return crashing

    def _wish(self, chair: NetworkedChair) -> None:
        """Let a chair that has rested wish for a place to which nobody else goes."""
        if chair.wish is not None or self.now_ms < chair.rests_ms or self.now_ms > self.last_wish_ms:
            return
        names = self.ways.names
        taken = {names[other.front] for other in self.chairs.values()}
        taken |= {other.wish[1] for other in self.chairs.values() if other.wish is not None}
        free = [place for place in self.places if place not in taken]
        if not free:
            chair.rests_ms = self.now_ms + 5_000
            return
        chair.wishes += 1
        chair.wish = (chair.wishes, free[int(self.rng.integers(len(free)))], self.now_ms)

    def _think(self, chair: NetworkedChair, crashes: bool) -> None:
        """Let a chair's peer take a step, and send its messages, or some of them if it crashes while it sends."""
        if chair.peer is None or chair.sleeps:
            chair.authority = SpotAuthority()
            if chair.peer is None:
                self.network.forget(chair.number)
            return
        now_ns = self.now_ms * 1_000_000
        clock_ns = self.network.clock_ns(now_ns, chair.number)
        wish = None
        if chair.wish is not None:
            number, goal, asked_ms = chair.wish
            wish = OwnWish(number, goal, 0, self.network.clock_ns(asked_ms * 1_000_000, chair.number))
        ready_ms = max(chair.ready_ms - self.now_ms, 0)
        wants = _WANTED if ready_ms < _NEAR_MS and wish is not None else 0
        blocked = {chair.sees_shut: _SHUT_MS} if chair.sees_shut else {}
        chair.sees_shut = ""
        leaves_ms = tuple(max(at_ms - self.now_ms, 0) for _, at_ms in chair.body[:-1])
        own = Own(tuple(spot for spot, _ in chair.body), chair.visit, ready_ms, leaves_ms, wants, wish, blocked=blocked)
        step = chair.peer.step(clock_ns, own, self.network.received(now_ns, chair.number))
        chair.authority = step.authority
        send = step.send
        if crashes:
            send = send[: int(self.rng.integers(len(send) + 1))]
        for to, _, data in send:
            self.sent.update(data)
            others = [to] if to is not None else [other for other in self.chairs if other != chair.number]
            self.network.send(now_ns, chair.number, others, data)
        if crashes:
            chair.peer, chair.authority = None, SpotAuthority()

    def _move(self, chair: NetworkedChair) -> None:
        """Let a chair's rear leave, and its front enter the next spot if it may."""
        chair.body = [each for each in chair.body if each[1] < 0 or each[1] > self.now_ms]
        if self.now_ms < chair.ready_ms or chair.wish is None:
            return
        authority = chair.authority
        for _ in range(_WANTED):
            spot = self._next(chair, authority)
            if spot is None:
                return
            self._enter(chair, spot, authority.alone)
            authority = SpotAuthority(authority.spots[1:], look=authority.look)
            chair.authority = authority
            if self.now_ms < chair.ready_ms or chair.wish is None:
                return

    def _next(self, chair: NetworkedChair, authority: SpotAuthority) -> int | None:
        """Return the spot that a chair enters now."""
        assert chair.wish is not None
        resource = self.ways.resource
        taken = self.taken(chair.number)
        if authority.alone:
            goal = chair.retreat or chair.wish[1]
            path = way_by_eye(self.ways, chair.front, goal, taken.keys() | self.shut)
            if path:
                chair.stands_ms = self.now_ms
                return path[0]
            self._face(chair, taken)
            return None
        chair.retreat = ""
        chair.stands_ms = self.now_ms
        if not authority.spots:
            return None
        spot = authority.spots[0]
        if int(resource[spot]) in self.shut:
            chair.sees_shut = self.ways.names[spot]
            return None
        own = {int(resource[each]) for each, _ in chair.body}
        if int(resource[spot]) in taken and int(resource[spot]) not in own:
            if authority.look:
                return None
            self.unseen.append(
                f"{self.now_ms / 1e3:.1f} s: chair {chair.number} entered {self.ways.names[spot]}, "
                f"in which chair {taken[int(resource[spot])]} is"
            )
        return spot

    def _face(self, chair: NetworkedChair, taken: dict[int, int]) -> None:
        """Let one of two chairs that stand face to face without a warden back out to a place aside."""
        assert chair.wish is not None
        if self.ways.at_home[chair.front]:
            return
        if chair.retreat:
            chair.retreat = ""
            return
        if self.now_ms - chair.stands_ms < _FACES_MS:
            return
        free = way_by_eye(self.ways, chair.front, chair.wish[1], frozenset())
        other = next((taken[r] for spot in free if (r := int(self.ways.resource[spot])) in taken), None)
        if other is None:
            return
        mine, theirs = self._standing(chair), self._standing(self.chairs[other])
        if backs_out(mine, theirs):
            options = [
                (int(self.ways.least_ms(name)[chair.front]), name)
                for name in self.places
                if way_by_eye(self.ways, chair.front, name, taken.keys())
            ]
            chair.retreat = min(options)[1] if options else ""

    def _standing(self, chair: NetworkedChair) -> Standing:
        way_ms = min(int(self.ways.least_ms(name)[chair.front]) for name in self.places)
        return Standing(0, 1e-3 * way_ms * SPEED, chair.number)

    def _enter(self, chair: NetworkedChair, spot: int, alone: bool) -> None:
        chair.body[-1][1] = self.now_ms + CLEARING_MS
        chair.body.append([spot, -1])
        chair.visit += 1
        passing = int(self.ways.passing_ms[spot])
        slower = SPEED / ALONE_SPEED if alone else 1.0
        stop_ms = 0
        if passing > 1 and self.rng.random() < STOP_SHARE:
            stop_ms = round(1e3 * self.rng.exponential(STOP_MEAN_S))
        chair.ready_ms = self.now_ms + round(passing * slower) + stop_ms
        assert chair.wish is not None
        if self.ways.names[spot] == chair.wish[1]:
            chair.done.append((chair.wish[0], self.now_ms - chair.wish[2]))
            chair.wish, chair.retreat = None, ""
            chair.rests_ms = self.now_ms + int(self.rng.integers(1_000, 10_000))


def quiet_places(graph: TrafficGraph) -> list[str]:
    """Return the places that nobody's way leads through."""
    joined = set(pieces(graph)[0])
    in_the_way = {finding.refuge for finding in well_formed(graph)}
    names = [refuge.name for refuge in graph.refuges if refuge.kind is not RefugeKind.BAY]
    names = names or [refuge.name for refuge in graph.refuges]
    return sorted(name for name in names if name not in in_the_way and graph.refuge[name].node in joined)
