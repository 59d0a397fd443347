"""D* Lite: the cheapest way to one goal, repaired instead of recomputed while the chair moves and cells change.

The optimised version of Koenig and Likhachev, "Fast Replanning for Navigation in Unknown Terrain", IEEE Transactions on
Robotics 21(3), 2005; section 3.3.1 of the source paper (intelligent wheelchair, D* Lite and DWA) describes its first
form. The search runs from the goal to the start. Every cell holds two estimates of its cost to the goal, g and the
one-step lookahead rhs, and is in one of the three states of the paper's Fig. 6 (`Consistency`); cells that are not
consistent wait in a queue ordered by (k1, k2) of Eqs. (5) and (7).

Where this module departs from the source paper's text, which is misprinted:
- Eq. (4) takes rhs over the predecessors; it is the minimum over the *successors* (as Eq. (3) has it for g).
- Eq. (6) writes the heuristic recursively and towards the goal; here h(s, start) is the octile distance of s from the
  *start*, in the same integers as the costs, hence consistent.
- k_m is missing from Eq. (5): k1 = min(g, rhs) + h(s, start) + k_m. Without it, the keys of queued cells are no longer
  lower bounds once the start has moved, and the search stops too early.
- "overconsistent ... updates the g values of the neighbours": it is their rhs that changes.

All costs and keys are integers and keys are compared exactly (see `grid_graph` for why).
"""

from __future__ import annotations

import enum
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from waychair.errors import NoPath
from waychair.planning.grid_graph import (
    UNREACHABLE,
    Cell,
    Prices,
    cells_from_padded,
    check_prices,
    neighbour,
    octile,
    padded,
    padded_index,
    step_cost,
)
from waychair.planning.indexed_heap import Heap, empty_heap, grown, has_room, less, put, remove
from waychair.types import IntArray


class Consistency(enum.IntEnum):
    """The three states of the paper's Fig. 6: g against rhs."""

    CONSISTENT = 0
    OVERCONSISTENT = 1
    UNDERCONSISTENT = 2


CONSISTENT = int(Consistency.CONSISTENT)
OVERCONSISTENT = int(Consistency.OVERCONSISTENT)
UNDERCONSISTENT = int(Consistency.UNDERCONSISTENT)


class _State(NamedTuple):
    """Flat padded arrays: prices int32, g and rhs int64; 24 bytes a cell with the heap's `place`, plus the queue."""

    prices: Prices
    g: IntArray
    rhs: IntArray


