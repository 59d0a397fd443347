"""Conjugate gradients preconditioned by multigrid, for Laplace's equation on a grid with holes.

Every free cell is linked to its four neighbours: diagonal * x - sum of neighbours = b, walls hold 0. A coarse cell
stands for two by two fine ones and is free when any of them is. The V-cycle (Briggs, Henson and McCormick, A Multigrid
Tutorial, 2000, chapter 3) interpolates bilinearly between the middles of cells and restricts by the transpose; it
smooths by red-black Gauss-Seidel, red first on the way down and black first on the way up, so that it is symmetric and
may precondition conjugate gradients (Tatebe 1993). How far a wall is from a coarse cell's middle is kept by direction:
it is no whole number of cells (finite volumes whose border cuts a cell).

All arrays of a level have a border of cells that are not free, so that no neighbour needs a bounds check.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numba import njit

from waychair.planning.slices import Parts, finished
from waychair.types import Float32Array, FloatArray

_NEAREST_WALL = 4.0
"""Weight that a wall's link has at most for each of a coarse cell's fine ones: one still nearer to the coarse cell's
middle, or past it, says no more than that the wall is there."""

SMOOTHINGS = 2
"""Sweeps before and after the correction on all levels but the finest, where a sweep costs three times as much as on
all others together; what the coarse levels get wrong beside walls is smoothed away where it is cheap."""

_COARSEST = 6
"""Sides up to which a level is relaxed rather than coarsened [cells]."""

COARSEST_SWEEPS = 8


class Level(NamedTuple):
    """One grid, (H + 2, W + 2) with its border.

    `east` and `south` hold the weights of the links to the next column and row, `inverse` that of the diagonal, 0 where
    the cell is not free. `x`, `b`, `r` are room to work in.
    """

    east: Float32Array
    south: Float32Array
    inverse: FloatArray
    x: FloatArray
    b: FloatArray
    r: FloatArray


def finest_level(absorption: Float32Array) -> Level:
    """The level of a grid whose cells (H, W) absorb; those that absorb infinitely are walls."""
    height, width = absorption.shape
    inverse = np.zeros((height + 2, width + 2))
    inverse[1:-1, 1:-1] = 1.0 / (4.0 + absorption.astype(np.float64))
    free = inverse > 0
    east, south = np.zeros(inverse.shape, np.float32), np.zeros(inverse.shape, np.float32)
    east[:, :-1] = free[:, :-1] & free[:, 1:]
    south[:-1] = free[:-1] & free[1:]
    return Level(east, south, inverse, *(np.zeros(inverse.shape) for _ in range(3)))


def levels_from(finest: Level, absorption: Float32Array) -> tuple[Level, ...]:
    """The finest level and all the coarser ones."""
    free = finest.inverse > 0
    walls, kept = np.zeros((*finest.east.shape, 4), np.float32), np.zeros_like(finest.east)
    for d, links in enumerate((finest.east, finest.south)):
        walls[..., d] = free & (links == 0)
        walls[..., d + 2] = free & (np.roll(links, 1, 1 - d) == 0)
    kept[1:-1, 1:-1][free[1:-1, 1:-1]] = absorption[free[1:-1, 1:-1]]
    levels = [finest]
    while min(levels[-1].inverse.shape) - 2 > _COARSEST:
        level, walls, kept = _coarser(levels[-1].east, levels[-1].south, levels[-1].inverse, walls, kept)
        levels.append(level)
    return tuple(levels)


@njit(cache=True, nogil=True)
def _coarser(
    east: Float32Array, south: Float32Array, inverse: FloatArray, walls: Float32Array, kept: Float32Array
) -> tuple[Level, Float32Array, Float32Array]:
    """The next level, what its walls take of each cell to the east, south, west and north (H, W, 4), and what it absorbs.

    A wall's weight is one over its distance from the cell's middle. Half a fine cell farther, or nearer, is that of the
    coarse cell; the distance counts half as much in its wider cells, and each of its two fine cells for half.
    """
    shape = ((inverse.shape[0] - 1) // 2 + 2, (inverse.shape[1] - 1) // 2 + 2)
    new_east, new_south = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
    new_walls, new_kept = np.zeros((shape[0], shape[1], 4), np.float32), np.zeros(shape, np.float32)
    new_inverse = np.zeros(shape)
    for i in range(1, inverse.shape[0] - 1):
        for j in range(1, inverse.shape[1] - 1):
            if inverse[i, j] > 0:
                row, column = (i + 1) // 2, (j + 1) // 2
                new_inverse[row, column] = 1.0
                new_kept[row, column] += kept[i, j]
                new_east[row, column] += np.float32(0.5 * (j % 2 == 0)) * east[i, j]
                new_south[row, column] += np.float32(0.5 * (i % 2 == 0)) * south[i, j]
                for d in range(4):
                    wall = walls[i, j, d]
                    if wall > 0:
                        outer = ((i if d % 2 else j) % 2 == 0) == (d < 2)
                        nearer = 1.0 + 0.5 * wall if outer else max(1.0 - 0.5 * wall, 1e-3)
                        new_walls[row, column, d] += np.float32(min(wall / nearer, _NEAREST_WALL))
    for i in range(1, shape[0] - 1):
        for j in range(1, shape[1] - 1):
            if new_inverse[i, j] > 0:
                links = new_east[i, j] + new_east[i, j - 1] + new_south[i, j] + new_south[i - 1, j]
                for d in range(4):
                    links += new_walls[i, j, d]
                new_inverse[i, j] = 1.0 / max(links + new_kept[i, j], np.float32(1e-6))
    room = (np.zeros(shape), np.zeros(shape), np.zeros(shape))
    return Level(new_east, new_south, new_inverse, room[0], room[1], room[2]), new_walls, new_kept


@njit(cache=True, nogil=True)
def relax(level: Level, x: FloatArray, b: FloatArray, colour: int, omega: float = 1.0) -> None:
    """Gauss-Seidel on the cells of one colour of a chessboard, in place, over-relaxed by omega."""
    for i in range(1, x.shape[0] - 1):
        _relax_row(level, x, b, i, colour, omega)


@njit(cache=True, nogil=True)
def smooth(level: Level, colour: int) -> None:
    """Gauss-Seidel on a level's `x`, one colour and then the other: a row behind, so that memory is gone through once."""
    last = level.x.shape[0] - 2
    for i in range(1, last + 1):
        _relax_row(level, level.x, level.b, i, colour, 1.0)
        if i > 1:
            _relax_row(level, level.x, level.b, i - 1, 1 - colour, 1.0)
    _relax_row(level, level.x, level.b, last, 1 - colour, 1.0)


