"""Two chairs that stand face to face in single file and cannot hear each other: the one that backs out.

Each decides alone, from the two points at which they stand. It measures these itself, so that the other one's numbers differ a
little: a way back counts as shorter only where the other chair finds so too.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from waychair.geometry import arc_lengths, nearest_step
from waychair.maps.traffic.traffic_graph import TrafficGraph
from waychair.planning.fleet.peers.alone import SAME_WAY, Standing, backs_out
from waychair.types import FloatArray

_BY_WAYS = 2
"""Times that two chairs that face each other compare their ways back; then their sides alone decide."""

_AROUND = 0.5
"""m; a chair so near to a node lets nobody through there."""

_AXIS = np.array([math.cos(0.47), math.sin(0.47)])
"""The chair that is farther in this direction of the map has the higher number. It is aslant to the axes of the map, as two
chairs in a corridor across it would measure different signs."""


class _At(NamedTuple):
    """A point on the graph: the nearest section, the way [m] along it, and its length."""

    section: str
    way: float
    length: float


def gives_way(graph: TrafficGraph, here: FloatArray, there: FloatArray, faced: int) -> bool:
    """Return whether a chair at the point `here` (2,) [m] in map backs out for the one at `there`, as these never both do.

    `faced`: how many times they have faced each other, this one included. The chair of the shorter way back to a place aside
    backs out at once; of two about equal ones, which each may find the shorter, the one on the higher side, the next time.
    """
    own, other = way_aside(graph, here, there), way_aside(graph, there, here)
    if faced == 1 and not max(own, other) - min(own, other) > SAME_WAY:
        return False
    if faced > _BY_WAYS:
        own = other = 0.0
    side = int((here - there) @ _AXIS > 0.0)
    return backs_out(Standing(0, own, side), Standing(0, other, 1 - side))


def way_aside(graph: TrafficGraph, here: FloatArray, there: FloatArray) -> float:
    """Return the way [m] from a point to the nearest refuge that does not lead past a chair at another point; inf without any."""
    at, other = _at(graph, here), _at(graph, there)
    section = graph.section[at.section]
    shut = {node.name for node in graph.nodes if math.dist((node.x, node.y), there) < _AROUND}
    left = {section.start: at.way, section.end: at.length - at.way}
    if at.section == other.section:
        left.pop(section.end if at.way < other.way else section.start)
    waiting, done = set(left) - shut, set(shut)
    while waiting:
        node = min(waiting, key=left.__getitem__)
        if node in graph.refuge_at:
            return left[node]
        waiting.remove(node)
        done.add(node)
        for move in graph.moves[node]:
            if move.section != other.section and move.end not in done:
                way = left[node] + graph.section[move.section].length
                left[move.end] = min(left.get(move.end, math.inf), way)
                waiting.add(move.end)
    return math.inf


def _at(graph: TrafficGraph, point: FloatArray) -> _At:
    """Return where a point (2,) [m] in map is on the graph."""
    best, found = math.inf, _At("", 0.0, 0.0)
    for section in graph.sections:
        points = np.array([(each.x, each.y) for each in graph.way(section.name)])
        along = arc_lengths(points)
        k, share = nearest_step(points, point)
        off = math.dist(points[k] + share * (points[k + 1] - points[k]), point)
        if off < best:
            best = off
            found = _At(section.name, float(along[k] + share * (along[k + 1] - along[k])), float(along[-1]))
    return found