class DStarLite:
    """Search state for one goal. Cells are (row, column); prices (H, W) int32 as in `grid_graph`.

    `pops` counts the cells taken from the queue since construction. A change of prices or start takes effect at the
    next `replan`; until then there is no path.

    Raises (constructor):
        ValueError: a cell outside the grid, an impossible price.
    """

    def __init__(self, prices: Prices, goal: Cell, start: Cell) -> None:
        self._shape: tuple[int, int] = (prices.shape[0], prices.shape[1])
        self._goal = padded_index(goal, self._shape)
        self._start = padded_index(start, self._shape)
        self._keys_start = self._start  # the start that k_m and the queued keys were last made for
        self._k_m = 0
        flat = padded(prices)
        self._state = _State(flat, np.full(len(flat), UNREACHABLE, np.int64), np.full(len(flat), UNREACHABLE, np.int64))
        self._heap = empty_heap(len(flat))
        self.pops = 0
        self._cost = UNREACHABLE  # of the plan in force
        self._state.rhs[self._goal] = 0
        put(self._heap, self._goal, octile(self._start, self._goal, self._stride), 0)

    @property
    def start(self) -> Cell:
        """The cell that the next `replan` starts from."""
        row, column = divmod(self._start, self._stride)
        return row - 1, column - 1

    @property
    def nbytes(self) -> int:
        """Memory held in arrays [bytes]."""
        return sum(array.nbytes for array in (*self._state, *self._heap))

    def move_start(self, cell: Cell) -> None:
        """The chair has moved: any cell of the grid, not only one on the path.

        Raises:
            ValueError: the cell lies outside the grid.
        """
        self._start = padded_index(cell, self._shape)
        self._cost = UNREACHABLE

    def update(self, cells: IntArray, prices: Prices) -> None:
        """Cells (N, 2) have new prices (N,).

        Raises:
            ValueError: a cell outside the grid, an impossible price, arrays of different length.
        """
        cells = np.asarray(cells, np.int64).reshape(-1, 2)
        prices = np.asarray(prices, np.int32)
        if len(cells) != len(prices):
            raise ValueError(f"{len(cells)} cells but {len(prices)} prices")
        if ((cells < 0) | (cells >= self._shape)).any():
            raise ValueError(f"changed cells must lie in the {self._shape[0]} x {self._shape[1]} grid")
        check_prices(prices)
        self._cost = UNREACHABLE
        self._account_for_motion()
        flat = ((cells[:, 0] + 1) * self._stride + cells[:, 1] + 1).astype(np.int32)
        # All prices first: the lookahead of a cell must see the new prices of all its neighbours.
        self._state.prices[flat] = prices
        done = 0
        while done < len(flat):
            done = _look_again(self._state, self._heap, flat, done, self._goal, self._start, self._k_m, self._stride)
            if done < len(flat):
                self._heap = grown(self._heap)

    def replan(self) -> int:
        """Cost of the cheapest way from the start to the goal, 10000 for a straight step between free cells.

        Raises:
            NoPath: they are not connected, or one of them is impassable.
        """
        self._account_for_motion()
        while True:
            pops, finished = _compute_shortest_path(
                self._state, self._heap, self._goal, self._start, self._k_m, self._stride
            )
            self.pops += pops
            if finished:
                break
            self._heap = grown(self._heap)
        if self._state.prices[self._start] == 0 or self._state.rhs[self._start] >= UNREACHABLE:
            goal = cells_from_padded(np.array([self._goal], np.int32), self._shape)[0]
            raise NoPath(
                f"cells {self.start} and ({goal[0]}, {goal[1]}) are not connected; choose another goal or clear the way"
            )
        self._cost = int(self._state.rhs[self._start])
        return self._cost

    def path(self) -> IntArray:
        """Cells (N, 2) of the plan in force, start and goal included; the steps' costs sum to `replan`'s exactly.

        Raises:
            NoPath: there is none, or start or prices changed since.
        """
        if self._cost >= UNREACHABLE:
            raise NoPath(f"there is no plan from cell {self.start}; replan first, or choose another goal")
        flat = _descend(self._state, self._start, self._goal, self._stride)
        return cells_from_padded(flat, self._shape)

    def consistency(self, cell: Cell) -> Consistency:
        """State of a cell in the sense of the paper's Fig. 6."""
        index = padded_index(cell, self._shape)
        return Consistency(_consistency(self._state.g[index], self._state.rhs[index]))

    @property
    def _stride(self) -> int:
        return self._shape[1] + 2

    def _account_for_motion(self) -> None:
        """Raise k_m by the heuristic distance moved, so that all queued keys stay lower bounds without reordering."""
        self._k_m += octile(self._keys_start, self._start, self._stride)
        self._keys_start = self._start


@njit(cache=True, inline="always")
def _consistency(g: int, rhs: int) -> int:
    """One of `Consistency`, as an integer."""
    if g == rhs:
        return CONSISTENT
    return OVERCONSISTENT if g > rhs else UNDERCONSISTENT


@njit(cache=True)
def _update_vertex(state: _State, heap: Heap, cell: int, start: int, k_m: int, stride: int) -> None:
    """Queue a cell with its key when it is not consistent, else take it out."""
    g, rhs = state.g[cell], state.rhs[cell]
    if _consistency(g, rhs) == CONSISTENT:
        remove(heap, cell)
    else:
        nearest = min(g, rhs)
        put(heap, cell, nearest + octile(start, cell, stride) + k_m, nearest)


@njit(cache=True)
def _lookahead(state: _State, cell: int, stride: int) -> int:
    """rhs of Eq. (4), over the successors."""
    best = UNREACHABLE
    if state.prices[cell] != 0:
        for direction in range(8):
            g = state.g[cell + neighbour(direction, stride)]
            if g < best:
                best = min(best, g + step_cost(state.prices, cell, direction, stride))
    return best