@njit(cache=True, nogil=True, inline="always")
def _relax_row(level: Level, x: FloatArray, b: FloatArray, i: int, colour: int, omega: float) -> None:
    east, south, inverse = level.east, level.south, level.inverse
    for j in range(1 + (i + colour + 1) % 2, x.shape[1] - 1, 2):
        across = east[i, j] * x[i, j + 1] + east[i, j - 1] * x[i, j - 1]
        along = south[i, j] * x[i + 1, j] + south[i - 1, j] * x[i - 1, j]
        x[i, j] += omega * (inverse[i, j] * (b[i, j] + across + along) - x[i, j])


@njit(cache=True, nogil=True)
def apply(level: Level, x: FloatArray, into: FloatArray) -> float:
    """The matrix times x; returns x times that."""
    east, south, inverse = level.east, level.south, level.inverse
    total = 0.0
    for i in range(1, x.shape[0] - 1):
        for j in range(1, x.shape[1] - 1):
            value = 0.0
            if inverse[i, j] > 0:
                across = east[i, j] * x[i, j + 1] + east[i, j - 1] * x[i, j - 1]
                along = south[i, j] * x[i + 1, j] + south[i - 1, j] * x[i - 1, j]
                value = x[i, j] / inverse[i, j] - across - along
            into[i, j] = value
            total += value * x[i, j]
    return total


@njit(cache=True, nogil=True)
def _restrict(level: Level, into: FloatArray) -> None:
    """What is left of b - A x, gathered onto the coarser level's b."""
    east, south, inverse, x, b, r = level.east, level.south, level.inverse, level.x, level.b, level.r
    height, width = x.shape
    for i in range(1, height - 1):
        for j in range(1, width - 1):
            value = 0.0
            if inverse[i, j] > 0:
                across = east[i, j] * x[i, j + 1] + east[i, j - 1] * x[i, j - 1]
                along = south[i, j] * x[i + 1, j] + south[i - 1, j] * x[i - 1, j]
                value = b[i, j] + across + along - x[i, j] / inverse[i, j]
            r[i, j] = value
    for i in range(1, into.shape[0] - 1):
        first = 2 * i - 1
        above, below = max(first - 1, 0), min(first + 2, height - 1)
        second = min(first + 1, height - 1)
        for j in range(1, into.shape[1] - 1):
            a = 2 * j - 1
            left, right = max(a - 1, 0), min(a + 2, width - 1)
            c = min(a + 1, width - 1)
            outer = r[above, left] + r[above, right] + r[below, left] + r[below, right]
            sides = r[above, a] + r[above, c] + r[below, a] + r[below, c]
            sides += r[first, left] + r[first, right] + r[second, left] + r[second, right]
            inner = r[first, a] + r[first, c] + r[second, a] + r[second, c]
            into[i, j] = (outer + 3.0 * sides + 9.0 * inner) / 16.0


