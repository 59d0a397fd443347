"""The cost model: integer, symmetric, no corner cutting."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waychair.planning.grid_graph import (
    UNREACHABLE,
    cells_from_padded,
    neighbour,
    octile,
    padded,
    padded_index,
    step_cost,
)


def test_a_free_straight_step_costs_10000_and_a_diagonal_one_14142() -> None:
    flat = padded(np.full((3, 3), 1000, np.int32))
    centre = padded_index((1, 1), (3, 3))
    assert [step_cost(flat, centre, d, 5) for d in range(8)] == [10_000, 14_142] * 4


@pytest.mark.parametrize("blocked", [(0, 1), (1, 2)])
def test_a_diagonal_step_past_a_blocked_corner_is_barred(blocked: tuple[int, int]) -> None:
    prices = np.full((3, 3), 1000, np.int32)
    prices[blocked] = 0
    flat = padded(prices)
    centre = padded_index((1, 1), (3, 3))
    up_right = next(d for d in range(8) if neighbour(d, 5) == 1 - 5)
    assert step_cost(flat, centre, up_right, 5) == UNREACHABLE


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=50, deadline=None)
def test_every_step_costs_the_same_both_ways_and_never_less_than_the_heuristic(seed: int) -> None:
    rng = np.random.default_rng(seed)
    prices = np.where(rng.random((5, 6)) < 0.3, 0, rng.integers(1000, 1_000_001, (5, 6))).astype(np.int32)
    flat = padded(prices)
    for row, column in np.ndindex(5, 6):
        here = padded_index((row, column), (5, 6))
        for direction in range(8):
            there = here + neighbour(direction, 8)
            if flat[there]:
                cost = step_cost(flat, here, direction, 8)
                assert cost == step_cost(flat, there, (direction + 4) % 8, 8)
                assert cost >= octile(here, there, 8)


def test_octile_is_the_cost_of_the_way_over_an_empty_grid() -> None:
    first, second = padded_index((0, 0), (9, 9)), padded_index((3, 7), (9, 9))
    assert octile(first, second, 11) == octile(second, first, 11) == 3 * 14_142 + 4 * 10_000


def test_indices_and_cells_are_inverse() -> None:
    cells = [(r, c) for r in range(4) for c in range(7)]
    flat = np.array([padded_index(cell, (4, 7)) for cell in cells], np.int32)
    assert [tuple(cell) for cell in cells_from_padded(flat, (4, 7)).tolist()] == cells


@pytest.mark.parametrize("price", [-1, 1, 999, 1_000_001])
def test_prices_that_would_break_the_heuristic_are_refused(price: int) -> None:
    with pytest.raises(ValueError, match=f"price {price} is neither"):
        padded(np.array([[1000, price]], np.int32))


@pytest.mark.parametrize("cell", [(-1, 0), (0, -1), (3, 0), (0, 4)])
def test_cells_outside_the_grid_are_refused(cell: tuple[int, int]) -> None:
    with pytest.raises(ValueError, match="lies outside the 3 x 4 grid"):
        padded_index(cell, (3, 4))
