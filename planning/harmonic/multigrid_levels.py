"""The levels of a multigrid cycle for Laplace's equation on a grid with holes, and the operations within one level.

Every free cell is linked to its four neighbours: diagonal * x - sum of neighbours = b, walls hold 0. A coarse cell
stands for two by two fine ones and is free if any of them is. The distance of a wall from a coarse cell's middle is
kept per direction: it is not a whole number of cells (finite volumes with a border that cuts a cell).

The smoother is a Chebyshev polynomial of the fourth kind with the optimal weights for a V-cycle (Lottes, Optimal
polynomial smoothers for multigrid V-cycles, 2022). Each step is a product with the matrix; no cell waits for another.

All arrays have a border of cells that are not free, so that no neighbour needs a bounds check.
"""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

import numpy as np
from numba import njit

from waychair.planning.harmonic.row_threads import over_rows
from waychair.planning.harmonic.scratch_memory import LINE, ScratchMemory, new_scratch_memory
from waychair.types import Bytes, Float32Array, FloatArray

AnyFloat: TypeAlias = Float32Array | FloatArray

_NEAREST_WALL = 4.0
"""Largest weight of a wall's link per fine cell of a coarse one. A wall still nearer to the coarse cell's middle, or
past it, has no larger effect."""

_COARSEST, COARSEST_SWEEPS = 6, 8
"""Largest side [cells] of a level that is solved by smoothing alone, and how often it is smoothed."""


def _polynomial() -> tuple[np.float32, np.float32]:
    """Return the smoother's coefficients of u, the residual over the diagonal, and of u's neighbours over the diagonal.

    Two steps of Lottes' algorithm 3 with the weights of its table 1. No eigenvalue of the matrix over its diagonal
    exceeds 2, since a cell's links weigh no more than its diagonal.
    """
    first, second = 1.02387287570313, 1.26408905371085
    share, before, after = 4 / 3 / 2, 1 / 5, 12 / 5 / 2
    # one step is share * u; the residual over the diagonal after it is u - share * (u - passed on)
    return (
        np.float32(first * share + second * (before * share + after * (1 - share))),
        np.float32(second * after * share),
    )


OF_ITSELF, OF_NEIGHBOURS = _polynomial()

SUMMED = {"reassoc", "contract", "nsz"}
"""Fast-math flags for sums, so that the compiler adds in several lanes. They are used only where no array is written:
elsewhere the array alignment would decide on vectorisation, and thereby on the last digits. `ninf` is not among them:
walls have infinite absorption."""


class MultigridLevel(NamedTuple):
    """One level's grid, (H + 2, W + 2) with its border.

    `east` and `south` hold the weights of the links to the next column and row (empty if `uniform`, then all 1);
    `inverse` is one over the diagonal, 0 where a cell is not free. `b` is the right-hand side, `x` the solution.
    """

    east: Float32Array
    south: Float32Array
    inverse: Float32Array
    uniform: bool
    x: Float32Array
    b: Float32Array


def levels_from(absorption: Float32Array, memory: ScratchMemory | None = None) -> tuple[MultigridLevel, ...]:
    """Return the levels, finest first, of a grid with absorption (H, W); infinite absorption is a wall.

    Their arrays are taken from `memory`, if given, which must have `levels_size` bytes.
    """
    shapes = _shapes(absorption.shape)
    memory = memory or new_scratch_memory(levels_size(absorption.shape))
    inverse = memory.framed(shapes[0])
    over_rows(_begin, 0, absorption.shape[0], absorption.size, absorption, inverse)
    none = np.zeros((0, 0), np.float32)
    levels = [
        MultigridLevel(
            east=none, south=none, inverse=inverse, uniform=True, x=memory.framed(shapes[0]), b=memory.framed(shapes[0])
        )
    ]
    taken = _CellAbsorption(np.zeros((0, 0, 4), np.float32), np.zeros((0, 0), np.uint8), absorption)
    for shape in shapes[1:]:
        coarser, taken = _coarser(levels[-1], taken, shape, memory)
        levels.append(coarser)
    return tuple(levels)


def levels_size(shape: tuple[int, ...]) -> int:
    """Return the size [bytes] of the levels of a grid (H, W)."""
    finest, *coarser = (height * width for height, width in _shapes(shape))
    # inverse, x and b; coarser levels also have links and the arrays of `_CellAbsorption`
    numbers = 3 * finest + (5 + 5) * sum(coarser)
    return 4 * numbers + sum(coarser) + LINE * (3 + 8 * len(coarser))


