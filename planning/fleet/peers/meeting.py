"""Two chairs that stand face to face in single file and cannot hear each other: the side that backs out.

Both compute it from the point in the middle between them, which each one measures, so that both find the same.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from waychair.geometry import arc_lengths, nearest_step
from waychair.maps.traffic.traffic_graph import TrafficGraph
from waychair.planning.fleet.peers.alone import Standing, backs_out
from waychair.types import FloatArray


class Meeting(NamedTuple):
    """A point between two chairs: its section, and the ways [m] from there to a place aside beyond the section's start and end."""

    section: str
    before: float
    beyond: float


def meeting_at(graph: TrafficGraph, point: FloatArray) -> Meeting:
    """Return the meeting at a point (2,) [m] in map."""
    best: tuple[float, str, float, float] | None = None
    for section in graph.sections:
        points = np.array([(each.x, each.y) for each in graph.way(section.name)])
        along = arc_lengths(points)
        k, share = nearest_step(points, point)
        off = math.dist(points[k] + share * (points[k + 1] - points[k]), point)
        if best is None or off < best[0]:
            way = float(along[k] + share * (along[k + 1] - along[k]))
            best = (off, section.name, way, float(along[-1]))
    assert best is not None
    _, name, way, length = best
    aside = _ways_aside(graph, name)
    section = graph.section[name]
    return Meeting(name, way + aside[section.start], length - way + aside[section.end])


def is_before(graph: TrafficGraph, section: str, point: FloatArray, pose: FloatArray) -> bool:
    """Return whether a pose (2,) is on the side of a section's start, seen from a point (2,) in it."""
    points = np.array([(each.x, each.y) for each in graph.way(section)])
    k, _ = nearest_step(points, point)
    return bool((pose - point) @ (points[k + 1] - points[k]) < 0.0)


def gives_way(meeting: Meeting, before: bool, again: bool) -> bool:
    """Return whether the chair on the side of the section's start (`before`), or of its end, backs out.

    The side of the shorter way backs out, of two equal ones that of the section's end. `again`: they have met without a
    result before; then only the side counts.
    """
    ways = (0.0, 0.0) if again else (meeting.before, meeting.beyond)
    start, end = Standing(0, ways[0], 0), Standing(0, ways[1], 1)
    return backs_out(start, end) if before else backs_out(end, start)


def _ways_aside(graph: TrafficGraph, without: str) -> Mapping[str, float]:
    """Return the way [m] from each node to the nearest refuge that does not lead through one section."""
    left = {node.name: math.inf for node in graph.nodes}
    left.update({refuge.node: 0.0 for refuge in graph.refuges})
    waiting = set(left)
    while waiting:
        node = min(waiting, key=left.__getitem__)
        waiting.remove(node)
        for move in graph.moves[node]:
            if move.section != without:
                left[move.end] = min(left[move.end], left[node] + graph.section[move.section].length)
    return left
