"""A priority queue of cells in typed arrays: 4-ary, with the place of every cell known, so that its key can change.

Keys are pairs of int64, compared lexicographically and exactly. Entries count from 1; `place[cell] == 0` means that the
cell is not queued. Kernels must leave room: they check `size[0] + 9 <= capacity` before they touch up to nine cells,
and return to Python, which calls `grown` and calls them again.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from waychair.types import IntArray

NEIGHBOURHOOD = 9
"""Cells that one step of a search can insert: a cell and its eight neighbours."""


class Heap(NamedTuple):
    """keys (capacity + 1, 2) int64, cells (capacity + 1,) int32, place (number of cells,) int32, size (1,) int64."""

    keys: IntArray
    cells: NDArray[np.int32]
    place: NDArray[np.int32]
    size: IntArray


def empty_heap(cell_count: int, capacity: int = 4096) -> Heap:
    """A heap for cells 0 ... cell_count - 1; 4 bytes a cell and 20 bytes for each entry it has room for."""
    return Heap(
        np.empty((capacity + 1, 2), np.int64),
        np.empty(capacity + 1, np.int32),
        np.zeros(cell_count, np.int32),
        np.zeros(1, np.int64),
    )


def grown(heap: Heap) -> Heap:
    """The same heap with room for twice as many entries."""
    room = len(heap.cells) - 1
    return heap._replace(
        keys=np.concatenate([heap.keys, np.empty((room, 2), np.int64)]),
        cells=np.concatenate([heap.cells, np.empty(room, np.int32)]),
    )


@njit(cache=True, inline="always")
def has_room(heap: Heap) -> bool:
    """Whether a whole neighbourhood can still be inserted."""
    return bool(heap.size[0] + NEIGHBOURHOOD < len(heap.cells))


@njit(cache=True, inline="always")
def less(first: int, second: int, other_first: int, other_second: int) -> bool:
    """Lexicographic order of two keys."""
    return first < other_first or (first == other_first and second < other_second)


@njit(cache=True)
def rise(heap: Heap, entry: int, cell: int, first: int, second: int) -> None:
    """Put a cell into the free entry, or above it when its key is smaller than its parents'."""
    keys, cells, place, _ = heap
    while entry > 1:
        parent = (entry + 2) // 4
        if not less(first, second, keys[parent, 0], keys[parent, 1]):
            break
        keys[entry, 0], keys[entry, 1], cells[entry] = keys[parent, 0], keys[parent, 1], cells[parent]
        place[cells[entry]] = entry
        entry = parent
    keys[entry, 0], keys[entry, 1], cells[entry] = first, second, cell
    place[cell] = entry


@njit(cache=True)
def sink(heap: Heap, entry: int, cell: int, first: int, second: int) -> None:
    """Put a cell into the free entry, or below it when its key is larger than its children's."""
    keys, cells, place, size = heap
    count = size[0]
    while True:
        child = 4 * entry - 2
        if child > count:
            break
        best = child
        for other in range(child + 1, min(child + 4, count + 1)):
            if less(keys[other, 0], keys[other, 1], keys[best, 0], keys[best, 1]):
                best = other
        if not less(keys[best, 0], keys[best, 1], first, second):
            break
        keys[entry, 0], keys[entry, 1], cells[entry] = keys[best, 0], keys[best, 1], cells[best]
        place[cells[entry]] = entry
        entry = best
    keys[entry, 0], keys[entry, 1], cells[entry] = first, second, cell
    place[cell] = entry


@njit(cache=True)
def put(heap: Heap, cell: int, first: int, second: int) -> None:
    """Insert a cell, or give it a new key when it is queued already."""
    entry = heap.place[cell]
    if entry == 0:
        heap.size[0] += 1
        rise(heap, heap.size[0], cell, first, second)
    elif less(first, second, heap.keys[entry, 0], heap.keys[entry, 1]):
        rise(heap, entry, cell, first, second)
    else:
        sink(heap, entry, cell, first, second)


@njit(cache=True)
def remove(heap: Heap, cell: int) -> None:
    """Take a cell out; one that is not queued stays out."""
    entry = heap.place[cell]
    if entry == 0:
        return
    heap.place[cell] = 0
    last = heap.size[0]
    heap.size[0] = last - 1
    if entry == last:
        return
    # The last entry fills the gap; it may belong above or below it.
    moved, first, second = heap.cells[last], heap.keys[last, 0], heap.keys[last, 1]
    if entry > 1:
        parent = (entry + 2) // 4
        if less(first, second, heap.keys[parent, 0], heap.keys[parent, 1]):
            rise(heap, entry, moved, first, second)
            return
    sink(heap, entry, moved, first, second)
