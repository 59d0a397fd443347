"""Laplace's equation on a grid: several solvers behind one function.

The source paper (harmonic fields on a GPU and a rubber band for smart wheelchairs, section II) solves for u, 0 at the
goal and 1 in obstacles. Here the unknown is v = 1 - u, 1 at the goal and 0 in obstacles: far from the goal u differs
from 1 by less than float64 resolves, while v keeps its relative accuracy. A cell may absorb part of the flow through it
(the diagonal is 4 + absorption): an obstacle absorbs everything, a dear or possibly occupied cell a little.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numba import njit

from waychair.errors import ConfigError, GoalOccupied, GoalOutsideMap, MapTooLarge, NotConverged
from waychair.maps.grid.cells import cells_where
from waychair.planning.grid.grid_graph import SIDES, Cell
from waychair.planning.harmonic.conjugate_gradients import conjugate_gradients, norm_of, write_residual
from waychair.planning.harmonic.multigrid_levels import levels_from, levels_size
from waychair.planning.harmonic.multigrid_patches import CellRectangle, smoothing_patches
from waychair.planning.harmonic.scratch_memory import LINE, borrowed_scratch_memory
from waychair.resumable import CountedSteps, finished
from waychair.types import BoolArray, Float32Array, FloatArray, IntArray

HasTime = Callable[[], bool]
"""Called between sweeps: returns whether there is time for more."""

_BYTES = MappingProxyType({"gauss-seidel": 40, "sor": 40, "multigrid": 70, "direct": 2000, "gpu": 90})
"""Approximate memory [bytes] per cell of each solver; the direct solver's factors grow faster than the map."""

_AROUND = (24, 64, 128)
"""Margins [cells] around a change of the squares that are solved locally, in turn, before the whole grid."""


_WRONG = 1e-3
"""Part of the largest residual above which a cell counts as changed; a warm start's error is smaller."""

_FADES = 0.03
"""A local solve that leaves more than this part of the residual shows that the change is not local."""


@dataclass(frozen=True, slots=True)
class SolverOptions:
    """Which solver is used, its tolerance, and its bounds of time and memory."""

    solver: str = "multigrid"
    """gauss-seidel, sor, multigrid, direct, gpu, or auto: gpu where there is one, else multigrid."""
    tolerance: float = 1e-8
    """Largest |b - A v| / |b|."""
    most_sweeps: int = 20_000
    """Sweeps, or cycles of multigrid, after which the solver gives up."""
    omega: float = 0.0
    """Over-relaxation of sor; 0: by the map's size."""
    initial: float = 0.0
    """Value of free cells before the first sweep."""
    memory: float = 4000.0
    """[MB] Memory that the solver may take."""


PAPER_SOLVER = SolverOptions(solver="gauss-seidel", initial=0.5, tolerance=1e-6, most_sweeps=1_000_000)
"""The source paper's solver: Eq 1 row by row, in place, from the middle of the range. It gives no iteration count."""


@dataclass(frozen=True, slots=True)
class LaplaceProblem:
    """The input of a field: absorption (H, W) float32, 0 for free floor and infinite for obstacles, and the goal.

    Raises:
        GoalOutsideMap, GoalOccupied: the goal is no free cell of the map.
    """

    absorption: Float32Array
    goal: Cell

    def __post_init__(self) -> None:
        height, width = self.absorption.shape
        row, column = self.goal
        if not (0 <= row < height and 0 <= column < width):
            raise GoalOutsideMap(
                f"the goal in column {column}, row {row} lies outside the map of {width} columns and {height} rows; "
                "choose a cell inside it"
            )
        if not math.isfinite(self.absorption[self.goal]):
            raise GoalOccupied(f"the goal in column {column}, row {row} is occupied; choose a free cell")


def laplace_problem(free: BoolArray, goal: Cell) -> LaplaceProblem:
    """Return the problem of free cells (H, W) that absorb nothing."""
    return LaplaceProblem(np.where(free, np.float32(0.0), np.float32(np.inf)), goal)


@dataclass(frozen=True, slots=True)
class LaplaceField:
    """The solution v (H, W) float64: 1 at the goal, 0 in obstacles. residual: |b - A v| / |b|; sweeps: their number."""

    v: FloatArray
    residual: float
    sweeps: int


