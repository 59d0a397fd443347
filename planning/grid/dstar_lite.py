"""D* Lite: the cheapest path to one goal, repaired instead of recomputed while the chair moves and cells change.

The optimised version of Koenig and Likhachev, "Fast Replanning for Navigation in Unknown Terrain", IEEE Transactions on
Robotics 21(3), 2005; section 3.3.1 of the source paper (intelligent wheelchair, D* Lite and DWA) describes its first
form. The search runs from the goal to the start. Every cell holds two estimates of its cost to the goal, g and the
one-step lookahead rhs, and is in one of the three states of the paper's Fig. 6 (`Consistency`); cells that are not
consistent wait in a queue ordered by (k1, k2) of Eqs. (5) and (7).

The source paper's text has misprints, corrected here:
- Eq. (4) takes rhs over the predecessors; it is the minimum over the *successors* (as in Eq. (3) for g).
- Eq. (6) writes the heuristic recursively and towards the goal; here h(s, start) is the octile distance of s from the
  *start*, in the same integers as the costs, hence consistent.
- k_m is missing from Eq. (5): k1 = min(g, rhs) + h(s, start) + k_m. Without it, the keys of queued cells are no longer
  lower bounds once the start has moved, and the search stops too early.
- "overconsistent ... updates the g values of the neighbours": their rhs changes; and the value first calculated
  "according to Eq. (3)" is the rhs of Eq. (4).

All costs and keys are integers and keys are compared exactly (see `grid_graph` for why).
"""

from __future__ import annotations

import enum
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from waychair.errors import NoPath
from waychair.planning.grid.grid_graph import (
    UNREACHABLE,
    Cell,
    Prices,
    Records,
    cells_from_padded,
    check_changes,
    least_step,
    octile,
    offsets,
    padded,
    padded_index,
    price_of,
    set_prices,
    step_cost,
)
from waychair.planning.grid.indexed_heap import ROOM, empty_heap, grown, has_room, less, put, remove
from waychair.resumable import Resumable
from waychair.types import Bytes, IntArray

POPS_PER_STEP = 20_000
"""Cells taken from the queue between two interruptions of `DStarLite.prepare`, about 8 ms of a control period's 50."""

CELLS_PER_STEP = 240_000
"""Cells whose records are made between two interruptions of it; on a large map their memory takes longest."""

_ALL = np.iinfo(np.int64).max

CELL = np.dtype([("g", np.int64), ("rhs", np.int64), ("ground", np.int32), ("place", np.int32)])
"""The search's record of a cell, 24 bytes: its two estimates, its ground and its place in the queue."""


class Consistency(enum.IntEnum):
    """The three states of the paper's Fig. 6: g against rhs."""

    CONSISTENT = 0
    OVERCONSISTENT = 1
    UNDERCONSISTENT = 2


CONSISTENT = int(Consistency.CONSISTENT)
OVERCONSISTENT = int(Consistency.OVERCONSISTENT)
UNDERCONSISTENT = int(Consistency.UNDERCONSISTENT)


class _KeyBasis(NamedTuple):
    """The basis of the queued keys: flat indices of goal and start, the start's padded row and column, k_m, stride."""

    goal: int
    start: int
    row: int
    column: int
    k_m: int
    stride: int


