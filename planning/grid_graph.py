"""The graph that all grid planners search: cells with prices, eight neighbours, integer costs, no corner cutting.

A price is an integer per mille of a free cell's price: 0 is impassable, 1000 a free cell, more is dearer. A straight
step between two free cells costs 10000, a diagonal one 14142; between dearer cells the cost grows with the mean of
both prices, so that it is the same in both directions. A diagonal step needs both orthogonal neighbours passable.

Costs are integers because planners that order a queue by sums of costs must see ties as ties: with floating point, keys
that are equal in theory differ by rounding, and D* Lite then silently keeps a path through a closed door.

Kernels see the grid with a border of impassable cells, flattened row by row, so that no neighbour needs a bounds check.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numba import njit
from numpy.typing import NDArray

from waychair.types import IntArray

Prices: TypeAlias = NDArray[np.int32]
"""(H, W) int32, per mille of a free cell's price; 0 is impassable."""

Cell: TypeAlias = tuple[int, int]
"""Row and column."""

FREE_PRICE = 1000
MAX_PRICE = 1_000_000
STRAIGHT = 10_000
DIAGONAL = 14_142
UNREACHABLE = 1 << 61
"""A cost above all sums of costs; twice it still fits an int64."""


def padded(prices: Prices) -> Prices:
    """Flat copy ((H + 2) * (W + 2),) of an (H, W) grid inside a border of impassable cells.

    Raises:
        ValueError: a price that is neither 0 nor in [1000, 1000000]; cheaper ones would break the heuristic.
    """
    check_prices(prices)
    return np.pad(prices.astype(np.int32, copy=False), 1).ravel()


def check_prices(prices: Prices) -> None:
    """Refuse prices that the searches cannot be exact with.

    Raises:
        ValueError: as in `padded`.
    """
    bad = (prices != 0) & ((prices < FREE_PRICE) | (prices > MAX_PRICE))
    if bad.any():
        raise ValueError(f"price {prices[bad][0]} is neither 0 (impassable) nor in [{FREE_PRICE}, {MAX_PRICE}]")


def padded_index(cell: Cell, shape: tuple[int, int]) -> int:
    """Flat index of a (row, column) of an (H, W) grid in its padded copy.

    Raises:
        ValueError: the cell lies outside the grid.
    """
    row, column = int(cell[0]), int(cell[1])
    if not (0 <= row < shape[0] and 0 <= column < shape[1]):
        raise ValueError(f"cell ({row}, {column}) lies outside the {shape[0]} x {shape[1]} grid")
    return (row + 1) * (shape[1] + 2) + column + 1


def cells_from_padded(indices: NDArray[np.int32], shape: tuple[int, int]) -> IntArray:
    """(N, 2) row and column of flat indices (N,) into the padded copy of an (H, W) grid."""
    rows, columns = np.divmod(indices.astype(np.int64), shape[1] + 2)
    return np.stack([rows - 1, columns - 1], axis=-1)


@njit(cache=True, inline="always")
def neighbour(direction: int, stride: int) -> int:
    """Offset of one of the eight neighbours in a flat grid of rows `stride` long; even directions are straight."""
    if direction == 0:
        return 1
    if direction == 1:
        return 1 + stride
    if direction == 2:
        return stride
    if direction == 3:
        return stride - 1
    if direction == 4:
        return -1
    if direction == 5:
        return -1 - stride
    if direction == 6:
        return -stride
    return 1 - stride


@njit(cache=True, inline="always")
def step_cost(prices: Prices, cell: int, direction: int, stride: int) -> int:
    """Cost of the step from a cell in a direction, the same as that of the step back; UNREACHABLE when it is barred."""
    offset = neighbour(direction, stride)
    here, there = np.int64(prices[cell]), np.int64(prices[cell + offset])
    if here == 0 or there == 0:
        return UNREACHABLE
    if direction % 2 == 0:
        return int(STRAIGHT * (here + there) // (2 * FREE_PRICE))
    before, after = neighbour(direction - 1, stride), neighbour((direction + 1) % 8, stride)
    if prices[cell + before] == 0 or prices[cell + after] == 0:
        return UNREACHABLE
    return int((DIAGONAL // 2) * (here + there) // FREE_PRICE)


@njit(cache=True, inline="always")
def octile(first: int, second: int, stride: int) -> int:
    """Cost of the cheapest way between two cells of an empty, free grid: a consistent heuristic for prices >= 1000."""
    rows = abs(first // stride - second // stride)
    columns = abs(first % stride - second % stride)
    return STRAIGHT * abs(rows - columns) + DIAGONAL * min(rows, columns)
