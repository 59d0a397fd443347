"""Conjugate gradients with multigrid on a GPU (numba.cuda), one thread per cell; the algorithm is the CPU's.

The levels are made on the CPU and copied; during the cycles only a few sums come back.
numba's CUDA simulator (NUMBA_ENABLE_CUDASIM=1) runs the same kernels on a CPU, slowly; the tests use it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from importlib import import_module
from itertools import pairwise
from typing import Any, NamedTuple

import numba
import numpy as np

from waychair.errors import MissingExtra
from waychair.planning.harmonic.multigrid_levels import COARSEST_SWEEPS, OF_ITSELF, OF_NEIGHBOURS, MultigridLevel
from waychair.types import Float32Array, FloatArray

cuda: Any
try:
    cuda = import_module("numba.cuda")
except ImportError:  # a numba without its CUDA target; numba-cuda (the extra `gpu`) provides it
    cuda = None

_COLUMNS, _ROWS = (4, 2) if getattr(numba.config, "ENABLE_CUDASIM", False) else (16, 4)
"""Size of a block of threads: neighbouring threads read neighbouring columns, which are contiguous in memory. The
simulator's threads are Python threads; fewer are faster."""

_BLOCK = (_COLUMNS, _ROWS)
_THREADS = _COLUMNS * _ROWS


@cache
def gpu_at_hand() -> bool:
    """Return whether kernels can be run here, including in the simulator."""
    return cuda is not None and bool(cuda.is_available())


class _DeviceLevel(NamedTuple):
    """A `MultigridLevel` on the GPU, the array `left` for its residual, over the diagonal or not, and its blocks."""

    east: Any
    south: Any
    inverse: Any
    uniform: bool
    x: Any
    b: Any
    left: Any
    blocks: tuple[int, int]


def conjugate_gradients_on_gpu(
    absorption: Float32Array,
    levels: tuple[MultigridLevel, ...],
    x: FloatArray,
    b: FloatArray,
    tolerance: float,
    most: int,
    has_time: Callable[[], bool] | None = None,
) -> tuple[float, int]:
    """Do `conjugate_gradients.conjugate_gradients` without patches on the GPU, transfers included.

    Raises:
        MissingExtra: there is no GPU.
    """
    if not gpu_at_hand():
        raise MissingExtra("no GPU can be used here: choose another solver, or install waychair[gpu] beside its driver")
    k = _kernels()
    grids = tuple(_on_device(level) for level in levels)
    finest, at = grids[0], grids[0].blocks
    absorbed, there, r, q = (
        cuda.to_device(np.ascontiguousarray(part)) for part in (absorption, x, b, np.zeros_like(x))
    )
    p = cuda.to_device(np.zeros(x.shape, np.float32))
    sums = cuda.to_device(np.zeros(1))

    def dot(first: Any, second: Any) -> float:
        sums.copy_to_device(np.zeros(1))
        k.dot[at, _BLOCK](first, second, sums)
        return float(sums.copy_to_host()[0])

    whole = float(np.linalg.norm(b)) or 1.0
    k.apply[at, _BLOCK](absorbed, there, q)
    k.add[at, _BLOCK](r, q, -1.0)
    before, left, cycles = 0.0, math.sqrt(dot(r, r)), 0
    while left > tolerance * whole and cycles < most and (has_time is None or has_time()):
        k.rough[at, _BLOCK](r, finest.b)
        _v_cycle(k, grids)
        now = dot(r, finest.x)
        k.turn[at, _BLOCK](p, finest.x, np.float32(now / before if before else 0.0))
        k.apply[at, _BLOCK](absorbed, p, q)
        length = now / (dot(p, q) or 1.0)
        k.add[at, _BLOCK](there, p, length)
        k.add[at, _BLOCK](r, q, -length)
        left = math.sqrt(dot(r, r))
        before, cycles = now, cycles + 1
    there.copy_to_host(x)
    return left / whole, cycles