class DStarLite:
    """The search state for one goal. Cells are (row, column); prices (H, W) int32 and barred (H, W) as in `grid_graph`.

    `pops` counts the cells taken from the queue since construction. A change of prices or start takes effect at the
    next `replan`; until then there is no path.

    Raises (constructor):
        ValueError: a cell outside the grid, an impossible price.
    """

    def __init__(self, prices: Prices, goal: Cell, start: Cell, barred: Bytes | None = None) -> None:
        self._shape: tuple[int, int] = (prices.shape[0], prices.shape[1])
        self._goal = padded_index(goal, self._shape)
        self._start = padded_index(start, self._shape)
        self._grounds: Prices | None = padded(prices, barred)  # until all records are made
        self._made = 0
        self._cells = np.empty(len(self._grounds), CELL)
        self._steps = offsets(self._stride)
        self._heap = empty_heap(self._cells)
        self._aim = self._aimed(k_m=0)
        self.pops = 0
        self._cost = UNREACHABLE  # of the plan in force

    @property
    def start(self) -> Cell:
        """The start cell of the next `replan`."""
        row, column = divmod(self._start, self._stride)
        return row - 1, column - 1

    @property
    def nbytes(self) -> int:
        """Size of the arrays [bytes]."""
        return self._cells.nbytes + self._heap.entries.nbytes

    def move_start(self, cell: Cell) -> None:
        """Move the start to any cell of the grid, not only one on the path.

        Raises:
            ValueError: the cell lies outside the grid.
        """
        self._start = padded_index(cell, self._shape)
        self._cost = UNREACHABLE

    def update(self, cells: IntArray, prices: Prices) -> None:
        """Give cells (N, 2) new prices (N,).

        Raises:
            ValueError: a cell outside the grid, an impossible price, arrays of different length.
        """
        self._make_records(_ALL)
        cells = np.ascontiguousarray(cells, np.int64).reshape(-1, 2)
        prices = np.ascontiguousarray(prices, np.int32)
        self._account_for_motion()
        while not has_room(self._heap, len(cells)):
            self._heap = grown(self._heap)
        possible = len(cells) == len(prices) and _apply(*self._heap, self._steps, cells, prices, self._shape, self._aim)
        if not possible:
            check_changes(cells, prices, self._shape)
        self._cost = UNREACHABLE

    def prepare(self) -> Resumable[None]:
        """Do the search of the next `replan` in bounded parts; the start may move and prices change between them."""
        while self._grounds is not None:
            yield
            self._make_records(CELLS_PER_STEP)
        while self._searched(POPS_PER_STEP) is None:
            yield

    def replan(self) -> int:
        """Return the cost of the cheapest path from start to goal, 10000 for a straight step between free cells.

        Raises:
            NoPath: they are not connected, or one of them is impassable.
        """
        cost = self._searched(_ALL)
        assert cost is not None
        if cost >= UNREACHABLE:
            goal = cells_from_padded(np.array([self._goal], np.int32), self._shape)[0]
            raise NoPath(
                f"cells {self.start} and ({goal[0]}, {goal[1]}) are not connected; choose another goal or clear the way"
            )
        self._cost = cost
        return self._cost

    def _searched(self, most: int) -> int | None:
        """Search on; return the start's cost, None if it is not final after so many pops."""
        self._make_records(_ALL)
        self._account_for_motion()
        while True:
            pops, cost, finished = _compute_shortest_path(*self._heap, self._steps, self._aim, most)
            self.pops += pops
            most -= pops
            if finished:
                return int(cost)
            if most <= 0:
                return None
            self._heap = grown(self._heap)

    def path(self) -> IntArray:
        """Return the cells (N, 2) of the present plan, start and goal included; their costs sum to `replan`'s exactly.

        Raises:
            NoPath: there is no plan, or start or prices have changed since.
        """
        if self._cost >= UNREACHABLE:
            raise NoPath(f"there is no plan from cell {self.start}; replan first, or choose another goal")
        flat = _descend(self._cells, self._steps, self._start, self._goal)
        return cells_from_padded(flat, self._shape)

    def consistency(self, cell: Cell) -> Consistency:
        """Return a cell's state in the sense of the paper's Fig. 6."""
        self._make_records(_ALL)
        record = self._cells[padded_index(cell, self._shape)]
        return Consistency(_consistency(record["g"], record["rhs"]))

    @property
    def _stride(self) -> int:
        return self._shape[1] + 2

    def _aimed(self, k_m: int) -> _KeyBasis:
        row, column = divmod(self._start, self._stride)
        return _KeyBasis(goal=self._goal, start=self._start, row=row, column=column, k_m=k_m, stride=self._stride)

    def _make_records(self, most: int) -> None:
        """Make the next records of cells, at most so many; with the last one, queue the goal."""
        if self._grounds is None:
            return
        end = min(self._made + most, len(self._cells))
        _forget_all(self._cells[self._made : end], self._grounds[self._made : end])
        self._made = end
        if end == len(self._cells):
            self._grounds = None
            self._cells["rhs"][self._goal] = 0
            _update_vertex(*self._heap, self._goal, self._aim)

    def _account_for_motion(self) -> None:
        """Raise k_m by the heuristic distance moved, so that all queued keys stay lower bounds without reordering."""
        before = self._aim
        if self._start != before.start:
            moved = octile(before.row, before.column, self._start, self._stride)
            self._aim = self._aimed(k_m=before.k_m + int(moved))


@njit(cache=True, error_model="numpy", nogil=True)
def _forget_all(cells: Records, grounds: Prices) -> None:
    """Reset every cell's record, except for its ground."""
    for i in range(len(cells)):
        cell = cells[i]
        cell.g, cell.rhs, cell.ground, cell.place = UNREACHABLE, UNREACHABLE, grounds[i], 0


@njit(cache=True, error_model="numpy", inline="always")
def _consistency(g: int, rhs: int) -> int:
    """Return one of `Consistency`, as an integer."""
    if g == rhs:
        return CONSISTENT
    return OVERCONSISTENT if g > rhs else UNDERCONSISTENT


@njit(cache=True, error_model="numpy", inline="always")
def _update_vertex(entries: Records, size: IntArray, cells: Records, cell: int, aim: _KeyBasis) -> None:
    """Queue a cell with its key if it is not consistent, else take it out."""
    g, rhs = cells[cell].g, cells[cell].rhs
    if _consistency(g, rhs) == CONSISTENT:
        remove(entries, size, cells, cell)
    else:
        nearest = min(g, rhs)
        put(entries, size, cells, cell, nearest + octile(aim.row, aim.column, cell, aim.stride) + aim.k_m, nearest)


