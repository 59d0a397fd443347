"""Rows shared between two threads: each row once, and results identical to one thread."""

from __future__ import annotations

import multiprocessing

import numpy as np
import pytest

from waychair.planning.harmonic import row_threads as module
from waychair.planning.harmonic.laplace_solvers import laplace_problem, solve
from waychair.planning.harmonic.row_threads import over_rows, row_ranges, sum_over_rows
from waychair.types import BoolArray, FloatArray

LARGE = 1 << 20


@pytest.mark.parametrize(("first", "stop"), [(0, 9), (1, 2), (5, 1000)])
@pytest.mark.parametrize("cells", [10, LARGE])
def test_every_row_is_in_one_band(first: int, stop: int, cells: int) -> None:
    rows = [row for begin, end in row_ranges(first, stop, cells) for row in range(begin, end)]
    assert rows == list(range(first, stop))


@pytest.mark.parametrize("cells", [10, LARGE])
def test_the_results_of_all_bands_are_combined(cells: int) -> None:
    def square(values: FloatArray, first: int, stop: int) -> float:
        values[first:stop] **= 2
        return float(values[first:stop].sum())

    values = np.arange(10.0)
    assert sum_over_rows(square, 2, 10, cells, values) == sum(k * k for k in range(2, 10))
    assert values.tolist() == [0, 1, *(k * k for k in range(2, 10))]


def test_an_error_in_the_second_band_is_raised() -> None:
    def fails(first: int, stop: int) -> None:
        if first > 0:
            raise ValueError("of the second band")

    with pytest.raises(ValueError, match="of the second band"):
        over_rows(fails, 0, 10, LARGE)


def floor(side: int = 400) -> BoolArray:
    """Free cells with random obstacles."""
    free = np.random.default_rng(0).random((side, side)) > 0.1
    free[side // 2, side // 3] = True
    return free


def test_one_thread_and_two_give_the_same_result(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = laplace_problem(floor(), (200, 133))
    by_two = solve(problem)
    monkeypatch.setattr(module, "_helper", lambda: None)
    by_one = solve(problem)
    assert by_one.sweeps == by_two.sweeps
    np.testing.assert_array_equal(by_one.v, by_two.v)


def residual_of_solution() -> float:
    return solve(laplace_problem(floor(), (200, 133))).residual


def test_a_forked_process_has_its_own_helper_thread() -> None:
    before = residual_of_solution()
    with multiprocessing.get_context("fork").Pool(1) as pool:
        assert pool.apply_async(residual_of_solution).get(timeout=60.0) == before
