"""Conjugate gradients preconditioned by multigrid, for Laplace's equation on a grid with holes.

Every free cell is linked to its four neighbours: diagonal * x - sum of neighbours = b, walls hold 0. A coarse cell
stands for two by two fine ones and is free when any of them is. The V-cycle (Briggs, Henson and McCormick, A Multigrid
Tutorial, 2000, chapter 3) interpolates bilinearly between the middles of cells and restricts by the transpose. It
smooths by Chebyshev's polynomials of the fourth kind with the best weights for a V-cycle (Lottes, Optimal polynomial
smoothers for multigrid V-cycles, 2022): the same ones before and after the correction, so that the cycle is symmetric
and may precondition conjugate gradients (Tatebe 1993), and each step of one is a product with the matrix, in which no
cell waits for another. How far a wall is from a coarse cell's middle is kept by direction: it is no whole number of
cells (finite volumes whose border cuts a cell).

The cycle computes in float32, twice as many cells at a time: it says where to go, not how far it is still. What it is
to solve, and what is left of it, are float64.

All arrays have a border of cells that are not free, so that no neighbour needs a bounds check.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import NamedTuple, TypeAlias

import numpy as np
from numba import njit

from waychair.planning.slices import Parts, finished
from waychair.types import Float32Array, FloatArray

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

_PASS = 5
"""Cells that a sweep of the cycle goes through while other work on the field goes through one."""

_SUMMED = {"reassoc", "contract", "nsz"}
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


def levels_from(absorption: Float32Array) -> tuple[Level, ...]:
    """The levels of a grid whose cells (H, W) absorb, the finest first; those that absorb infinitely are walls."""
    kept = np.pad(absorption, 1, constant_values=np.inf)
    none = np.zeros((0, 0), np.float32)
    levels = [_level(none, none, np.float32(1.0) / (np.float32(4.0) + kept))]
    walls = np.zeros((0, 0, 4), np.float32)
    while min(levels[-1].x.shape) - 2 > _COARSEST:
        east, south, walls, kept, inverse = _coarser(levels[-1], walls, kept)
        levels.append(_level(east, south, inverse))
    return tuple(levels)


def _level(east: Float32Array, south: Float32Array, inverse: Float32Array) -> Level:
    """Uniform where no links are given."""
    x, b = (np.zeros(inverse.shape, np.float32) for _ in range(2))
    return Level(east, south, inverse, east.size == 0, x, b)


@njit(cache=True, nogil=True)
def _coarser(
    fine: Level, walls: Float32Array, kept: Float32Array
) -> tuple[Float32Array, Float32Array, Float32Array, Float32Array, Float32Array]:
    """The next level's links to the east and the south, what walls and it itself take of each cell, and `inverse`.

    walls (H + 2, W + 2, 4) to the east, south, west and north, and kept (H + 2, W + 2), are the fine level's; where that
    is uniform, a cell that is not free is a wall to its neighbours.
    """
    height, width = fine.x.shape
    shape = ((height - 1) // 2 + 2, (width - 1) // 2 + 2)
    east, south = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
    new_walls, new_kept = np.zeros((shape[0], shape[1], 4), np.float32), np.zeros(shape, np.float32)
    inverse, free = np.zeros(shape, np.float32), fine.inverse
    for row in range(1, shape[0] - 1):
        for column in range(1, shape[1] - 1):
            first_i, first_j = 2 * row - 1, 2 * column - 1
            if fine.uniform and first_i + 2 < height and first_j + 2 < width and _amid(free, first_i, first_j):
                inverse[row, column] = east[row, column] = south[row, column] = 1.0
                above, below = kept[first_i], kept[first_i + 1]
                new_kept[row, column] = above[first_j] + above[first_j + 1] + below[first_j] + below[first_j + 1]
                continue
            for i in range(first_i, min(first_i + 2, height - 1)):
                for j in range(first_j, min(first_j + 2, width - 1)):
                    if not free[i, j] > 0:
                        continue
                    inverse[row, column] = 1.0
                    new_kept[row, column] += kept[i, j]
                    if j % 2 == 0:
                        link = np.float32(free[i, j + 1] > 0) if fine.uniform else fine.east[i, j]
                        east[row, column] += np.float32(0.5) * link
                    if i % 2 == 0:
                        link = np.float32(free[i + 1, j] > 0) if fine.uniform else fine.south[i, j]
                        south[row, column] += np.float32(0.5) * link
                    for d in range(4):
                        if fine.uniform:
                            beside = free[i + (d == 1) - (d == 3), j + (d == 0) - (d == 2)]
                            wall = np.float32(0.0 if beside > 0 else 1.0)
                        else:
                            wall = walls[i, j, d]
                        if wall > 0:
                            outer = ((i if d % 2 else j) % 2 == 0) == (d < 2)
                            new_walls[row, column, d] += _wall_of_coarser(float(wall), outer)
    for i in range(1, shape[0] - 1):
        for j in range(1, shape[1] - 1):
            if inverse[i, j] > 0:
                links = east[i, j] + east[i, j - 1] + south[i, j] + south[i - 1, j]
                for d in range(4):
                    links += new_walls[i, j, d]
                inverse[i, j] = np.float32(1.0) / max(links + new_kept[i, j], np.float32(1e-6))
    return east, south, new_walls, new_kept, inverse


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
def _passed_on(level: Level, x: Float32Array, above: int, here: int, below: int, i: int, j: int) -> np.float32:
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


@njit(cache=True, nogil=True, inline="always")
def _near(level: Level, rows: Float32Array, i: int, j: int) -> np.float32:
    """`_passed_on` of rows that are kept four at a time."""
    return _passed_on(level, rows, (i - 1) & 3, i & 3, (i + 1) & 3, i, j)


@njit(cache=True, nogil=True, inline="always")
def _begin_row(level: Level, u: Float32Array, i: int) -> None:
    """A row of what is left over the diagonal while x is 0; this one and all rows below are 0 outside the level."""
    if 0 < i < level.x.shape[0] - 1:
        for j in range(1, level.x.shape[1] - 1):
            u[i & 3, j] = level.inverse[i, j] * level.b[i, j]
    else:
        u[i & 3] = 0.0


@njit(cache=True, nogil=True, inline="always")
def _smooth_row(level: Level, u: Float32Array, x: Float32Array, i: int) -> None:
    """A row of x smoothed from 0."""
    if 0 < i < level.x.shape[0] - 1:
        for j in range(1, level.x.shape[1] - 1):
            x[i & 3, j] = OF_ITSELF * u[i & 3, j] + OF_NEIGHBOURS * (level.inverse[i, j] * _near(level, u, i, j))
    else:
        x[i & 3] = 0.0


@njit(cache=True, nogil=True, inline="always")
def _rest_row(level: Level, x: Float32Array, rest: Float32Array, i: int) -> None:
    """A row of b - A x."""
    if 0 < i < level.x.shape[0] - 1:
        for j in range(1, level.x.shape[1] - 1):
            left = level.b[i, j] + _near(level, x, i, j) - x[i & 3, j] / level.inverse[i, j]
            rest[i & 3, j] = left if level.inverse[i, j] > 0 else np.float32(0.0)
    else:
        rest[i & 3] = 0.0


@njit(cache=True, nogil=True, inline="always")
def _left_row(level: Level, x: Float32Array, u: Float32Array, i: int) -> None:
    """A row of b - A x over the diagonal."""
    if 0 < i < level.x.shape[0] - 1:
        for j in range(1, level.x.shape[1] - 1):
            u[i & 3, j] = level.inverse[i, j] * (level.b[i, j] + _near(level, x, i, j)) - x[i & 3, j]
    else:
        u[i & 3] = 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def _descend(level: Level, coarser: Level) -> None:
    """Smooth from x = 0, and gather what is left of b - A x onto the coarser level's b; x itself is not kept.

    In one sweep: each row is worked on as soon as those that it needs are there, one row behind each other.
    """
    width, into = level.x.shape[1], coarser.b
    u, x, rest = np.zeros((4, width), np.float32), np.zeros((4, width), np.float32), np.zeros((4, width), np.float32)
    gathered = np.zeros(2 * into.shape[1], np.float32)
    for i in range(-1, 2 * into.shape[0] - 1):
        _begin_row(level, u, i + 2)
        _smooth_row(level, u, x, i + 1)
        _rest_row(level, x, rest, i)
        row = i // 2  # gathers four rows, of which an odd one is the last
        if i % 2 == 1 and 0 < row < into.shape[0] - 1:
            above, first, second, below = (i - 3) & 3, (i - 2) & 3, (i - 1) & 3, i & 3
            for j in range(width):
                gathered[j] = (rest[above, j] + rest[below, j]) + np.float32(3.0) * (rest[first, j] + rest[second, j])
            for j in range(1, into.shape[1] - 1):
                sides, inner = gathered[2 * j - 2] + gathered[2 * j + 1], gathered[2 * j - 1] + gathered[2 * j]
                total = (sides + np.float32(3.0) * inner) * np.float32(1 / 16)
                into[row, j] = total if coarser.inverse[row, j] > 0 else np.float32(0.0)


@njit(cache=True, nogil=True)
def _ascend(coarser: Level, level: Level) -> None:
    """x smoothed from 0 once more, the coarser level's x added, interpolated bilinearly, and all smoothed again."""
    (height, width), e = level.x.shape, coarser.x
    u, x, left = np.zeros((4, width), np.float32), np.zeros((4, width), np.float32), np.zeros((4, width), np.float32)
    near, between = np.zeros(e.shape[1], np.float32), np.zeros(2 * e.shape[1], np.float32)
    for i in range(-2, height - 1):
        _begin_row(level, u, i + 3)
        _smooth_row(level, u, x, i + 2)
        _add_row(coarser, level, x, i + 2, near, between)
        _left_row(level, x, left, i + 1)
        if i > 0:
            for j in range(1, width - 1):
                passed_on = level.inverse[i, j] * _near(level, left, i, j)
                level.x[i, j] = x[i & 3, j] + OF_ITSELF * left[i & 3, j] + OF_NEIGHBOURS * passed_on


