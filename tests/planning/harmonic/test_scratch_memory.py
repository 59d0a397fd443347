"""Scratch memory of successive solves: no part is lent twice at a time, and old contents have no effect."""

from __future__ import annotations

import numpy as np
import pytest

from tests.planning.plain_multigrid import scattered
from waychair.planning.harmonic import scratch_memory as module
from waychair.planning.harmonic.laplace_solvers import solve
from waychair.planning.harmonic.multigrid_levels import levels_from, levels_size
from waychair.planning.harmonic.scratch_memory import borrowed_scratch_memory, new_scratch_memory


@pytest.fixture(autouse=True)
def nothing_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_kept", [])


def test_parts_do_not_overlap() -> None:
    memory = new_scratch_memory(1000)
    first, second, third = memory.take((3, 5)), memory.take((7,), np.uint8), memory.framed((4, 6), np.float64)
    first[:], second[:], third[1:-1, 1:-1] = 1.0, 2, 3.0
    assert (first == 1.0).all()
    assert (second == 2).all()
    assert third[1:-1, 1:-1].min() == 3.0
    assert third.sum() == 3.0 * 8  # and its border is 0


def test_a_returned_part_is_lent_again_and_to_one_borrower_at_a_time() -> None:
    with borrowed_scratch_memory(1000) as memory:
        first = memory.take((10,))
    with borrowed_scratch_memory(500) as memory:
        second = memory.take((10,))
        with borrowed_scratch_memory(1000) as other:
            third = other.take((10,))
    assert np.shares_memory(first, second)
    assert not np.shares_memory(second, third)
    assert len(module._kept) == 1


def test_large_memory_is_not_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_MOST_KEPT", 100)
    with borrowed_scratch_memory(1000):
        pass
    assert module._kept == []


@pytest.mark.parametrize("shape", [(1, 1), (3, 200), (37, 50), (64, 64), (129, 7)])
def test_levels_take_no_more_than_their_stated_size(shape: tuple[int, int]) -> None:
    size = levels_size(shape)
    memory = new_scratch_memory(size + 64)
    levels_from(np.zeros(shape, np.float32), memory)
    assert memory.take((64,), np.uint8).shape == (64,), "the memory beyond them is left"


def test_contents_left_by_the_last_solve_do_not_change_the_next() -> None:
    problem = scattered(3)
    clean = solve(problem)
    module._kept[:] = [np.full(10_000_000, 255, np.uint8)]  # not a number, be it read as float32 or float64
    spoilt = solve(problem)
    assert len(module._kept) == 1
    np.testing.assert_array_equal(spoilt.v, clean.v)
    warm = solve(scattered(4), warm_start=clean)
    module._kept[:] = [np.full(10_000_000, 255, np.uint8)]
    np.testing.assert_array_equal(solve(scattered(4), warm_start=clean).v, warm.v)
