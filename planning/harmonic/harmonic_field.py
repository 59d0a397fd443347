"""Harmonic potential fields: from every cell connected to the goal, climbing v leads there.

The idea is Connolly, Burns and Weiss's (1990): a harmonic function has no local extremum, so a descent cannot be
trapped. With numbers this holds only without underflow: v falls by a factor per corridor width, and the source paper's
u = 1 - v, in float32, is flat on most of a real floor. Here the logarithm of v is kept. It is found in stages. A solver
finds v from the goal on, as far as its accuracy goes. These values are then fixed, everything is rescaled by the
largest value at their border, and the next stage continues from there. Cells without a stage hold a lower bound that
has no local maximum either, so every descent arrives, only less smoothly. For a path from one start, only cells near
its shortest path get stages.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import cv2
import numpy as np
from numba import njit

from waychair.config import Settings, setting
from waychair.errors import NoPath, NotConverged, StartOutsideMap
from waychair.planning.grid.grid_graph import NO_BARS, Cell
from waychair.planning.harmonic.laplace_solvers import (
    HasTime,
    LaplaceProblem,
    LinearSystem,
    SolverOptions,
    check_memory,
    chosen_solver,
    run_solver,
)
from waychair.planning.harmonic.log_relay import Indices, breadth_first_order, cells_near_shortest, log_sweep
from waychair.resumable import CountedSteps, finished, ranges_of
from waychair.types import BoolArray, Bytes, Float32Array, FloatArray, IntArray

_SMOOTHING, _REPAIRS = 2, 200
"""Sweeps in logarithms after the stages, and the most further sweeps until every cell has a better neighbour."""

_DIRECTED_SWEEPS = 60
"""Sweeps for a map with one-way zones: its matrix is not symmetric, so the stages' solvers cannot be used."""


TOLERANCE, MOST_SWEEPS = 1e-13, 400
"""Relative residual of a stage's solution, and the most cycles for it: the last digits of v carry the far cells."""

TRUSTED = 1e-8
"""Values below this part of a stage's largest are left to the next stage."""

STAGES = 1000
"""Most stages; cells beyond them only get a lower bound."""

DETOUR = 200
"""[steps] Cells on no path at most this much longer than the shortest one are not solved."""

STREAMLINE_STEP = 0.4
"""[cells] Length of one step of a streamline."""


@dataclass(frozen=True, slots=True)
class HarmonicSettings(Settings):
    """The solver of the harmonic planner."""

    solver: str = setting(
        "multigrid",
        "",
        "solver: gauss-seidel, sor, multigrid, direct, gpu, or auto (gpu where there is one, else multigrid)",
    )
    memory: float = setting(
        4000.0, "MB", "memory that the solver may take; larger: larger maps are accepted", low=1.0, high=1e7
    )

    @property
    def options(self) -> SolverOptions:
        """The options of the stages' solver."""
        return SolverOptions(solver=self.solver, tolerance=TOLERANCE, most_sweeps=MOST_SWEEPS, memory=self.memory)


@dataclass(frozen=True, slots=True)
class LogField:
    """The harmonic field as logs (H, W) float64 = log v: 0 at the goal, -inf where no path to it exists.

    `connected` counts the cells with a path; `solved` (H, W) are those that `stages` stages with `sweeps` sweeps found.
    """

    logs: FloatArray
    goal: Cell
    connected: int
    solved: BoolArray
    stages: int
    sweeps: int
    barred: Bytes = field(default_factory=lambda: NO_BARS)


def log_field(
    problem: LaplaceProblem,
    settings: HarmonicSettings = HarmonicSettings(),
    warm_start: LogField | None = None,
    until: Cell | None = None,
    barred: Bytes | None = None,
    has_time: HasTime | None = None,
) -> LogField:
    """Return the field of a problem in logarithms; every connected cell but the goal has a strictly better neighbour.

    Arguments and errors are those of `log_field_resumably`.
    """
    return finished(
        log_field_resumably(
            problem=problem, settings=settings, warm_start=warm_start, until=until, barred=barred, has_time=has_time
        )
    )


