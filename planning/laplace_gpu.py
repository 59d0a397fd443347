"""The same conjugate gradients with the same multigrid on a GPU (numba.cuda), one thread a cell.

The levels are made on the CPU and copied over; between two looks at the residual nothing comes back but a few sums.
numba's simulator of CUDA (NUMBA_ENABLE_CUDASIM=1) runs the same kernels on a CPU, slowly, which is how they are tested.
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
from waychair.planning.multigrid import COARSEST_SWEEPS, SMOOTHINGS, Level
from waychair.types import FloatArray

cuda: Any
try:
    cuda = import_module("numba.cuda")
except ImportError:  # a numba without its CUDA target, which numba-cuda, of the extra `gpu`, brings back
    cuda = None

_COLUMNS, _ROWS = (4, 2) if getattr(numba.config, "ENABLE_CUDASIM", False) else (16, 4)
"""A block of threads: neighbouring ones read neighbouring columns, which lie together in memory. The simulator's are
threads of Python, of which fewer do."""

_BLOCK = (_COLUMNS, _ROWS)
_THREADS = _COLUMNS * _ROWS


@cache
def gpu_at_hand() -> bool:
    """Whether kernels can be run here, be it in the simulator."""
    return cuda is not None and bool(cuda.is_available())


class _Grid(NamedTuple):
    """A `Level` on the GPU, and in how many blocks it is worked on."""

    east: Any
    south: Any
    inverse: Any
    x: Any
    b: Any
    r: Any
    blocks: tuple[int, int]


def conjugate_gradients_on_gpu(
    levels: tuple[Level, ...],
    x: FloatArray,
    b: FloatArray,
    tolerance: float,
    most: int,
    go_on: Callable[[], bool] | None = None,
) -> tuple[float, int]:
    """`multigrid.conjugate_gradients`, transfers included, on the GPU.

    Raises:
        MissingExtra: there is none.
    """
    if not gpu_at_hand():
        raise MissingExtra("no GPU can be used here: choose another solver, or install waychair[gpu] beside its driver")
    k = _kernels()
    grids = tuple(_on_device(level) for level in levels)
    finest, at = grids[0], grids[0].blocks
    there, p, q = cuda.to_device(x), cuda.to_device(np.zeros_like(x)), cuda.to_device(np.zeros_like(x))
    sums = cuda.to_device(np.zeros(1))

    def dot(first: Any, second: Any) -> float:
        sums.copy_to_device(np.zeros(1))
        k.dot[at, _BLOCK](first, second, sums)
        return float(sums.copy_to_host()[0])

    whole = float(np.linalg.norm(b)) or 1.0
    k.apply[at, _BLOCK](finest.east, finest.south, finest.inverse, there, q)
    finest.b.copy_to_device(b)
    k.add[at, _BLOCK](finest.b, q, -1.0)
    before, left, cycles = 0.0, math.sqrt(dot(finest.b, finest.b)), 0
    while left > tolerance * whole and cycles < most and (go_on is None or go_on()):
        _v_cycle(k, grids)
        now = dot(finest.b, finest.x)
        k.turn[at, _BLOCK](p, finest.x, now / before if before else 0.0)
        k.apply[at, _BLOCK](finest.east, finest.south, finest.inverse, p, q)
        length = now / (dot(p, q) or 1.0)
        k.add[at, _BLOCK](there, p, length)
        k.add[at, _BLOCK](finest.b, q, -length)
        left = math.sqrt(dot(finest.b, finest.b))
        before, cycles = now, cycles + 1
    there.copy_to_host(x)
    return left / whole, cycles


def _on_device(level: Level) -> _Grid:
    blocks = (math.ceil(level.x.shape[1] / _COLUMNS), math.ceil(level.x.shape[0] / _ROWS))
    east, south, inverse, x, b, r = (cuda.to_device(np.ascontiguousarray(part)) for part in level)
    return _Grid(east, south, inverse, x, b, r, blocks)


def _v_cycle(k: _Kernels, grids: tuple[_Grid, ...]) -> None:
    def relax(grid: _Grid, colour: int) -> None:
        k.relax[grid.blocks, _BLOCK](grid.east, grid.south, grid.inverse, grid.x, grid.b, colour)

    for depth, (grid, coarser) in enumerate(pairwise(grids)):
        k.clear[grid.blocks, _BLOCK](grid.x)
        for _ in range(SMOOTHINGS if depth else 1):
            relax(grid, 0)
            relax(grid, 1)
        k.rest[grid.blocks, _BLOCK](grid.east, grid.south, grid.inverse, grid.x, grid.b, grid.r)
        k.gather[coarser.blocks, _BLOCK](grid.r, coarser.b)
    last = grids[-1]
    k.relax_all[1, _BLOCK](last.east, last.south, last.inverse, last.x, last.b)
    for depth, (grid, coarser) in reversed(list(enumerate(pairwise(grids)))):
        k.prolong[grid.blocks, _BLOCK](coarser.x, grid.x, grid.inverse)
        for _ in range(SMOOTHINGS if depth else 1):
            relax(grid, 1)
            relax(grid, 0)


class _Kernels(NamedTuple):
    clear: Any
    relax: Any
    relax_all: Any
    apply: Any
    rest: Any
    gather: Any
    prolong: Any
    add: Any
    turn: Any
    dot: Any


@cache
def _kernels() -> _Kernels:
    """The kernels, made when they are first wanted: each thread has a cell, those on the border have nothing to do."""
    jit = cuda.jit

    @jit
    def clear(x: Any) -> None:
        j, i = cuda.grid(2)
        if i < x.shape[0] and j < x.shape[1]:
            x[i, j] = 0.0

    @jit
    def relax(east: Any, south: Any, inverse: Any, x: Any, b: Any, colour: int) -> None:
        j, i = cuda.grid(2)
        if 0 < i < x.shape[0] - 1 and 0 < j < x.shape[1] - 1 and (i + j + colour) % 2 == 0:
            across = east[i, j] * x[i, j + 1] + east[i, j - 1] * x[i, j - 1]
            along = south[i, j] * x[i + 1, j] + south[i - 1, j] * x[i - 1, j]
            x[i, j] = inverse[i, j] * (b[i, j] + across + along)

    @jit
    def relax_all(east: Any, south: Any, inverse: Any, x: Any, b: Any) -> None:
        # the coarsest level in one launch: one block goes through all of its cells, again and again
        first_j, first_i = cuda.grid(2)
        for i in range(first_i, x.shape[0], _ROWS):
            for j in range(first_j, x.shape[1], _COLUMNS):
                x[i, j] = 0.0
        for turn in range(4 * COARSEST_SWEEPS):
            cuda.syncthreads()
            colour = turn % 2 if turn < 2 * COARSEST_SWEEPS else 1 - turn % 2
            for i in range(first_i + 1, x.shape[0] - 1, _ROWS):
                for j in range(first_j + 1, x.shape[1] - 1, _COLUMNS):
                    if (i + j + colour) % 2 == 0:
                        across = east[i, j] * x[i, j + 1] + east[i, j - 1] * x[i, j - 1]
                        along = south[i, j] * x[i + 1, j] + south[i - 1, j] * x[i - 1, j]
                        x[i, j] = inverse[i, j] * (b[i, j] + across + along)

    @jit
    def apply(east: Any, south: Any, inverse: Any, x: Any, into: Any) -> None:
        j, i = cuda.grid(2)
        if 0 < i < x.shape[0] - 1 and 0 < j < x.shape[1] - 1:
            value = 0.0
            if inverse[i, j] > 0:
                across = east[i, j] * x[i, j + 1] + east[i, j - 1] * x[i, j - 1]
                along = south[i, j] * x[i + 1, j] + south[i - 1, j] * x[i - 1, j]
                value = x[i, j] / inverse[i, j] - across - along
            into[i, j] = value

    @jit
    def rest(east: Any, south: Any, inverse: Any, x: Any, b: Any, into: Any) -> None:
        j, i = cuda.grid(2)
        if 0 < i < x.shape[0] - 1 and 0 < j < x.shape[1] - 1:
            value = 0.0
            if inverse[i, j] > 0:
                across = east[i, j] * x[i, j + 1] + east[i, j - 1] * x[i, j - 1]
                along = south[i, j] * x[i + 1, j] + south[i - 1, j] * x[i - 1, j]
                value = b[i, j] + across + along - x[i, j] / inverse[i, j]
            into[i, j] = value

    @jit
    def gather(r: Any, into: Any) -> None:
        j, i = cuda.grid(2)
        if 0 < i < into.shape[0] - 1 and 0 < j < into.shape[1] - 1:
            total = 0.0
            for di in range(-1, 3):
                for dj in range(-1, 3):
                    row, column = 2 * i - 1 + di, 2 * j - 1 + dj
                    if row < r.shape[0] and column < r.shape[1]:
                        near = (3.0 if 0 <= di <= 1 else 1.0) * (3.0 if 0 <= dj <= 1 else 1.0)
                        total += near * r[row, column]
            into[i, j] = total / 16.0

    @jit
    def prolong(e: Any, x: Any, inverse: Any) -> None:
        j, i = cuda.grid(2)
        if 0 < i < x.shape[0] - 1 and 0 < j < x.shape[1] - 1 and inverse[i, j] > 0:
            row, column = (i + 1) // 2, (j + 1) // 2
            beyond = row - 1 if i % 2 == 1 else row + 1
            aside = column - 1 if j % 2 == 1 else column + 1
            near = 9.0 * e[row, column] + 3.0 * (e[row, aside] + e[beyond, column])
            x[i, j] += (near + e[beyond, aside]) / 16.0

    @jit
    def add(x: Any, p: Any, length: float) -> None:
        j, i = cuda.grid(2)
        if i < x.shape[0] and j < x.shape[1]:
            x[i, j] += length * p[i, j]

    @jit
    def turn(p: Any, z: Any, beta: float) -> None:
        j, i = cuda.grid(2)
        if i < p.shape[0] and j < p.shape[1]:
            p[i, j] = z[i, j] + beta * p[i, j]

    @jit
    def dot(x: Any, y: Any, into: Any) -> None:
        # each block sums its own cells in shared memory first, so that only one of its threads adds to the whole
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

    return _Kernels(clear, relax, relax_all, apply, rest, gather, prolong, add, turn, dot)
