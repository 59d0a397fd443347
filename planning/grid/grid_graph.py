"""The graph of all grid planners: cells with prices, eight neighbours, integer costs, no corner cutting.

A price is an integer, per mille of a free cell's price: 0 is impassable, 1000 a free cell. A straight step between two
free cells costs 10000, a diagonal one 14142. The cost is proportional to the mean of both prices, and so the same in
both directions. A diagonal step needs both orthogonal neighbours passable. In a one-way zone the steps against its
heading are barred: one bit per direction, in either cell of the step.

Costs are integers so that equal sums of costs compare equal. With floating point, keys that are equal in theory differ
by rounding, and D* Lite then silently keeps a path through a closed door.

Kernels see the grid with a border of impassable cells, flattened row by row, so that no neighbour needs a bounds check.
All that a search knows of a cell is in one record: a step to a neighbour reads one cache line, not four.
"""

from __future__ import annotations

import math
from typing import Any, TypeAlias

import numpy as np
from numba import njit
from numpy.typing import NDArray

from waychair.types import Bytes, IntArray

Prices: TypeAlias = NDArray[np.int32]
"""(H, W) int32, per mille of a free cell's price; 0 is impassable."""

Cell: TypeAlias = tuple[int, int]
"""Row and column."""

Records: TypeAlias = NDArray[Any]
"""Structured array; its fields are named where its dtype is made."""

SIDES = ((0, 1), (1, 0), (0, -1), (-1, 0))
"""The straight steps in rows and columns: every second of the eight directions."""

FREE_PRICE = 1000
MAX_PRICE = 1_000_000
STRAIGHT = 10_000
DIAGONAL = 14_142
UNREACHABLE = 1 << 61
"""A cost above all sums of costs; twice this still fits an int64."""

_BARRED_SHIFT = 20
_PRICE_BITS = (1 << _BARRED_SHIFT) - 1
"""A record's `ground` holds the price in its low bits and the barred directions in the eight above them."""


NO_BARS: Bytes = np.zeros((0, 0), np.uint8)
"""The barred directions for kernels where there is no one-way zone."""


def padded(prices: Prices, barred: Bytes | None = None) -> Prices:
    """Return flat grounds ((H + 2) * (W + 2),) int32 of an (H, W) grid inside a border of impassable cells.

    `barred` (H, W) has bit d set where no step may lead in direction d (see `offsets`), into or out of the cell.

    Raises:
        ValueError: a price that is neither 0 nor in [1000, 1000000]; cheaper ones would break the heuristic.
    """
    check_prices(prices)
    grounds = np.zeros((prices.shape[0] + 2, prices.shape[1] + 2), np.int32)
    grounds[1:-1, 1:-1] = prices
    if barred is not None:
        grounds[1:-1, 1:-1] |= barred.astype(np.int32) << _BARRED_SHIFT
    return grounds.ravel()


def check_changes(cells: IntArray, prices: Prices, shape: tuple[int, int]) -> None:
    """Refuse impossible new prices (N,) of cells (N, 2) in an (H, W) grid.

    Raises:
        ValueError: a cell outside the grid, an impossible price, arrays of different length.
    """
    if len(cells) != len(prices):
        raise ValueError(f"{len(cells)} cells but {len(prices)} prices")
    if ((cells < 0) | (cells >= shape)).any():
        raise ValueError(f"changed cells must lie in the {shape[0]} x {shape[1]} grid")
    check_prices(prices)


def check_prices(prices: Prices) -> None:
    """Refuse prices with which the searches would not be exact.

    Raises:
        ValueError: as in `padded`.
    """
    bad = (prices != 0) & ((prices < FREE_PRICE) | (prices > MAX_PRICE))
    if bad.any():
        raise ValueError(f"price {prices[bad][0]} is neither 0 (impassable) nor in [{FREE_PRICE}, {MAX_PRICE}]")


