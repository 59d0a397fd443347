"""Chairs on a traffic graph that drive by the coordinator's order, with stops as people cause them; exact, by events."""

from __future__ import annotations

import heapq
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from waychair.errors import TaskError
from waychair.maps.traffic.traffic_graph import RefugeKind, TrafficGraph
from waychair.maps.traffic.well_formed import pieces, well_formed
from waychair.planning.fleet.audit import order_record
from waychair.planning.fleet.granting import granted
from waychair.planning.fleet.order import Order, Request, asked, cleared, entered, held_up, parked
from waychair.planning.fleet.rules import Priority
from waychair.planning.fleet.waits import Audit, wait_of
from waychair.planning.fleet.ways import ways_of
from waychair.types import Json

SPEED = 1.0 / 3.0
"""m/s; the paper's 0.330 m/s, so that a cell of 1 m takes three seconds."""

LOCKED_MS = 300_000
"""ms without a move of anybody, while somebody wants to move: the chairs have locked each other up."""

CLEARING_MS = 1
"""ms that a rear takes to leave a cell: a chair follows another cell by cell, as on the grids of the benchmark."""

_MEASURED_EVERY = 16
"""Plans of which the time of one is measured: reading a thread's clock costs as much as a plan on some computers."""

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


@dataclass
class OrderedChairs:
    """Chairs that always have a task: a new one as soon as one is done.

    `goals` are the places to go to (all, if empty), `top` is the chair of top priority, and `log` hears every decision and
    movement, as `planning/fleet/audit.py` reads them.
    """

    order: Order
    rng: np.random.Generator
    stops: Stops = Stops()
    rounds: int = 30
    now_ms: int = 0
    done: list[Done] = field(default_factory=list)
    alone_ms: dict[int, int] = field(default_factory=dict)
    events: list[tuple[int, int]] = field(default_factory=list)
    audit: Audit | None = None
    most_overtaken: int = 0
    plan_ms: list[float] = field(default_factory=list)
    requests: int = 0
    goals: tuple[str, ...] = ()
    top: int | None = None
    log: Callable[[Json], None] | None = None

    def run(self, until_ms: int, progress: Callable[[float], None] = lambda share: None) -> bool:
        """Let time pass; return whether the chairs have not locked each other up.

        `progress` is called with the share (0 to 1) of the time until then.
        """
        if not self.events:
            self._tell(order_record(self.order, 0))
            for chair in self.order.chains:
                self._new_task(chair)
            self._plan()
        while self.events and self.events[0][0] <= until_ms:
            self.now_ms, chair = heapq.heappop(self.events)
            self._act(chair)
            progress(self.now_ms / max(until_ms, 1))
            if self._is_locked():
                return False
        return bool(self.events)

    def _is_locked(self) -> bool:
        """Return whether nobody has moved for long though somebody wants to."""
        chains = self.order.chains.values()
        moved_ms = max(chain.entered_ms for chain in chains)
        return self.now_ms - moved_ms > LOCKED_MS and any(len(chain.spots) > 1 for chain in chains)

    def _act(self, chair: int) -> None:
        """Let a chair's rear leave, and the chair enter its next spot if it can; then the first of those who wait for it."""
        waiting = [chair]
        while waiting:
            chair = waiting.pop()
            chain = self.order.chains[chair]
            while chain.behind and self.now_ms >= chain.entered_ms + CLEARING_MS:
                resource = int(self.order.ways.resource[chain.behind[0][1]])
                self.order = cleared(self.order, chair)
                self._tell({"event": "left", "t_ms": self.now_ms, "chair": chair, "resource": resource})
                chain = self.order.chains[chair]
                waiting += [turn.chair for turn in self.order.queues.get(resource, ())[:1]]
            if len(chain.spots) > 1 and self.now_ms >= chain.ready_ms:
                if self.order.may_enter(chair):
                    self._enter(chair)
                    waiting.append(chair)
                elif self.audit is not None and chair not in self.audit.begun:
                    self.audit.begin(wait_of(self.order, chair, self.now_ms, CLEARING_MS), self.now_ms)

    def _enter(self, chair: int) -> None:
        if self.audit is not None:
            ended = self.audit.end(chair, self.now_ms)
            if ended is not None:
                self._tell({"event": "waited", "t_ms": self.now_ms, **ended})
        before = self.order.chains[chair]
        self.order = entered(self.order, chair, self.now_ms)
        chain = self.order.chains[chair]
        resource = int(self.order.ways.resource[chain.spots[0]])
        self._tell(
            {"event": "entered", "t_ms": self.now_ms, "chair": chair, "visit": chain.visit, "resource": resource}
        )
        self._stop(chair)
        chain = self.order.chains[chair]
        heapq.heappush(self.events, (chain.entered_ms + CLEARING_MS, chair))
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
        if stop_ms > _OFF_MS:
            self._plan()

    def _new_task(self, chair: int) -> None:
        """Ask for a way to a goal that nobody is in or goes to; where there is none, to another chair's, which has to wait."""
        names = self.order.ways.names
        own = names[self.order.chains[chair].spots[-1]]
        taken = {names[chain.spots[-1]] for chain in self.order.chains.values()}
        taken |= {request.goal for request in self.order.waiting}
        goals = self.goals or tuple(self.order.ways.slots)
        free = [name for name in goals if name not in taken] or [name for name in goals if name != own]
        goal = free[int(self.rng.integers(len(free)))]
        self.requests += 1
        priority = Priority.TOP if chair == self.top else Priority.ROUTINE
        self.order = asked(self.order, Request(self.requests, chair, goal, self.now_ms, priority))
        self._tell({"event": "asked", "t_ms": self.now_ms, "chair": chair, "request": self.requests, "goal": goal})
        self.alone_ms[chair] = int(self.order.ways.least_ms(goal)[self.order.chains[chair].spots[0]]) - 1

    def _plan(self) -> None:
        is_measured = self.requests % _MEASURED_EVERY == 0
        begun = time.thread_time() if is_measured else 0.0
        before = self.order
        self.order = granted(self.order, self.now_ms, CLEARING_MS, self.rng, self.rounds)
        if is_measured:
            self.plan_ms.append(1e3 * (time.thread_time() - begun))
        for chair, chain in self.order.chains.items():
            self.most_overtaken = max(self.most_overtaken, len(chain.overtaken_by))
            if len(chain.spots) > 1:
                heapq.heappush(self.events, (max(chain.ready_ms, self.now_ms), chair))
        if self.log is not None and self.order is not before:
            self.log(order_record(self.order, self.now_ms))

    def _tell(self, record: Json) -> None:
        if self.log is not None:
            self.log(record)


