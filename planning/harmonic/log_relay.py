"""The harmonic field in logarithms: cells in breadth-first order from the goal, and sweeps in that order.

v falls by a factor per corridor width and underflows float64 in a long building; its logarithm does not. A sweep in
breadth-first order from the goal carries a change of scale through the whole map at once.
"""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np
from numba import njit
from numpy.typing import NDArray

from waychair.planning.grid.grid_graph import SIDES, Cell
from waychair.resumable import CountedSteps, ranges_of
from waychair.types import BoolArray, Bytes, Float32Array, FloatArray

Indices: TypeAlias = NDArray[np.int32]


def breadth_first_order(absorption: Float32Array, barred: Bytes, goal: Cell) -> CountedSteps[tuple[Indices, Indices]]:
    """Return the cells connected to a goal: flat indices (N,) in breadth-first order, and neighbour numbers (N, 4).

    A cell's neighbour numbers are its neighbours' places in that order, -1 where no step leads: into a wall, or against
    a one-way zone (`barred` (H, W) as in `grid_graph`, or empty). The goal is the first cell.
    """
    place = np.full(absorption.size, -1, np.int32)
    order = np.empty(absorption.size, np.int32)
    order[0] = goal[0] * absorption.shape[1] + goal[1]
    place[order[0]] = 0
    count, done = 1, 0
    while done < count:
        first, last = done, done + _CHUNK
        count = _reach(absorption, barred, place, order, count, first, last)
        done = min(last, count)
        yield _STEP_PRICE * (done - first)
    numbers = np.empty((count, 4), np.int32)
    for first, last in ranges_of(0, count, _CHUNK):
        _number(absorption.shape, barred, place, order, numbers, first, last)
        yield _STEP_PRICE * (last - first)
    return order[:count].copy(), numbers


_CHUNK, _STEP_PRICE = 50_000, 11
"""Cells of one part, and the time per cell in units of a solver's visit to a cell."""


@njit(cache=True, nogil=True)
def _reach(
    absorption: Float32Array, barred: Bytes, place: Indices, order: Indices, count: int, first: int, last: int
) -> int:
    """Append the unvisited neighbours of the cells from `first` to before `last`; return the new number of cells."""
    height, width = absorption.shape
    at = first
    while at < min(count, last):
        i, j = order[at] // width, order[at] % width
        for d in range(4):
            k, m = i - SIDES[d][0], j - SIDES[d][1]
            if not (0 <= k < height and 0 <= m < width) or absorption[k, m] == np.inf:
                continue
            if barred.size and (barred[i, j] | barred[k, m]) >> (2 * d) & 1:
                continue
            if place[k * width + m] < 0:
                place[k * width + m] = count
                order[count] = k * width + m
                count += 1
        at += 1
    return count


@njit(cache=True, nogil=True)
def _number(
    shape: tuple[int, int], barred: Bytes, place: Indices, order: Indices, numbers: Indices, first: int, last: int
) -> None:
    """Fill the neighbour numbers of the cells from `first` to before `last` in the order."""
    height, width = shape
    for at in range(first, last):
        i, j = order[at] // width, order[at] % width
        for d in range(4):
            k, m = i + SIDES[d][0], j + SIDES[d][1]
            numbers[at, d] = -1
            if not (0 <= k < height and 0 <= m < width):
                continue
            if not (barred.size and (barred[i, j] | barred[k, m]) >> (2 * d) & 1):
                numbers[at, d] = place[k * width + m]


@njit(cache=True, nogil=True)
def cells_near_shortest(numbers: Indices, start: int, detour: int) -> BoolArray:
    """Return (N,) which cells lie on a path from start to goal at most `detour` steps longer than the shortest.

    numbers (N, 4) are those of `breadth_first_order` without barred steps; `start` is the start's place in the order.
    """
    to_goal = np.zeros(len(numbers), np.int32)
    for k in range(1, len(numbers)):
        nearest = k
        for d in range(4):
            if 0 <= numbers[k, d] < nearest:
                nearest = numbers[k, d]
        to_goal[k] = to_goal[nearest] + 1
    longest = to_goal[start] + detour
    from_start = np.full(len(numbers), -1, np.int32)
    queue = np.empty(len(numbers), np.int32)
    from_start[start], queue[0] = 0, start
    count, at = 1, 0
    while at < count:
        k = queue[at]
        for d in range(4):
            beside = numbers[k, d]
            if beside >= 0 and from_start[beside] < 0 and from_start[k] + 1 + to_goal[beside] <= longest:
                from_start[beside] = from_start[k] + 1
                queue[count] = beside
                count += 1
        at += 1
    return from_start >= 0


@njit(cache=True, nogil=True)
def log_sweep(
    logs: FloatArray, numbers: Indices, diagonals: Float32Array, first: int, last: int, forward: bool
) -> float:
    """Relax the cells from `first` to before `last` from their neighbours; return the largest change.

    Unknown cells (-inf) contribute nothing.
    """
    largest = 0.0
    for step in range(first, last):
        k = step if forward else last - 1 - (step - first)
        best = -np.inf
        for d in range(4):
            if numbers[k, d] >= 0:
                best = max(best, logs[numbers[k, d]])
        total = 0.0
        for d in range(4):
            if numbers[k, d] >= 0:
                total += math.exp(logs[numbers[k, d]] - best)
        new = best + math.log(total / diagonals[k])
        largest = max(largest, abs(new - logs[k]))
        logs[k] = new
    return largest
