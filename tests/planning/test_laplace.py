"""Laplace's equation: all solvers agree, changes are solved again, and failures are errors."""

from __future__ import annotations

import math
import os
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.planning.plain_multigrid import drawn, plain_cycle, scattered, walls_of
from waychair.errors import ConfigError, GoalOccupied, GoalOutsideMap, MapTooLarge, MissingExtra, NotConverged
from waychair.planning.harmonic.conjugate_gradients import conjugate_gradients, write_residual
from waychair.planning.harmonic.laplace_gpu import gpu_at_hand
from waychair.planning.harmonic.laplace_solvers import (
    PAPER_SOLVER,
    LaplaceProblem,
    SolverOptions,
    laplace_problem,
    relative_residual,
    relax,
    solve,
)
from waychair.planning.harmonic.multigrid import v_cycle
from waychair.planning.harmonic.multigrid_levels import levels_from
from waychair.resumable import finished
from waychair.types import BoolArray, Float32Array, FloatArray


@pytest.mark.parametrize("solver", ["gauss-seidel", "sor", "multigrid"])
@pytest.mark.parametrize("seed", [0, 1])
def test_every_solver_agrees_with_the_direct_one(solver: str, seed: int) -> None:
    problem = scattered(seed)
    exact = solve(problem, SolverOptions(solver="direct"))
    found = solve(problem, SolverOptions(solver=solver, tolerance=1e-11))
    assert found.residual <= 1e-11
    np.testing.assert_allclose(found.v, exact.v, rtol=0, atol=1e-9)
    assert relative_residual(problem, found.v) == pytest.approx(found.residual, rel=0.05, abs=1e-14)


def test_the_papers_preset_goes_row_by_row_from_the_middle_of_the_range() -> None:
    problem = scattered(2, 12, 14)
    exact = solve(problem, SolverOptions(solver="direct"))
    found = solve(problem, PAPER_SOLVER)
    assert PAPER_SOLVER.solver == "gauss-seidel"
    np.testing.assert_allclose(found.v, exact.v, atol=1e-4)


def test_values_lie_between_those_of_the_goal_and_of_obstacles() -> None:
    found = solve(scattered(3))
    assert found.v.min() > -1e-9
    assert found.v.max() == 1.0


def test_a_narrow_corridor_decays_by_two_plus_root_three_a_cell() -> None:
    found = solve(laplace_problem(np.ones((1, 15), np.bool_), (0, 0)), SolverOptions(solver="direct"))
    np.testing.assert_allclose(found.v[0, :8] / found.v[0, 1:9], 2 + math.sqrt(3), rtol=1e-5)


@given(st.integers(0, 10_000), st.integers(3, 40), st.integers(3, 40))
@settings(max_examples=25)
def test_multigrid_is_right_on_maps_of_any_shape(seed: int, height: int, width: int) -> None:
    problem = scattered(seed, height, width, 0.35)
    found = solve(problem, SolverOptions(tolerance=1e-10))
    assert relative_residual(problem, found.v) <= 1.1e-10


def test_the_v_cycle_is_symmetric_and_positive_so_that_it_may_precondition() -> None:
    walls = walls_of(scattered(4))
    levels = levels_from(walls)

    def cycled(b: FloatArray) -> FloatArray:
        levels[0].b[:] = b
        v_cycle(levels)
        return levels[0].x.astype(np.float64)

    first, second = drawn(walls, 0), drawn(walls, 1)
    assert np.vdot(first, cycled(second)) == pytest.approx(np.vdot(second, cycled(first)), rel=1e-4)
    assert np.vdot(first, cycled(first)) > 0


@pytest.mark.parametrize(("height", "width"), [(21, 30), (14, 17), (32, 19), (7, 40)])
def test_the_v_cycle_equals_a_plain_reference(height: int, width: int) -> None:
    walls = walls_of(scattered(5, height, width))
    levels, b = levels_from(walls), drawn(walls, 0)
    assert len(levels) >= 2
    levels[0].b[:] = b
    v_cycle(levels)
    plain = plain_cycle(levels, [], b.ravel()).reshape(b.shape)
    np.testing.assert_allclose(levels[0].x, plain, atol=1e-5 * np.abs(plain).max())


