"""Chairs on a traffic graph that drive by the coordinator's order, with stops as people cause them; exact, by events."""

from __future__ import annotations

import heapq
import math
import time
from dataclasses import dataclass, field

import numpy as np

from waychair.maps.traffic.corridors import corridor_cells, load_corridors, room_doors
from waychair.maps.traffic.traffic_graph import Refuge, RefugeKind, Section, TrafficGraph, TrafficNode
from waychair.planning.fleet.cbs import Constraint, barred_entries, barred_uses, best_ways
from waychair.planning.fleet.granting import CBS_STEPS, granted
from waychair.planning.fleet.order import Order, Request, Turn, asked, cleared, entered, foreseen, held_up, parked
from waychair.planning.fleet.sipp import Stay, earliest, gaps_between
from waychair.planning.fleet.waits import Audit, wait_of
from waychair.planning.fleet.ways import Ways, ways_of

SPEED = 1.0 / 3.0
"""m/s; the paper's 0.330 m/s, so that a cell of 1 m takes three seconds."""

LOCKED_MS = 300_000
"""ms without a move of anybody, while somebody wants to move: the chairs have locked each other up."""

_CLEARING_MS = 1
"""ms that a rear takes to leave a cell: a chair follows another cell by cell, as on the grids of the benchmark."""

_OFF_MS = 10_000
"""ms that a chair may be late before the order is planned anew."""


@dataclass(frozen=True, slots=True)
class Stops:
    """Stops as people cause them: the share of entered spots longer than nothing in which one begins, and its mean [s]."""

    share: float = 0.0
    mean_s: float = 15.0


@dataclass(frozen=True, slots=True)
class Done:
    """A finished task: its chair, and the times [ms] that it took and would have taken alone."""

    chair: int
    took_ms: int
    alone_ms: int

    @property
    def delay_s(self) -> float:
        return 1e-3 * (self.took_ms - self.alone_ms)


def cell_traffic(name: str, bays: bool) -> TrafficGraph:
    """Return a floor plan by cells of 1 m in which nobody can pass, with rooms beside the corridors as refuges.

    With `bays`, any chair may step aside into any room.
    """
    plan = load_corridors(name)
    cells = sorted(corridor_cells(plan))
    nodes = [TrafficNode(f"{x},{y}", x, y) for x, y in cells]
    sections = [
        Section(f"{x},{y}-{x + dx},{y + dy}", f"{x},{y}", f"{x + dx},{y + dy}", 1.0, 1.2)
        for x, y in cells
        for dx, dy in ((1, 0), (0, 1))
        if (x + dx, y + dy) in set(cells)
    ]
    refuges = []
    for room, (door, place) in room_doors(plan).items():
        nodes.append(TrafficNode(room, *place))
        sections.append(Section(f"door of {room}", f"{round(door[0])},{round(door[1])}", room, 1.0, 1.2))
        refuges.append(Refuge(room, room, waiting=bays, kind=RefugeKind.BAY if bays else RefugeKind.PLACE))
    return TrafficGraph(name, tuple(nodes), tuple(sections), tuple(refuges))


