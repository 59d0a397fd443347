"""A* and Dijkstra from scratch: baselines for D* Lite on the same graph with the same costs and heap.

A* (Hart, Nilsson and Raphael 1968) orders the queue by cost so far plus the octile distance to the goal; among equals
it prefers the cell nearer to the goal. Dijkstra (1959) uses no heuristic.
"""

from __future__ import annotations

from dataclasses import dataclass

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
    check_prices,
    least_step,
    octile,
    offsets,
    padded,
    padded_index,
    step_cost,
)
from waychair.planning.grid.indexed_heap import ROOM, empty_heap, grown, put, remove
from waychair.types import Bytes, IntArray

CELL = np.dtype([("cost", np.int64), ("parent", np.int32), ("ground", np.int32), ("place", np.int32)], align=True)
"""A search's record of a cell, 24 bytes."""


@dataclass(frozen=True, slots=True)
class GridPath:
    """The result of a search: cost, cells (N, 2) from start to goal, and how many cells were taken from the queue."""

    cost: int
    cells: IntArray
    pops: int


class FromScratch:
    """A search with the interface of `DStarLite` that starts each `replan` from scratch.

    Raises (constructor):
        ValueError: a cell outside the grid, an impossible price.
    """

    informed = True

    def __init__(self, prices: Prices, goal: Cell, start: Cell, barred: Bytes | None = None) -> None:
        self._prices, self._barred = prices.copy(), barred
        self._goal = goal
        check_prices(prices)
        padded_index(goal, self._shape)
        self.pops = 0
        self.move_start(start)

    def move_start(self, cell: Cell) -> None:
        """Start the next `replan` from this cell, as `DStarLite.move_start`."""
        padded_index(cell, self._shape)
        self.start = cell
        self._found: GridPath | None = None

    @property
    def _shape(self) -> tuple[int, int]:
        return self._prices.shape[0], self._prices.shape[1]

    def update(self, cells: IntArray, prices: Prices) -> None:
        """Change prices, as `DStarLite.update`."""
        cells = np.asarray(cells, np.int64).reshape(-1, 2)
        check_changes(cells, np.asarray(prices), self._shape)
        self._prices[tuple(cells.T)] = prices
        self._found = None

    def replan(self) -> int:
        """Plan, and return the cost, as `DStarLite.replan`."""
        self._found = search(self._prices, self.start, self._goal, informed=self.informed, barred=self._barred)
        self.pops += self._found.pops
        return self._found.cost

    def path(self) -> IntArray:
        """Return the cells of the plan, as `DStarLite.path`."""
        if self._found is None:
            raise NoPath(f"there is no plan from cell {self.start}; replan first, or choose another goal")
        return self._found.cells


class AStar(FromScratch):
    """A* from scratch each time."""


class Dijkstra(FromScratch):
    """Dijkstra's search from scratch each time."""

    informed = False


def shortest_cost(prices: Prices, start: Cell, goal: Cell, *, informed: bool = True) -> int:
    """Return the cost of the cheapest path over (H, W) prices, by A* or (not informed) Dijkstra.

    Raises:
        NoPath: start and goal are not connected.
        ValueError: a cell outside the grid, an impossible price.
    """
    return search(prices, start, goal, informed=informed).cost


def search(prices: Prices, start: Cell, goal: Cell, *, informed: bool = True, barred: Bytes | None = None) -> GridPath:
    """Return the cheapest path with cost and work; `barred` as in `grid_graph`; raises as `shortest_cost`."""
    shape = (prices.shape[0], prices.shape[1])
    first, last = padded_index(start, shape), padded_index(goal, shape)
    grounds = padded(prices, barred)
    cells = np.empty(len(grounds), CELL)
    _forget_all(cells, grounds)
    heap, steps = empty_heap(cells), offsets(shape[1] + 2)
    if prices[start] != 0:
        cells["cost"][first] = 0
        put(*heap, first, 0, 0)
    pops = 0
    while True:
        popped, finished = _expand(*heap, steps, last, shape[1] + 2, informed)
        pops += popped
        if finished:
            break
        heap = grown(heap)
    cost = int(cells["cost"][last])
    if cost >= UNREACHABLE:
        raise NoPath(f"cells {start} and {goal} are not connected; choose another goal or clear the way")
    return GridPath(cost, cells_from_padded(_trace(cells, last), shape), pops)


@njit(cache=True, error_model="numpy", nogil=True)
def _forget_all(cells: Records, grounds: Prices) -> None:
    """Reset every cell's record, except for its ground."""
    for i in range(len(cells)):
        cell = cells[i]
        cell.cost, cell.parent, cell.ground, cell.place = UNREACHABLE, -1, grounds[i], 0


@njit(cache=True, error_model="numpy", nogil=True)
def _expand(
    entries: Records, size: IntArray, cells: Records, steps: IntArray, goal: int, stride: int, informed: bool
) -> tuple[int, bool]:
    """Expand cells until the goal is taken from the queue; return (cells popped, false when the heap must grow)."""
    goal_row, goal_column = goal // stride, goal % stride
    pops = 0
    while size[0] > 0:
        if size[0] + ROOM >= len(entries):
            return pops, False
        cell = entries[1].cell
        remove(entries, size, cells, cell)
        pops += 1
        if cell == goal:
            break
        cost = cells[cell].cost
        for direction in range(8):
            other = cell + steps[direction]
            if cost + least_step(direction) >= cells[other].cost:
                continue
            through = cost + step_cost(cells, cell, direction, steps, False)
            if through < cells[other].cost:
                cells[other].cost = through
                cells[other].parent = cell
                ahead = octile(goal_row, goal_column, other, stride) if informed else 0
                put(entries, size, cells, other, through + ahead, ahead)
    return pops, True


@njit(cache=True, error_model="numpy")
def _trace(cells: Records, goal: int) -> NDArray[np.int32]:
    """Return the cells from the start (the one without parent) to the goal."""
    count = 1
    cell = goal
    while cells[cell].parent >= 0:
        cell = cells[cell].parent
        count += 1
    path = np.empty(count, np.int32)
    cell = goal
    for i in range(count - 1, -1, -1):
        path[i] = cell
        cell = cells[cell].parent
    return path
