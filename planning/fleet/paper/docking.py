"""Docks (the paper's assumption I: every chair has a place where it is charged when it is idle)."""

from __future__ import annotations

from collections.abc import Sequence

from waychair.errors import TrafficError
from waychair.maps.traffic.traffic_graph import RefugeKind, TrafficGraph


def dock_nodes(graph: TrafficGraph, starts: Sequence[str]) -> tuple[str, ...]:
    """Return the node of each chair's dock: its own dock, else a dock of nobody, else the place it started from.

    Raises:
        TrafficError: a chair starts at a node that is not in the graph.
    """
    free = [refuge for refuge in graph.refuges if refuge.kind is RefugeKind.DOCK and refuge.owner is None]
    spare = [refuge.node for refuge in free for _ in range(refuge.slots)]
    own = {refuge.owner: refuge.node for refuge in graph.refuges if refuge.kind is RefugeKind.DOCK}
    found: list[str] = []
    for chair, start in enumerate(starts):
        if start not in graph.node:
            raise TrafficError(f"chair {chair} starts at node {start}, which is not in {graph.name}")
        found.append(own.get(chair) or (spare.pop(0) if spare else start))
    return tuple(found)