@njit(cache=True, nogil=True, inline="always")
def _add_row(coarser: Level, level: Level, x: Float32Array, i: int, near: Float32Array, between: Float32Array) -> None:
    """Add to a row what lies there between the coarser level's x; `near` and `between` are room for its rows."""
    e = coarser.x
    if 0 < i < level.x.shape[0] - 1:
        row = (i + 1) // 2
        beyond = row - 1 if i % 2 == 1 else row + 1
        for j in range(e.shape[1]):
            near[j] = (np.float32(3.0) * e[row, j] + e[beyond, j]) * np.float32(1 / 16)
        for j in range(1, e.shape[1] - 1):
            between[2 * j - 1] = np.float32(3.0) * near[j] + near[j - 1]
            between[2 * j] = np.float32(3.0) * near[j] + near[j + 1]
        for j in range(1, level.x.shape[1] - 1):
            x[i & 3, j] += between[j] if level.inverse[i, j] > 0 else np.float32(0.0)


@njit(cache=True, nogil=True)
def _settle(level: Level) -> None:
    """Smooth the coarsest level from 0, again and again."""
    x, b, inverse = level.x, level.b, level.inverse
    left = np.zeros_like(x)
    x[:] = 0.0
    for _ in range(COARSEST_SWEEPS):
        for i in range(1, x.shape[0] - 1):
            for j in range(1, x.shape[1] - 1):
                left[i, j] = inverse[i, j] * (b[i, j] + _passed_on(level, x, i - 1, i, i + 1, i, j)) - x[i, j]
        for i in range(1, x.shape[0] - 1):
            for j in range(1, x.shape[1] - 1):
                near = inverse[i, j] * _passed_on(level, left, i - 1, i, i + 1, i, j)
                x[i, j] += OF_ITSELF * left[i, j] + OF_NEIGHBOURS * near


