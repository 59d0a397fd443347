"""A binary heap of int64 items, each a cost above 32 bits and a state below; improved states are pushed again."""

from __future__ import annotations

from numba import njit

from waychair.planning.building.overlay import Int64Array

SHIFT = 32
"""A queued item is `cost << SHIFT | state`."""


@njit(cache=True)
def push(heap: Int64Array, size: int, item: int) -> int:
    at = size
    while at > 0:
        parent = (at - 1) >> 1
        if heap[parent] <= item:
            break
        heap[at] = heap[parent]
        at = parent
    heap[at] = item
    return size + 1


@njit(cache=True)
def pop(heap: Int64Array, size: int) -> int:
    """Remove the least item, heap[0]; return the new size."""
    size -= 1
    item, at = heap[size], 0
    while True:
        child = 2 * at + 1
        if child >= size:
            break
        if child + 1 < size and heap[child + 1] < heap[child]:
            child += 1
        if heap[child] >= item:
            break
        heap[at] = heap[child]
        at = child
    heap[at] = item
    return size
