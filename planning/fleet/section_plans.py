"""The best plans where nodes hold any number of chairs and a section takes chairs of one direction at a time.

This is the model of the source paper: chairs pass each other at nodes, follow each other on a section, and meet nobody on it.
The plans are found by conflict-based search in continuous time (see `cbs.py`); where it needs too many steps, by the best
of several orders in which the chairs are planned one after the other. Only the order at each section has to be kept.
"""

from __future__ import annotations

import heapq
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from waychair.errors import TrafficError
from waychair.maps.traffic.indexed_traffic import IndexedTraffic
from waychair.types import FloatArray

STEPS = 150
"""Steps of the search; beyond it, a small gain would cost more time than a control tick has."""

_ORDERS = 24
"""Orders of chairs that are tried where the best plans are not proven."""


class Trip(NamedTuple):
    """A chair that can leave `start` at `ready_ms` and goes to `goal` (numbers of nodes); `weight` of its lateness."""

    start: int
    goal: int
    ready_ms: int
    weight: float = 1.0


class SectionUse(NamedTuple):
    """A chair's drive through a section in a direction (0 from its start), from a time until a time [ms]."""

    section: int
    direction: int
    from_ms: int
    until_ms: int


Drive = tuple[SectionUse, ...]
"""All that a chair drives, in the order of time."""

_Rules = Mapping[tuple[int, int], Sequence[tuple[int, int]]]
"""Times [ms] in which a section must not be entered in a direction."""


@dataclass(frozen=True, slots=True)
class SectionPlans:
    """The drives of the chairs in the order of their trips; `is_best` if no smaller weighted sum of arrivals is possible."""

    drives: tuple[Drive, ...]
    is_best: bool