def chairs_on(graph: TrafficGraph, chairs: int, seed: int, **how: object) -> OrderedChairs:
    """Return chairs parked in random places of a graph, which go from place to place.

    Bays are no goals beside places, nor are places that a chair would shut off others from, or that no way leads to.

    Raises:
        TaskError: there are not more places than chairs.
    """
    ways, rng = ways_of(graph, SPEED), np.random.default_rng(seed)
    names = {refuge.name for refuge in graph.refuges if refuge.kind is not RefugeKind.BAY} or set(ways.slots)
    joined = set(pieces(graph)[0]) if graph.nodes else set()
    in_the_way = {finding.refuge for finding in well_formed(graph)}
    places = sorted(name for name in names - in_the_way if graph.refuge[name].node in joined)
    if not 0 < chairs < len(places):
        others = len(names) - len(places)
        why = f" ({others} shut off others or are cut off, as `waychair fleet check` says)" if others else ""
        most = len(places) - 1
        raise TaskError(
            f"{chairs} chairs cannot go from place to place in {graph.name}, which has {len(places)} places in nobody's way"
            f"{why}: give {f'1 to {most} chairs' if most > 1 else '1 chair'}"
            if most > 0
            else f"{graph.name} has no two places in nobody's way between which chairs can go{why}: add places"
        )
    starts = rng.permutation(places)[:chairs].tolist()
    order = parked(ways, dict(enumerate(starts, start=1)))
    return OrderedChairs(order, rng, goals=tuple(places), **how)  # type: ignore[arg-type]
