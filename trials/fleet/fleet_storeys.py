"""Hundreds of chairs on several storeys, by events: each storey keeps its own order, and lifts carry chairs between them.

Nobody is late here; every request is booked behind the plans made before (`planning/fleet/booking.py`). Each lift takes the
chairs in the order in which they came, except those whose storey has no room before the lift.
"""

from __future__ import annotations

import heapq
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from waychair.errors import TaskError
from waychair.maps.traffic.storeys import cut_at_lifts, lobby_in, lobby_out
from waychair.maps.traffic.traffic_graph import TrafficGraph
from waychair.planning.fleet.booking import Booking, booked, handed_over, taken_in
from waychair.planning.fleet.order import Order, Request, cleared, entered, parked
from waychair.planning.fleet.ways import ways_of
from waychair.trials.fleet.fleet_ordered import SPEED

_CLEARING_MS = 500
"""ms that a rear takes to leave a spot."""

_RETRY_MS = 2_000
"""ms after which a request without a way is tried again."""


@dataclass(slots=True)
class _Storey:
    """A storey's order, and the bookings of the chairs that drive in it."""

    order: Order
    bookings: dict[int, Booking] = field(default_factory=dict)


@dataclass(slots=True)
class _Lift:
    """A lift: whether its cabin is empty, and the chairs that wait before it with the lobbies where they are and go to.

    `asking` are chairs that wait elsewhere until there is room in a lobby.
    """

    name: str
    is_free: bool = True
    queue: list[tuple[int, str, str]] = field(default_factory=list)
    asking: dict[str, deque[int]] = field(default_factory=dict)

    @property
    def waiting(self) -> int:
        """The chairs that wait before the lift or for room there."""
        return len(self.queue) + sum(map(len, self.asking.values()))


@dataclass(slots=True)
class _Chair:
    """A chair: its storey, place, goal, when it asked, when it came to its lift, and the rides that are still to come."""

    storey: str
    place: str
    goal: str = ""
    asked_ms: int = 0
    came_ms: int = 0
    rides: list[tuple[str, str, str]] = field(default_factory=list)


@dataclass(slots=True)
class StoreysDone:
    """The figures: arrivals, the time [s] from each task's beginning to its end, and waits [s] for each lift."""

    arrivals: int = 0
    took_s: list[float] = field(default_factory=list)
    lift_waits_s: dict[str, list[float]] = field(default_factory=dict)
    longest_queue: Counter[str] = field(default_factory=Counter)
    without_way: int = 0


