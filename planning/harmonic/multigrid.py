"""The multigrid V-cycle on levels of a grid with holes; it is symmetric, so it can precondition conjugate gradients.

The V-cycle (Briggs, Henson and McCormick, A Multigrid Tutorial, 2000, chapter 3) interpolates bilinearly between the
middles of cells and restricts by the transpose. It smooths the same way before and after the correction (Tatebe 1993).
It computes in float32, twice as many cells at a time, since a preconditioner need not be exact.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise, repeat

import numpy as np
from numba import njit

from waychair.planning.harmonic.multigrid_levels import (
    OF_ITSELF,
    OF_NEIGHBOURS,
    MultigridLevel,
    neighbour_sum,
    product_of_row,
    solve_coarsest,
)
from waychair.planning.harmonic.multigrid_patches import SmoothingPatch, SmoothingPatches, correct_after, correct_before
from waychair.planning.harmonic.row_threads import over_rows, sum_over_rows
from waychair.resumable import CountedSteps, finished
from waychair.types import Float32Array

PASS = 5
"""Cells that a sweep of the cycle visits in the time in which other work on the field visits one."""


@njit(cache=True, nogil=True, inline="always")
def _neighbour_sum(level: MultigridLevel, rows: Float32Array, i: int, j: int) -> np.float32:
    """Return `neighbour_sum` for rows in a ring buffer of four."""
    return neighbour_sum(level, rows, (i - 1) & 3, i & 3, (i + 1) & 3, i, j)


@njit(cache=True, nogil=True, inline="always")
def _begin_row(level: MultigridLevel, u: Float32Array, i: int) -> None:
    """Compute a row of the residual over the diagonal while x is 0; rows outside the level are 0, here and below."""
    if 0 < i < level.x.shape[0] - 1:
        for j in range(1, level.x.shape[1] - 1):
            u[i & 3, j] = level.inverse[i, j] * level.b[i, j]
    else:
        u[i & 3] = 0.0


@njit(cache=True, nogil=True, inline="always")
def _smooth_row(level: MultigridLevel, u: Float32Array, x: Float32Array, i: int) -> None:
    """Compute a row of x smoothed from 0."""
    if 0 < i < level.x.shape[0] - 1:
        for j in range(1, level.x.shape[1] - 1):
            x[i & 3, j] = OF_ITSELF * u[i & 3, j] + OF_NEIGHBOURS * (
                level.inverse[i, j] * _neighbour_sum(level, u, i, j)
            )
    else:
        x[i & 3] = 0.0


@njit(cache=True, nogil=True, inline="always")
def _residual_row(level: MultigridLevel, x: Float32Array, rest: Float32Array, i: int) -> None:
    """Compute a row of the residual b - A x."""
    if 0 < i < level.x.shape[0] - 1:
        for j in range(1, level.x.shape[1] - 1):
            left = level.b[i, j] + _neighbour_sum(level, x, i, j) - x[i & 3, j] / level.inverse[i, j]
            rest[i & 3, j] = left if level.inverse[i, j] > 0 else np.float32(0.0)
    else:
        rest[i & 3] = 0.0


@njit(cache=True, nogil=True, inline="always")
def _scaled_residual_row(level: MultigridLevel, x: Float32Array, u: Float32Array, i: int) -> None:
    """Compute a row of b - A x over the diagonal."""
    if 0 < i < level.x.shape[0] - 1:
        for j in range(1, level.x.shape[1] - 1):
            u[i & 3, j] = level.inverse[i, j] * (level.b[i, j] + _neighbour_sum(level, x, i, j)) - x[i & 3, j]
    else:
        u[i & 3] = 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def _descend(level: MultigridLevel, coarser: MultigridLevel, first: int, stop: int) -> None:
    """Smooth from x = 0, and restrict the residual b - A x to rows of the coarser level's b; x itself is not kept.

    All is done in one sweep: each stage follows one row behind the stage that it needs.
    """
    width, into = level.x.shape[1], coarser.b
    u, x, rest = np.zeros((4, width), np.float32), np.zeros((4, width), np.float32), np.zeros((4, width), np.float32)
    gathered = np.zeros(2 * into.shape[1], np.float32)
    for i in range(2 * first - 6, 2 * stop):
        _begin_row(level, u, i + 2)
        _smooth_row(level, u, x, i + 1)
        _residual_row(level, x, rest, i)
        row = i // 2  # gathers four rows, the last of them odd
        if i % 2 == 1 and first <= row < stop:
            above, first, second, below = (i - 3) & 3, (i - 2) & 3, (i - 1) & 3, i & 3
            for j in range(width):
                gathered[j] = (rest[above, j] + rest[below, j]) + np.float32(3.0) * (rest[first, j] + rest[second, j])
            for j in range(1, into.shape[1] - 1):
                sides, inner = gathered[2 * j - 2] + gathered[2 * j + 1], gathered[2 * j - 1] + gathered[2 * j]
                total = (sides + np.float32(3.0) * inner) * np.float32(1 / 16)
                into[row, j] = total if coarser.inverse[row, j] > 0 else np.float32(0.0)


@njit(cache=True, nogil=True)
def _ascend(coarser: MultigridLevel, level: MultigridLevel, first: int, stop: int) -> float:
    """Compute rows of x: smoothed from 0 again, the coarser level's x added by interpolation, and smoothed once more.

    Return the rows' share of the product of x and b.
    """
    width, e = level.x.shape[1], coarser.x
    u, x, left = np.zeros((4, width), np.float32), np.zeros((4, width), np.float32), np.zeros((4, width), np.float32)
    near, between = np.zeros(e.shape[1], np.float32), np.zeros(2 * e.shape[1], np.float32)
    total = 0.0
    for i in range(first - 6, stop):
        _begin_row(level, u, i + 3)
        _smooth_row(level, u, x, i + 2)
        _add_row(coarser, level, x, i + 2, near, between)
        _scaled_residual_row(level, x, left, i + 1)
        if i >= first:
            for j in range(1, width - 1):
                neighbour_sum = level.inverse[i, j] * _neighbour_sum(level, left, i, j)
                level.x[i, j] = x[i & 3, j] + OF_ITSELF * left[i & 3, j] + OF_NEIGHBOURS * neighbour_sum
            total += product_of_row(level.b, level.x, i)
    return total


@njit(cache=True, nogil=True, inline="always")
def _add_row(
    coarser: MultigridLevel, level: MultigridLevel, x: Float32Array, i: int, near: Float32Array, between: Float32Array
) -> None:
    """Add the interpolated x of the coarser level to a row; `near` and `between` are buffers for its rows."""
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


def v_cycle(levels: tuple[MultigridLevel, ...], patches: SmoothingPatches = ()) -> None:
    """Solve the finest level's A x = b approximately from x = 0: its `b` is read, its `x` written."""
    finished(v_cycle_resumably(levels, patches))


def v_cycle_resumably(levels: tuple[MultigridLevel, ...], patches: SmoothingPatches = ()) -> CountedSteps[float]:
    """Do `v_cycle` resumably, a level at a time; return the product of x and b."""
    near: list[Sequence[SmoothingPatch]] = [*patches, *repeat((), len(levels) - 1 - len(patches))]
    steps = [(level, coarser, seen_to) for (level, coarser), seen_to in zip(pairwise(levels), near, strict=True)]
    for level, coarser, seen_to in steps:
        correct_before(level, seen_to)
        over_rows(_descend, 1, coarser.x.shape[0] - 1, level.x.size, level, coarser)
        yield 2 * level.x.size // PASS
    product = solve_coarsest(levels[-1])
    for level, coarser, seen_to in reversed(steps):
        product = sum_over_rows(_ascend, 1, level.x.shape[0] - 1, level.x.size, coarser, level)
        product += correct_after(level, seen_to)
        yield 3 * level.x.size // PASS
    return product
