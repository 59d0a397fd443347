"""Extra local smoothing in a multigrid cycle: small patches around places where coarse levels are inaccurate.

Coarse cells misjudge the effect of a wall of one or a few cells, around which the solution is steep: a single cell,
such as the goal, costs a cycle or two more than a long wall. A few more smoothing steps around it cost next to nothing.
A patch is smoothed from 0 before the cycle continues to coarser levels, which then only see the residual, and again
after them, which keeps the cycle symmetric.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, TypeAlias

import numpy as np
from numba import njit

from waychair.planning.harmonic.multigrid_levels import MultigridLevel, neighbour_sum, solve_coarsest
from waychair.types import Float32Array, IntArray

_ROUND = 8
"""Margin [cells] around a place that is smoothed with it, on each level."""

_SMALLEST_SIDE = 16
"""Least side [cells, with border] of a level with patches."""

_WORTH = 1 << 18
"""Least number of cells of a grid for which patches save more time than they take."""

_LARGEST_SHARE = 1 / 16
"""Largest part of a grid's cells in a patch."""


class SmoothingPatch(NamedTuple):
    """A rectangle of a level, with a border fixed at 0; `top` and `left` are the border's row and column.

    `part` is the level within. `first` is the solution found before the coarser levels, `given` the level's b before.
    """

    top: int
    left: int
    part: MultigridLevel
    first: Float32Array
    given: Float32Array


SmoothingPatches: TypeAlias = tuple[tuple[SmoothingPatch, ...], ...]
"""The patches of each level, finest first; levels beyond the last have none."""

CellRectangle: TypeAlias = tuple[IntArray, IntArray]
"""A rectangle in the finest level: its first and last (row, column), (2,) each."""


def smoothing_patches(levels: Sequence[MultigridLevel], places: Sequence[CellRectangle]) -> SmoothingPatches:
    """Return patches around places of a grid; none where they would not be worth their time."""
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


def _patch(level: MultigridLevel, low: IntArray, high: IntArray) -> SmoothingPatch:
    """Return the patch around a rectangle of a level, cut at the level's border."""
    top, left = (int(at) for at in np.maximum(low - _ROUND, 1) - 1)
    bottom, right = (int(at) for at in np.minimum(high + _ROUND, np.array(level.x.shape) - 2) + 1)
    within = (slice(top, bottom + 1), slice(left, right + 1))
    inverse = np.pad(level.inverse[within][1:-1, 1:-1], 1)
    east, south = (
        links if level.uniform else np.ascontiguousarray(links[within]) for links in (level.east, level.south)
    )
    x, b, first, given = (np.zeros_like(inverse) for _ in range(4))
    return SmoothingPatch(
        top,
        left,
        MultigridLevel(east=east, south=south, inverse=inverse, uniform=level.uniform, x=x, b=b),
        first,
        given,
    )


def correct_before(level: MultigridLevel, patches: Sequence[SmoothingPatch]) -> None:
    """Solve for x in the patches in turn, and subtract A x from the level's b."""
    for patch in patches:
        _correct_before(level, patch)


def correct_after(level: MultigridLevel, patches: Sequence[SmoothingPatch]) -> float:
    """Correct the level's x in the patches once more, in reverse order; add the first solution, and restore b.

    Return the resulting change of the product of x and b.
    """
    return sum(_correct_after(level, patch) for patch in reversed(patches))


@njit(cache=True, nogil=True)
def _correct_before(level: MultigridLevel, patch: SmoothingPatch) -> None:
    part, first, top, left = patch.part, patch.first, patch.top, patch.left
    height, width = part.x.shape
    patch.given[:] = level.b[top : top + height, left : left + width]
    part.b[:] = patch.given
    solve_coarsest(part)
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
def _pass_on(level: MultigridLevel, row: int, column: int, much: np.float32) -> None:
    """Add to a cell's b, unless the cell is a wall: there b stays 0."""
    if level.inverse[row, column] > 0:
        level.b[row, column] += much


@njit(cache=True, nogil=True)
def _correct_after(level: MultigridLevel, patch: SmoothingPatch) -> float:
    part, x, top, left, change = patch.part, level.x, patch.top, patch.left, 0.0
    height, width = part.x.shape
    for i in range(1, height - 1):
        for j in range(1, width - 1):
            row, column = top + i, left + j
            if part.inverse[i, j] > 0:
                near = neighbour_sum(level, x, row - 1, row, row + 1, row, column)
                part.b[i, j] = level.b[row, column] + near - x[row, column] / part.inverse[i, j]
    solve_coarsest(part)
    for i in range(height):
        for j in range(width):
            row, column = top + i, left + j
            change -= np.float64(x[row, column]) * np.float64(level.b[row, column])
            x[row, column] += patch.first[i, j] + part.x[i, j]
            level.b[row, column] = patch.given[i, j]
            change += np.float64(x[row, column]) * np.float64(level.b[row, column])
    return change