@dataclass
class OrderedChairs:
    """Chairs that always have a task: a new one as soon as one is done.

    `replans` says whether the order is planned anew when somebody is late.
    """

    order: Order
    rng: np.random.Generator
    stops: Stops = Stops()
    rounds: int = 30
    replans: bool = True
    now_ms: int = 0
    moved_ms: int = 0
    done: list[Done] = field(default_factory=list)
    alone_ms: dict[int, int] = field(default_factory=dict)
    events: list[tuple[int, int]] = field(default_factory=list)
    audit: Audit | None = None
    most_overtaken: int = 0
    plan_ms: list[float] = field(default_factory=list)
    requests: int = 0

    def run(self, until_ms: int) -> bool:
        """Let time pass; return whether the chairs have not locked each other up."""
        if not self.events:
            for chair in self.order.chains:
                self._new_task(chair)
            self._plan()
        while self.events and self.events[0][0] <= until_ms:
            self.now_ms, chair = heapq.heappop(self.events)
            self._act(chair)
            if self.now_ms - self.moved_ms > LOCKED_MS and any(len(c.spots) > 1 for c in self.order.chains.values()):
                return False
        return bool(self.events)

    def _act(self, chair: int) -> None:
        """Let a chair's rear leave, and the chair enter its next spot if it can; then those who wait for it."""
        waiting = [chair]
        while waiting:
            chair = waiting.pop()
            chain = self.order.chains[chair]
            while chain.behind and self.now_ms >= chain.entered_ms + _CLEARING_MS:
                self.order = cleared(self.order, chair)
                chain = self.order.chains[chair]
                waiting += [other for other in self.order.chains if other != chair]
            if len(chain.spots) > 1 and self.now_ms >= chain.ready_ms:
                if self.order.may_enter(chair):
                    self._enter(chair)
                    waiting.append(chair)
                elif self.audit is not None and chair not in self.audit.begun:
                    self.audit.begin(wait_of(self.order, chair, self.now_ms, _CLEARING_MS), self.now_ms)

    def _enter(self, chair: int) -> None:
        if self.audit is not None:
            self.audit.end(chair, self.now_ms)
        before = self.order.chains[chair]
        self.order = entered(self.order, chair, self.now_ms)
        self.moved_ms = self.now_ms
        self._stop(chair)
        chain = self.order.chains[chair]
        heapq.heappush(self.events, (chain.entered_ms + _CLEARING_MS, chair))
        heapq.heappush(self.events, (chain.ready_ms, chair))
        if len(chain.spots) == 1 and before.request is not None:
            request = before.request
            self.done.append(Done(chair, self.now_ms - request.asked_ms, self.alone_ms[chair]))
            self._new_task(chair)
            self._plan()

    def _stop(self, chair: int) -> None:
        """Begin a stop by chance, and have the order planned anew when it is long."""
        chain = self.order.chains[chair]
        if self.order.ways.passing_ms[chain.spots[0]] <= 1 or self.rng.random() >= self.stops.share:
            return
        stop_ms = round(1e3 * self.rng.exponential(self.stops.mean_s))
        self.order = held_up(self.order, chair, chain.ready_ms + stop_ms)
        if self.replans and stop_ms > _OFF_MS:
            self._plan()

    def _new_task(self, chair: int) -> None:
        """Ask for a way to a refuge that nobody is in or goes to."""
        names = self.order.ways.names
        taken = {names[chain.spots[-1]] for chain in self.order.chains.values()}
        taken |= {request.goal for request in self.order.waiting}
        free = [name for name in self.order.ways.slots if name not in taken]
        goal = free[int(self.rng.integers(len(free)))]
        self.requests += 1
        self.order = asked(self.order, Request(self.requests, chair, goal, self.now_ms))
        self.alone_ms[chair] = int(self.order.ways.least_ms(goal)[self.order.chains[chair].spots[0]]) - 1

    def _plan(self) -> None:
        begun = time.thread_time()
        self.order = granted(self.order, self.now_ms, _CLEARING_MS, self.rng, self.rounds)
        self.plan_ms.append(1e3 * (time.thread_time() - begun))
        assert foreseen(self.order, self.now_ms, _CLEARING_MS) is not None
        for chair, chain in self.order.chains.items():
            self.most_overtaken = max(self.most_overtaken, len(chain.overtaken_by))
            heapq.heappush(self.events, (max(chain.ready_ms, self.now_ms), chair))


@dataclass(frozen=True, slots=True)
class OneTask:
    """The delay a chair [s] of one task each, all at once: by the proven best ways (None without proof), by rounds of large
    neighbourhood search alone, and as the coordinator grants them."""

    best_s: float | None
    rounds_s: float
    granted_s: float


def one_task(ways: Ways, chairs: int, seed: int, steps: int = 2000, rounds: int = 60) -> OneTask:
    """Return the delays of chairs that go from random rooms to random rooms of others or free ones."""
    rng = np.random.default_rng([seed, chairs])
    rooms, goals = (rng.permutation(sorted(ways.slots))[:chairs].tolist() for _ in range(2))
    order = parked(ways, dict(enumerate(rooms)))
    for chair, goal in enumerate(goals):
        order = asked(order, Request(chair, chair, goal, 0))
    starts = [order.chains[chair].spots[0] for chair in range(chairs)]
    alone = sum(int(ways.least_ms(goal)[start]) for start, goal in zip(starts, goals, strict=True))
    alone -= sum(start not in ways.slots[goal] for start, goal in zip(starts, goals, strict=True))

    def way_of(chair: int, constraints: tuple[Constraint, ...]) -> tuple[Stay, ...]:
        gaps = gaps_between(ways, barred_uses(ways, constraints), 0)
        return earliest(ways, gaps, starts[chair], 0, goals[chair], _CLEARING_MS, barred=barred_entries(constraints))

    best = best_ways(ways, dict.fromkeys(range(chairs), 1.0), way_of, _CLEARING_MS, steps)

    def delay_s(arrivals: float) -> float:
        return 1e-3 * (arrivals - alone) / chairs

    def by(proof_steps: int) -> float:
        new = granted(order, 0, _CLEARING_MS, np.random.default_rng(seed), rounds, proof_steps)
        times = foreseen(new, 0, _CLEARING_MS)
        if times is None or new.waiting:
            return math.inf
        return delay_s(sum(times[Turn(chair, chain.last)].from_ms for chair, chain in new.chains.items()))

    return OneTask(None if best is None else delay_s(best.price), by(0), by(CBS_STEPS))


def chairs_on(graph: TrafficGraph, chairs: int, seed: int, **how: object) -> OrderedChairs:
    """Return chairs parked in random refuges of a graph."""
    ways, rng = ways_of(graph, SPEED), np.random.default_rng(seed)
    rooms = rng.permutation(sorted(ways.slots))[:chairs].tolist()
    return OrderedChairs(parked(ways, dict(enumerate(rooms, start=1))), rng, **how)  # type: ignore[arg-type]
