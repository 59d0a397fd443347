"""One connected graph: parts of a sketch that the chair can drive between are joined, the others are left out."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from waychair.maps.building.hgraph import NodeKind
from waychair.planning.building.generation.region_network import link_between, whole_storey
from waychair.planning.building.generation.sketch_parts import SketchArc, SketchDoorway, SketchMap, SketchNode
from waychair.planning.grid.costmap import Costmap

Key: TypeAlias = tuple[int, int]
"""A node: the index of its room, -1 for the storey's own sub-map, and its index there."""

STOREY = -1
TRIES = 3
"""Pairs of nodes, the nearest first, between which a way from one part to another is looked for."""

LONGEST = 3.0
"""A way that joins two parts is at most so many times as long as the straight line."""


def joined_parts(
    costmap: Costmap, storey: SketchMap, rooms: list[SketchMap], doorways: list[SketchDoorway]
) -> tuple[SketchMap, list[SketchMap], list[SketchDoorway]]:
    """Return the largest connected part, with all that can be joined to it by a way in the storey's sub-map."""
    while True:
        parts = _parts(storey, rooms, doorways)
        if len(set(parts.values())) < 2:
            return storey, rooms, doorways
        main = Counter(parts.values()).most_common(1)[0][0]
        if not _join_one(costmap, storey, parts, main):
            return _only(storey, rooms, doorways, {key for key, part in parts.items() if part == main})


def _parts(storey: SketchMap, rooms: list[SketchMap], doorways: list[SketchDoorway]) -> dict[Key, Key]:
    """Return the part of each node, named by one of its nodes."""
    parts = {(STOREY, k): (STOREY, k) for k in range(len(storey.nodes))}
    parts |= {(r, k): (r, k) for r, room in enumerate(rooms) for k in range(len(room.nodes))}

    def root(key: Key) -> Key:
        while parts[key] != key:
            parts[key] = parts[parts[key]]
            key = parts[key]
        return key

    for r, each in ((STOREY, storey), *enumerate(rooms)):
        for arc in each.arcs:
            parts[root((r, arc.start))] = root((r, arc.end))
    for door in doorways:
        parts[root((STOREY, door.start))] = root((door.room, door.node))
    return {key: root(key) for key in parts}


def _join_one(costmap: Costmap, storey: SketchMap, parts: dict[Key, Key], main: Key) -> bool:
    """Add a way between the main part and another one to the storey's sub-map; return whether there is one."""
    points = np.array([(node.x, node.y) for node in storey.nodes]).reshape(-1, 2)
    inside = [k for k in range(len(points)) if parts[STOREY, k] == main]
    region = whole_storey(costmap)
    for part in sorted(set(parts.values()) - {main}):
        outside = [k for k in range(len(points)) if parts[STOREY, k] == part]
        if not inside or not outside:
            continue
        away = np.hypot(*(points[outside][:, None] - points[inside][None]).transpose(2, 0, 1))
        for flat in np.argsort(away, axis=None, kind="stable")[:TRIES]:
            row, column = np.unravel_index(flat, away.shape)
            link = link_between(region, points, outside[row], inside[column])
            if link is None or link.length > LONGEST * max(float(away[row, column]), 0.5):
                continue
            chain = [link.start]
            chain += [storey.add(SketchNode("k", NodeKind.CROSS, x, y)) for x, y in link.bends.tolist()]
            chain.append(link.end)
            for start, end, length in zip(chain, chain[1:], link.lengths.tolist(), strict=False):
                storey.arcs.append(SketchArc(start, end, length))
            return True
    return False


def _only(
    storey: SketchMap, rooms: list[SketchMap], doorways: list[SketchDoorway], keys: set[Key]
) -> tuple[SketchMap, list[SketchMap], list[SketchDoorway]]:
    """Return the parts without the nodes that are not among the keys."""
    own, numbers = _filtered(storey, [k for r, k in sorted(keys) if r == STOREY])
    kept: list[SketchMap] = []
    inner: dict[int, dict[int, int]] = {}
    places: dict[int, int] = {}
    for r, room in enumerate(rooms):
        wanted = [k for q, k in sorted(keys) if q == r]
        if wanted:
            places[r] = len(kept)
            smaller, inner[r] = _filtered(room, wanted)
            kept.append(smaller)
    left = [
        SketchDoorway(numbers[each.start], places[each.room], inner[each.room][each.node], each.width)
        for each in doorways
        if (STOREY, each.start) in keys and (each.room, each.node) in keys
    ]
    return own, kept, left


def _filtered(part: SketchMap, wanted: list[int]) -> tuple[SketchMap, dict[int, int]]:
    numbers = {k: position for position, k in enumerate(wanted)}
    arcs = [
        replace(arc, start=numbers[arc.start], end=numbers[arc.end])
        for arc in part.arcs
        if arc.start in numbers and arc.end in numbers
    ]
    return SketchMap(part.title, part.middle, [part.nodes[k] for k in wanted], arcs), numbers