def _on_device(level: MultigridLevel) -> _DeviceLevel:
    blocks = (math.ceil(level.x.shape[1] / _COLUMNS), math.ceil(level.x.shape[0] / _ROWS))
    links = (level.east, level.south) if not level.uniform else (np.ones((1, 1), np.float32),) * 2
    east, south, inverse, x, b, left = (
        cuda.to_device(np.ascontiguousarray(part)) for part in (*links, level.inverse, level.x, level.b, level.x)
    )
    return _DeviceLevel(
        east=east, south=south, inverse=inverse, uniform=level.uniform, x=x, b=b, left=left, blocks=blocks
    )


def _v_cycle(k: _Kernels, grids: tuple[_DeviceLevel, ...]) -> None:
    def smooth(grid: _DeviceLevel) -> None:
        links = (grid.east, grid.south, grid.inverse, grid.uniform)
        k.left[grid.blocks, _BLOCK](*links, grid.x, grid.b, grid.left)
        k.smooth[grid.blocks, _BLOCK](*links, grid.left, grid.x)

    for grid, coarser in pairwise(grids):
        k.clear[grid.blocks, _BLOCK](grid.x)
        smooth(grid)
        k.left[grid.blocks, _BLOCK](grid.east, grid.south, grid.inverse, grid.uniform, grid.x, grid.b, grid.left)
        k.gather[coarser.blocks, _BLOCK](grid.left, grid.inverse, coarser.inverse, coarser.b)
    last = grids[-1]
    k.settle[1, _BLOCK](last.east, last.south, last.inverse, last.uniform, last.x, last.b, last.left)
    for grid, coarser in reversed(list(pairwise(grids))):
        k.prolong[grid.blocks, _BLOCK](coarser.x, grid.x, grid.inverse)
        smooth(grid)


class _Kernels(NamedTuple):
    clear: Any
    left: Any
    smooth: Any
    settle: Any
    apply: Any
    gather: Any
    prolong: Any
    add: Any
    turn: Any
    rough: Any
    dot: Any