def log_field_resumably(
    problem: LaplaceProblem,
    settings: HarmonicSettings = HarmonicSettings(),
    warm_start: LogField | None = None,
    until: Cell | None = None,
    barred: Bytes | None = None,
    has_time: HasTime | None = None,
) -> CountedSteps[LogField]:
    """Return the field of a problem in logarithms, in parts of a few milliseconds each.

    With a cell `until`, only the cells between it and the goal are solved. A `warm_start` from a similar problem saves
    the stages most of their work. `barred` (H, W) has the directions of one-way zones, as in `grid_graph`.

    Raises:
        MapTooLarge, NotConverged, ConfigError: see `laplace_solvers.solve`.
    """
    absorption = problem.absorption
    check_memory(absorption.size, chosen_solver(settings.solver), settings.memory)
    bars = NO_BARS if barred is None else barred
    yield 3 * absorption.size  # for making the problem
    order, numbers = yield from breadth_first_order(absorption, bars, problem.goal)
    logs = np.full(absorption.shape, -np.inf)
    logs[problem.goal] = 0.0
    yield absorption.size
    stages, sweeps = 0, 0
    if barred is None:
        wanted = order if until is None else order[_between(order, numbers, absorption.shape, until, DETOUR)]
        mask = _mask(absorption.shape, wanted)
        yield 4 * len(order)
        stages, sweeps = yield from _staged(
            problem=problem,
            wanted=mask,
            logs=logs,
            options=settings.options,
            warm_start=warm_start,
            until=until,
            has_time=has_time,
        )
        solved = np.isfinite(logs)
    else:
        solved = _mask(absorption.shape, order)
    in_order = logs.ravel()[order]
    smoothing = _SMOOTHING if barred is None else _DIRECTED_SWEEPS
    yield from _finish(in_order, numbers, absorption.ravel()[order], smoothing)
    logs.ravel()[order] = in_order
    return LogField(
        logs=logs, goal=problem.goal, connected=len(order), solved=solved, stages=stages, sweeps=sweeps, barred=bars
    )


def _between(order: Indices, numbers: Indices, shape: tuple[int, ...], start: Cell, detour: int) -> BoolArray:
    """Return (N,) which cells of the order lie between a start and the goal; none if they are not connected."""
    at = np.flatnonzero(order == start[0] * shape[1] + start[1])
    return cells_near_shortest(numbers, int(at[0]), detour) if len(at) else np.zeros(len(order), np.bool_)


def _mask(shape: tuple[int, ...], cells: Indices) -> BoolArray:
    """Return (H, W) a mask that is true at flat indices (N,)."""
    mask = np.zeros(shape, np.bool_)
    mask.ravel()[cells] = True
    return mask


def _staged(
    problem: LaplaceProblem,
    wanted: BoolArray,
    logs: FloatArray,
    options: SolverOptions,
    warm_start: LogField | None,
    until: Cell | None,
    has_time: HasTime | None,
) -> CountedSteps[tuple[int, int]]:
    """Find `logs` (H, W) of wanted cells, in place, from the goal on; return the numbers of stages and sweeps."""
    stages, sweeps = 0, 0
    warm = warm_start.logs if warm_start is not None and warm_start.logs.shape == logs.shape else None
    while stages < STAGES and (until is None or not np.isfinite(logs[until])):
        unknown = wanted & ~np.isfinite(logs)
        left, top, width, height = cv2.boundingRect(unknown.view(np.uint8))
        if not width:
            break
        box = (slice(max(top - 1, 0), top + height + 1), slice(max(left - 1, 0), left + width + 1))
        found, done = yield from _stage(
            np.where(unknown[box], problem.absorption[box], np.float32(np.inf)),
            logs[box],
            None if warm is None else warm[box],
            options,
            has_time,
        )
        stages, sweeps = stages + 1, sweeps + done
        if not np.isfinite(found).any():
            break
        logs[box] = np.where(np.isfinite(found), found, logs[box])
    return stages, sweeps


def _stage(
    absorption: Float32Array,
    known: FloatArray,
    warm: FloatArray | None,
    options: SolverOptions,
    has_time: HasTime | None,
) -> CountedSteps[tuple[FloatArray, int]]:
    """Return logs (H, W) of the unknown cells that one solution finds exactly enough, else -inf; and its sweeps."""
    free = np.pad(absorption < np.inf, 1)
    border = np.pad(known, 1, constant_values=-np.inf)
    beside = free[1:-1, 2:] | free[1:-1, :-2] | free[2:, 1:-1] | free[:-2, 1:-1]
    scale = float(known[beside].max(initial=-np.inf))
    none = np.full(known.shape, -np.inf)
    if scale == -np.inf:
        return none, 0
    with np.errstate(under="ignore"):
        values = np.exp(border - scale, out=np.zeros_like(border), where=border <= scale)
    b = np.zeros_like(values)
    b[1:-1, 1:-1] = values[1:-1, 2:] + values[1:-1, :-2] + values[2:, 1:-1] + values[:-2, 1:-1]
    b[~free] = 0.0
    x = np.zeros_like(b)
    if warm is not None:
        x[1:-1, 1:-1] = np.exp(np.minimum(warm - scale, 0.0))
        x[~free] = 0.0
    yield 4 * x.size
    solver = chosen_solver(options.solver)
    _, sweeps = yield from run_solver(solver, LinearSystem(absorption, x, b, options, has_time))
    yield 4 * x.size
    told = x[1:-1, 1:-1] > TRUSTED * x.max()
    return np.where(told, np.log(x[1:-1, 1:-1], where=told, out=none.copy()) + scale, none), sweeps


