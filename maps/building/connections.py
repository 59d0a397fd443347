"""How a building's nodes are connected, as arrays kept for each sub-map, so that checks after an edit take milliseconds."""

from __future__ import annotations

import unicodedata
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from waychair.maps.building.hgraph import (
    Arc,
    ArcRef,
    HGraph,
    NodeKind,
    NodeRef,
    SubMap,
    Way,
    inner_end,
)
from waychair.maps.building.hgraph_edits import arc_ref
from waychair.types import BoolArray, IntArray

Edge = tuple[int, int]


def folded(name: str) -> str:
    """Return a name without case, accents and doubled spaces."""
    plain = unicodedata.normalize("NFKD", name)
    return " ".join("".join(each for each in plain if not unicodedata.combining(each)).casefold().split())


@dataclass(frozen=True, slots=True)
class ConnectedSubmap:
    """One sub-map: its nodes' places by id, goals with their folded names, open directed arcs (A, 2), its arcs that are
    one-way or closed, and whether one of its arcs was driven, by node (N,)."""

    index: dict[str, int]
    goals: tuple[tuple[str, str], ...]
    open_arcs: IntArray
    special: tuple[Arc, ...]
    driven: BoolArray


def part_of(submap: SubMap) -> ConnectedSubmap:
    """Return the arrays of a sub-map."""
    index = {key: at for at, key in enumerate(submap.nodes)}
    rows: list[Edge] = []
    special = []
    driven = np.zeros(len(index), np.bool_)
    for arc in submap.arcs:
        one, other = index[arc.start], index[arc.end]
        if arc.way.closure is None:
            rows.append((one, other))
            if not arc.way.one_way:
                rows.append((other, one))
        if arc.way.closure is not None or arc.way.one_way:
            special.append(arc)
        if arc.way.drive_s is not None:
            driven[one] = driven[other] = True
    goals = tuple((node.id, folded(node.name)) for node in submap.nodes.values() if node.kind is NodeKind.END)
    return ConnectedSubmap(index, goals, np.array(rows, np.int64).reshape(-1, 2), tuple(special), driven)


@dataclass(frozen=True, slots=True)
class Connections:
    """All nodes of a building in one numbering: where each sub-map's begin, and the strongly connected component of each
    node (N,) by open arcs, doorways and lifts."""

    first: dict[str, int]
    parts: dict[str, ConnectedSubmap]
    component: NDArray[np.int32]

    def number(self, ref: NodeRef) -> int | None:
        """Return the number of a node, None if there is none."""
        part = self.parts.get(ref.submap)
        at = None if part is None else part.index.get(ref.node)
        return None if at is None else self.first[ref.submap] + at

    def refs(self, numbers: IntArray) -> list[NodeRef]:
        """Return the addresses of nodes given by ascending numbers."""
        found = []
        for path, part in self.parts.items():
            low = self.first[path]
            inside = numbers[(numbers >= low) & (numbers < low + len(part.index))]
            if len(inside):
                keys = list(part.index)
                found += [NodeRef(path, keys[number - low]) for number in inside.tolist()]
        return found


def connections(hgraph: HGraph, parts: dict[str, ConnectedSubmap]) -> Connections:
    """Return how a building is connected, given the arrays of its sub-maps."""
    first, count = {}, 0
    for path, part in parts.items():
        first[path] = count
        count += len(part.index)
    bare = Connections(first, parts, np.zeros(0, np.int32))
    rows = [part.open_arcs + first[path] for path, part in parts.items()]
    joints = [edge for _, way, edge, back in _doorways(hgraph, bare) for edge in _open(way, edge, back)]
    for lift in hgraph.lifts.values():
        numbers = [bare.number(stop.at) for stop in lift.stops if stop.closure is None]
        known = [number for number in numbers if number is not None]
        joints += [edge for one, other in pairwise(known) for edge in ((one, other), (other, one))]
    ends = np.concatenate([*rows, np.array(joints, np.int64).reshape(-1, 2)])
    matrix = csr_array((np.ones(len(ends), np.int8), (ends[:, 0], ends[:, 1])), shape=(count, count))
    component = connected_components(matrix, directed=True, connection="strong")[1]
    return Connections(first, parts, component)


def special_arcs(hgraph: HGraph, linked: Connections) -> Iterator[tuple[ArcRef, Way, Edge]]:
    """Yield the arcs and doorways that are one-way or closed, with the numbers of their ends."""
    for path, part in linked.parts.items():
        low = linked.first[path]
        for arc in part.special:
            ends = low + part.index[arc.start], low + part.index[arc.end]
            yield arc_ref(hgraph.submaps[path], arc), arc.way, ends
    for ref, way, edge, _ in _doorways(hgraph, linked):
        if way.closure is not None or way.one_way:
            yield ref, way, edge


def _doorways(hgraph: HGraph, linked: Connections) -> Iterator[tuple[ArcRef, Way, Edge, bool]]:
    """Yield the doorways that have both sides, with the numbers of their ends, outer first, and if they lead outwards."""
    for submap in hgraph.submaps.values():
        for doorway in submap.doorways:
            one, other = linked.number(NodeRef(submap.path, doorway.start)), linked.number(inner_end(submap, doorway))
            if one is not None and other is not None:
                yield arc_ref(submap, doorway), doorway.way, (one, other), doorway.outwards


def _open(way: Way, edge: Edge, outwards: bool) -> tuple[Edge, ...]:
    if way.closure is not None:
        return ()
    back = (edge[1], edge[0])
    if way.one_way:
        return (back,) if outwards else (edge,)
    return edge, back