@cache
def _kernels() -> _Kernels:
    """Return the kernels, made at first use: each thread has one cell; threads on the border do nothing."""
    jit = cuda.jit

    @jit(device=True)
    def near(east: Any, south: Any, uniform: bool, x: Any, i: int, j: int) -> Any:
        if uniform:
            return (x[i, j + 1] + x[i, j - 1]) + (x[i + 1, j] + x[i - 1, j])
        across = east[i, j] * x[i, j + 1] + east[i, j - 1] * x[i, j - 1]
        return across + (south[i, j] * x[i + 1, j] + south[i - 1, j] * x[i - 1, j])

    @jit(device=True)
    def left_at(east: Any, south: Any, inverse: Any, uniform: bool, x: Any, b: Any, i: int, j: int) -> Any:
        # the residual over the diagonal
        return inverse[i, j] * (b[i, j] + near(east, south, uniform, x, i, j)) - x[i, j]

    @jit(device=True)
    def smoothed_at(east: Any, south: Any, inverse: Any, uniform: bool, u: Any, i: int, j: int) -> Any:
        # the correction from the residual u over the diagonal
        return OF_ITSELF * u[i, j] + OF_NEIGHBOURS * (inverse[i, j] * near(east, south, uniform, u, i, j))

    @jit
    def clear(x: Any) -> None:
        j, i = cuda.grid(2)
        if i < x.shape[0] and j < x.shape[1]:
            x[i, j] = 0.0

    @jit
    def left(east: Any, south: Any, inverse: Any, uniform: bool, x: Any, b: Any, into: Any) -> None:
        j, i = cuda.grid(2)
        if 0 < i < x.shape[0] - 1 and 0 < j < x.shape[1] - 1:
            into[i, j] = left_at(east, south, inverse, uniform, x, b, i, j)

    @jit
    def smooth(east: Any, south: Any, inverse: Any, uniform: bool, u: Any, x: Any) -> None:
        j, i = cuda.grid(2)
        if 0 < i < x.shape[0] - 1 and 0 < j < x.shape[1] - 1:
            x[i, j] += smoothed_at(east, south, inverse, uniform, u, i, j)

    @jit
    def settle(east: Any, south: Any, inverse: Any, uniform: bool, x: Any, b: Any, u: Any) -> None:
        # the coarsest level in one launch: one block sweeps over all of its cells repeatedly
        first_j, first_i = cuda.grid(2)
        for i in range(first_i, x.shape[0], _ROWS):
            for j in range(first_j, x.shape[1], _COLUMNS):
                x[i, j] = 0.0
        for turn in range(2 * COARSEST_SWEEPS):
            cuda.syncthreads()
            for i in range(first_i + 1, x.shape[0] - 1, _ROWS):
                for j in range(first_j + 1, x.shape[1] - 1, _COLUMNS):
                    if turn % 2 == 0:
                        u[i, j] = left_at(east, south, inverse, uniform, x, b, i, j)
                    else:
                        x[i, j] += smoothed_at(east, south, inverse, uniform, u, i, j)

    @jit
    def apply(absorption: Any, x: Any, into: Any) -> None:
        # in float64 even if x is float32
        j, i = cuda.grid(2)
        if 0 < i < x.shape[0] - 1 and 0 < j < x.shape[1] - 1:
            value = 0.0
            if absorption[i - 1, j - 1] < math.inf:
                across = np.float64(x[i, j + 1]) + np.float64(x[i, j - 1])
                along = np.float64(x[i + 1, j]) + np.float64(x[i - 1, j])
                value = (4.0 + np.float64(absorption[i - 1, j - 1])) * np.float64(x[i, j]) - (across + along)
            into[i, j] = value

    @jit
    def gather(u: Any, inverse: Any, free: Any, into: Any) -> None:
        j, i = cuda.grid(2)
        if 0 < i < into.shape[0] - 1 and 0 < j < into.shape[1] - 1:
            total = np.float32(0.0)
            for di in range(-1, 3):
                for dj in range(-1, 3):
                    row, column = 2 * i - 1 + di, 2 * j - 1 + dj
                    if row < u.shape[0] and column < u.shape[1] and inverse[row, column] > 0:
                        weight = (3.0 if 0 <= di <= 1 else 1.0) * (3.0 if 0 <= dj <= 1 else 1.0)
                        total += np.float32(weight) * (u[row, column] / inverse[row, column])
            into[i, j] = total * np.float32(1 / 16) if free[i, j] > 0 else np.float32(0.0)

    @jit
    def prolong(e: Any, x: Any, inverse: Any) -> None:
        j, i = cuda.grid(2)
        if 0 < i < x.shape[0] - 1 and 0 < j < x.shape[1] - 1 and inverse[i, j] > 0:
            row, column = (i + 1) // 2, (j + 1) // 2
            beyond = row - 1 if i % 2 == 1 else row + 1
            aside = column - 1 if j % 2 == 1 else column + 1
            three = np.float32(3.0)
            beside = three * e[row, aside] + e[beyond, aside]
            x[i, j] += (three * (three * e[row, column] + e[beyond, column]) + beside) * np.float32(1 / 16)

    @jit
    def add(x: Any, p: Any, length: float) -> None:
        j, i = cuda.grid(2)
        if i < x.shape[0] and j < x.shape[1]:
            x[i, j] += length * np.float64(p[i, j])

    @jit
    def turn(p: Any, z: Any, beta: Any) -> None:
        j, i = cuda.grid(2)
        if i < p.shape[0] and j < p.shape[1]:
            p[i, j] = z[i, j] + beta * p[i, j]

    @jit
    def rough(r: Any, into: Any) -> None:
        j, i = cuda.grid(2)
        if i < r.shape[0] and j < r.shape[1]:
            into[i, j] = r[i, j]

    @jit
    def dot(x: Any, y: Any, into: Any) -> None:
        # each block first sums its cells in shared memory, so that only one of its threads adds to the total
        parts = cuda.shared.array(_THREADS, np.float64)
        j, i = cuda.grid(2)
        own = cuda.threadIdx.y * _COLUMNS + cuda.threadIdx.x
        parts[own] = x[i, j] * y[i, j] if i < x.shape[0] and j < x.shape[1] else 0.0
        half = _THREADS // 2
        while half > 0:
            cuda.syncthreads()
            if own < half:
                parts[own] += parts[own + half]
            half //= 2
        if own == 0:
            cuda.atomic.add(into, 0, parts[0])

    return _Kernels(
        clear=clear,
        left=left,
        smooth=smooth,
        settle=settle,
        apply=apply,
        gather=gather,
        prolong=prolong,
        add=add,
        turn=turn,
        rough=rough,
        dot=dot,
    )
