"""A 4-ary priority queue of cells in typed arrays; every cell knows its place in it, so that its key can change.

Keys are pairs of int64, compared lexicographically and exactly. Entries count from 1; a cell whose `place` is 0 is not
queued. The place is a field of the search's records of the cells. Inserting does not grow the heap: kernels check for
`ROOM` before they touch up to nine cells, and otherwise return to Python, which calls `grown` and calls them again.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from waychair.planning.grid.grid_graph import Records
from waychair.types import IntArray

NEIGHBOURHOOD = 9
"""Most cells that one step of a search inserts: a cell and its eight neighbours."""

_SIBLINGS = 3
"""Entries behind the last that are read with it, as its siblings."""

ROOM = NEIGHBOURHOOD + _SIBLINGS
"""Entries that must be free before one step of a search."""

ENTRY = np.dtype([("first", np.int64), ("second", np.int64), ("cell", np.int64)])
"""A queued cell with its key; 24 bytes."""

_LAST = np.iinfo(np.int64).max
_NOBODY = np.array((_LAST, _LAST, 0), ENTRY)
"""Fills the room behind the last entry, so that always four children can be compared."""


class Heap(NamedTuple):
    """entries (capacity + 1 + siblings,) of `ENTRY`, size (1,), and the cells' records (N,) with their `place`."""

    entries: Records
    size: IntArray
    cells: Records


def empty_heap(cells: Records, capacity: int = 4096) -> Heap:
    """Return an empty heap for cells whose `place`, int32, is 0."""
    return Heap(np.full(capacity + 1 + _SIBLINGS, _NOBODY, ENTRY), np.zeros(1, np.int64), cells)


def has_room(heap: Heap, neighbourhoods: int = 1) -> bool:
    """Return whether so many whole neighbourhoods can still be inserted."""
    return int(heap.size[0]) + neighbourhoods * NEIGHBOURHOOD + _SIBLINGS < len(heap.entries)


def grown(heap: Heap) -> Heap:
    """Return the heap with room for twice as many entries."""
    return heap._replace(
        entries=np.concatenate([heap.entries, np.full(len(heap.entries) - 1 - _SIBLINGS, _NOBODY, ENTRY)])
    )


@njit(cache=True, inline="always")
def less(first: int, second: int, other_first: int, other_second: int) -> bool:
    """Return whether a key is lexicographically less than another, without an (unpredictable) branch."""
    return (first < other_first) | ((first == other_first) & (second < other_second))


@njit(cache=True)
def rise(entries: Records, cells: Records, entry: int, cell: int, first: int, second: int) -> None:
    """Put a cell into the free entry, or above it while its key is smaller than the parent's."""
    while entry > 1:
        parent = entries[(entry + 2) >> 2]
        if not less(first, second, parent.first, parent.second):
            break
        free = entries[entry]
        free.first, free.second, free.cell = parent.first, parent.second, parent.cell
        cells[parent.cell].place = entry
        entry = (entry + 2) >> 2
    free = entries[entry]
    free.first, free.second, free.cell = first, second, cell
    cells[cell].place = entry


@njit(cache=True)
def sink(entries: Records, count: int, cells: Records, entry: int, cell: int, first: int, second: int) -> None:
    """Put a cell into the free entry, or below it while its key is larger than a child's, among `count` entries."""
    while True:
        child = 4 * entry - 2
        if child > count:
            break
        best, best_first, best_second = child, entries[child].first, entries[child].second
        for sibling in range(1, 4):
            other = child + sibling
            other_first, other_second = entries[other].first, entries[other].second
            smaller = less(other_first, other_second, best_first, best_second)
            best = other if smaller else best
            best_first = other_first if smaller else best_first
            best_second = other_second if smaller else best_second
        if not less(best_first, best_second, first, second):
            break
        free, child_cell = entries[entry], entries[best].cell
        free.first, free.second, free.cell = best_first, best_second, child_cell
        cells[child_cell].place = entry
        entry = best
    free = entries[entry]
    free.first, free.second, free.cell = first, second, cell
    cells[cell].place = entry


@njit(cache=True)
def put(entries: Records, size: IntArray, cells: Records, cell: int, first: int, second: int) -> None:
    """Insert a cell, or change its key if it is queued already."""
    entry = int(cells[cell].place)
    if entry == 0:
        size[0] += 1
        rise(entries, cells, int(size[0]), cell, first, second)
    elif less(first, second, entries[entry].first, entries[entry].second):
        rise(entries, cells, entry, cell, first, second)
    else:
        sink(entries, int(size[0]), cells, entry, cell, first, second)


@njit(cache=True)
def remove(entries: Records, size: IntArray, cells: Records, cell: int) -> None:
    """Take a cell out, if it is queued."""
    entry = int(cells[cell].place)
    if entry == 0:
        return
    cells[cell].place = 0
    last = int(size[0])
    moved = entries[last]
    cell, first, second = moved.cell, moved.first, moved.second
    size[0] = last - 1
    moved.first, moved.second = _LAST, _LAST
    if entry == last:
        return
    # The last entry fills the gap; it may belong above or below it.
    if entry > 1:
        parent = entries[(entry + 2) >> 2]
        if less(first, second, parent.first, parent.second):
            rise(entries, cells, entry, cell, first, second)
            return
    sink(entries, last - 1, cells, entry, cell, first, second)
