"""The least sum of delays of one task each in the paper's model: nodes hold any number, sections are single file.

Conflict-based search in continuous time (A. Andreychuk et al., "Multi-agent pathfinding with continuous time", IJCAI
2019). A chair may wait at any node for as long as it likes, so that its earliest arrival under constraints is Dijkstra's.
It is written apart from the product's planners, in plain Python.
"""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from itertools import count
from typing import NamedTuple

from waychair.maps.traffic.traffic_graph import TrafficGraph
from waychair.planning.fleet.paper.goal_filters import distances_from
from waychair.trials.fleet.fleet_tasks import PAPER_SPEED

MOST_NODES = 5_000
"""Conflicts looked at before an instance is given up as not proved."""


class SectionEntry(NamedTuple):
    """A chair's entry into a section from a node at a time [s]; it is at the other end after `takes_s`."""

    section: str
    start: str
    end: str
    enters_s: float
    takes_s: float


Forbidden = dict[tuple[str, str], list[tuple[float, float]]]
"""Intervals [s] in which a chair may not enter a section from a node."""


def least_mean_delay(graph: TrafficGraph, starts: Sequence[str], goals: Sequence[str]) -> float | None:
    """Return the least possible mean delay [s] at the paper's speed, or None where it was not proved."""
    free_s = sum(distances_from(graph, start)[goal] for start, goal in zip(starts, goals, strict=True))
    plans = [_earliest(graph, start, goal, {}) for start, goal in zip(starts, goals, strict=True)]
    number = count()
    none: list[Forbidden] = [{} for _ in starts]
    waiting = [(_cost(plans), len(_conflicts(graph, plans)), next(number), none, plans)]
    for _ in range(MOST_NODES):
        cost, _, _, forbidden, plans = heapq.heappop(waiting)
        found = _conflicts(graph, plans)
        if not found:
            return (cost - free_s) / len(starts)
        first, second = found[0]
        for (chair, own), (_, other) in ((first, second), (second, first)):
            rules = dict(forbidden[chair])
            key = (own.section, own.start)
            rules[key] = sorted([*rules.get(key, []), (own.enters_s, other.enters_s + other.takes_s)])
            changed = [rules if i == chair else each for i, each in enumerate(forbidden)]
            again = _earliest(graph, starts[chair], goals[chair], rules)
            renewed = [again if i == chair else each for i, each in enumerate(plans)]
            heapq.heappush(waiting, (_cost(renewed), len(_conflicts(graph, renewed)), next(number), changed, renewed))
    return None


def _cost(plans: Sequence[Sequence[SectionEntry]]) -> float:
    return sum(plan[-1].enters_s + plan[-1].takes_s for plan in plans if plan)


def _conflicts(
    graph: TrafficGraph, plans: Sequence[Sequence[SectionEntry]]
) -> list[tuple[tuple[int, SectionEntry], tuple[int, SectionEntry]]]:
    """Return all pairs of entries by which two chairs would meet, the earliest first."""
    by_section: dict[str, list[tuple[int, SectionEntry]]] = {}
    for chair, plan in enumerate(plans):
        for entry in plan:
            if graph.section[entry.section].lanes == 1:
                by_section.setdefault(entry.section, []).append((chair, entry))
    found = [
        (first, second)
        for entries in by_section.values()
        for i, first in enumerate(entries)
        for second in entries[i + 1 :]
        if first[0] != second[0]
        and first[1].start != second[1].start
        and first[1].enters_s < second[1].enters_s + second[1].takes_s - 1e-9
        and second[1].enters_s < first[1].enters_s + first[1].takes_s - 1e-9
    ]
    return sorted(found, key=lambda pair: (max(pair[0][1].enters_s, pair[1][1].enters_s), pair[0][0], pair[1][0]))


def _earliest(graph: TrafficGraph, start: str, goal: str, forbidden: Forbidden) -> list[SectionEntry]:
    """Return the entries of the earliest arrival; a chair waits at nodes for as long as it likes."""
    came: dict[str, SectionEntry | None] = {}
    waiting: list[tuple[float, int, str, SectionEntry | None]] = [(0.0, 0, start, None)]
    number = count(1)
    while goal not in came:
        time, _, name, entry = heapq.heappop(waiting)
        if name in came:
            continue
        came[name] = entry
        for move in graph.moves[name]:
            if move.end in came:
                continue
            enters = time
            for first, last in forbidden.get((move.section, name), ()):
                if first - 1e-9 <= enters < last:
                    enters = last
            takes = graph.section[move.section].seconds(PAPER_SPEED)
            entering = SectionEntry(move.section, name, move.end, enters, takes)
            heapq.heappush(waiting, (enters + takes, next(number), move.end, entering))
    plan: list[SectionEntry] = []
    step = came[goal]
    while step is not None:
        plan.append(step)
        step = came[step.start]
    return plan[::-1]