def _finish(logs: FloatArray, numbers: Indices, absorption: Float32Array, sweeps: int) -> CountedSteps[None]:
    """Fill the unknown logs (N,), in breadth-first order from the goal, so that no cell is a local maximum.

    Raises:
        NotConverged: some cell still is one.
    """
    diagonals = (4.0 + absorption).astype(np.float32)
    _fill(logs, numbers, diagonals)
    yield 2 * len(logs)
    for sweep in range(sweeps):
        yield from _swept(logs, numbers, diagonals, sweep % 2 == 0)
    for repair in range(_REPAIRS):
        if not summits(logs, numbers):
            return
        yield from _swept(logs, numbers, diagonals, repair % 2 == 0)
    raise NotConverged(
        f"{summits(logs, numbers)} cells of the field have no better neighbour; ask the solver for a smaller tolerance"
    )


def _swept(logs: FloatArray, numbers: Indices, diagonals: Float32Array, forward: bool) -> CountedSteps[None]:
    """Do one sweep over logs (N,), except the goal's, in chunks."""
    parts = ranges_of(1, len(logs), _CHUNK)
    for first, last in parts if forward else parts[::-1]:
        log_sweep(logs, numbers, diagonals, first, last, forward)
        yield _LOG_PRICE * (last - first)


_CHUNK, _LOG_PRICE = 100_000, 12
"""Cells of one chunk of a sweep in logarithms, and the time per cell in units of the other passes."""


@njit(cache=True, nogil=True)
def _fill(logs: FloatArray, numbers: Indices, diagonals: Float32Array) -> None:
    """Bound the unknown cells from below by the contribution of their best neighbour nearer to the goal."""
    for k in range(1, len(logs)):
        if logs[k] == -np.inf:
            best = -np.inf
            for d in range(4):
                if numbers[k, d] >= 0:
                    best = max(best, logs[numbers[k, d]])
            logs[k] = best - math.log(diagonals[k])


@njit(cache=True, nogil=True)
def summits(logs: FloatArray, numbers: Indices) -> int:
    """Return how many cells, except the first, have no strictly better neighbour."""
    count = 0
    for k in range(1, len(logs)):
        better = False
        for d in range(4):
            better |= numbers[k, d] >= 0 and logs[numbers[k, d]] > logs[k]
        count += not better
    return count


def count_summits(found: LogField) -> int:
    """Return how many connected cells but the goal have no strictly better neighbour, in plain array arithmetic."""
    padded = np.pad(found.logs, 1, constant_values=-np.inf)
    best = np.maximum.reduce([padded[1:-1, 2:], padded[1:-1, :-2], padded[2:, 1:-1], padded[:-2, 1:-1]])
    lacking = np.isfinite(found.logs) & (best <= found.logs)
    lacking[found.goal] = False
    return int(lacking.sum())


def descend(found: LogField, start: Cell) -> IntArray:
    """Return cells (N, 2) from a start to the goal, each the best of the eight neighbours of the one before.

    A diagonal step needs both cells beside it free. The source paper takes the best of four neighbours.

    Raises:
        StartOutsideMap, NoPath.
    """
    _check_start(found, start)
    cells, count = _descend(found.logs, found.barred, start[0], start[1], found.connected)
    if count == 0:
        raise NoPath(
            f"the descent from column {start[1]}, row {start[0]} does not reach the goal; solve the field anew"
        )
    return cells[:count]


def _check_start(found: LogField, start: Cell) -> None:
    height, width = found.logs.shape
    at = f"the start in column {start[1]}, row {start[0]}"
    if not (0 <= start[0] < height and 0 <= start[1] < width):
        raise StartOutsideMap(
            f"{at} lies outside the map of {width} columns and {height} rows; choose a cell inside it"
        )
    if not np.isfinite(found.logs[start]):
        raise NoPath(f"{at} is not connected to the goal; clear the way or choose another goal")


@njit(cache=True, nogil=True)
def _descend(logs: FloatArray, barred: Bytes, row: int, column: int, most: int) -> tuple[IntArray, int]:
    """Return the cells and their number; 0 when the descent gets stuck."""
    height, width = logs.shape
    cells = np.empty((most, 2), np.int64)
    rows, columns = (0, 1, 1, 1, 0, -1, -1, -1), (1, 1, 0, -1, -1, -1, 0, 1)
    count = 0
    while count < most:
        cells[count, 0], cells[count, 1] = row, column
        count += 1
        here = logs[row, column]
        if here == 0.0:
            return cells, count
        best, to_row, to_column = here, row, column
        for d in range(8):
            i, j = row + rows[d], column + columns[d]
            if not (0 <= i < height and 0 <= j < width) or not logs[i, j] > best:
                continue
            if d % 2 == 1 and (logs[row, j] == -np.inf or logs[i, column] == -np.inf):
                continue
            if barred.size and (barred[row, column] | barred[i, j]) >> d & 1:
                continue
            best, to_row, to_column = logs[i, j], i, j
        if best == here:
            return cells, 0
        row, column = to_row, to_column
    return cells, 0