def padded_index(cell: Cell, shape: tuple[int, int]) -> int:
    """Return the flat index of a (row, column) of an (H, W) grid in its padded copy.

    Raises:
        ValueError: the cell lies outside the grid.
    """
    row, column = int(cell[0]), int(cell[1])
    if not (0 <= row < shape[0] and 0 <= column < shape[1]):
        raise ValueError(f"cell ({row}, {column}) lies outside the {shape[0]} x {shape[1]} grid")
    return (row + 1) * (shape[1] + 2) + column + 1


def cells_from_padded(indices: NDArray[np.int32], shape: tuple[int, int]) -> IntArray:
    """Return (N, 2) row and column of flat indices (N,) into the padded copy of an (H, W) grid."""
    rows, columns = np.divmod(indices.astype(np.int64), shape[1] + 2)
    return np.stack([rows - 1, columns - 1], axis=-1)


def offsets(stride: int) -> IntArray:
    """Return (9,) steps to the neighbours in a flat grid of rows `stride` long.

    Direction d points d * 45 degrees from +column to +row; even ones are straight; the first is repeated at the end.
    """
    return np.array([1, 1 + stride, stride, stride - 1, -1, -1 - stride, -stride, 1 - stride, 1])


def directions_against(heading: float) -> int:
    """Return the directions, as bits, that lead against a heading [rad] in the grid's frame; sideways is allowed."""
    return sum(1 << d for d in range(8) if math.cos(d * math.pi / 4 - heading) < -1e-9)


@njit(cache=True, inline="always")
def price_of(ground: int) -> int:
    """Return the price in a ground."""
    return int(ground) & _PRICE_BITS


@njit(cache=True, nogil=True)
def set_prices(records: Records, cells: IntArray, prices: Prices, height: int, width: int) -> bool:
    """Give cells (N, 2) of an (H, W) grid new prices (N,); if one is impossible, change none and return false.

    Barred directions stay.
    """
    for i in range(len(cells)):
        possible = prices[i] == 0 or FREE_PRICE <= prices[i] <= MAX_PRICE
        if not (possible and 0 <= cells[i, 0] < height and 0 <= cells[i, 1] < width):
            return False
    for i in range(len(cells)):
        record = records[(cells[i, 0] + 1) * (width + 2) + cells[i, 1] + 1]
        record.ground = (record.ground & ~_PRICE_BITS) | prices[i]
    return True


@njit(cache=True, inline="always")
def least_step(direction: int) -> int:
    """Return the least cost of a step in a direction."""
    return STRAIGHT if direction % 2 == 0 else DIAGONAL


@njit(cache=True, inline="always")
def step_cost(cells: Records, cell: int, direction: int, steps: IntArray, backward: bool) -> int:
    """Return the cost of the step from a cell in a direction, or of the step `backward` from there into the cell.

    UNREACHABLE when it is barred. `cells` are records with a `ground`, `steps` are the `offsets`.
    """
    ground, ground_there = cells[cell].ground, cells[cell + steps[direction]].ground
    price, price_there = price_of(ground), price_of(ground_there)
    if price == 0 or price_there == 0:
        return UNREACHABLE
    barred = (ground | ground_there) >> _BARRED_SHIFT
    if barred != 0 and barred >> ((direction ^ 4) if backward else direction) & 1:
        return UNREACHABLE
    if direction % 2 == 0:
        return int(STRAIGHT // (2 * FREE_PRICE) * (price + price_there))
    before, after = cells[cell + steps[direction - 1]].ground, cells[cell + steps[direction + 1]].ground
    if price_of(before) == 0 or price_of(after) == 0:
        return UNREACHABLE
    return int(DIAGONAL // 2 * (price + price_there) // FREE_PRICE)


@njit(cache=True, inline="always")
def octile(row: int, column: int, cell: int, stride: int) -> int:
    """Return the cost of the cheapest path over free floor from a row and column to a flat index of the padded grid.

    It is a consistent heuristic for prices >= 1000.
    """
    cell_row = int(np.uint64(cell) // np.uint64(stride))  # unsigned division is the faster one
    rows, columns = abs(cell_row - row), abs(cell - cell_row * stride - column)
    return STRAIGHT * max(rows, columns) + (DIAGONAL - STRAIGHT) * min(rows, columns)
