"""Runs and districts of a traffic graph: parts that chairs share as one.

A run is a maximal chain of single-file sections with no place to step aside: chairs drive through it in one direction at
a time. A district is a part of one storey that is joined to the rest by refuges and lifts only, so that its order of
chairs can be kept by itself.
"""

from __future__ import annotations

from dataclasses import dataclass

from waychair.maps.traffic.traffic_graph import Section, TrafficGraph


@dataclass(frozen=True, slots=True)
class Run:
    """A chain of single-file sections: `sections` in order, and `nodes` in order, one more than sections.

    A run that is a ring begins and ends at the same node.
    """

    name: str
    sections: tuple[str, ...]
    nodes: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class District:
    """Sections and nodes that are joined to the rest of the building by refuges and lifts only."""

    name: str
    storey: str
    sections: tuple[str, ...]
    nodes: tuple[str, ...]


def runs(graph: TrafficGraph) -> tuple[Run, ...]:
    """Return all runs, in the order of their first sections; each single-file section is in one of them.

    A chain ends where a chair could step aside or another way branches off: at a refuge, at a node for several chairs, at a
    section of two lanes, and where other than two sections meet.
    """
    at: dict[str, list[Section]] = {node.name: [] for node in graph.nodes}
    for section in graph.sections:
        at[section.start].append(section)
        at[section.end].append(section)

    def goes_on(node: str) -> bool:
        return (
            len(at[node]) == 2
            and all(_single_file(section) for section in at[node])
            and node not in graph.refuge_at
            and graph.capacity(node) == 1
        )

    found: list[Run] = []
    taken: set[str] = set()
    for section in graph.sections:
        if not _single_file(section) or section.name in taken:
            continue
        taken.add(section.name)
        ahead, behind = [section.end], [section.start]
        chain = [section.name]
        before: list[str] = []
        for nodes, names in ((ahead, chain), (behind, before)):
            last = section
            while goes_on(nodes[-1]):
                last = next(other for other in at[nodes[-1]] if other.name != last.name)
                if last.name in taken:
                    break  # the chain is a ring
                taken.add(last.name)
                names.append(last.name)
                nodes.append(last.other(nodes[-1]))
        sections = (*reversed(before), *chain)
        found.append(Run(f"run {sections[0]}", sections, (*reversed(behind), *ahead)))
    return tuple(found)


def districts(graph: TrafficGraph) -> tuple[District, ...]:
    """Return the districts, in the order of their first sections.

    Two sections are in one district if a way joins them that passes no refuge and no lift. A refuge's node is in each
    district that it touches. The sections of a lift are a district each lift, named after it.
    """
    at: dict[str, list[Section]] = {node.name: [] for node in graph.nodes}
    for section in graph.sections:
        at[section.start].append(section)
        at[section.end].append(section)
    found: list[District] = []
    for lift in graph.lifts:
        inside = [section for section in graph.sections if section.lift == lift.name]
        nodes = dict.fromkeys(node for section in inside for node in (section.start, section.end))
        found.append(District(lift.name, "", tuple(section.name for section in inside), tuple(nodes)))
    taken: set[str] = set()
    for first in graph.sections:
        if first.lift is not None or first.name in taken:
            continue
        taken.add(first.name)
        waiting, members, reached = [first], [first], dict.fromkeys((first.start, first.end))
        while waiting:
            section = waiting.pop()
            for node in (section.start, section.end):
                reached[node] = None
                if node in graph.refuge_at:
                    continue
                for other in at[node]:
                    if other.lift is None and other.name not in taken:
                        taken.add(other.name)
                        members.append(other)
                        waiting.append(other)
        storey = graph.node[first.start].storey
        found.append(
            District(f"{storey} {first.name}", storey, tuple(section.name for section in members), tuple(reached))
        )
    return tuple(found)


def _single_file(section: Section) -> bool:
    return section.lanes == 1 and section.lift is None