@njit(cache=True, nogil=True)
def _look_again(
    state: _State,
    heap: Heap,
    cells: NDArray[np.int32],
    done: int,
    goal: int,
    start: int,
    k_m: int,
    stride: int,
) -> int:
    """New lookahead for the changed cells from index `done` on; how many are done when the heap is full.

    A changed price touches only steps whose ends both lie in the 3 x 3 cells round it, diagonal steps past it included.
    """
    for i in range(done, len(cells)):
        if not has_room(heap):
            return i
        for row in range(-1, 2):
            for column in range(-1, 2):
                cell = cells[i] + row * stride + column
                if cell != goal:
                    state.rhs[cell] = _lookahead(state, cell, stride)
                    _update_vertex(state, heap, cell, start, k_m, stride)
    return len(cells)


@njit(cache=True, nogil=True)
def _compute_shortest_path(state: _State, heap: Heap, goal: int, start: int, k_m: int, stride: int) -> tuple[int, bool]:
    """Make cells consistent until the start's cost is certain; (cells popped, false when the heap must grow)."""
    g, rhs = state.g, state.rhs
    pops = 0
    while heap.size[0] > 0:
        nearest = min(g[start], rhs[start])
        first, second = heap.keys[1, 0], heap.keys[1, 1]
        if not less(first, second, nearest + k_m, nearest) and rhs[start] <= g[start]:
            break
        if not has_room(heap):
            return pops, False
        cell = heap.cells[1]
        pops += 1
        nearest = min(g[cell], rhs[cell])
        now_first = nearest + octile(start, cell, stride) + k_m
        if less(first, second, now_first, nearest):
            # The key was made for an earlier start.
            put(heap, cell, now_first, nearest)
        elif _consistency(g[cell], rhs[cell]) == OVERCONSISTENT:
            _settle(state, heap, cell, goal, start, k_m, stride)
        else:
            _forget(state, heap, cell, goal, start, k_m, stride)
    return pops, True


@njit(cache=True)
def _settle(state: _State, heap: Heap, cell: int, goal: int, start: int, k_m: int, stride: int) -> None:
    """Overconsistent: the lookahead found a cheaper way, g takes it and the neighbours may go through this cell."""
    state.g[cell] = state.rhs[cell]
    remove(heap, cell)
    for direction in range(8):
        other = cell + neighbour(direction, stride)
        step = step_cost(state.prices, cell, direction, stride)
        if other != goal and step != UNREACHABLE and state.g[cell] + step < state.rhs[other]:
            state.rhs[other] = state.g[cell] + step
            _update_vertex(state, heap, other, start, k_m, stride)


@njit(cache=True)
def _forget(state: _State, heap: Heap, cell: int, goal: int, start: int, k_m: int, stride: int) -> None:
    """Underconsistent: the way got dearer, g is given up and whoever relied on it looks ahead again."""
    before = state.g[cell]
    state.g[cell] = UNREACHABLE
    _update_vertex(state, heap, cell, start, k_m, stride)
    for direction in range(8):
        other = cell + neighbour(direction, stride)
        step = step_cost(state.prices, cell, direction, stride)
        if other != goal and step != UNREACHABLE and state.rhs[other] == before + step:
            state.rhs[other] = _lookahead(state, other, stride)
            _update_vertex(state, heap, other, start, k_m, stride)


@njit(cache=True)
def _descend(state: _State, start: int, goal: int, stride: int) -> NDArray[np.int32]:
    """Cells from start to goal, each the successor that Eq. (3) takes its minimum from."""
    path = np.empty(1024, np.int32)
    path[0] = start
    count = 1
    cell = start
    while cell != goal:
        best, following = UNREACHABLE, cell
        for direction in range(8):
            other = cell + neighbour(direction, stride)
            g = state.g[other]
            if g < best:
                through = g + step_cost(state.prices, cell, direction, stride)
                if through < best:
                    best, following = through, other
        if count == len(path):
            path = np.concatenate((path, np.empty(count, np.int32)))
        path[count] = following
        count += 1
        cell = following
    return path[:count]