class SectionPlanner:
    """Plans on one graph at one speed.

    Args:
        graph: the building; sections of two lanes never are in anybody's way.
        speed: m/s of all chairs.
        free_s: (N, N) time of the shortest way between all nodes [s].
    """

    def __init__(self, graph: IndexedTraffic, speed: float, free_s: FloatArray) -> None:
        self._takes = np.rint(1e3 * graph.seconds(speed)).astype(int).tolist()
        self._single = (graph.lanes == 1).tolist()
        self._left = np.where(np.isfinite(free_s), np.floor(1e3 * free_s) - len(graph.length), np.inf).tolist()
        moves = graph.leaving.tolist()
        self._moves = [moves[first:last] for first, last in pairwise(graph.first.tolist())]

    def alone_ms(self, start: int, goal: int) -> int:
        """Return the least time [ms] from one node to another with nobody about."""
        drive = self._earliest(Trip(start, goal, 0), {})
        if drive is None:
            raise TrafficError(f"no way leads from node {start} to node {goal}; join the parts of the graph")
        return _arrival(Trip(start, goal, 0), drive)

    def plans(self, trips: Sequence[Trip], busy: Sequence[SectionUse] = (), steps: int = STEPS) -> SectionPlans | None:
        """Return the plans of all trips beside chairs that are on sections now; None if a goal cannot be reached."""
        rules: dict[tuple[int, int], list[tuple[int, int]]] = {}
        for use in busy:
            if self._single[use.section]:
                rules.setdefault((use.section, 1 - use.direction), []).append((use.from_ms, use.until_ms))
        own: tuple[_Rules, ...] = tuple({key: sorted(each) for key, each in rules.items()} for _ in trips)
        first = tuple(self._earliest(trip, each) for trip, each in zip(trips, own, strict=True))
        drives = tuple(drive for drive in first if drive is not None)
        if len(drives) < len(trips):
            return None
        count = 0
        price = sum(trip.weight * _arrival(trip, drive) for trip, drive in zip(trips, drives, strict=True))
        queue = [(price, 0, 0, own, drives)]
        for _ in range(steps):
            price, _, _, own, drives = heapq.heappop(queue)
            conflict = self._first_conflict(drives)
            if conflict is None:
                return SectionPlans(drives, is_best=True)
            for (chair, use), (_, other) in (conflict, conflict[::-1]):
                key = (use.section, use.direction)
                added = sorted((*own[chair].get(key, ()), (use.from_ms, other.until_ms)))
                changed = {**own[chair], key: added}
                drive = self._earliest(trips[chair], changed)
                if drive is None:
                    continue
                later = _arrival(trips[chair], drive) - _arrival(trips[chair], drives[chair])
                count += 1
                heapq.heappush(
                    queue,
                    (
                        price + trips[chair].weight * later,
                        -count,
                        count,
                        (*own[:chair], changed, *own[chair + 1 :]),
                        (*drives[:chair], drive, *drives[chair + 1 :]),
                    ),
                )
        return SectionPlans(self._in_order(trips, rules), is_best=False)

    def _earliest(self, trip: Trip, rules: _Rules) -> Drive | None:
        """Return the drive of the earliest arrival; a chair waits at nodes for as long as it likes."""
        goal, takes = trip.goal, self._takes
        came: dict[int, tuple[int, SectionUse] | None] = {}
        waiting: list[tuple[float, int, int, tuple[int, SectionUse] | None]] = [
            (trip.ready_ms + self._left[trip.start][goal], trip.ready_ms, trip.start, None)
        ]
        while waiting:
            _, time, node, before = heapq.heappop(waiting)
            if node in came:
                continue
            came[node] = before
            if node == goal:
                break
            for section, direction, ahead in self._moves[node]:
                if ahead in came:
                    continue
                enters = time
                for first, last in rules.get((section, direction), ()):
                    if first <= enters < last:
                        enters = last
                leaves = enters + takes[section]
                left = self._left[ahead][goal]
                if left < np.inf:
                    use = SectionUse(section, direction, enters, leaves)
                    heapq.heappush(waiting, (leaves + left, leaves, ahead, (node, use)))
        if goal not in came:
            return None
        drive: list[SectionUse] = []
        step = came[goal]
        while step is not None:
            node, use = step
            drive.append(use)
            step = came[node]
        return tuple(reversed(drive))

    def _first_conflict(self, drives: Sequence[Drive]) -> tuple[tuple[int, SectionUse], tuple[int, SectionUse]] | None:
        """Return the earliest two uses by which chairs would meet on a section, with their chairs."""
        by_section: dict[int, list[tuple[int, SectionUse]]] = {}
        found: tuple[int, tuple[int, SectionUse], tuple[int, SectionUse]] | None = None
        for chair, drive in enumerate(drives):
            for use in drive:
                if not self._single[use.section]:
                    continue
                others = by_section.setdefault(use.section, [])
                for other, theirs in others:
                    if (
                        theirs.direction != use.direction
                        and other != chair
                        and theirs.from_ms < use.until_ms
                        and use.from_ms < theirs.until_ms
                    ):
                        begins = max(use.from_ms, theirs.from_ms)
                        if found is None or begins < found[0]:
                            found = (begins, (other, theirs), (chair, use))
                others.append((chair, use))
        return None if found is None else found[1:]

    def _in_order(self, trips: Sequence[Trip], rules: _Rules) -> tuple[Drive, ...]:
        """Return the best plans of several orders in which the chairs are planned one after the other."""
        random = np.random.default_rng(len(trips))
        best: tuple[float, dict[int, Drive]] | None = None
        by_weight = sorted(range(len(trips)), key=lambda chair: -trips[chair].weight)
        for attempt in range(_ORDERS):
            order: list[int] = by_weight if attempt == 0 else random.permutation(len(trips)).tolist()
            taken = {key: list(each) for key, each in rules.items()}
            drives: dict[int, Drive] = {}
            for chair in order:
                drive = self._earliest(trips[chair], self._blind(taken))
                assert drive is not None  # all the others have driven some day
                drives[chair] = drive
                for use in drive:
                    if self._single[use.section]:
                        taken.setdefault((use.section, 1 - use.direction), []).append((use.from_ms, use.until_ms))
            price = sum(trips[chair].weight * _arrival(trips[chair], drive) for chair, drive in drives.items())
            if best is None or price < best[0]:
                best = (price, drives)
        assert best is not None
        return tuple(best[1][chair] for chair in range(len(trips)))

    def _blind(self, taken: Mapping[tuple[int, int], Sequence[tuple[int, int]]]) -> _Rules:
        """Return the times in which a section must not be entered, as it is driven through the other way later on."""
        return {
            key: sorted((first - self._takes[key[0]] + 1, last) for first, last in each) for key, each in taken.items()
        }


def _arrival(trip: Trip, drive: Drive) -> int:
    return drive[-1].until_ms if drive else trip.ready_ms


class SectionOrder:
    """The order in which chairs drive through sections: a chair enters when those against it that come first have left.

    The order of times has no cycle and nodes hold any number, so that somebody can always go on, however late anybody is.
    """

    def __init__(self, graph: IndexedTraffic) -> None:
        self._single = graph.lanes == 1
        self._ahead: dict[int, list[SectionUse]] = {}

    def set(self, drives: Mapping[int, Drive]) -> None:
        """Replace the order by that of new drives: all that each chair, by number, drives from now on."""
        self._ahead = {chair: list(drive) for chair, drive in drives.items()}

    def left(self, chair: int) -> None:
        """Hear that a chair has left the first section that it had ahead."""
        self._ahead[chair].pop(0)

    def following(self, chair: int) -> int | None:
        """Return the section that a chair enters next; None if it has none ahead."""
        uses = self._ahead.get(chair)
        return uses[0].section if uses else None

    def before(self, chair: int, section: int) -> int | None:
        """Return a chair for which another one waits before it enters a section next; None if it may."""
        if not self._single[section]:
            return None
        own = next(use for use in self._ahead[chair] if use.section == section)
        for other, uses in self._ahead.items():
            for use in uses:
                against = use.section == section and use.direction != own.direction
                if other != chair and against and (use.from_ms, other) < (own.from_ms, chair):
                    return other
        return None
