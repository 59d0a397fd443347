"""A* and Dijkstra from scratch: what D* Lite is measured against, on the same graph with the same costs and heap.

A* (Hart, Nilsson and Raphael 1968) orders the queue by cost so far plus the octile distance still to go, and prefers
the cell nearer to the goal among equals; Dijkstra (1959) leaves the heuristic out.
"""

from __future__ import annotations

from dataclasses import dataclass
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
    neighbour,
    octile,
    padded,
    padded_index,
    step_cost,
)
from waychair.planning.indexed_heap import Heap, empty_heap, grown, has_room, put, remove
from waychair.types import IntArray


@dataclass(frozen=True, slots=True)
class GridPath:
    """What a search found: cost, cells (N, 2) from start to goal, and how many cells left the queue on the way."""

    cost: int
    cells: IntArray
    pops: int


class _Search(NamedTuple):
    prices: Prices
    cost: IntArray
    parent: NDArray[np.int32]


def shortest_cost(prices: Prices, start: Cell, goal: Cell, *, informed: bool = True) -> int:
    """Cost of the cheapest way over (H, W) prices, by A* or (not informed) Dijkstra.

    Raises:
        NoPath: start and goal are not connected.
        ValueError: a cell outside the grid, an impossible price.
    """
    return search(prices, start, goal, informed=informed).cost


def shortest_path(prices: Prices, start: Cell, goal: Cell, *, informed: bool = True) -> IntArray:
    """Cells (N, 2) of the cheapest way, start and goal included; raises as `shortest_cost`."""
    return search(prices, start, goal, informed=informed).cells


def search(prices: Prices, start: Cell, goal: Cell, *, informed: bool = True) -> GridPath:
    """The cheapest way with its cost and the work it took; raises as `shortest_cost`."""
    shape = (prices.shape[0], prices.shape[1])
    first, last = padded_index(start, shape), padded_index(goal, shape)
    flat = padded(prices)
    state = _Search(flat, np.full(len(flat), UNREACHABLE, np.int64), np.full(len(flat), -1, np.int32))
    heap = empty_heap(len(flat))
    if flat[first]:
        state.cost[first] = 0
        put(heap, first, 0, 0)
    pops = 0
    while True:
        popped, finished = _expand(state, heap, last, shape[1] + 2, informed)
        pops += popped
        if finished:
            break
        heap = grown(heap)
    if state.cost[last] >= UNREACHABLE:
        raise NoPath(f"cells {start} and {goal} are not connected; choose another goal or clear the way")
    return GridPath(int(state.cost[last]), cells_from_padded(_trace(state.parent, last), shape), pops)


@njit(cache=True, nogil=True)
def _expand(state: _Search, heap: Heap, goal: int, stride: int, informed: bool) -> tuple[int, bool]:
    """Expand cells until the goal is taken from the queue; (cells popped, false when the heap must grow)."""
    prices, cost, parent = state
    pops = 0
    while heap.size[0] > 0:
        if not has_room(heap):
            return pops, False
        cell = heap.cells[1]
        remove(heap, cell)
        pops += 1
        if cell == goal:
            break
        for direction in range(8):
            step = step_cost(prices, cell, direction, stride)
            if step == UNREACHABLE:
                continue
            other = cell + neighbour(direction, stride)
            through = cost[cell] + step
            if through < cost[other]:
                cost[other] = through
                parent[other] = cell
                ahead = octile(other, goal, stride) if informed else 0
                put(heap, other, through + ahead, ahead)
    return pops, True


@njit(cache=True)
def _trace(parent: NDArray[np.int32], goal: int) -> NDArray[np.int32]:
    """Cells from the start (the one without parent) to the goal."""
    count = 1
    cell = goal
    while parent[cell] >= 0:
        cell = parent[cell]
        count += 1
    path = np.empty(count, np.int32)
    cell = goal
    for i in range(count - 1, -1, -1):
        path[i] = cell
        cell = parent[cell]
    return path
