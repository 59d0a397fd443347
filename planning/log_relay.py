"""The harmonic field in logarithms: cells in the order in which it spreads from the goal, and sweeps along that order.

v falls by a factor with every width of a corridor, and leaves the range of float64 in a long building. Its logarithm
does not. A sweep in the order of the steps from the goal carries a change of scale through the whole map at once.
"""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np
from numba import njit
from numpy.typing import NDArray

from waychair.types import Bytes, Float32Array, FloatArray

Indices: TypeAlias = NDArray[np.int32]


@njit(cache=True, nogil=True)
def spread(absorption: Float32Array, barred: Bytes, row: int, column: int) -> tuple[Indices, Indices]:
    """Cells from which steps lead to a goal: flat indices (N,) in the order of their steps, and numbers (N, 4).

    A cell's numbers are its neighbours' places in that order, -1 where no step leads: into a wall, or against a one-way
    zone (`barred` (H, W) as in `grid_graph`, or empty). The goal is the first.
    """
    height, width = absorption.shape
    place = np.full(height * width, -1, np.int32)
    order = np.empty(height * width, np.int32)
    steps = ((0, 1), (1, 0), (0, -1), (-1, 0))
    order[0] = row * width + column
    place[order[0]] = 0
    count, at = 1, 0
    while at < count:
        i, j = order[at] // width, order[at] % width
        for d in range(4):
            k, m = i - steps[d][0], j - steps[d][1]
            if not (0 <= k < height and 0 <= m < width) or absorption[k, m] == np.inf:
                continue
            if barred.size and (barred[i, j] | barred[k, m]) >> (2 * d) & 1:
                continue
            if place[k * width + m] < 0:
                place[k * width + m] = count
                order[count] = k * width + m
                count += 1
        at += 1
    numbers = np.full((count, 4), -1, np.int32)
    for at in range(count):
        i, j = order[at] // width, order[at] % width
        for d in range(4):
            k, m = i + steps[d][0], j + steps[d][1]
            if (
                0 <= k < height
                and 0 <= m < width
                and not (barred.size and (barred[i, j] | barred[k, m]) >> (2 * d) & 1)
            ):
                numbers[at, d] = place[k * width + m]
    return order[:count].copy(), numbers


@njit(cache=True, nogil=True)
def log_sweep(
    logs: FloatArray, numbers: Indices, diagonals: Float32Array, first: int, last: int, forward: bool
) -> float:
    """Set cells from `first` to before `last` to what their neighbours say; returns the largest change.

    Cells that nothing is known of (-inf) count for nothing.
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
