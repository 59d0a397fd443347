"""The Bloom filters of the paper's nodes: by which neighbour a goal is reached without a large detour."""

from __future__ import annotations

import heapq
import math
from collections.abc import Collection

from waychair.maps.traffic.traffic_graph import TrafficGraph
from waychair.planning.fleet.paper.bloom import BloomFilter, empty_filter

DETOUR = 1.5
"""A neighbour's filter holds the goals to which the way over it is at most this much longer than the shortest."""

_SPEED = 0.33
"""m/s; the paper's speed. It weighs lengths against the fixed times of doors and lifts."""


def goal_filters(
    graph: TrafficGraph, closed: Collection[str] = (), detour: float = DETOUR
) -> dict[str, dict[str, BloomFilter]]:
    """Return the filter of each neighbour of each node, without the closed sections.

    The filter of v at u holds the nodes t with w(u, v) + d(v, t) <= detour * d(u, t).
    """
    distances = {node.name: distances_from(graph, node.name, closed) for node in graph.nodes}
    filters: dict[str, dict[str, BloomFilter]] = {}
    for node in graph.nodes:
        filters[node.name] = {}
        own = distances[node.name]
        for neighbour in dict.fromkeys(move.end for move in graph.moves[node.name]):
            weight = min(
                (
                    graph.section[move.section].seconds(_SPEED)
                    for move in graph.moves[node.name]
                    if move.end == neighbour and move.section not in closed
                ),
                default=math.inf,
            )
            over = distances[neighbour]
            goals = [
                goal
                for goal in own
                if goal != node.name and weight + over.get(goal, math.inf) <= detour * own[goal] + 1e-9
            ]
            filters[node.name][neighbour] = empty_filter(len(goals)).with_names(goals)
    return filters


def distances_from(graph: TrafficGraph, source: str, closed: Collection[str] = ()) -> dict[str, float]:
    """Return the shortest time [s] from a node to every node that it reaches (Dijkstra)."""
    found: dict[str, float] = {}
    waiting = [(0.0, source)]
    while waiting:
        time, name = heapq.heappop(waiting)
        if name in found:
            continue
        found[name] = time
        for move in graph.moves[name]:
            if move.end not in found and move.section not in closed:
                heapq.heappush(waiting, (time + graph.section[move.section].seconds(_SPEED), move.end))
    return found
