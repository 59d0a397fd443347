"""The checks of a building's graph: faults E1 to E18 and warnings W1 to W3, each with place, sentence and remedy.

`check` is a pure function of the graph and its surroundings (the chair, the maps of the storeys). `Checker` keeps the
findings of sub-maps that have not changed, so that a check after one edit takes milliseconds. Faults of one sub-map are in
`submap_checks`, those of lifts, tree and reachability in `building_checks`.
"""

from __future__ import annotations

from collections.abc import Iterator

from waychair.maps.building.building_checks import building_findings
from waychair.maps.building.connections import Part, part_of
from waychair.maps.building.findings import NO_SURROUNDINGS, Finding, Severity, Surroundings
from waychair.maps.building.hgraph import Frame, HGraph, SubMap, parent_path
from waychair.maps.building.submap_checks import outer_ends, submap_findings

__all__ = ["Checker", "Finding", "Severity", "Surroundings", "check"]


def check(hgraph: HGraph, around: Surroundings = NO_SURROUNDINGS) -> tuple[Finding, ...]:
    """Return all faults and warnings of a building's graph, by sub-map, then those of the whole building."""
    return Checker(around).check(hgraph)


class Checker:
    """Checks a graph again after each edit; sub-maps that are the same objects as before are not checked again."""

    def __init__(self, around: Surroundings = NO_SURROUNDINGS) -> None:
        self._around = around
        self._kept: dict[str, tuple[tuple[object, ...], tuple[Finding, ...]]] = {}
        self._parts: dict[str, tuple[SubMap, Part]] = {}

    def check(self, hgraph: HGraph) -> tuple[Finding, ...]:
        """Return all faults and warnings of a graph."""
        ends = outer_ends(hgraph)
        found: list[Finding] = []
        kept = {}
        for path, submap in hgraph.submaps.items():
            seen = (*_seen(hgraph, submap), ends.get(path, frozenset()))
            before = self._kept.get(path)
            if before is not None and _are_same(before[0], seen):
                kept[path] = before
            else:
                kept[path] = seen, tuple(submap_findings(hgraph, path, ends.get(path, frozenset()), self._around))
            found += kept[path][1]
        self._kept = kept
        self._parts = {path: self._part(path, submap) for path, submap in hgraph.submaps.items()}
        parts = {path: part for path, (_, part) in self._parts.items()}
        return (*found, *building_findings(hgraph, parts, self._around))

    def _part(self, path: str, submap: SubMap) -> tuple[SubMap, Part]:
        kept = self._parts.get(path)
        return kept if kept is not None and kept[0] is submap else (submap, part_of(submap))


def _seen(hgraph: HGraph, submap: SubMap) -> Iterator[SubMap | Frame | None]:
    """Yield the objects that a sub-map's findings depend on, besides its outer ends."""
    yield hgraph.frame_of(submap.path)
    yield submap
    yield hgraph.submaps.get(parent_path(submap.path))
    for child in dict.fromkeys(doorway.child for doorway in submap.doorways):
        yield hgraph.submaps.get(f"{submap.path}/{child}" if submap.path else child)


def _are_same(one: tuple[object, ...], other: tuple[object, ...]) -> bool:
    return len(one) == len(other) and all(
        first is second or (isinstance(first, frozenset | Frame) and first == second)
        for first, second in zip(one, other, strict=True)
    )
