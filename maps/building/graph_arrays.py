"""A building's graph as arrays, for searches and tables: nodes, directed arcs with costs in millimetres, the tree.

Every open way becomes two directed arcs, a one-way one becomes one. A lift becomes a chain of cabin nodes in the root:
from the floor in front of a stop into the cabin (waiting, boarding), from storey to storey, and out again, so that changes
of lift and lifts that pass storeys need no special case. All coordinates are in the building's frame.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from waychair.maps.building.costs import CLOSED_MM, CostSettings, millimetres
from waychair.types import FloatArray

Int32Array = NDArray[np.int32]
Int16Array = NDArray[np.int16]

NO_HEADING = -32768
"""The heading of a lift's arcs: going over to another arc from them is no turn."""

TURN_UNITS = 65536
"""Headings are int16 in this many parts of a full turn."""


class GraphArrays(NamedTuple):
    """N nodes sorted by sub-map, A directed arcs sorted by tail, M sub-maps with parents before children, the root first.

    Nodes: `node_submap` (N,) int32, `xy` (N, 2) [m], `level` (N,) int32 index of the storey. Tree: `parent` (M,) int32,
    -1 for the root. Arcs: `first` (N + 1,) int32 index of each node's first, `tail`, `head` (A,) int32, `cost` (A,) int32
    [mm], `CLOSED_MM` where closed, `heading` (A,) int16, `reverse` (A,) int32, -1 for a one-way arc. `turns` (2,) int32
    [mm]: of a turn to one side, and of turning round. `lift` (2,) int32 [mm]: the least of leaving a storey by any lift,
    and of one storey's ride, for lower bounds.
    """

    node_submap: Int32Array
    xy: FloatArray
    level: Int32Array
    parent: Int32Array
    first: Int32Array
    tail: Int32Array
    head: Int32Array
    cost: Int32Array
    heading: Int16Array
    reverse: Int32Array
    turns: Int32Array
    lift: Int32Array


def headings(dx: FloatArray, dy: FloatArray) -> Int16Array:
    """Return directions (A,) as int16 parts of a turn, never `NO_HEADING`."""
    parts = np.rint(np.arctan2(dy, dx) * (TURN_UNITS / (2.0 * np.pi)))
    return np.clip(parts, NO_HEADING + 1, -NO_HEADING - 1).astype(np.int16)


def turn_costs(costs: CostSettings) -> Int32Array:
    """Return the costs of a turn to one side and of turning round (2,) [mm]."""
    return np.array([millimetres(costs.turn_m), millimetres(costs.turn_round_m)], np.int32)


def assembled(
    node_submap: Int32Array,
    xy: FloatArray,
    level: Int32Array,
    parent: Int32Array,
    ends: Int32Array,
    cost: Int32Array,
    is_lift: NDArray[np.bool_],
    turns: Int32Array,
) -> tuple[GraphArrays, Int32Array]:
    """Return the arrays of a graph, and where each given arc went: (A,) int32.

    `ends` (A, 2) are tails and heads of directed arcs in any order; arcs of lifts (`is_lift` (A,)) have no heading. The
    nodes must be sorted by sub-map.
    """
    order = np.lexsort((ends[:, 1], ends[:, 0]))
    tail, head = np.ascontiguousarray(ends[order, 0]), np.ascontiguousarray(ends[order, 1])
    first = np.searchsorted(tail, np.arange(len(xy) + 1)).astype(np.int32)
    heading = headings(*(xy[head] - xy[tail]).T)
    heading[is_lift[order]] = NO_HEADING
    place = np.empty(len(order), np.int32)
    place[order] = np.arange(len(order), dtype=np.int32)
    sorted_cost = np.ascontiguousarray(cost[order])
    graph = GraphArrays(
        node_submap,
        np.ascontiguousarray(xy),
        level,
        parent,
        first,
        tail,
        head,
        sorted_cost,
        heading,
        _reverses(tail, head, len(xy)),
        turns,
        _least_lift(level, tail, head, sorted_cost, is_lift[order]),
    )
    return graph, place


def _reverses(tail: Int32Array, head: Int32Array, count: int) -> Int32Array:
    """Return the arc back of each arc (A,), -1 for none; of doubled arcs, the n-th belongs to the n-th."""
    there = tail.astype(np.int64) * count + head  # ascending
    back = head.astype(np.int64) * count + tail
    nth = np.arange(len(there)) - np.searchsorted(there, there)
    at = np.searchsorted(there, back) + nth
    inside = np.minimum(at, len(there) - 1)
    return np.where((at < len(there)) & (there[inside] == back), inside, -1).astype(np.int32)


def _least_lift(
    level: Int32Array, tail: Int32Array, head: Int32Array, cost: Int32Array, is_lift: NDArray[np.bool_]
) -> Int32Array:
    """Return the least costs [mm] of a lift's arc on one storey (boarding or alighting) and of riding one storey."""
    rise = np.abs(level[head].astype(np.int64) - level[tail])
    open_ = cost < CLOSED_MM
    flat, riding = is_lift & (rise == 0) & open_, (rise > 0) & open_
    still = int(cost[flat].min()) if flat.any() else 0
    storey = int((cost[riding] // rise[riding]).min()) if riding.any() else 0
    return np.array([still, storey], np.int32)