def test_the_kernels_equal_plain_loops() -> None:
    walls = walls_of(scattered(6, 9, 11))
    x, b = drawn(walls, 0), drawn(walls, 1)
    free = np.pad(walls < np.inf, 1)
    rest, left = np.zeros_like(x), np.zeros_like(x)
    assert write_residual(walls, x, b, rest) ** 2 == pytest.approx(float(np.vdot(rest, rest)))
    relaxed = x.copy()
    for i in range(1, x.shape[0] - 1):
        for j in range(1, x.shape[1] - 1):
            if free[i, j]:
                near = [(i + 1, j), (i - 1, j), (i, j + 1), (i, j - 1)]
                total = sum(x[at] for at in near if free[at])
                diagonal = 4.0 + float(walls[i - 1, j - 1])
                left[i, j] = b[i, j] - diagonal * x[i, j] + total
                if (i + j) % 2 == 0:
                    relaxed[i, j] += 1.5 * ((b[i, j] + total) / diagonal - x[i, j])
    np.testing.assert_allclose(rest, left, atol=1e-14)
    relax(np.pad(1.0 / (4.0 + walls.astype(np.float64)), 1), x, b, 0, 1.5)
    np.testing.assert_allclose(x, relaxed, atol=1e-14)


def test_the_same_problem_has_exactly_the_same_field_anywhere_in_memory() -> None:
    rng, problem, kept = np.random.default_rng(3), scattered(3, 60, 70, 0.25), []
    fields = set()
    for _ in range(40):
        kept.append(np.empty(rng.integers(1, 5000)))
        fields.add(solve(problem, SolverOptions(tolerance=1e-13)).v.tobytes())
    assert len(fields) == 1


def test_the_residual_is_reported_exactly_however_small() -> None:
    """The cycles are in float32, the residual is not: the reported residual is that of the answer."""
    problem = scattered(11)
    for tolerance in (1e-6, 1e-9, 1e-12, 1e-14):
        found = solve(problem, SolverOptions(tolerance=tolerance))
        assert found.residual <= tolerance
        assert relative_residual(problem, found.v) <= 1.1 * tolerance + 2e-15


@pytest.mark.parametrize("apart", [False, True])
def test_after_changes_a_warm_start_finds_the_same_field_with_less_work_for_local_changes(apart: bool) -> None:
    free, goal = np.ones((280, 280), np.bool_), (45, 30)
    for wall in (70, 140, 210):
        free[wall], free[:, wall] = False, False
        for door in (30, 100, 180, 250):
            free[wall, door : door + 6] = free[door : door + 6, wall] = True
    before, rng = laplace_problem(free, goal), np.random.default_rng(1)
    field = solve(before)
    changed = free.copy()
    cells = rng.integers(5, 275, (20, 2)) if apart else rng.integers(85, 125, (20, 2))
    changed[cells[:, 0], cells[:, 1]] ^= True
    changed[goal] = True
    problem = laplace_problem(changed, goal)
    cold, warm = solve(problem), solve(problem, SolverOptions(), field)
    assert warm.residual <= 1e-8
    assert warm.sweeps <= (cold.sweeps if apart else 1)
    assert cold.sweeps >= 5
    np.testing.assert_allclose(warm.v, cold.v, atol=1e-6)


def test_a_goal_that_is_not_a_free_cell_is_refused() -> None:
    free = np.ones((4, 5), np.bool_)
    free[1, 2] = False
    with pytest.raises(GoalOccupied, match="column 2, row 1 is occupied; choose a free cell"):
        laplace_problem(free, (1, 2))
    with pytest.raises(GoalOutsideMap, match="lies outside the map of 5 columns and 4 rows"):
        laplace_problem(free, (4, 2))


