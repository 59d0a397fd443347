"""Lengths of shortest paths along the edges of a graph (Dijkstra 1959), with a binary heap."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from waychair.types import FloatArray, IntArray


def shortest_paths(i: IntArray, j: IntArray, lengths: FloatArray, count: int, node: int) -> FloatArray:
    """Return the length (count,) of the shortest path from a node to each of `count` nodes; inf where there is none.

    Edge k joins the nodes `i[k]` and `j[k]`, both ways, and has length `lengths[k]` >= 0.
    """
    return _shortest(i, j, lengths, count, node)


@njit(cache=True)
def _shortest(i: IntArray, j: IntArray, lengths: FloatArray, count: int, node: int) -> FloatArray:
    """See `shortest_paths`. The edges of each node stand together; a node may wait in the heap several times."""
    ends = np.zeros(count + 1, np.int64)
    for k in range(len(i)):
        ends[i[k] + 1] += 1
        ends[j[k] + 1] += 1
    for k in range(count):
        ends[k + 1] += ends[k]
    filled, others, edges = ends[:-1].copy(), np.empty(2 * len(i), np.int64), np.empty(2 * len(i), np.int64)
    for k in range(len(i)):
        for a, b in ((i[k], j[k]), (j[k], i[k])):
            others[filled[a]], edges[filled[a]] = b, k
            filled[a] += 1
    found = np.full(count, math.inf)
    found[node] = 0.0
    heap, names, size = np.empty(2 * len(i) + 1), np.empty(2 * len(i) + 1, np.int64), 1
    heap[0], names[0] = 0.0, node
    while size > 0:
        length, here = heap[0], names[0]
        size -= 1
        last, name, at = heap[size], names[size], 0
        while 2 * at + 1 < size:  # the last one sinks from the top
            below = 2 * at + 1
            if below + 1 < size and heap[below + 1] < heap[below]:
                below += 1
            if heap[below] >= last:
                break
            heap[at], names[at] = heap[below], names[below]
            at = below
        heap[at], names[at] = last, name
        if length > found[here]:
            continue
        for k in range(ends[here], ends[here + 1]):
            other, reached = others[k], length + lengths[edges[k]]
            if reached >= found[other]:
                continue
            found[other] = reached
            at = size
            size += 1
            while at > 0 and heap[(at - 1) // 2] > reached:
                heap[at], names[at] = heap[(at - 1) // 2], names[(at - 1) // 2]
                at = (at - 1) // 2
            heap[at], names[at] = reached, other
    return found