def solve(
    problem: LaplaceProblem,
    options: SolverOptions = SolverOptions(),
    warm_start: LaplaceField | None = None,
    has_time: HasTime | None = None,
) -> LaplaceField:
    """Return the field of a problem; with a `warm_start` of the same shape only the differences take time.

    Raises:
        MapTooLarge: the solver would exceed its memory.
        NotConverged: the tolerance was not reached within the allowed sweeps or time.
        ConfigError: no solver has this name.
    """
    solver = chosen_solver(options.solver)
    absorption = problem.absorption
    check_memory(absorption.size, solver, options.memory)
    walls = absorption.copy()
    walls[problem.goal] = np.inf
    free = np.pad(walls < np.inf, 1)
    row, column = problem.goal[0] + 1, problem.goal[1] + 1
    b = np.full(free.shape, 0.0)
    for d, e in SIDES:
        b[row + d, column + e] = free[row + d, column + e]
    x = np.zeros_like(b)
    if warm_start is not None and warm_start.v.shape == absorption.shape:
        np.multiply(warm_start.v, free[1:-1, 1:-1], out=x[1:-1, 1:-1])
    elif options.initial:
        x[free] = options.initial
    system = LinearSystem(absorption=walls, x=x, b=b, options=options, has_time=has_time, warm=warm_start is not None)
    residual, sweeps = finished(run_solver(solver, system))
    v = x[1:-1, 1:-1]
    v[problem.goal] = 1.0
    return LaplaceField(v, residual, sweeps)


@dataclass(frozen=True, slots=True)
class LinearSystem:
    """The linear system A x = b of cells (H, W) with absorption; infinite absorption is a wall.

    x and b (H + 2, W + 2) are 0 in walls and on the border; x is improved in place. `warm`: x is nearly right already.
    """

    absorption: Float32Array
    x: FloatArray
    b: FloatArray
    options: SolverOptions
    has_time: HasTime | None = None
    warm: bool = False


def run_solver(solver: str, system: LinearSystem) -> CountedSteps[tuple[float, int]]:
    """Improve x in place until A x = b; return the relative residual, and the sweeps.

    Raises:
        NotConverged: as in `solve`.
    """
    residual, sweeps = yield from _SOLVERS[solver](system)
    tolerance = system.options.tolerance
    if not residual <= tolerance:
        raise NotConverged(
            f"the field's relative residual is {residual:.1e} after {sweeps} sweeps of {solver}, not "
            f"{tolerance:.1e}; allow more sweeps or time, or take a coarser map"
        )
    return residual, sweeps


def relative_residual(problem: LaplaceProblem, v: FloatArray) -> float:
    """Return |b - A v| / |b| of values (H, W) that include the goal's 1, in plain array arithmetic."""
    free = np.isfinite(problem.absorption)
    free[problem.goal] = False
    b, padded = np.zeros_like(v), np.pad(np.where(free, v, 0.0), 1)
    b[problem.goal] = 1.0
    spread = np.pad(b, 1)
    at_cells = np.where(free, _neighbours(spread), 0.0)
    with np.errstate(invalid="ignore"):
        left = at_cells + _neighbours(padded) - (4.0 + problem.absorption.astype(np.float64)) * np.where(free, v, 0.0)
    return float(np.linalg.norm(left[free]) / (np.linalg.norm(at_cells) or 1.0))


def _neighbours(padded: FloatArray) -> FloatArray:
    """Return (H, W) sums over the four neighbours of (H + 2, W + 2)."""
    total: FloatArray = padded[1:-1, 2:] + padded[1:-1, :-2] + padded[2:, 1:-1] + padded[:-2, 1:-1]
    return total


def check_memory(cells: int, solver: str, memory: float) -> None:
    """Refuse a map for which a solver would need more than `memory` [MB].

    Raises:
        MapTooLarge: it would.
    """
    needed = cells * _BYTES[solver] / 1e6
    if needed > memory:
        raise MapTooLarge(
            f"a map of {cells} cells takes {needed:.0f} MB by {solver}, and {memory:.0f} MB are allowed; take coarser "
            "cells, or allow more memory"
        )


def chosen_solver(solver: str) -> str:
    """Return the name of the solver; `auto` is the best on this computer."""
    if solver == "auto":
        from waychair.planning.harmonic.laplace_gpu import gpu_at_hand

        return "gpu" if gpu_at_hand() else "multigrid"
    if solver not in _SOLVERS:
        raise ConfigError(f"there is no solver '{solver}'; choose auto, {', '.join(_SOLVERS)}")
    return solver