def _shapes(shape: tuple[int, ...]) -> list[tuple[int, int]]:
    """Return the shapes of all levels of a grid (H, W), with their borders."""
    shapes = [(shape[0] + 2, shape[1] + 2)]
    while min(shapes[-1]) - 2 > _COARSEST:
        shapes.append(((shapes[-1][0] - 1) // 2 + 2, (shapes[-1][1] - 1) // 2 + 2))
    return shapes


class _CellAbsorption(NamedTuple):
    """The absorption of a level's cells (H, W): by walls (H, W, 4) to the east, south, west, north, and by themselves.

    `by_walls` is valid where `walled`. The uniform level, where every cell that is not free is a wall, has `itself`
    only.
    """

    by_walls: Float32Array
    walled: Bytes
    itself: Float32Array


def _coarser(
    fine: MultigridLevel, taken: _CellAbsorption, shape: tuple[int, int], memory: ScratchMemory
) -> tuple[MultigridLevel, _CellAbsorption]:
    """Return the next coarser level, of this shape, and its cells' absorption."""
    inner = (shape[0] - 2, shape[1] - 2)
    east, south, inverse, x, b = (memory.framed(shape) for _ in range(5))
    coarser = MultigridLevel(east=east, south=south, inverse=inverse, uniform=False, x=x, b=b)
    new = _CellAbsorption(memory.take((*inner, 4)), memory.take(inner, np.uint8), memory.take(inner))
    over_rows(_gather, 1, shape[0] - 1, fine.x.size, fine, taken, coarser, new)
    over_rows(_invert, 1, shape[0] - 1, fine.x.size, coarser, new.itself)
    return coarser, new


@njit(cache=True, nogil=True)
def _begin(absorption: Float32Array, inverse: Float32Array, first: int, stop: int) -> None:
    """Fill rows of the finest level."""
    for i in range(first, stop):
        for j in range(absorption.shape[1]):
            inverse[i + 1, j + 1] = np.float32(1.0) / (np.float32(4.0) + absorption[i, j])


@njit(cache=True, nogil=True)
def _gather(
    fine: MultigridLevel,
    taken: _CellAbsorption,
    coarser: MultigridLevel,
    new: _CellAbsorption,
    first: int,
    stop: int,
) -> None:
    """Fill rows of the next level; `inverse` becomes 1 plus the walls' absorption in free cells, else 0."""
    height, width = fine.x.shape
    east, south, inverse = coarser.east, coarser.south, coarser.inverse
    free, half, one = fine.inverse, np.float32(0.5), np.float32(1.0)
    for row in range(first, stop):
        for column in range(1, inverse.shape[1] - 1):
            i, j = 2 * row - 1, 2 * column - 1
            new.walled[row - 1, column - 1] = 0
            if i + 2 < height and j + 2 < width:
                if fine.uniform:
                    plain = _is_inner(free, i, j)
                else:
                    walled = taken.walled
                    plain = not (walled[i - 1, j - 1] | walled[i - 1, j] | walled[i, j - 1] | walled[i, j])
                if plain:
                    above, below = taken.itself[i - 1], taken.itself[i]
                    new.itself[row - 1, column - 1] = above[j - 1] + above[j] + below[j - 1] + below[j]
                    if fine.uniform:
                        inverse[row, column] = east[row, column] = south[row, column] = one
                    else:
                        anywhere = free[i, j] + free[i, j + 1] + free[i + 1, j] + free[i + 1, j + 1]
                        inverse[row, column] = one if anywhere > 0 else np.float32(0.0)
                        east[row, column] = half * (fine.east[i, j + 1] + fine.east[i + 1, j + 1])
                        south[row, column] = half * (fine.south[i + 1, j] + fine.south[i + 1, j + 1])
                    continue
            _gather_cell(fine, taken, coarser, new, row, column)


@njit(cache=True, nogil=True)
def _gather_cell(
    fine: MultigridLevel, taken: _CellAbsorption, coarser: MultigridLevel, new: _CellAbsorption, row: int, column: int
) -> None:
    """Fill a cell of the next level beside walls or at the far border, where it may have fewer than four fine cells."""
    height, width = fine.x.shape
    east, south, inverse = coarser.east, coarser.south, coarser.inverse
    free, half = fine.inverse, np.float32(0.5)
    inverse[row, column] = east[row, column] = south[row, column] = new.itself[row - 1, column - 1] = 0.0
    new.by_walls[row - 1, column - 1] = 0.0
    for i in range(2 * row - 1, min(2 * row + 1, height - 1)):
        for j in range(2 * column - 1, min(2 * column + 1, width - 1)):
            if not free[i, j] > 0:
                continue
            inverse[row, column] = max(inverse[row, column], np.float32(1.0))
            new.itself[row - 1, column - 1] += taken.itself[i - 1, j - 1]
            if j % 2 == 0:
                link = np.float32(free[i, j + 1] > 0) if fine.uniform else fine.east[i, j]
                east[row, column] += half * link
            if i % 2 == 0:
                link = np.float32(free[i + 1, j] > 0) if fine.uniform else fine.south[i, j]
                south[row, column] += half * link
            for d in range(4):
                if fine.uniform:
                    beside = free[i + (d == 1) - (d == 3), j + (d == 0) - (d == 2)]
                    wall = np.float32(0.0 if beside > 0 else 1.0)
                else:
                    wall = taken.by_walls[i - 1, j - 1, d] if taken.walled[i - 1, j - 1] else np.float32(0.0)
                if wall > 0:
                    outer = ((i if d % 2 else j) % 2 == 0) == (d < 2)
                    weight = np.float32(_coarse_wall_weight(float(wall), outer))
                    new.by_walls[row - 1, column - 1, d] += weight
                    new.walled[row - 1, column - 1] = 1
                    inverse[row, column] += weight


@njit(cache=True, nogil=True)
def _invert(level: MultigridLevel, itself: Float32Array, first: int, stop: int) -> None:
    """Turn `inverse` into one over the diagonal in the free cells of rows."""
    east, south, inverse, one = level.east, level.south, level.inverse, np.float32(1.0)
    for i in range(first, stop):
        for j in range(1, inverse.shape[1] - 1):
            if inverse[i, j] > 0:
                links = east[i, j] + east[i, j - 1] + south[i, j] + south[i - 1, j]
                inverse[i, j] = one / max(links + (inverse[i, j] - one) + itself[i - 1, j - 1], np.float32(1e-6))


@njit(cache=True, nogil=True, inline="always")
def _is_inner(free: Float32Array, i: int, j: int) -> bool:
    """Return whether two by two cells and all cells beside them are free."""
    inner = free[i, j] > 0 and free[i, j + 1] > 0 and free[i + 1, j] > 0 and free[i + 1, j + 1] > 0
    rows = free[i - 1, j] > 0 and free[i - 1, j + 1] > 0 and free[i + 2, j] > 0 and free[i + 2, j + 1] > 0
    columns = free[i, j - 1] > 0 and free[i + 1, j - 1] > 0 and free[i, j + 2] > 0 and free[i + 1, j + 2] > 0
    return bool(inner and rows and columns)


@njit(cache=True, nogil=True, inline="always")
def _coarse_wall_weight(wall: float, outer: bool) -> float:
    """Return a wall's weight for a coarse cell, from its weight for one of the fine cells.

    A wall's weight is one over its distance from the cell's middle. The coarse cell's middle is half a fine cell
    farther (`outer`) or nearer. In coarse cells the distance counts half, and each of the two fine cells counts half.
    """
    nearer = 1.0 + 0.5 * wall if outer else max(1.0 - 0.5 * wall, 1e-3)
    return min(wall / nearer, _NEAREST_WALL)


@njit(cache=True, nogil=True, inline="always")
def neighbour_sum(
    level: MultigridLevel, x: Float32Array, above: int, here: int, below: int, i: int, j: int
) -> np.float32:
    """Return the weighted sum of a cell's neighbours; `above`, `here` and `below` are the indices of the rows in x.

    All arrays hold 0 in walls.
    """
    near: np.float32
    if level.uniform:
        near = (x[here, j + 1] + x[here, j - 1]) + (x[below, j] + x[above, j])
    else:
        across = level.east[i, j] * x[here, j + 1] + level.east[i, j - 1] * x[here, j - 1]
        near = across + (level.south[i, j] * x[below, j] + level.south[i - 1, j] * x[above, j])
    return near


@njit(cache=True, nogil=True)
def solve_coarsest(level: MultigridLevel) -> float:
    """Solve a small level by repeated smoothing from x = 0; return the product of x and b."""
    x, b, inverse = level.x, level.b, level.inverse
    left = np.zeros_like(x)
    x[:] = 0.0
    for _ in range(COARSEST_SWEEPS):
        for i in range(1, x.shape[0] - 1):
            for j in range(1, x.shape[1] - 1):
                left[i, j] = inverse[i, j] * (b[i, j] + neighbour_sum(level, x, i - 1, i, i + 1, i, j)) - x[i, j]
        for i in range(1, x.shape[0] - 1):
            for j in range(1, x.shape[1] - 1):
                near = inverse[i, j] * neighbour_sum(level, left, i - 1, i, i + 1, i, j)
                x[i, j] += OF_ITSELF * left[i, j] + OF_NEIGHBOURS * near
    return product_of_rows(b, x, 1, x.shape[0] - 1)


@njit(cache=True, nogil=True, fastmath=SUMMED)
def product_of_row(first: AnyFloat, second: AnyFloat, i: int) -> float:
    """Return one row's share of the product of two vectors."""
    total = 0.0
    for j in range(first.shape[1]):
        total += np.float64(first[i, j]) * np.float64(second[i, j])
    return total


@njit(cache=True, nogil=True)
def product_of_rows(first: AnyFloat, second: AnyFloat, begin: int, stop: int) -> float:
    """Return the sum of `product_of_row` over the rows from `begin` to before `stop`."""
    total = 0.0
    for i in range(begin, stop):
        total += product_of_row(first, second, i)
    return total