def v_cycle(levels: tuple[Level, ...]) -> None:
    """Solve the finest level's A x = b roughly, from x = 0: its `b` is read, its `x` written."""
    finished(_v_cycle(levels))


def _v_cycle(levels: tuple[Level, ...]) -> Parts[None]:
    for level, coarser in pairwise(levels):
        _descend(level, coarser)
        yield 2 * level.x.size // _PASS
    _settle(levels[-1])
    for level, coarser in reversed(list(pairwise(levels))):
        _ascend(coarser, level)
        yield 3 * level.x.size // _PASS


def conjugate_gradients(
    absorption: Float32Array,
    levels: tuple[Level, ...],
    x: FloatArray,
    b: FloatArray,
    tolerance: float,
    most: int,
    go_on: Callable[[], bool] | None = None,
) -> Parts[tuple[float, int]]:
    """Improve x (H + 2, W + 2), in place, until |b - A x| <= tolerance |b|; returns what was reached, and the cycles.

    absorption (H, W): of the cells that A is of, as the levels are. x and b are 0 in walls and on the border. Stops
    early after `most` cycles, or when `go_on` says so between two.
    """
    finest = levels[0]
    r, p = np.zeros_like(x), np.zeros_like(finest.x)
    whole = float(np.linalg.norm(b)) or 1.0
    rest_of(absorption, x, b, r)
    left = float(np.linalg.norm(r))
    finest.b[:] = r
    before, cycles = 0.0, 0
    while left > tolerance * whole and cycles < most and (go_on is None or go_on()):
        yield from _v_cycle(levels)
        now = _dot(r, finest.x)
        _next_direction(p, finest.x, now / before if before else 0.0)
        yield x.size // _PASS
        length = now / (_bent(absorption, p) or 1.0)
        _go(absorption, x, r, p, length, finest.b)
        left = float(np.linalg.norm(r))
        before, cycles = now, cycles + 1
        yield 3 * x.size // _PASS
    return left / whole, cycles


