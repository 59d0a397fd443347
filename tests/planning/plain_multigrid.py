"""Problems for multigrid, and plain dense references for it, on grids of a few hundred cells."""

from __future__ import annotations

import numpy as np

from waychair.planning.harmonic.laplace_solvers import LaplaceProblem, laplace_problem
from waychair.planning.harmonic.multigrid_levels import COARSEST_SWEEPS, MultigridLevel
from waychair.planning.harmonic.multigrid_patches import CellRectangle
from waychair.types import Float32Array, FloatArray

ROUND = 2
"""Return the cells round a place that are in its patch."""


def scattered(seed: int, height: int = 37, width: int = 50, full: float = 0.2) -> LaplaceProblem:
    """Free cells with random obstacles, and a goal; some cells absorb."""
    rng = np.random.default_rng(seed)
    free = rng.random((height, width)) > full
    goal = (height // 2, width // 3)
    free[goal] = True
    problem = laplace_problem(free, goal)
    problem.absorption[free & (rng.random(free.shape) < 0.1)] = 0.05
    return problem


def walls_of(problem: LaplaceProblem) -> Float32Array:
    """Return the absorption of its cells; the goal absorbs as much as a wall."""
    walls = problem.absorption.copy()
    walls[problem.goal] = np.inf
    return walls


def drawn(walls: Float32Array, seed: int) -> FloatArray:
    """(H + 2, W + 2) numbers where there are no walls."""
    free = np.pad(walls < np.inf, 1)
    return np.where(free, np.random.default_rng(seed).normal(size=free.shape), 0.0)


def plain_matrix(level: MultigridLevel) -> FloatArray:
    """(N, N) of all cells of a level, its border's and its walls' rows and columns 0."""
    height, width = level.x.shape
    free = level.inverse > 0
    matrix = np.zeros((height * width, height * width))
    for i in range(1, height - 1):
        for j in range(1, width - 1):
            if free[i, j]:
                at = i * width + j
                matrix[at, at] = 1.0 / level.inverse[i, j]
                for row, column, links, d, e in (
                    (i, j + 1, level.east, 0, 0),
                    (i, j - 1, level.east, 0, -1),
                    (i + 1, j, level.south, 0, 0),
                    (i - 1, j, level.south, -1, 0),
                ):
                    if free[row, column]:
                        matrix[at, row * width + column] = -(1.0 if level.uniform else links[i + d, j + e])
    return matrix


def plain_interpolation(coarse: MultigridLevel, fine: MultigridLevel) -> FloatArray:
    """(N, M) bilinear weights between the middles of cells, of the fine level's free cells and the coarse one's."""
    height, width = fine.x.shape
    columns = coarse.x.shape[1]
    weights = np.zeros((fine.x.size, coarse.x.size))
    for i in range(1, height - 1):
        for j in range(1, width - 1):
            row, column = (i + 1) // 2, (j + 1) // 2
            for k, of_row in ((row, 0.75), (row - 1 if i % 2 else row + 1, 0.25)):
                for m, of_column in ((column, 0.75), (column - 1 if j % 2 else column + 1, 0.25)):
                    if fine.inverse[i, j] > 0 and coarse.inverse[k, m] > 0:
                        weights[i * width + j, k * columns + m] = of_row * of_column
    return weights


def plain_smoothing(matrix: FloatArray, x: FloatArray, b: FloatArray) -> FloatArray:
    """Two steps of Lottes' algorithm 3, exactly as published, with the weights of his table 1."""
    diagonal = np.diag(matrix)
    over = np.divide(1.0, diagonal, out=np.zeros_like(diagonal), where=diagonal > 0)
    step, left = np.zeros_like(x), b - matrix @ x
    for k, weight in ((1, 1.02387287570313), (2, 1.26408905371085)):
        step = (2 * k - 3) / (2 * k + 1) * step + (8 * k - 4) / (2 * k + 1) / 2.0 * over * left
        x = x + weight * step
        left = left - matrix @ step
    return x


def plain_patch(level: MultigridLevel, at: CellRectangle) -> FloatArray:
    """Return (N, N) the correction of x by a patch of a level, from the residual."""
    matrix, shape = plain_matrix(level), level.x.shape
    within = np.zeros(shape, np.bool_)
    low, high = np.maximum(at[0] - ROUND, 1), np.minimum(at[1] + ROUND, np.array(shape) - 2)
    within[low[0] : high[0] + 1, low[1] : high[1] + 1] = True
    cells = np.flatnonzero(within)
    held, adds = matrix[np.ix_(cells, cells)], np.zeros_like(matrix)
    for cell, b in zip(cells, np.eye(len(cells)), strict=True):
        x = np.zeros_like(b)
        for _ in range(COARSEST_SWEEPS):
            x = plain_smoothing(held, x, b)
        adds[cells, cell] = x
    return adds


def plain_cycle(levels: tuple[MultigridLevel, ...], places: list[CellRectangle], b: FloatArray) -> FloatArray:
    """A V-cycle with patches round places, of vectors (N,)."""
    matrix, x = plain_matrix(levels[0]), np.zeros_like(b)
    if len(levels) == 1:
        for _ in range(COARSEST_SWEEPS):
            x = plain_smoothing(matrix, x, b)
        return x
    patches = [plain_patch(levels[0], at) for at in places] if min(levels[0].x.shape) >= 16 else []
    for patch in patches:
        x = x + patch @ (b - matrix @ x)
    weights, left = plain_interpolation(levels[1], levels[0]), b - matrix @ x
    y = plain_smoothing(matrix, np.zeros_like(b), left)
    coarser = [((low + 1) // 2, (high + 1) // 2) for low, high in places]
    y = y + weights @ plain_cycle(levels[1:], coarser, weights.T @ (left - matrix @ y))
    x = x + plain_smoothing(matrix, y, left)
    for patch in reversed(patches):
        x = x + patch @ (b - matrix @ x)
    return x
