"""Whether chairs at rest leave everybody a way: the well-formed infrastructure of M. Čáp, J. Vokřínek and A. Kleiner,
"Complete decentralized method for on-line multi-robot trajectory planning in well-formed infrastructures" (ICAPS 2015).

In a well-formed graph any two refuges are joined by a way that passes no third one. Then a chair always finds a plan
against all plans made before, however many chairs there are.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from waychair.errors import TrafficError
from waychair.maps.traffic.traffic_graph import TrafficGraph


@dataclass(frozen=True, slots=True)
class ShutOff:
    """A refuge whose chair would be in others' way: `others` are the refuges that a full `refuge` shuts off.

    An empty `refuge` means that nobody stands in the way: the graph itself has no way to the others. `slots` are the chairs
    that fill the refuge.
    """

    refuge: str
    others: tuple[str, ...]
    slots: int = 1

    @property
    def sentence(self) -> str:
        """The finding as a sentence with its remedy."""
        shown = ", ".join(self.others[:4]) + (f" and {len(self.others) - 4} more" if len(self.others) > 4 else "")
        if not self.refuge:
            return f"No way leads to {shown} and back; join the parts of the map or take the one-way rule off."
        who = "A chair at {0} shuts" if self.slots == 1 else f"{self.slots} chairs at {{0}} shut"
        return f"{who.format(self.refuge)} off {shown}; move {self.refuge} aside or give it another way past."


def well_formed(graph: TrafficGraph) -> tuple[ShutOff, ...]:
    """Return all places that shut off others, in the order of the refuges; empty for a well-formed graph.

    Only refuges are asked for, or all nodes of a graph without any, and not the lobbies of lifts, which chairs pass. Where a refuge cuts the graph in two, the
    part with fewer refuges is shut off; a part without any is none.
    """
    findings: list[ShutOff] = []
    at = {refuge.node: refuge.name for refuge in graph.refuges}
    parts = pieces(graph)
    goals = at or {node.name: node.name for node in graph.nodes}
    apart = tuple(goals[node] for part in parts[1:] for node in part if node in goals)
    if apart:
        findings.append(ShutOff("", apart))
    home = {node: number for number, part in enumerate(parts) for node in part}
    lobbies = {stop for lift in graph.lifts for stop in lift.stops}
    for refuge in graph.refuges:
        if refuge.node in lobbies:
            continue
        neighbours = {move.end for move in graph.moves[refuge.node]}
        neighbours |= {section.start for section in graph.sections if section.end == refuge.node}
        if len(neighbours) < 2:
            continue  # the end of a stub is on nobody's way
        inside = [node for node in parts[home[refuge.node]] if node != refuge.node]
        left = sorted(_strong_parts(graph, inside), key=lambda part: -sum(node in at for node in part))
        others = tuple(at[node] for part in left[1:] for node in part if node in at)
        if others:
            findings.append(ShutOff(refuge.name, others, refuge.slots))
    return tuple(findings)


def refuse_pieces(graph: TrafficGraph, among: Iterable[str] | None = None) -> None:
    """Pass if all nodes, or those `among` them, are joined both ways.

    Raises:
        TrafficError: they are not; the message names two of them.
    """
    wanted = set(graph.node if among is None else among)
    parts = [[node for node in part if node in wanted] for part in pieces(graph)]
    parts = [part for part in parts if part]
    if len(parts) > 1:
        here, there = (graph.node[part[0]] for part in parts[:2])
        raise TrafficError(
            f"{graph.name} is in {len(parts)} pieces: no way leads from {here.name} at {here.x:g} {here.y:g} to {there.name} at "
            f"{there.x:g} {there.y:g} and back; join them"
        )


def pieces(graph: TrafficGraph) -> tuple[tuple[str, ...], ...]:
    """Return the sets of nodes that reach each other both ways, the largest first; one for a sound graph."""
    return _strong_parts(graph, [node.name for node in graph.nodes])


def _strong_parts(graph: TrafficGraph, nodes: Iterable[str]) -> tuple[tuple[str, ...], ...]:
    """Return the strongly connected parts among some nodes (Kosaraju), the largest first, each in their order."""
    order = list(nodes)
    allowed = set(order)
    arriving: dict[str, list[str]] = {name: [] for name in order}
    for name in order:
        for move in graph.moves[name]:
            if move.end in allowed:
                arriving[move.end].append(name)
    finished: list[str] = []
    seen: set[str] = set()
    for first in order:
        if first in seen:
            continue
        seen.add(first)
        stack = [(first, iter(graph.moves[first]))]
        while stack:
            name, moves = stack[-1]
            ahead = next((move.end for move in moves if move.end in allowed and move.end not in seen), None)
            if ahead is None:
                finished.append(name)
                stack.pop()
            else:
                seen.add(ahead)
                stack.append((ahead, iter(graph.moves[ahead])))
    part_of: dict[str, int] = {}
    count = 0
    for first in reversed(finished):
        if first in part_of:
            continue
        waiting = [first]
        part_of[first] = count
        while waiting:
            for before in arriving[waiting.pop()]:
                if before not in part_of:
                    part_of[before] = count
                    waiting.append(before)
        count += 1
    parts: list[list[str]] = [[] for _ in range(count)]
    for name in order:
        parts[part_of[name]].append(name)
    return tuple(tuple(part) for part in sorted(parts, key=lambda part: -len(part)))
