"""The grids of a multigrid cycle for Laplace's equation on a grid with holes, and what is done within one of them.

Every free cell is linked to its four neighbours: diagonal * x - sum of neighbours = b, walls hold 0. A coarse cell
stands for two by two fine ones and is free when any of them is. How far a wall is from a coarse cell's middle is kept by
direction: it is no whole number of cells (finite volumes whose border cuts a cell).

Levels are smoothed by Chebyshev's polynomials of the fourth kind with the best weights for a V-cycle (Lottes, Optimal
polynomial smoothers for multigrid V-cycles, 2022), in which each step is a product with the matrix and no cell waits for
another.

All arrays have a border of cells that are not free, so that no neighbour needs a bounds check.
"""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

import numpy as np
from numba import njit

from waychair.planning.bands import in_bands
from waychair.planning.memory import LINE, Memory, new_memory
from waychair.types import Bytes, Float32Array, FloatArray

AnyFloat: TypeAlias = Float32Array | FloatArray

_NEAREST_WALL = 4.0
"""Weight that a wall's link has at most for each of a coarse cell's fine ones: one still nearer to the coarse cell's
middle, or past it, says no more than that the wall is there."""

_COARSEST, COARSEST_SWEEPS = 6, 8
"""Sides up to which a level is solved by smoothing alone [cells], and how often it is smoothed."""


def _polynomial() -> tuple[np.float32, np.float32]:
    """What a smoothing adds of u, which is what is left over the diagonal, and of what u's neighbours pass on over it.

    Two steps of Lottes' algorithm 3 with the weights of its table 1. No eigenvalue of the matrix over its diagonal is
    larger than 2: a cell's links weigh no more than its diagonal.
    """
    first, second = 1.02387287570313, 1.26408905371085
    share, before, after = 4 / 3 / 2, 1 / 5, 12 / 5 / 2
    # one step is share * u; what is left over the diagonal after it, u - share * (u - passed on)
    return (
        np.float32(first * share + second * (before * share + after * (1 - share))),
        np.float32(second * after * share),
    )


OF_ITSELF, OF_NEIGHBOURS = _polynomial()

SUMMED = {"reassoc", "contract", "nsz"}
"""What a compiler may do to a sum, so that it is added up in several lanes. Only where nothing is written: elsewhere it
would hang on where the arrays lie whether it does, and with that the last digits. Not that nothing is infinite: walls
absorb so much."""


class Level(NamedTuple):
    """One grid, (H + 2, W + 2) with its border.

    `east` and `south` hold the weights of the links to the next column and row (empty where they are `uniform`, all 1),
    `inverse` one over the diagonal, 0 where a cell is not free. `b` is what to solve, `x` what was found.
    """

    east: Float32Array
    south: Float32Array
    inverse: Float32Array
    uniform: bool
    x: Float32Array
    b: Float32Array


def levels_from(absorption: Float32Array, memory: Memory | None = None) -> tuple[Level, ...]:
    """The levels of a grid whose cells (H, W) absorb, the finest first; those that absorb infinitely are walls.

    They lie in the memory, if one is given, which has the `size_of_levels`.
    """
    shapes = _shapes(absorption.shape)
    memory = memory or new_memory(size_of_levels(absorption.shape))
    inverse = memory.framed(shapes[0])
    in_bands(_begin, 0, absorption.shape[0], absorption.size, absorption, inverse)
    none = np.zeros((0, 0), np.float32)
    levels = [Level(none, none, inverse, True, memory.framed(shapes[0]), memory.framed(shapes[0]))]
    taken = _Taken(np.zeros((0, 0, 4), np.float32), np.zeros((0, 0), np.uint8), absorption)
    for shape in shapes[1:]:
        coarser, taken = _coarser(levels[-1], taken, shape, memory)
        levels.append(coarser)
    return tuple(levels)


def size_of_levels(shape: tuple[int, ...]) -> int:
    """Bytes that the levels of a grid (H, W) take."""
    finest, *coarser = (height * width for height, width in _shapes(shape))
    # inverse, x and b; of coarser ones links, what is taken of each cell, and whether walls do, too
    numbers = 3 * finest + (5 + 5) * sum(coarser)
    return 4 * numbers + sum(coarser) + LINE * (3 + 8 * len(coarser))


