"""The checks of a building's graph: faults E1 to E18 and warnings W1 to W3, each with place, sentence and remedy.

`check` is a pure function of the graph and its surroundings (the chair, the maps of the storeys). `Checker` keeps the
findings of sub-maps that have not changed, so that a check after one edit takes milliseconds. Faults of one sub-map are in
`submap_checks`, those between the sub-maps of a storey in `storey_checks`, those of lifts, tree and reachability in
`building_checks`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from waychair.maps.building.checks.building_checks import building_findings
from waychair.maps.building.checks.graph_findings import (
    NO_SURROUNDINGS,
    FindingSeverity,
    GraphFinding,
    GraphSurroundings,
)
from waychair.maps.building.checks.storey_checks import (
    Crossings,
    Outline,
    Suspect,
    detours_within,
    outline_of,
    storey_findings,
)
from waychair.maps.building.checks.submap_checks import Outside, outsides, submap_findings
from waychair.maps.building.connections import ConnectedSubmap, connections, part_of
from waychair.maps.building.hgraph import HGraph, SubMap, SubmapFrame, parent_path

__all__ = ["Checker", "FindingSeverity", "GraphFinding", "GraphSurroundings", "check"]


def check(hgraph: HGraph, around: GraphSurroundings = NO_SURROUNDINGS) -> tuple[GraphFinding, ...]:
    """Return all faults and warnings of a building's graph, by sub-map, then those of the whole building."""
    return Checker(around).check(hgraph)


class Checker:
    """Checks a graph again after each edit; sub-maps that are the same objects as before are not checked again."""

    def __init__(self, around: GraphSurroundings = NO_SURROUNDINGS) -> None:
        self._around = around
        self._kept: dict[str, _Checked] = {}
        self._parts: dict[str, tuple[SubMap, ConnectedSubmap]] = {}
        self._outlines: dict[str, Outline] = {}
        self._crossings = Crossings()

    def check(self, hgraph: HGraph, around: GraphSurroundings | None = None) -> tuple[GraphFinding, ...]:
        """Return all faults and warnings of a graph; `around`: its surroundings from now on, None for those of before.

        A sub-map is checked again where the places, zones or grid of its storey are other objects than before; all are
        where the chair, the grid planner or step guidance is another one.
        """
        if around is not None:
            if _whole(around) != _whole(self._around):
                self._kept = {}
            self._around = around
        into, frames = outsides(hgraph), _frames(hgraph)
        self._outlines = {path: self._outline(submap, frames[path]) for path, submap in hgraph.submaps.items()}
        kept = {}
        for path, submap in hgraph.submaps.items():
            outside = into.get(path, Outside())
            seen = (frames[path], *_seen(hgraph, submap), *self._drawn(hgraph.storey_of(path)), outside)
            before = self._kept.get(path)
            if before is not None and _are_same(before.seen, seen):
                kept[path] = before
            else:
                found = tuple(submap_findings(hgraph, path, frames, outside, self._around))
                kept[path] = _Checked(seen, found, detours_within(hgraph, self._outlines[path]))
        self._kept = kept
        self._parts = {path: self._part(path, submap) for path, submap in hgraph.submaps.items()}
        parts = {path: part for path, (_, part) in self._parts.items()}
        linked = connections(hgraph, parts)
        return (
            *(finding for each in kept.values() for finding in each.findings),
            *building_findings(hgraph, linked, self._around),
            *storey_findings(
                hgraph,
                self._outlines,
                [pair for each in kept.values() for pair in each.detours],
                self._around,
                self._crossings,
            ),
        )

    def _drawn(self, storey: str) -> tuple[object, ...]:
        around = self._around
        return around.grids.get(storey), around.places.get(storey), around.zones.get(storey)

    def _part(self, path: str, submap: SubMap) -> tuple[SubMap, ConnectedSubmap]:
        kept = self._parts.get(path)
        return kept if kept is not None and kept[0] is submap else (submap, part_of(submap))

    def _outline(self, submap: SubMap, frame: SubmapFrame) -> Outline:
        kept = self._outlines.get(submap.path)
        return kept if kept is not None and kept.submap is submap and kept.frame == frame else outline_of(submap, frame)


@dataclass(frozen=True, slots=True)
class _Checked:
    """A sub-map's findings and detours, and the objects that they depend on."""

    seen: tuple[object, ...]
    findings: tuple[GraphFinding, ...]
    detours: tuple[Suspect, ...]


def _whole(around: GraphSurroundings) -> tuple[object, ...]:
    """Return the surroundings that count for every sub-map."""
    return around.width, around.length, around.driven, around.turns, around.guides


def _frames(hgraph: HGraph) -> dict[str, SubmapFrame]:
    """Return each sub-map's frame in the building's."""
    frames: dict[str, SubmapFrame] = {}
    for path, submap in hgraph.submaps.items():
        parent = frames.get(parent_path(path)) if path else SubmapFrame()
        frames[path] = hgraph.frame_of(path) if parent is None else parent @ submap.frame
    return frames


def _seen(hgraph: HGraph, submap: SubMap) -> Iterator[SubMap | None]:
    """Yield the objects that a sub-map's findings depend on, besides its frame and what leads into it."""
    yield submap
    yield hgraph.submaps.get(parent_path(submap.path))
    for child in dict.fromkeys(doorway.child for doorway in submap.doorways):
        yield hgraph.submaps.get(f"{submap.path}/{child}" if submap.path else child)


def _are_same(one: tuple[object, ...], other: tuple[object, ...]) -> bool:
    return len(one) == len(other) and all(
        first is second or (isinstance(first, Outside | SubmapFrame) and first == second)
        for first, second in zip(one, other, strict=True)
    )