def _multigrid(system: LinearSystem) -> CountedSteps[tuple[float, int]]:
    absorption, x, b, s = system.absorption, system.x, system.b, system.options
    sources = cells_where(b != 0.0)
    places = [_extent(sources)] if len(sources) else []
    rest_and_direction = (8 + 4) * x.size + 2 * LINE
    with borrowed_scratch_memory(levels_size(absorption.shape) + rest_and_direction) as memory:
        rest = None
        if system.warm:
            rest = memory.framed(x.shape, np.float64)
            residual, changed = _solved_nearby(absorption, x, b, s.tolerance, rest)
            if residual <= s.tolerance:
                return residual, 0
            places += [changed] if changed is not None else []
        levels = levels_from(absorption, memory)
        yield 4 * x.size
        patches, most, has_time = smoothing_patches(levels, places), s.most_sweeps, system.has_time
        solving = conjugate_gradients(
            absorption=absorption,
            levels=levels,
            x=x,
            b=b,
            tolerance=s.tolerance,
            most=most,
            has_time=has_time,
            patches=patches,
            rest=rest,
            memory=memory,
        )
        return (yield from solving)


def _solved_nearby(
    absorption: Float32Array, x: FloatArray, b: FloatArray, tolerance: float, rest: FloatArray
) -> tuple[float, CellRectangle | None]:
    """Improve x around the cells where it is wrong, in larger and larger squares.

    The effect of a local change fades with the distance. Return the residual, and the rectangle of the first error;
    None if the error was small but everywhere. Afterwards `rest` is the residual b - A x.
    """
    whole = norm_of(b) or 1.0
    before, changed = math.inf, None
    for around in _AROUND:
        residual = write_residual(absorption, x, b, rest) / whole
        if residual <= tolerance or residual > _FADES * before:
            return residual, changed
        before = residual
        enough = max(_WRONG * float(max(rest.max(), -rest.min())), 0.1 * tolerance * whole)
        wrong = cells_where((rest > enough) | (rest < -enough))
        if not len(wrong):  # a small error everywhere
            return residual, changed
        first, last = _extent(wrong)
        changed = changed or (first, last)
        low, high = np.maximum(first - around, 1), np.minimum(last + around, np.array(x.shape) - 2)
        if np.prod(high - low + 1) > 0.25 * x.size:
            return residual, changed
        _solve_square(absorption=absorption, x=x, rest=rest, low=low, high=high, enough=tolerance * whole)
    return write_residual(absorption, x, b, rest) / whole, changed


def _extent(cells: IntArray) -> CellRectangle:
    """Return first and last row and column of cells (N, 2)."""
    return cells.min(axis=0), cells.max(axis=0)


def _solve_square(
    absorption: Float32Array, x: FloatArray, rest: FloatArray, low: IntArray, high: IntArray, enough: float
) -> None:
    """Correct x from row and column `low` to `high` (in the padded grid); all other values are fixed."""
    inner = (slice(int(low[0]), int(high[0]) + 1), slice(int(low[1]), int(high[1]) + 1))
    part = np.ascontiguousarray(absorption[low[0] - 1 : high[0], low[1] - 1 : high[1]])
    b = np.pad(rest[inner], 1)
    correction, size = np.zeros_like(b), norm_of(b)
    if size > 0.0:
        least = min(0.1 * enough / size, 0.5)
        finished(
            conjugate_gradients(absorption=part, levels=levels_from(part), x=correction, b=b, tolerance=least, most=30)
        )
        x[inner] += correction[1:-1, 1:-1]


def _red_black(system: LinearSystem) -> CountedSteps[tuple[float, int]]:
    """Solve by successive over-relaxation; the default factor is the best one for an empty square of the map's side."""
    inverse, x, b = _inverse(system.absorption), system.x, system.b
    omega = system.options.omega or 2.0 / (1.0 + math.sin(math.pi / max(x.shape)))

    def sweep() -> None:
        relax(inverse, x, b, 0, omega)
        relax(inverse, x, b, 1, omega)

    return _swept(sweep, system)


def _gauss_seidel(system: LinearSystem) -> CountedSteps[tuple[float, int]]:
    inverse = _inverse(system.absorption)
    return _swept(lambda: row_by_row(inverse, system.x, system.b), system)


