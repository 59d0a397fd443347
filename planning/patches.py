"""Small places of a grid that a multigrid cycle sees to by themselves, on each of its levels.

Coarse cells misjudge how much a wall of one or a few cells takes of what passes by, round which the solution is steep:
a single cell, such as the goal, takes a cycle or two longer than a wall does. Smoothing a few more times round it costs
next to nothing. A patch is smoothed from 0 before the cycle goes on to coarser levels, which then have only what is left
to see to, and again after them, which keeps the cycle symmetric.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, TypeAlias

import numpy as np
from numba import njit

from waychair.planning.levels import Level, passed_on, settle
from waychair.types import Float32Array, IntArray

_ROUND = 8
"""Cells round a place that are smoothed with it, on each level."""

_SMALLEST_SIDE = 16
"""Levels with shorter sides [cells, with their border] have no patches."""

_WORTH = 1 << 18
"""Cells of a grid from which on patches save more time than they take."""

_LARGEST_SHARE = 1 / 16
"""Of a grid's cells that a patch may have."""


class Patch(NamedTuple):
    """A rectangle of a level, with a border that is held at 0; `top` and `left` are the border's row and column.

    `part` is the level within; `first` is what was found before the coarser levels, `given` the level's b before that.
    """

    top: int
    left: int
    part: Level
    first: Float32Array
    given: Float32Array


Patches: TypeAlias = tuple[tuple[Patch, ...], ...]
"""Of each level, the finest first; coarser ones than the last have none."""

Place: TypeAlias = tuple[IntArray, IntArray]
"""The first and the last row and column, (2,) each, of a rectangle in the finest level."""


def patches_of(levels: Sequence[Level], places: Sequence[Place]) -> Patches:
    """Patches round places of a grid; none where they would not be worth their time."""
    finest = levels[0].x
    if finest.size < _WORTH:
        return ()
    small = [(low, high) for low, high in places if np.prod(high - low + 1) <= _LARGEST_SHARE * finest.size]
    patches = []
    for level in levels[:-1]:
        if min(level.x.shape) < _SMALLEST_SIDE:
            break
        patches.append(tuple(_patch(level, low, high) for low, high in small))
        small = [((low + 1) // 2, (high + 1) // 2) for low, high in small]
    return tuple(patches)


def _patch(level: Level, low: IntArray, high: IntArray) -> Patch:
    """Round a rectangle of a level, as far as that reaches."""
    top, left = (int(at) for at in np.maximum(low - _ROUND, 1) - 1)
    bottom, right = (int(at) for at in np.minimum(high + _ROUND, np.array(level.x.shape) - 2) + 1)
    within = (slice(top, bottom + 1), slice(left, right + 1))
    inverse = np.pad(level.inverse[within][1:-1, 1:-1], 1)
    east, south = (
        links if level.uniform else np.ascontiguousarray(links[within]) for links in (level.east, level.south)
    )
    x, b, first, given = (np.zeros_like(inverse) for _ in range(4))
    return Patch(top, left, Level(east, south, inverse, level.uniform, x, b), first, given)


def correct_before(level: Level, patches: Sequence[Patch]) -> None:
    """Find x in the patches, one after the other, and take what that makes up for off the level's b."""
    for patch in patches:
        _correct_before(level, patch)


def correct_after(level: Level, patches: Sequence[Patch]) -> float:
    """Correct the level's x in the patches once more, the last one first; add what was found before, and give b back.

    Returns by how much that changes the product of x and b.
    """
    return sum(_correct_after(level, patch) for patch in reversed(patches))


@njit(cache=True, nogil=True)
def _correct_before(level: Level, patch: Patch) -> None:
    part, first, top, left = patch.part, patch.first, patch.top, patch.left
    height, width = part.x.shape
    patch.given[:] = level.b[top : top + height, left : left + width]
    part.b[:] = patch.given
    settle(part)
    first[:] = part.x
    for i in range(1, height - 1):
        for j in range(1, width - 1):
            row, column, found = top + i, left + j, first[i, j]
            if part.inverse[i, j] > 0:
                level.b[row, column] -= found / part.inverse[i, j]
                one = np.float32(1.0)
                _pass_on(level, row, column + 1, found * (one if level.uniform else level.east[row, column]))
                _pass_on(level, row, column - 1, found * (one if level.uniform else level.east[row, column - 1]))
                _pass_on(level, row + 1, column, found * (one if level.uniform else level.south[row, column]))
                _pass_on(level, row - 1, column, found * (one if level.uniform else level.south[row - 1, column]))


@njit(cache=True, nogil=True, inline="always")
def _pass_on(level: Level, row: int, column: int, much: np.float32) -> None:
    """Walls take nothing: their b stays 0."""
    if level.inverse[row, column] > 0:
        level.b[row, column] += much


@njit(cache=True, nogil=True)
def _correct_after(level: Level, patch: Patch) -> float:
    part, x, top, left, change = patch.part, level.x, patch.top, patch.left, 0.0
    height, width = part.x.shape
    for i in range(1, height - 1):
        for j in range(1, width - 1):
            row, column = top + i, left + j
            if part.inverse[i, j] > 0:
                near = passed_on(level, x, row - 1, row, row + 1, row, column)
                part.b[i, j] = level.b[row, column] + near - x[row, column] / part.inverse[i, j]
    settle(part)
    for i in range(height):
        for j in range(width):
            row, column = top + i, left + j
            change -= np.float64(x[row, column]) * np.float64(level.b[row, column])
            x[row, column] += patch.first[i, j] + part.x[i, j]
            level.b[row, column] = patch.given[i, j]
            change += np.float64(x[row, column]) * np.float64(level.b[row, column])
    return change
