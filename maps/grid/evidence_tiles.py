"""The evidence of a growing grid in square tiles: memory is taken only where something is known, and growing copies little."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from waychair.types import IntArray

SHIFT = 5
SIDE = 1 << SHIFT
"""Cells on a side of a tile; cell c lies in tile c >> SHIFT. A map of long corridors takes half the memory that it took in
tiles four times as long."""

_SPARE = 64  # tiles by which the table grows beyond what is needed, on each side

Evidence = NDArray[np.int32]


class EvidenceTiles:
    """Evidence by cell; a cell of which nothing is known holds 0.

    `table` (H, W) is the number of each tile, 0 for one of which nothing is known; tile k is `pool[k]` (SIDE, SIDE), and tile
    0 stays empty. `low` (2,) is the first cell of the table, column and row. `used` (1,) is the number of tiles in use;
    kernels take further ones from the pool, after `reserve` has made room for them.
    """

    def __init__(self) -> None:
        self.low = np.zeros(2, np.int64)
        self.table = np.zeros((0, 0), np.int32)
        self.pool = np.zeros((1, SIDE, SIDE), np.int32)
        self.used = np.zeros(1, np.int64)

    def hold(self, low: IntArray, high: IntArray) -> None:
        """Make the table reach from the cell `low` (2,), column and row, to before `high`."""
        height, width = self.table.shape
        first, end = low // SIDE, -(-high // SIDE)
        own = self.low // SIDE
        beyond = own + np.array([width, height])
        if self.table.size:
            if (first >= own).all() and (end <= beyond).all():
                return
            first, end = np.minimum(first, own), np.maximum(end, beyond)
        first, end = first - _SPARE, end + _SPARE
        table = np.zeros((end - first)[::-1], np.int32)
        left, down = (own - first).tolist()
        if self.table.size:
            table[down : down + height, left : left + width] = self.table
        self.low, self.table = first * SIDE, table

    def reserve(self, low: IntArray, high: IntArray) -> None:
        """Make room in the pool for all tiles of boxes from cells `low` (N, 2) up to `high` (N, 2), counted from the table's
        first cell."""
        low, high = low // SIDE, high // SIDE
        origin = low.min(axis=0)
        across, down = origin.tolist()
        table = self.table[down : int(high[:, 1].max()) + 1, across : int(high[:, 0].max()) + 1]
        wanted = np.zeros(table.shape, np.bool_)
        for (left, bottom), (right, top) in zip((low - origin).tolist(), (high - origin).tolist(), strict=True):
            wanted[bottom : top + 1, left : right + 1] = True
        needed = int(self.used[0]) + 1 + int((wanted & (table == 0)).sum())
        if needed > len(self.pool):
            pool = np.zeros((max(needed, len(self.pool) * 3 // 2), SIDE, SIDE), np.int32)
            pool[: self.used[0] + 1] = self.pool[: self.used[0] + 1]
            self.pool = pool

    def tiles(self) -> Iterator[tuple[IntArray, Evidence]]:
        """Yield the first cell (2,) of each tile in use, column and row, and its evidence."""
        for row, col in np.argwhere(self.table > 0):
            yield self.low + SIDE * np.array([col, row]), self.pool[self.table[row, col]]

    def tile(self, first: IntArray) -> Evidence:
        """Return the evidence of the tile whose first cell is `first` (2,), inside the table, to be changed."""
        col, row = ((first - self.low) // SIDE).tolist()
        if not self.table[row, col]:
            at = np.array([[col, row]]) * SIDE
            self.reserve(at, at)
            self.used += 1
            self.table[row, col] = self.used[0]
        found: Evidence = self.pool[self.table[row, col]]
        return found

    def extent(self) -> tuple[IntArray, IntArray]:
        """Return the first known cell (2,), column and row, and the one after the last; both equal if none is known."""
        rows, cols = np.nonzero(self.table)
        if not len(rows):
            return np.zeros(2, np.int64), np.zeros(2, np.int64)
        numbers, pool = self.table[rows, cols], self.pool[: self.used[0] + 1]
        each = np.arange(SIDE)
        spans = []
        for tiles, axis in ((cols, 1), (rows, 2)):
            some = np.logical_or.reduce(pool, axis=axis)[numbers]
            at = (tiles[:, None] * SIDE + each)[some]
            spans.append((int(at.min()), int(at.max()) + 1) if len(at) else (0, 0))
        low, high = np.array(spans, np.int64).T
        return self.low + low, self.low + high