def streamline(found: LogField, start: FloatArray) -> FloatArray:
    """Return points (N, 2), columns and rows [cells], from a start along the field's interpolated gradient.

    (0.5, 0.5) is the middle of cell (0, 0). Where the gradient leads into a wall or no higher, the line goes to the
    middle of the best neighbour. Each such detour climbs above all points before it, so the line arrives.

    Raises:
        StartOutsideMap, NoPath.
    """
    cell = (math.floor(start[1]), math.floor(start[0]))
    _check_start(found, cell)
    points, count = _streamline(found.logs, start[0], start[1], STREAMLINE_STEP, 64 * found.connected + 64)
    if count == 0:
        raise NoPath(f"the line from column {cell[1]}, row {cell[0]} does not reach the goal; solve the field anew")
    goal = np.array([found.goal[1] + 0.5, found.goal[0] + 0.5])
    return np.concatenate([points[:count], goal[None]])


_PATIENCE = 6
"""Number of steps within which a streamline has to climb above its highest value so far."""


@njit(cache=True, nogil=True)
def _streamline(logs: FloatArray, x: float, y: float, step: float, most: int) -> tuple[FloatArray, int]:
    height, width = logs.shape
    points = np.empty((min(most, 1 << 20), 2))
    count, best, since = 0, -np.inf, 0
    while count < len(points):
        points[count, 0], points[count, 1] = x, y
        count += 1
        row, column = int(y), int(x)
        if logs[row, column] == 0.0:
            return points, count
        if logs[row, column] > best:
            best, since = logs[row, column], 0
        else:
            since += 1
        gx, gy = gradient(logs, x, y)
        size = math.sqrt(gx * gx + gy * gy)
        if since < _PATIENCE and size > 0.0:
            to_x, to_y = x + step * gx / size, y + step * gy / size
            half_x, half_y = 0.5 * (x + to_x), 0.5 * (y + to_y)
            if _free(logs, to_x, to_y) and _free(logs, half_x, half_y) and _open_between(logs, x, y, to_x, to_y):
                x, y = to_x, to_y
                continue
        # to the middle of the best of the four neighbours
        highest, to_row, to_column = logs[row, column], row, column
        for d in range(4):
            i, j = row + (d == 0) - (d == 1), column + (d == 2) - (d == 3)
            if 0 <= i < height and 0 <= j < width and logs[i, j] > highest:
                highest, to_row, to_column = logs[i, j], i, j
        if highest == logs[row, column]:
            return points, 0
        x, y = to_column + 0.5, to_row + 0.5
        since = 0
    return points, 0


@njit(cache=True, inline="always")
def _free(logs: FloatArray, x: float, y: float) -> bool:
    return bool(0.0 <= x < logs.shape[1] and 0.0 <= y < logs.shape[0] and logs[int(y), int(x)] > -np.inf)


@njit(cache=True, inline="always")
def _open_between(logs: FloatArray, x: float, y: float, to_x: float, to_y: float) -> bool:
    """Return whether a step to a diagonal neighbour passes no corner of a wall."""
    if int(x) == int(to_x) or int(y) == int(to_y):
        return True
    return bool(logs[int(y), int(to_x)] > -np.inf and logs[int(to_y), int(x)] > -np.inf)


@njit(cache=True, nogil=True)
def gradient(logs: FloatArray, x: float, y: float) -> tuple[float, float]:
    """Return the gradient of v, interpolated between the middles of the four cells around a point; walls hold 0.

    It is in units of the largest of the four values, so that it cannot underflow.
    """
    left, above = math.floor(x - 0.5), math.floor(y - 0.5)
    fx, fy = x - 0.5 - left, y - 0.5 - above
    top = -np.inf
    for i in range(2):
        for j in range(2):
            top = max(top, _at(logs, above + i, left + j))
    if top == -np.inf:
        return 0.0, 0.0
    a, b = math.exp(_at(logs, above, left) - top), math.exp(_at(logs, above, left + 1) - top)
    c, d = math.exp(_at(logs, above + 1, left) - top), math.exp(_at(logs, above + 1, left + 1) - top)
    return (1 - fy) * (b - a) + fy * (d - c), (1 - fx) * (c - a) + fx * (d - b)


@njit(cache=True, inline="always")
def _at(logs: FloatArray, row: int, column: int) -> float:
    if 0 <= row < logs.shape[0] and 0 <= column < logs.shape[1]:
        return float(logs[row, column])
    return -np.inf