@njit(cache=True, nogil=True)
def rest_of(absorption: Float32Array, x: FloatArray, b: FloatArray, into: FloatArray) -> None:
    """b - A x, written."""
    for i in range(absorption.shape[0]):
        for j in range(absorption.shape[1]):
            into[i + 1, j + 1] = b[i + 1, j + 1] - _product(absorption, x, i, j)


@njit(cache=True, nogil=True, inline="always")
def _product(absorption: Float32Array, x: AnyFloat, i: int, j: int) -> float:
    """A x in one cell of those that absorb, in float64 whatever x is; 0 in a wall."""
    across = np.float64(x[i + 1, j + 2]) + np.float64(x[i + 1, j])
    along = np.float64(x[i + 2, j + 1]) + np.float64(x[i, j + 1])
    value = (4.0 + np.float64(absorption[i, j])) * np.float64(x[i + 1, j + 1]) - (across + along)
    return float(value) if absorption[i, j] < np.inf else 0.0


@njit(cache=True, nogil=True, fastmath=_SUMMED)
def _bent(absorption: Float32Array, p: Float32Array) -> float:
    """p times A p."""
    total = 0.0
    for i in range(absorption.shape[0]):
        for j in range(absorption.shape[1]):
            total += _product(absorption, p, i, j) * p[i + 1, j + 1]
    return total


@njit(cache=True, nogil=True, fastmath=_SUMMED)
def _dot(r: FloatArray, z: Float32Array) -> float:
    total = 0.0
    for i in range(r.shape[0]):
        for j in range(r.shape[1]):
            total += r[i, j] * z[i, j]
    return total


@njit(cache=True, nogil=True)
def _next_direction(p: Float32Array, z: Float32Array, beta: float) -> None:
    share = np.float32(beta)
    for i in range(p.shape[0]):
        for j in range(p.shape[1]):
            p[i, j] = z[i, j] + share * p[i, j]


@njit(cache=True, nogil=True)
def _go(
    absorption: Float32Array, x: FloatArray, r: FloatArray, p: Float32Array, length: float, rough: Float32Array
) -> None:
    """Go along p: x, the rest r, and that again in float32 are updated."""
    for i in range(absorption.shape[0]):
        for j in range(absorption.shape[1]):
            x[i + 1, j + 1] += length * p[i + 1, j + 1]
            left = r[i + 1, j + 1] - length * _product(absorption, p, i, j)
            r[i + 1, j + 1], rough[i + 1, j + 1] = left, left