def _inverse(absorption: Float32Array) -> FloatArray:
    """Return (H + 2, W + 2) the inverse of the matrix's diagonal, 0 in walls."""
    inverse: FloatArray = np.pad(1.0 / (4.0 + absorption.astype(np.float64)), 1)
    return inverse


def _swept(sweep: Callable[[], None], system: LinearSystem) -> CountedSteps[tuple[float, int]]:
    x, b, options, has_time = system.x, system.b, system.options, system.has_time
    whole, rest = norm_of(b) or 1.0, np.zeros_like(b)
    residual, done = math.inf, 0
    while True:
        residual = write_residual(system.absorption, x, b, rest) / whole
        if residual <= options.tolerance or done >= options.most_sweeps or (has_time is not None and not has_time()):
            return residual, done
        for _ in range(min(_BETWEEN, options.most_sweeps - done)):
            sweep()
            done += 1
            yield x.size


_BETWEEN = 10
"""Sweeps between two checks of the residual, which takes about as long as one sweep."""


@njit(cache=True, nogil=True)
def relax(inverse: FloatArray, x: FloatArray, b: FloatArray, colour: int, omega: float) -> None:
    """Do one Gauss-Seidel sweep over the cells of one colour of a chessboard, in place, over-relaxed by omega."""
    for i in range(1, x.shape[0] - 1):
        for j in range(1 + (i + colour + 1) % 2, x.shape[1] - 1, 2):
            near = x[i, j + 1] + x[i, j - 1] + x[i + 1, j] + x[i - 1, j]
            x[i, j] += omega * (inverse[i, j] * (b[i, j] + near) - x[i, j])


@njit(cache=True, nogil=True)
def row_by_row(inverse: FloatArray, x: FloatArray, b: FloatArray) -> None:
    """Do one sweep of the paper's Eq 1 in sequence: each cell becomes the mean of its neighbours, already updated ones
    included."""
    for i in range(1, x.shape[0] - 1):
        for j in range(1, x.shape[1] - 1):
            near = x[i, j + 1] + x[i, j - 1] + x[i + 1, j] + x[i - 1, j]
            x[i, j] = inverse[i, j] * (b[i, j] + near)


def _direct(system: LinearSystem) -> CountedSteps[tuple[float, int]]:
    """Solve by sparse LU (SuperLU) without pivoting: a diagonally dominant matrix needs none."""
    from scipy.sparse import csc_matrix
    from scipy.sparse.linalg import splu

    x, b = system.x, system.b
    free = np.pad(system.absorption < np.inf, 1)
    count = int(free.sum())
    if count == 0:
        return 0.0, 0
    number = np.full(x.shape, -1, np.int64)
    number[free] = np.arange(count)
    rows, columns = [np.arange(count)], [np.arange(count)]
    absorbed = np.zeros(x.shape)
    absorbed[1:-1, 1:-1] = system.absorption
    values = [4.0 + absorbed[free]]
    for shift in SIDES:
        other = np.roll(number, (-shift[0], -shift[1]), (0, 1))[free]
        linked = other >= 0
        rows.append(np.flatnonzero(linked))
        columns.append(other[linked])
        values.append(np.full(int(linked.sum()), -1.0))
    entries = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
    matrix = csc_matrix(entries, shape=(count, count))
    yield x.size
    factors = splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    x[free] = factors.solve(b[free])
    rest = b[free] - matrix @ x[free]
    return float(np.linalg.norm(rest) / (np.linalg.norm(b) or 1.0)), 1


def _on_gpu(system: LinearSystem) -> CountedSteps[tuple[float, int]]:
    from waychair.planning.harmonic.laplace_gpu import conjugate_gradients_on_gpu

    levels, s = levels_from(system.absorption), system.options
    yield system.x.size
    return conjugate_gradients_on_gpu(
        absorption=system.absorption,
        levels=levels,
        x=system.x,
        b=system.b,
        tolerance=s.tolerance,
        most=s.most_sweeps,
        has_time=system.has_time,
    )


_SOLVERS: Mapping[str, Callable[[LinearSystem], CountedSteps[tuple[float, int]]]] = MappingProxyType(
    {
        "gauss-seidel": _gauss_seidel,
        "sor": _red_black,
        "multigrid": _multigrid,
        "direct": _direct,
        "gpu": _on_gpu,
    }
)