@njit(cache=True, nogil=True)
def _prolong(coarse: Level, fine: Level) -> None:
    """Add the coarser level's x, interpolated bilinearly, to the finer level's."""
    x, e, inverse = fine.x, coarse.x, fine.inverse
    for i in range(1, x.shape[0] - 1):
        row = (i + 1) // 2
        beyond = row - 1 if i % 2 == 1 else row + 1
        for j in range(1, x.shape[1] - 1):
            if inverse[i, j] > 0:
                column = (j + 1) // 2
                aside = column - 1 if j % 2 == 1 else column + 1
                near = 9.0 * e[row, column] + 3.0 * (e[row, aside] + e[beyond, column])
                x[i, j] += (near + e[beyond, aside]) / 16.0


def v_cycle(levels: tuple[Level, ...]) -> None:
    """Solve the finest level's A x = b roughly, from x = 0: its `b` is read, its `x` written."""
    finished(_v_cycle(levels))


def _v_cycle(levels: tuple[Level, ...]) -> Parts[None]:
    for depth, (level, coarser) in enumerate(pairwise(levels)):
        level.x[:] = 0.0
        for _ in range(SMOOTHINGS if depth else 1):
            smooth(level, 0)
            yield 2 * level.x.size
        _restrict(level, coarser.b)
        yield level.x.size
    last = levels[-1]
    last.x[:] = 0.0
    for colour in (0,) * COARSEST_SWEEPS + (1,) * COARSEST_SWEEPS:
        smooth(last, colour)
    for depth, (level, coarser) in reversed(list(enumerate(pairwise(levels)))):
        _prolong(coarser, level)
        yield level.x.size
        for _ in range(SMOOTHINGS if depth else 1):
            smooth(level, 1)
            yield 2 * level.x.size


def conjugate_gradients(
    levels: tuple[Level, ...],
    x: FloatArray,
    b: FloatArray,
    tolerance: float,
    most: int,
    go_on: Callable[[], bool] | None = None,
) -> Parts[tuple[float, int]]:
    """Improve x (H + 2, W + 2), in place, until |b - A x| <= tolerance |b|; returns what was reached, and the cycles.

    Stops early after `most` cycles, or when `go_on` says so between two.
    """
    finest = levels[0]
    r, p, q = finest.b, np.zeros_like(x), np.zeros_like(x)
    whole = math.sqrt(float(np.vdot(b, b))) or 1.0
    apply(finest, x, q)
    np.subtract(b, q, out=r)
    before, left, cycles = 0.0, math.sqrt(float(np.vdot(r, r))), 0
    while left > tolerance * whole and cycles < most and (go_on is None or go_on()):
        yield from _v_cycle(levels)
        z = finest.x
        now = float(np.vdot(r, z))
        _next_direction(p, z, now / before if before else 0.0)
        length = now / (apply(finest, p, q) or 1.0)
        left = math.sqrt(_step(x, r, p, q, length))
        before, cycles = now, cycles + 1
        yield 2 * x.size
    return left / whole, cycles


@njit(cache=True, nogil=True)
def _next_direction(p: FloatArray, z: FloatArray, beta: float) -> None:
    for i in range(p.shape[0]):
        for j in range(p.shape[1]):
            p[i, j] = z[i, j] + beta * p[i, j]


@njit(cache=True, nogil=True)
def _step(x: FloatArray, r: FloatArray, p: FloatArray, q: FloatArray, length: float) -> float:
    """Go along p: x and the rest r are updated; returns the square of what is left."""
    total = 0.0
    for i in range(x.shape[0]):
        for j in range(x.shape[1]):
            x[i, j] += length * p[i, j]
            r[i, j] -= length * q[i, j]
            total += r[i, j] * r[i, j]
    return total
