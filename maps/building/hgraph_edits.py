"""Edits of a building's graph: each returns a new graph, in which everything else is shared with the old one."""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TypeVar

from waychair.errors import BuildingError
from waychair.maps.building.hgraph import (
    Arc,
    ArcRef,
    Closure,
    GraphDoorway,
    HGraph,
    Lift,
    Node,
    Storey,
    SubMap,
    Way,
    parent_path,
)

FEWEST_DRIVES = 5
"""Drives along an arc from which on their median replaces the estimate of its cost."""

A = TypeVar("A", Arc, GraphDoorway)


def with_submap(hgraph: HGraph, submap: SubMap) -> HGraph:
    """Return the graph with a sub-map added, or replaced if there is one at its path.

    Raises:
        BuildingError: it has no parent.
    """
    if submap.path and parent_path(submap.path) not in hgraph.submaps:
        raise BuildingError(f"sub-map '{submap.path}' has no parent: add '{parent_path(submap.path)}' first")
    return replace(hgraph, submaps={**hgraph.submaps, submap.path: submap})


def without_submap(hgraph: HGraph, path: str) -> HGraph:
    """Return the graph without a sub-map, everything below it, and the doorways and stops that lead there."""
    gone = {each for each in hgraph.submaps if each == path or each.startswith(f"{path}/")}
    kept = {each: submap for each, submap in hgraph.submaps.items() if each not in gone}
    parent, last = kept[parent_path(path)], path.rpartition("/")[2]
    kept[parent.path] = replace(parent, doorways=tuple(each for each in parent.doorways if each.child != last))
    lifts = {
        key: replace(lift, stops=tuple(stop for stop in lift.stops if stop.at.submap not in gone))
        for key, lift in hgraph.lifts.items()
    }
    return replace(hgraph, submaps=kept, lifts=lifts)


def with_storey(hgraph: HGraph, storey: Storey) -> HGraph:
    """Return the graph with a storey added or replaced; storeys stay ordered by height."""
    others = [each for each in hgraph.storeys if each.id != storey.id]
    return replace(hgraph, storeys=tuple(sorted([*others, storey], key=lambda each: each.height)))


def with_lift(hgraph: HGraph, lift: Lift) -> HGraph:
    """Return the graph with a lift added or replaced."""
    return replace(hgraph, lifts={**hgraph.lifts, lift.id: lift})


def with_nodes(submap: SubMap, nodes: Iterable[Node]) -> SubMap:
    """Return the sub-map with nodes added or replaced."""
    return replace(submap, nodes={**submap.nodes, **{node.id: node for node in nodes}})


def without_node(submap: SubMap, node: str) -> SubMap:
    """Return the sub-map without a node and without the arcs and doorways at it."""
    return replace(
        submap,
        nodes={key: each for key, each in submap.nodes.items() if key != node},
        arcs=tuple(arc for arc in submap.arcs if node not in (arc.start, arc.end)),
        doorways=tuple(doorway for doorway in submap.doorways if doorway.start != node),
    )


def with_way(hgraph: HGraph, ref: ArcRef, **changes: object) -> HGraph:
    """Return the graph with fields of an arc's or doorway's `Way` changed, e.g. `price=30.0` or `closure=None`.

    Raises:
        BuildingError: there is no such arc.
    """
    submap = hgraph.submaps.get(ref.submap)
    if submap is not None:
        arcs = [_changed(arc, changes) if _is_arc(arc, ref) else arc for arc in submap.arcs]
        doors = [_changed(door, changes) if _is_doorway(door, ref) else door for door in submap.doorways]
        if any(map(_is_other, arcs, submap.arcs)) or any(map(_is_other, doors, submap.doorways)):
            return with_submap(hgraph, replace(submap, arcs=tuple(arcs), doorways=tuple(doors)))
    raise BuildingError(f"there is no arc {ref}: name the sub-map, then its two ends, as in ground/west:n1>n2")


def with_drives(hgraph: HGraph, drives: Mapping[ArcRef, Sequence[float]]) -> HGraph:
    """Return the graph with learnt driving times: the median [s] of each arc's drives, where there are enough of them.

    Raises:
        BuildingError: there is no such arc, or a time is not above 0.
    """
    for ref, seconds in drives.items():
        if not all(0.0 < each < math.inf for each in seconds):
            raise BuildingError(f"a drive along {ref} took {min(seconds):g} s, which is impossible: measure it again")
        if len(seconds) >= FEWEST_DRIVES:
            hgraph = with_way(hgraph, ref, drive_s=float(statistics.median(seconds)))
    return hgraph


def closed(hgraph: HGraph, ref: ArcRef, reason: str, until_ns: int | None = None) -> HGraph:
    """Return the graph with an arc or doorway closed, for a reason and until a time [ns UTC]; None for good."""
    return with_way(hgraph, ref, closure=Closure(reason, until_ns))


def opened(hgraph: HGraph, ref: ArcRef) -> HGraph:
    """Return the graph with an arc or doorway open again."""
    return with_way(hgraph, ref, closure=None)


def arc_ref(submap: SubMap, arc: Arc | GraphDoorway) -> ArcRef:
    """Return the address of an arc or doorway of a sub-map."""
    end = arc.end if isinstance(arc, Arc) else f"{arc.child}:{arc.node}"
    return ArcRef(submap.path, arc.start, end)


def _is_arc(arc: Arc, ref: ArcRef) -> bool:
    return {arc.start, arc.end} == {ref.start, ref.end}


def _is_doorway(doorway: GraphDoorway, ref: ArcRef) -> bool:
    return {doorway.start, f"{doorway.child}:{doorway.node}"} == {ref.start, ref.end}


def _is_other(new: object, old: object) -> bool:
    return new is not old


def _changed(arc: A, changes: Mapping[str, object]) -> A:
    way: Way = replace(arc.way, **changes)  # type: ignore[arg-type]
    return replace(arc, way=way)
