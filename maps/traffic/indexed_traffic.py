"""A traffic graph by numbers instead of names, for kernels."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from waychair.maps.traffic.traffic_graph import TrafficGraph
from waychair.types import FloatArray, IntArray


class IndexedTraffic(NamedTuple):
    """N nodes and S sections in the order of their graph.

    Attributes:
        ends: (S, 2) nodes at the start and the end of each section; direction 0 drives from start to end, 1 back.
        length: (S,) m.
        delay_s: (S,) s beside driving.
        lanes: (S,) 1 or 2.
        one_way: (S,) 1 where direction 1 is forbidden.
        first: (N + 1,) the moves that leave node n are first[n] to first[n + 1].
        leaving: (M, 3) section, direction and next node of each move.
    """

    ends: IntArray
    length: FloatArray
    delay_s: FloatArray
    lanes: IntArray
    one_way: IntArray
    first: IntArray
    leaving: IntArray

    def seconds(self, speed: float) -> FloatArray:
        """Return the time (S,) [s] that a chair at a speed [m/s] takes through each section with nobody in its way."""
        return self.length / speed + self.delay_s


def indexed_traffic(graph: TrafficGraph) -> IndexedTraffic:
    """Return the arrays of a graph."""
    node = {each.name: i for i, each in enumerate(graph.nodes)}
    section = {each.name: i for i, each in enumerate(graph.sections)}
    first = [0]
    leaving: list[tuple[int, int, int]] = []
    for each in graph.nodes:
        for move in graph.moves[each.name]:
            number = section[move.section]
            direction = 0 if move.start == graph.sections[number].start else 1
            leaving.append((number, direction, node[move.end]))
        first.append(len(leaving))
    sections = graph.sections
    return IndexedTraffic(
        np.array([(node[each.start], node[each.end]) for each in sections], dtype=np.int64).reshape(-1, 2),
        np.array([each.length for each in sections], dtype=np.float64),
        np.array([each.delay_s for each in sections], dtype=np.float64),
        np.array([each.lanes for each in sections], dtype=np.int64),
        np.array([each.one_way for each in sections], dtype=np.int64),
        np.array(first, dtype=np.int64),
        np.array(leaving, dtype=np.int64).reshape(-1, 3),
    )