@njit(cache=True, error_model="numpy")
def _lookahead(cells: Records, steps: IntArray, cell: int) -> int:
    """Return rhs of Eq. (4), over the successors."""
    best = UNREACHABLE
    if price_of(cells[cell].ground) != 0:
        for direction in range(8):
            g = cells[cell + steps[direction]].g
            if g + least_step(direction) < best:
                best = min(best, g + step_cost(cells, cell, direction, steps, False))
    return best


@njit(cache=True, error_model="numpy", nogil=True)
def _apply(
    entries: Records,
    size: IntArray,
    cells: Records,
    steps: IntArray,
    changed: IntArray,
    prices: Prices,
    shape: tuple[int, int],
    aim: _KeyBasis,
) -> bool:
    """Set new prices and the lookahead of all affected cells; return false, and do nothing, if a change is impossible.

    A changed price affects only steps whose ends both lie in the 3 x 3 cells around it, diagonal steps past it
    included. All prices are set first, since a cell's lookahead must see the new prices of all its neighbours.
    """
    if not set_prices(cells, changed, prices, shape[0], shape[1]):
        return False
    for i in range(len(changed)):
        middle = (changed[i, 0] + 1) * aim.stride + changed[i, 1] + 1
        for row in range(-1, 2):
            for column in range(-1, 2):
                cell = middle + row * aim.stride + column
                if cell == aim.goal:
                    continue
                rhs = _lookahead(cells, steps, cell)
                if rhs != cells[cell].rhs:
                    cells[cell].rhs = rhs
                    _update_vertex(entries, size, cells, cell, aim)
    return True


@njit(cache=True, error_model="numpy", nogil=True)
def _compute_shortest_path(
    entries: Records, size: IntArray, cells: Records, steps: IntArray, aim: _KeyBasis, most: int
) -> tuple[int, int, bool]:
    """Make cells consistent until the start's cost is final, at most so many; return (pops, cost, whether it is final)."""
    start = cells[aim.start]
    pops = 0
    while size[0] > 0:
        first, second, cell = entries[1].first, entries[1].second, entries[1].cell
        nearest = min(start.g, start.rhs)
        if not less(first, second, nearest + aim.k_m, nearest) and start.rhs <= start.g:
            break
        if size[0] + ROOM >= len(entries) or pops >= most:
            return pops, UNREACHABLE, False
        pops += 1
        g, rhs = cells[cell].g, cells[cell].rhs
        nearest = min(g, rhs)
        now_first = nearest + octile(aim.row, aim.column, cell, aim.stride) + aim.k_m
        if less(first, second, now_first, nearest):
            # The key belongs to an earlier start.
            put(entries, size, cells, cell, now_first, nearest)
        elif _consistency(g, rhs) == OVERCONSISTENT:
            _settle(entries, size, cells, steps, cell, aim)
        else:
            _forget(entries, size, cells, steps, cell, aim)
    return pops, start.rhs if price_of(start.ground) != 0 else UNREACHABLE, True


@njit(cache=True, error_model="numpy")
def _settle(entries: Records, size: IntArray, cells: Records, steps: IntArray, cell: int, aim: _KeyBasis) -> None:
    """Settle an overconsistent cell: g takes the cheaper lookahead, and the neighbours may go through this cell."""
    g = cells[cell].rhs
    cells[cell].g = g
    remove(entries, size, cells, cell)
    for direction in range(8):
        other = cell + steps[direction]
        # Most neighbours have a path that no step could improve; the goal's costs nothing.
        if g + least_step(direction) < cells[other].rhs:
            through = g + step_cost(cells, cell, direction, steps, True)
            if through < cells[other].rhs:
                cells[other].rhs = through
                _update_vertex(entries, size, cells, other, aim)


@njit(cache=True, error_model="numpy")
def _forget(entries: Records, size: IntArray, cells: Records, steps: IntArray, cell: int, aim: _KeyBasis) -> None:
    """Reset an underconsistent cell: its path became dearer, so all neighbours that relied on it look ahead again."""
    before = cells[cell].g
    cells[cell].g = UNREACHABLE
    _update_vertex(entries, size, cells, cell, aim)
    for direction in range(8):
        other = cell + steps[direction]
        rhs = cells[other].rhs
        if rhs < before + least_step(direction) or rhs == UNREACHABLE or other == aim.goal:
            continue
        if rhs == before + step_cost(cells, cell, direction, steps, True):
            cells[other].rhs = _lookahead(cells, steps, other)
            _update_vertex(entries, size, cells, other, aim)


@njit(cache=True, error_model="numpy")
def _descend(cells: Records, steps: IntArray, start: int, goal: int) -> NDArray[np.int32]:
    """Return the cells from start to goal, each the successor with the minimum of Eq. (3)."""
    path = np.empty(1024, np.int32)
    path[0] = start
    count = 1
    cell = start
    while cell != goal:
        best, following = UNREACHABLE, cell
        for direction in range(8):
            other = cell + steps[direction]
            g = cells[other].g
            if g < best:
                through = g + step_cost(cells, cell, direction, steps, False)
                if through < best:
                    best, following = through, other
        if count == len(path):
            path = np.concatenate((path, np.empty(count, np.int32)))
        path[count] = following
        count += 1
        cell = following
    return path[:count]