def test_a_map_that_needs_too_much_memory_is_refused_before_any_is_allocated() -> None:
    absorption: Float32Array = np.broadcast_to(np.float32(0.0), (100_000, 100_000))
    with pytest.raises(MapTooLarge, match="a map of 10000000000 cells takes 700000 MB by multigrid"):
        solve(LaplaceProblem(absorption, (0, 0)))


def test_no_convergence_within_the_sweeps_or_the_time_is_an_error() -> None:
    problem = scattered(7)
    with pytest.raises(NotConverged, match=r"after 3 sweeps of sor, not 1\.0e-08"):
        solve(problem, SolverOptions(solver="sor", most_sweeps=3))
    with pytest.raises(NotConverged, match="after 0 sweeps of multigrid"):
        solve(problem, SolverOptions(), has_time=lambda: False)


def test_an_enclosed_goal_has_a_field_of_its_own_cell() -> None:
    free: BoolArray = np.zeros((5, 5), np.bool_)
    free[2, 2] = free[0, 0] = True
    found = solve(laplace_problem(free, (2, 2)))
    assert found.v.sum() == 1.0


def test_an_unknown_solver_is_refused_by_name() -> None:
    with pytest.raises(ConfigError, match="there is no solver 'jacobi'; choose auto, gauss-seidel"):
        solve(scattered(8), SolverOptions(solver="jacobi"))


@pytest.mark.skipif(gpu_at_hand(), reason="there is a GPU")
def test_without_a_gpu_it_is_refused_and_auto_takes_the_processor() -> None:
    with pytest.raises(MissingExtra, match="no GPU can be used here"):
        solve(scattered(9), SolverOptions(solver="gpu"))
    assert solve(scattered(9), SolverOptions(solver="auto")).residual <= 1e-8


ON_THE_SIMULATOR = """
import sys
import numpy as np
from waychair.planning.harmonic.laplace_gpu import conjugate_gradients_on_gpu, gpu_at_hand
from waychair.planning.harmonic.conjugate_gradients import conjugate_gradients
from waychair.planning.harmonic.multigrid_levels import levels_from
from waychair.resumable import finished
assert gpu_at_hand()
rng = np.random.default_rng(0)
walls = np.where(rng.random((7, 9)) > 0.2, rng.choice([0.0, 0.05], (7, 9)), np.inf).astype(np.float32)
levels = levels_from(walls)
assert len(levels) == 2
b = np.where(np.pad(walls < np.inf, 1), rng.random(levels[0].x.shape), 0.0)
for most, near in {"one": [(1, 1e-6)], "all": [(20, 1e-11)]}[sys.argv[1]]:
    ours, theirs = np.zeros_like(b), np.zeros_like(b)
    residual, cycles = finished(conjugate_gradients(walls, levels, ours, b, 1e-12, most))
    there, gone = conjugate_gradients_on_gpu(walls, levels, theirs, b, 1e-12, most)
    assert cycles == gone, (cycles, gone)
    assert most == 1 or max(residual, there) <= 1e-12
    np.testing.assert_allclose(theirs, ours, rtol=0, atol=near)
print("equal")
"""


@pytest.mark.nightly
@pytest.mark.parametrize("cycles", ["one", "all"])
def test_the_gpu_kernels_on_the_simulator_agree_with_the_processor(cycles: str) -> None:
    """One cycle after the other, on a small map: the simulator's threads are Python's."""
    pytest.importorskip("numba.cuda", reason="this numba has no CUDA target: install waychair[gpu]")
    simulated = {**os.environ, "NUMBA_ENABLE_CUDASIM": "1"}
    run = subprocess.run(
        [sys.executable, "-c", ON_THE_SIMULATOR, cycles],
        env=simulated,
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    assert run.stdout.strip() == "equal", run.stderr


def test_conjugate_gradients_keep_an_exact_answer() -> None:
    walls = walls_of(scattered(10))
    x = drawn(walls, 0)
    b, none = np.zeros_like(x), np.zeros_like(x)
    write_residual(walls, x, none, b)
    b = -b
    residual, cycles = finished(conjugate_gradients(walls, levels_from(walls), x, b, 1e-15, 10))
    assert (residual, cycles) == (0.0, 0)