def _shapes(shape: tuple[int, ...]) -> list[tuple[int, int]]:
    """Of all levels of a grid (H, W), with their borders."""
    shapes = [(shape[0] + 2, shape[1] + 2)]
    while min(shapes[-1]) - 2 > _COARSEST:
        shapes.append(((shapes[-1][0] - 1) // 2 + 2, (shapes[-1][1] - 1) // 2 + 2))
    return shapes


class _Taken(NamedTuple):
    """What is taken of a level's cells (H, W): by walls (H, W, 4) to the east, south, west and north, valid where there
    are any (`walled`), and by themselves.

    Of the uniform level, where a cell that is not free is a wall to its neighbours, only the last.
    """

    by_walls: Float32Array
    walled: Bytes
    itself: Float32Array


def _coarser(fine: Level, taken: _Taken, shape: tuple[int, int], memory: Memory) -> tuple[Level, _Taken]:
    """The next level, of this shape, and what is taken of its cells."""
    inner = (shape[0] - 2, shape[1] - 2)
    east, south, inverse, x, b = (memory.framed(shape) for _ in range(5))
    coarser = Level(east, south, inverse, False, x, b)
    new = _Taken(memory.take((*inner, 4)), memory.take(inner, np.uint8), memory.take(inner))
    in_bands(_gather, 1, shape[0] - 1, fine.x.size, fine, taken, coarser, new)
    in_bands(_invert, 1, shape[0] - 1, fine.x.size, coarser, new.itself)
    return coarser, new


@njit(cache=True, nogil=True)
def _begin(absorption: Float32Array, inverse: Float32Array, first: int, stop: int) -> None:
    """Rows of the finest level."""
    for i in range(first, stop):
        for j in range(absorption.shape[1]):
            inverse[i + 1, j + 1] = np.float32(1.0) / (np.float32(4.0) + absorption[i, j])


@njit(cache=True, nogil=True)
def _gather(
    fine: Level,
    taken: _Taken,
    coarser: Level,
    new: _Taken,
    first: int,
    stop: int,
) -> None:
    """Rows of the next level; `inverse` is one more than walls take of a cell that is free, and 0 else."""
    height, width = fine.x.shape
    east, south, inverse = coarser.east, coarser.south, coarser.inverse
    free, half, one = fine.inverse, np.float32(0.5), np.float32(1.0)
    for row in range(first, stop):
        for column in range(1, inverse.shape[1] - 1):
            i, j = 2 * row - 1, 2 * column - 1
            new.walled[row - 1, column - 1] = 0
            if i + 2 < height and j + 2 < width:
                if fine.uniform:
                    plain = _amid(free, i, j)
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
def _gather_cell(fine: Level, taken: _Taken, coarser: Level, new: _Taken, row: int, column: int) -> None:
    """A cell of the next level with walls about, or at the far border, which may have fewer than four fine ones."""
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
                    weight = np.float32(_wall_of_coarser(float(wall), outer))
                    new.by_walls[row - 1, column - 1, d] += weight
                    new.walled[row - 1, column - 1] = 1
                    inverse[row, column] += weight


@njit(cache=True, nogil=True)
def _invert(level: Level, itself: Float32Array, first: int, stop: int) -> None:
    """One over the diagonal in the free cells of rows."""
    east, south, inverse, one = level.east, level.south, level.inverse, np.float32(1.0)
    for i in range(first, stop):
        for j in range(1, inverse.shape[1] - 1):
            if inverse[i, j] > 0:
                links = east[i, j] + east[i, j - 1] + south[i, j] + south[i - 1, j]
                inverse[i, j] = one / max(links + (inverse[i, j] - one) + itself[i - 1, j - 1], np.float32(1e-6))


@njit(cache=True, nogil=True, inline="always")
def _amid(free: Float32Array, i: int, j: int) -> bool:
    """Whether two by two cells are free, and those beside them are."""
    inner = free[i, j] > 0 and free[i, j + 1] > 0 and free[i + 1, j] > 0 and free[i + 1, j + 1] > 0
    rows = free[i - 1, j] > 0 and free[i - 1, j + 1] > 0 and free[i + 2, j] > 0 and free[i + 2, j + 1] > 0
    columns = free[i, j - 1] > 0 and free[i + 1, j - 1] > 0 and free[i, j + 2] > 0 and free[i + 1, j + 2] > 0
    return bool(inner and rows and columns)


@njit(cache=True, nogil=True, inline="always")
def _wall_of_coarser(wall: float, outer: bool) -> float:
    """What a wall takes of a coarse cell by one of its fine ones, of which it takes so much.

    A wall's weight is one over its distance from the cell's middle. Half a fine cell farther (`outer`), or nearer, is
    that of the coarse cell; the distance counts half as much in its wider cells, and each of its two fine cells for half.
    """
    nearer = 1.0 + 0.5 * wall if outer else max(1.0 - 0.5 * wall, 1e-3)
    return min(wall / nearer, _NEAREST_WALL)


@njit(cache=True, nogil=True, inline="always")
def passed_on(level: Level, x: Float32Array, above: int, here: int, below: int, i: int, j: int) -> np.float32:
    """What the neighbours of a cell pass on to it: x has its row and those beside it as `here`, `above` and `below`.

    Walls hold 0, as all arrays here do there.
    """
    near: np.float32
    if level.uniform:
        near = (x[here, j + 1] + x[here, j - 1]) + (x[below, j] + x[above, j])
    else:
        across = level.east[i, j] * x[here, j + 1] + level.east[i, j - 1] * x[here, j - 1]
        near = across + (level.south[i, j] * x[below, j] + level.south[i - 1, j] * x[above, j])
    return near


@njit(cache=True, nogil=True)
def settle(level: Level) -> float:
    """Find a small level's x by smoothing it from 0, again and again; returns the product of x and b."""
    x, b, inverse = level.x, level.b, level.inverse
    left = np.zeros_like(x)
    x[:] = 0.0
    for _ in range(COARSEST_SWEEPS):
        for i in range(1, x.shape[0] - 1):
            for j in range(1, x.shape[1] - 1):
                left[i, j] = inverse[i, j] * (b[i, j] + passed_on(level, x, i - 1, i, i + 1, i, j)) - x[i, j]
        for i in range(1, x.shape[0] - 1):
            for j in range(1, x.shape[1] - 1):
                near = inverse[i, j] * passed_on(level, left, i - 1, i, i + 1, i, j)
                x[i, j] += OF_ITSELF * left[i, j] + OF_NEIGHBOURS * near
    return product_of_rows(b, x, 1, x.shape[0] - 1)


@njit(cache=True, nogil=True, fastmath=SUMMED)
def product_of_row(first: AnyFloat, second: AnyFloat, i: int) -> float:
    """Of two vectors, what a row adds to their product."""
    total = 0.0
    for j in range(first.shape[1]):
        total += np.float64(first[i, j]) * np.float64(second[i, j])
    return total


@njit(cache=True, nogil=True)
def product_of_rows(first: AnyFloat, second: AnyFloat, begin: int, stop: int) -> float:
    """`product_of_row` of the rows from `begin` to before `stop`."""
    total = 0.0
    for i in range(begin, stop):
        total += product_of_row(first, second, i)
    return total
