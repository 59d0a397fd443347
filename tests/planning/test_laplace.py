"""Laplace's equation: all solvers agree, what changed is found anew, and what cannot be solved is said."""

from __future__ import annotations

import math
import os
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waychair.errors import ConfigError, GoalOccupied, GoalOutsideMap, MapTooLarge, MissingExtra, NotConverged
from waychair.planning.laplace_gpu import gpu_at_hand
from waychair.planning.laplace_solvers import (
    PAPER_SOLVER,
    Problem,
    SolverSettings,
    problem_of,
    relative_residual,
    solve,
)
from waychair.planning.multigrid import (
    Level,
    _prolong,
    _restrict,
    apply,
    conjugate_gradients,
    finest_level,
    levels_from,
    relax,
    v_cycle,
)
from waychair.planning.slices import finished
from waychair.types import BoolArray, Float32Array, FloatArray


def scattered(seed: int, height: int = 37, width: int = 50, full: float = 0.2) -> Problem:
    """Free cells with obstacles strewn about, and a goal; some cells absorb."""
    rng = np.random.default_rng(seed)
    free = rng.random((height, width)) > full
    goal = (height // 2, width // 3)
    free[goal] = True
    problem = problem_of(free, goal)
    problem.absorption[free & (rng.random(free.shape) < 0.1)] = 0.05
    return problem


def level_of(problem: Problem) -> tuple[Level, Float32Array]:
    walls = problem.absorption.copy()
    walls[problem.goal] = np.inf
    return finest_level(walls), walls


@pytest.mark.parametrize("solver", ["gauss-seidel", "sor", "multigrid"])
@pytest.mark.parametrize("seed", [0, 1])
def test_every_solver_finds_what_the_direct_one_finds(solver: str, seed: int) -> None:
    problem = scattered(seed)
    exact = solve(problem, SolverSettings(solver="direct"))
    found = solve(problem, SolverSettings(solver=solver, tolerance=1e-11))
    assert found.residual <= 1e-11
    np.testing.assert_allclose(found.v, exact.v, rtol=0, atol=1e-9)
    assert relative_residual(problem, found.v) == pytest.approx(found.residual, rel=0.05, abs=1e-14)


def test_the_papers_preset_goes_row_by_row_from_the_middle_of_the_range() -> None:
    problem = scattered(2, 12, 14)
    exact = solve(problem, SolverSettings(solver="direct"))
    found = solve(problem, PAPER_SOLVER)
    assert PAPER_SOLVER.solver == "gauss-seidel"
    np.testing.assert_allclose(found.v, exact.v, atol=1e-4)


def test_values_lie_between_those_of_the_goal_and_of_obstacles() -> None:
    found = solve(scattered(3))
    assert found.v.min() > -1e-9
    assert found.v.max() == 1.0


def test_a_narrow_corridor_decays_by_two_plus_root_three_a_cell() -> None:
    found = solve(problem_of(np.ones((1, 15), np.bool_), (0, 0)), SolverSettings(solver="direct"))
    np.testing.assert_allclose(found.v[0, :8] / found.v[0, 1:9], 2 + math.sqrt(3), rtol=1e-5)


@given(st.integers(0, 10_000), st.integers(3, 40), st.integers(3, 40))
@settings(max_examples=25)
def test_multigrid_is_right_on_maps_of_any_shape(seed: int, height: int, width: int) -> None:
    problem = scattered(seed, height, width, 0.35)
    found = solve(problem, SolverSettings(tolerance=1e-10))
    assert relative_residual(problem, found.v) <= 1.1e-10


def test_the_v_cycle_is_symmetric_and_positive_so_that_it_may_precondition() -> None:
    level, walls = level_of(scattered(4))
    levels, rng = levels_from(level, walls), np.random.default_rng(0)

    def cycled(b: FloatArray) -> FloatArray:
        level.b[:] = b
        v_cycle(levels)
        return level.x.copy()

    first, second = (np.where(level.inverse > 0, rng.normal(size=level.x.shape), 0.0) for _ in range(2))
    assert np.vdot(first, cycled(second)) == pytest.approx(np.vdot(second, cycled(first)), rel=1e-5)
    assert np.vdot(first, cycled(first)) > 0


def test_restriction_is_the_transpose_of_interpolation() -> None:
    level, walls = level_of(scattered(5, 21, 30))
    fine, coarse = levels_from(level, walls)[:2]
    rng = np.random.default_rng(0)
    fine.x[:] = 0.0
    fine.b[:] = np.where(fine.inverse > 0, rng.normal(size=fine.x.shape), 0.0)
    gathered = np.zeros_like(coarse.x)
    _restrict(fine, gathered)
    coarse.x[:] = 0.0
    coarse.x[1:-1, 1:-1] = rng.normal(size=(coarse.x.shape[0] - 2, coarse.x.shape[1] - 2))
    _prolong(coarse, fine)
    assert np.vdot(gathered, coarse.x) == pytest.approx(np.vdot(fine.b, fine.x), rel=1e-12)


def test_the_kernels_do_what_plain_loops_do() -> None:
    level, walls = level_of(scattered(6, 9, 11))
    rng = np.random.default_rng(0)
    x = np.where(level.inverse > 0, rng.normal(size=level.x.shape), 0.0)
    b = np.where(level.inverse > 0, rng.normal(size=level.x.shape), 0.0)
    free = level.inverse > 0
    image, product = np.zeros_like(x), np.zeros_like(x)
    assert apply(level, x, image) == pytest.approx(float(np.vdot(x, image)))
    relaxed = x.copy()
    for i in range(1, x.shape[0] - 1):
        for j in range(1, x.shape[1] - 1):
            if free[i, j]:
                near = [(i + 1, j), (i - 1, j), (i, j + 1), (i, j - 1)]
                total = sum(x[at] for at in near if free[at])
                diagonal = 4.0 + float(walls[i - 1, j - 1])
                product[i, j] = diagonal * x[i, j] - total
                if (i + j) % 2 == 0:
                    relaxed[i, j] += 1.5 * ((b[i, j] + total) / diagonal - x[i, j])
    np.testing.assert_allclose(image, product, atol=1e-5)
    relax(level, x, b, 0, 1.5)
    np.testing.assert_allclose(x, relaxed, atol=1e-6)


@pytest.mark.parametrize("apart", [False, True])
def test_after_changed_cells_a_warm_start_finds_the_same_with_no_more_work(apart: bool) -> None:
    free = np.ones((150, 160), np.bool_)
    free[40:110, 80] = False
    before, goal, rng = problem_of(free, (75, 30)), (75, 30), np.random.default_rng(1)
    field = solve(before)
    changed = free.copy()
    cells = rng.integers(5, 145, (20, 2)) if apart else rng.integers(60, 101, (20, 2))
    changed[cells[:, 0], cells[:, 1]] ^= True
    changed[goal] = True
    problem = problem_of(changed, goal)
    cold, warm = solve(problem), solve(problem, SolverSettings(), field)
    assert warm.residual <= 1e-8
    assert warm.sweeps <= cold.sweeps if apart else warm.sweeps < cold.sweeps
    np.testing.assert_allclose(warm.v, cold.v, atol=1e-6)


def test_a_goal_that_is_no_free_cell_is_refused() -> None:
    free = np.ones((4, 5), np.bool_)
    free[1, 2] = False
    with pytest.raises(GoalOccupied, match="column 2, row 1 is occupied; choose a free cell"):
        problem_of(free, (1, 2))
    with pytest.raises(GoalOutsideMap, match="lies outside the map of 5 columns and 4 rows"):
        problem_of(free, (4, 2))


def test_a_map_that_takes_too_much_memory_is_refused_before_any_is_taken() -> None:
    absorption: Float32Array = np.broadcast_to(np.float32(0.0), (100_000, 100_000))
    with pytest.raises(MapTooLarge, match="a map of 10000000000 cells takes 900000 MB by multigrid"):
        solve(Problem(absorption, (0, 0)))


def test_no_convergence_in_the_sweeps_or_the_time_allowed_is_said() -> None:
    problem = scattered(7)
    with pytest.raises(NotConverged, match=r"after 3 sweeps of sor, not 1\.0e-08"):
        solve(problem, SolverSettings(solver="sor", most_sweeps=3))
    with pytest.raises(NotConverged, match="after 0 sweeps of multigrid"):
        solve(problem, SolverSettings(), go_on=lambda: False)


def test_a_goal_walled_in_on_all_sides_has_a_field_of_its_own_cell() -> None:
    free: BoolArray = np.zeros((5, 5), np.bool_)
    free[2, 2] = free[0, 0] = True
    found = solve(problem_of(free, (2, 2)))
    assert found.v.sum() == 1.0


def test_an_unknown_solver_is_refused_by_name() -> None:
    with pytest.raises(ConfigError, match="there is no solver 'jacobi'; choose auto, gauss-seidel"):
        solve(scattered(8), SolverSettings(solver="jacobi"))


@pytest.mark.skipif(gpu_at_hand(), reason="there is a GPU")
def test_without_a_gpu_it_is_refused_and_auto_takes_the_processor() -> None:
    with pytest.raises(MissingExtra, match="no GPU can be used here"):
        solve(scattered(9), SolverSettings(solver="gpu"))
    assert solve(scattered(9), SolverSettings(solver="auto")).residual <= 1e-8


ON_THE_SIMULATOR = """
import numpy as np
from waychair.planning.laplace_gpu import conjugate_gradients_on_gpu, gpu_at_hand
from waychair.planning.multigrid import conjugate_gradients, finest_level, levels_from
from waychair.planning.slices import finished
assert gpu_at_hand()
rng = np.random.default_rng(0)
walls = np.where(rng.random((7, 9)) > 0.2, 0.0, np.inf).astype(np.float32)
level = finest_level(walls)
levels = levels_from(level, walls)
assert len(levels) == 2
b = np.where(level.inverse > 0, rng.random(level.x.shape), 0.0)
ours, theirs = np.zeros_like(b), np.zeros_like(b)
assert finished(conjugate_gradients(levels, ours, b, 0.0, 2))[1] == 2
assert conjugate_gradients_on_gpu(levels, theirs, b, 0.0, 2)[1] == 2
np.testing.assert_allclose(theirs, ours, rtol=1e-9, atol=1e-12)
print("equal")
"""


def test_the_gpus_kernels_run_on_the_simulator_give_what_the_processor_gives() -> None:
    """Cycle for cycle, on a small map: the simulator's threads are Python's."""
    pytest.importorskip("numba.cuda", reason="this numba has no CUDA target: install waychair[gpu]")
    simulated = {**os.environ, "NUMBA_ENABLE_CUDASIM": "1"}
    run = subprocess.run(
        [sys.executable, "-c", ON_THE_SIMULATOR],
        env=simulated,
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    assert run.stdout.strip() == "equal", run.stderr


def test_conjugate_gradients_leave_an_exact_answer_alone() -> None:
    level, walls = level_of(scattered(10))
    rng = np.random.default_rng(0)
    x = np.where(level.inverse > 0, rng.normal(size=level.x.shape), 0.0)
    b = np.zeros_like(x)
    apply(level, x, b)
    residual, cycles = finished(conjugate_gradients(levels_from(level, walls), x, b, 1e-12, 10))
    assert (residual, cycles) == (0.0, 0)