class FleetStoreys:
    """Chairs that go from place to place of a building with lifts, without end.

    Args:
        graph: the building.
        chairs: their number.
        seed: of starts and tasks.
        between: the share of tasks that lead to another storey.

    Raises:
        TaskError: there are not more places than chairs.
    """

    def __init__(self, graph: TrafficGraph, chairs: int, seed: int, between: float = 0.05) -> None:
        self._graph = graph
        self._between = between if graph.lifts else 0.0
        self._rng = np.random.default_rng(seed)
        storeys = cut_at_lifts(graph)
        lobbies = {stop for lift in graph.lifts for stop in lift.stops}
        self._places = [refuge.name for refuge in graph.refuges if refuge.node not in lobbies]
        self._node_of = {refuge.name: refuge.node for refuge in graph.refuges}
        if not 0 < chairs < len(self._places):
            raise TaskError(f"{graph.name} has {len(self._places)} places: give 1 to {len(self._places) - 1} chairs")
        starts = self._rng.permutation(self._places)[:chairs].tolist()
        self._chairs = {
            chair: _Chair(graph.node[self._node_of[place]].storey, place) for chair, place in enumerate(starts)
        }
        self._storeys = {
            name: _Storey(
                parked(ways_of(storey, SPEED), {k: c.place for k, c in self._chairs.items() if c.storey == name})
            )
            for name, storey in storeys.items()
        }
        self._lifts = {lift.name: _Lift(lift.name) for lift in graph.lifts}
        self._ride_ms = {
            frozenset((section.start, section.end)): round(1e3 * section.seconds(SPEED))
            for section in graph.sections
            if section.lift is not None
        }
        self._taken = {chair.place for chair in self._chairs.values()}
        self._events: list[tuple[int, bool, int, Callable[[], None]]] = []
        self._count = 0
        self._requests = 0
        self.now_ms = 0
        self.done = StoreysDone(lift_waits_s={lift.name: [] for lift in graph.lifts})
        for chair in self._chairs:
            self._at(0, partial(self._begin, chair))

    def run(self, until_ms: int) -> None:
        """Let time pass."""
        while self._events and self._events[0][0] <= until_ms:
            self.now_ms, _, _, act = heapq.heappop(self._events)
            act()
        self.now_ms = until_ms

    def _at(self, time_ms: int, act: Callable[[], None], leaves: bool = False) -> None:
        """Do something at a time; chairs leave spots before others enter them."""
        self._count += 1
        heapq.heappush(self._events, (time_ms, not leaves, self._count, act))

    def _begin(self, chair: int) -> None:
        """Let a chair choose a free goal, and the lift that makes its way shortest."""
        own = self._chairs[chair]
        elsewhere = self._rng.random() < self._between
        goal = own.place
        while goal in self._taken or (self._storey_of(goal) != own.storey) != elsewhere:
            goal = self._places[int(self._rng.integers(len(self._places)))]
        self._taken.add(goal)
        own.goal, own.asked_ms = goal, self.now_ms
        own.rides = self._rides(self._node_of[own.place], self._node_of[goal])
        self._go_on(chair)

    def _storey_of(self, place: str) -> str:
        return self._graph.node[self._node_of[place]].storey

    def _rides(self, start: str, goal: str) -> list[tuple[str, str, str]]:
        """Return the lift to take with its lobbies, none on one storey: that of the shortest way and queue."""
        one, other = self._graph.node[start], self._graph.node[goal]
        if one.storey == other.storey:
            return []
        options = []
        for lift in self._graph.lifts:
            at = {self._graph.node[stop].storey: stop for stop in lift.stops}
            if one.storey in at and other.storey in at:
                here, there = at[one.storey], at[other.storey]
                metres = sum(
                    abs(a.x - b.x) + abs(a.y - b.y)
                    for a, b in ((one, self._graph.node[here]), (other, self._graph.node[there]))
                )
                wait_s = self._lifts[lift.name].waiting * 1e-3 * self._ride_ms[frozenset((here, there))]
                options.append((metres / SPEED + wait_s, (lift.name, here, there)))
        if not options:
            raise TaskError(f"no lift joins the storeys {one.storey} and {other.storey} of {self._graph.name}")
        return [min(options)[1]]

    def _go_on(self, chair: int) -> None:
        """Ask for the way to the chair's goal, or to the lobby of its lift."""
        own = self._chairs[chair]
        storey = self._storeys[own.storey]
        goal = lobby_in(own.rides[0][1]) if own.rides else own.goal
        if own.rides and not self._has_room(storey.order, goal):
            name, lobby, _ = own.rides[0]
            lift = self._lifts[name]
            lift.asking.setdefault(lobby, deque()).append(chair)
            self.done.longest_queue[name] = max(self.done.longest_queue[name], lift.waiting)
            return
        self._requests += 1
        found = booked(
            storey.order,
            storey.bookings,
            Request(self._requests, chair, goal, self.now_ms),
            self.now_ms,
            _CLEARING_MS,
        )
        if found is None:
            self.done.without_way += 1
            self._at(self.now_ms + _RETRY_MS, partial(self._go_on, chair))
            return
        storey.order, storey.bookings[chair] = found
        self._taken.discard(own.place)
        own.place = goal
        self._at(found[1].stays[1].from_ms, partial(self._enter, chair))

    def _has_room(self, order: Order, goal: str) -> bool:
        ends = sum(order.ways.names[chain.spots[-1]] == goal for chain in order.chains.values())
        return ends < len(order.ways.slots[goal])

    def _enter(self, chair: int) -> None:
        """Let a chair enter its next spot, and end its drive in the last one."""
        own = self._chairs[chair]
        storey = self._storeys[own.storey]
        storey.order = entered(storey.order, chair, self.now_ms)
        self._at(self.now_ms + _CLEARING_MS, partial(self._clear, own.storey, chair), leaves=True)
        chain = storey.order.chains[chair]
        if len(chain.spots) > 1:
            self._at(storey.bookings[chair].from_ms(chain.visit + 1), partial(self._enter, chair))

    def _clear(self, storey_name: str, chair: int) -> None:
        """Let a chair's rear leave the spot before; it has arrived when that was the last one."""
        storey = self._storeys[storey_name]
        storey.order = cleared(storey.order, chair)
        chain = storey.order.chains[chair]
        if len(chain.spots) > 1 or chain.behind:
            return
        del storey.bookings[chair]
        own = self._chairs[chair]
        if own.rides:
            name, here, there = own.rides[0]
            lift = self._lifts[name]
            own.came_ms = self.now_ms
            lift.queue.append((chair, here, there))
            self.done.longest_queue[name] = max(self.done.longest_queue[name], lift.waiting)
            self._serve(lift)
            return
        self.done.arrivals += 1
        self.done.took_s.append(1e-3 * (self.now_ms - own.asked_ms))
        self._begin(chair)

    def _serve(self, lift: _Lift) -> None:
        """Let the first chair ride whose storey has room before the lift."""
        if not lift.is_free:
            return
        for k, (chair, here, there) in enumerate(lift.queue):
            storey = self._storeys[self._graph.node[there].storey]
            (spot,) = storey.order.ways.slots[lobby_out(there)]
            if int(storey.order.ways.resource[spot]) in storey.order.queues:
                continue
            del lift.queue[k]
            own = self._chairs[chair]
            self.done.lift_waits_s[lift.name].append(1e-3 * (self.now_ms - own.came_ms))
            lift.is_free = False
            here_storey = self._storeys[own.storey]
            here_storey.order = handed_over(here_storey.order, chair)
            storey.order = taken_in(storey.order, chair, lobby_out(there), self.now_ms)
            own.storey, own.rides = self._graph.node[there].storey, own.rides[1:]
            self._at(self.now_ms + self._ride_ms[frozenset((here, there))], partial(self._come_out, lift, chair))
            if lift.asking.get(here):
                self._go_on(lift.asking[here].popleft())
            return
        if lift.queue:
            self._at(self.now_ms + _RETRY_MS, partial(self._serve, lift))

    def _come_out(self, lift: _Lift, chair: int) -> None:
        lift.is_free = True
        self._go_on(chair)
        self._serve(lift)
