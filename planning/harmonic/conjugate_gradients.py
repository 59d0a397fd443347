"""Conjugate gradients preconditioned by multigrid, for Laplace's equation on a grid with holes.

The solution x is float64. The residual and the preconditioning cycle are float32: they only give the search direction.
The residual is recomputed from x before it has lost its digits.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numba import njit

from waychair.planning.harmonic.multigrid import PASS, v_cycle_resumably
from waychair.planning.harmonic.multigrid_levels import (
    SUMMED,
    AnyFloat,
    MultigridLevel,
    product_of_row,
    product_of_rows,
)
from waychair.planning.harmonic.multigrid_patches import SmoothingPatches
from waychair.planning.harmonic.row_threads import row_ranges, sum_over_rows
from waychair.planning.harmonic.scratch_memory import ScratchMemory, new_scratch_memory
from waychair.resumable import CountedSteps
from waychair.types import Float32Array, FloatArray


def conjugate_gradients(
    absorption: Float32Array,
    levels: tuple[MultigridLevel, ...],
    x: FloatArray,
    b: FloatArray,
    tolerance: float,
    most: int,
    has_time: Callable[[], bool] | None = None,
    patches: SmoothingPatches = (),
    rest: FloatArray | None = None,
    memory: ScratchMemory | None = None,
) -> CountedSteps[tuple[float, int]]:
    """Improve x (H + 2, W + 2) in place until |b - A x| <= tolerance |b|; return the relative residual and the cycles.

    absorption (H, W) of the cells defines A, as it does the levels. x and b are 0 in walls and on the border. The solve
    stops early after `most` cycles, or when `has_time` is false between two. patches: extra local smoothing on the
    levels. rest: the residual b - A x, if known. memory: for one grid of float32.
    """
    finest, rows, cells = levels[0], absorption.shape[0], absorption.size
    r, z = finest.b, finest.x
    p = (memory or new_scratch_memory(z.nbytes)).take(z.shape)
    p[:] = 0.0
    whole = norm_of(b) or 1.0
    if rest is None:
        left = write_residual(absorption, x, b, r)
    else:
        r[:], left = rest, norm_of(rest)
    exact, before, cycles = left, 0.0, 0
    while left > tolerance * whole and cycles < most and (has_time is None or has_time()):
        now = yield from v_cycle_resumably(levels, patches)
        curvature = sum_over_rows(_new_direction, 0, rows, cells, absorption, p, z, now / before if before else 0.0)
        length = now / (
            curvature + sum(_curvature_of_ends(absorption, p, *band) for band in row_ranges(0, rows, cells)) or 1.0
        )
        left = math.sqrt(sum_over_rows(_step, 0, rows, cells, absorption, x, r, p, length))
        before, cycles = now, cycles + 1
        yield 3 * x.size // PASS
        if left < _RECOMPUTED_BELOW * exact and (
            left > tolerance * whole or _ROUNDING_LOSS * exact > tolerance * whole
        ):
            left = exact = write_residual(absorption, x, b, r)
            yield x.size // PASS
    return left / whole, cycles


_RECOMPUTED_BELOW, _ROUNDING_LOSS = 1e-3, 1e-6
"""The residual is rounded to float32 in each cycle. It is recomputed once it is smaller by the first factor; rounding
may have lost the second part of its last exact value by then."""


def norm_of(x: FloatArray) -> float:
    """Return the Euclidean norm of a vector (H + 2, W + 2)."""
    return math.sqrt(sum_over_rows(product_of_rows, 1, x.shape[0] - 1, x.size, x, x))


def write_residual(absorption: Float32Array, x: FloatArray, b: FloatArray, into: AnyFloat) -> float:
    """Write the residual b - A x into an array, shapes as in `conjugate_gradients`; return its norm."""
    return math.sqrt(sum_over_rows(_write_residual, 0, absorption.shape[0], absorption.size, absorption, x, b, into))


@njit(cache=True, nogil=True)
def _write_residual(
    absorption: Float32Array, x: FloatArray, b: FloatArray, into: AnyFloat, first: int, stop: int
) -> float:
    """Write rows of b - A x; return the sum of their squares."""
    squares = 0.0
    for i in range(first, stop):
        for j in range(absorption.shape[1]):
            into[i + 1, j + 1] = b[i + 1, j + 1] - _product(absorption, x, i, j)
        squares += product_of_row(into, into, i + 1)
    return squares


@njit(cache=True, nogil=True, inline="always")
def _product(absorption: Float32Array, x: AnyFloat, i: int, j: int) -> float:
    """Return A x in one cell, in float64 even if x is float32; 0 in a wall."""
    across = np.float64(x[i + 1, j + 2]) + np.float64(x[i + 1, j])
    along = np.float64(x[i + 2, j + 1]) + np.float64(x[i, j + 1])
    value = (4.0 + np.float64(absorption[i, j])) * np.float64(x[i + 1, j + 1]) - (across + along)
    return float(value) if absorption[i, j] < np.inf else 0.0


@njit(cache=True, nogil=True)
def _new_direction(
    absorption: Float32Array, p: Float32Array, z: Float32Array, beta: float, first: int, stop: int
) -> float:
    """Update the search direction p to z + beta p; return the inner rows' share of p A p (without first and last)."""
    total, share = 0.0, np.float32(beta)
    for i in range(first, stop):
        for j in range(p.shape[1]):
            p[i + 1, j] = z[i + 1, j] + share * p[i + 1, j]
        if i > first + 1:
            total += _curvature_of_row(absorption, p, i - 1)
    return total


@njit(cache=True, nogil=True)
def _curvature_of_ends(absorption: Float32Array, p: Float32Array, first: int, stop: int) -> float:
    """Return the share of p A p of the first and the last row of a range, once the rows beside them are updated."""
    last = _curvature_of_row(absorption, p, stop - 1) if stop - 1 > first else 0.0
    return float(_curvature_of_row(absorption, p, first) + last)


@njit(cache=True, nogil=True, fastmath=SUMMED)
def _curvature_of_row(absorption: Float32Array, p: Float32Array, i: int) -> float:
    total = 0.0
    for j in range(absorption.shape[1]):
        total += _product(absorption, p, i, j) * p[i + 1, j + 1]
    return total


@njit(cache=True, nogil=True)
def _step(
    absorption: Float32Array, x: FloatArray, r: Float32Array, p: Float32Array, length: float, first: int, stop: int
) -> float:
    """Step along p, updating x and the residual r; return the sum of the squares of r."""
    squares = 0.0
    for i in range(first, stop):
        for j in range(absorption.shape[1]):
            x[i + 1, j + 1] += length * p[i + 1, j + 1]
            r[i + 1, j + 1] = r[i + 1, j + 1] - length * _product(absorption, p, i, j)
        squares += product_of_row(r, r, i + 1)
    return squares
