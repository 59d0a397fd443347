"""A traffic graph cut at its lifts: one graph for each storey, on which the order of chairs is kept by itself.

Each lobby becomes two refuges beside its node: `NAME in` for chairs that wait for the lift, and `NAME out` for one that has come
out of it. A chair that comes out always has room, so that chairs which go up never wait for chairs which go down.
"""

from __future__ import annotations

from dataclasses import replace

from waychair.maps.traffic.traffic_graph import Refuge, RefugeKind, Section, TrafficGraph, TrafficNode

LOBBY_DEPTH = 1.0
"""m from the node before a lift to a chair that waits beside it."""


def cut_at_lifts(graph: TrafficGraph) -> dict[str, TrafficGraph]:
    """Return a graph for each storey by its name, without lifts."""
    lobbies = {stop: None for lift in graph.lifts for stop in lift.stops}
    found: dict[str, TrafficGraph] = {}
    for storey in graph.storeys:
        names = {node.name for node in graph.nodes if node.storey == storey}
        nodes = [node for node in graph.nodes if node.name in names]
        sections = [
            section
            for section in graph.sections
            if section.lift is None and section.start in names and section.end in names
        ]
        refuges = [refuge for refuge in graph.refuges if refuge.node in names and refuge.node not in lobbies]
        for lobby in lobbies:
            if lobby not in names:
                continue
            slots = max(1, graph.capacity(lobby) - 1)
            where = graph.node[lobby]
            for name, room in ((lobby_in(lobby), slots), (lobby_out(lobby), 1)):
                nodes.append(TrafficNode(name, where.x, where.y, storey))
                width = graph.chair_width + 0.1
                sections.append(Section(f"way to {name}", lobby, name, LOBBY_DEPTH, width))
                refuges.append(Refuge(name, name, room, RefugeKind.BAY, waiting=True))
        found[storey] = replace(
            graph,
            name=f"{graph.name} {storey}",
            nodes=tuple(nodes),
            sections=tuple(sections),
            refuges=tuple(refuges),
            lifts=(),
        )
    return found


def lobby_in(lobby: str) -> str:
    """Return the name of the refuge of chairs that wait for the lift at a node."""
    return f"{lobby} in"


def lobby_out(lobby: str) -> str:
    """Return the name of the refuge of a chair that has come out of the lift at a node."""
    return f"{lobby} out"
