"""The cost model: integer, symmetric, no corner cutting."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waychair.planning.grid.grid_graph import (
    UNREACHABLE,
    Prices,
    Records,
    cells_from_padded,
    directions_against,
    octile,
    offsets,
    padded,
    padded_index,
    step_cost,
)
from waychair.types import Bytes

GROUND = np.dtype([("other", np.int64), ("ground", np.int32)])


def records(prices: Prices, barred: Bytes | None = None) -> Records:
    grounds = padded(prices, barred)
    cells = np.zeros(len(grounds), GROUND)
    cells["ground"] = grounds
    return cells


def test_a_free_straight_step_costs_10000_and_a_diagonal_one_14142() -> None:
    flat = records(np.full((3, 3), 1000, np.int32))
    centre = padded_index((1, 1), (3, 3))
    assert [step_cost(flat, centre, d, offsets(5), False) for d in range(8)] == [10_000, 14_142] * 4


@pytest.mark.parametrize("blocked", [(0, 1), (1, 2)])
def test_a_diagonal_step_past_a_blocked_corner_is_barred(blocked: tuple[int, int]) -> None:
    prices = np.full((3, 3), 1000, np.int32)
    prices[blocked] = 0
    flat = records(prices)
    centre = padded_index((1, 1), (3, 3))
    assert step_cost(flat, centre, 7, offsets(5), False) == UNREACHABLE


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=50, deadline=None)
def test_every_step_costs_the_same_both_ways_and_never_less_than_the_heuristic(seed: int) -> None:
    rng = np.random.default_rng(seed)
    prices = np.where(rng.random((5, 6)) < 0.3, 0, rng.integers(1000, 1_000_001, (5, 6))).astype(np.int32)
    flat = records(prices)
    for row, column in np.ndindex(5, 6):
        here = padded_index((row, column), (5, 6))
        for direction in range(8):
            there = here + int(offsets(8)[direction])
            if flat["ground"][there]:
                cost = step_cost(flat, here, direction, offsets(8), False)
                assert cost == step_cost(flat, there, (direction + 4) % 8, offsets(8), False)
                assert cost >= octile(*divmod(here, 8), there, 8)


def test_the_octile_distance_is_the_cost_of_a_path_on_an_empty_grid() -> None:
    first, second = padded_index((0, 0), (9, 9)), padded_index((3, 7), (9, 9))
    assert octile(*divmod(first, 11), second, 11) == octile(*divmod(second, 11), first, 11) == 3 * 14_142 + 4 * 10_000


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


@pytest.mark.parametrize(
    ("heading", "against"),
    [(0.0, {3, 4, 5}), (math.pi / 2, {5, 6, 7}), (math.pi / 4, {4, 5, 6}), (0.3, {3, 4, 5, 6}), (-math.pi, {0, 1, 7})],
)
def test_directions_against_a_heading_are_those_with_a_backward_part(heading: float, against: set[int]) -> None:
    assert {d for d in range(8) if directions_against(heading) >> d & 1} == against


def test_a_barred_direction_bars_steps_out_of_and_into_the_cell_and_no_others() -> None:
    barred = np.zeros((3, 3), np.uint8)
    barred[1, 1] = 1 << 4  # no step towards -column
    cells = records(np.full((3, 3), 1000, np.int32), barred)
    here, left, right = (padded_index((1, column), (3, 3)) for column in (1, 0, 2))
    steps = offsets(5)
    assert step_cost(cells, here, 4, steps, False) == step_cost(cells, right, 4, steps, False) == UNREACHABLE
    assert step_cost(cells, left, 0, steps, True) == step_cost(cells, here, 0, steps, True) == UNREACHABLE
    assert step_cost(cells, left, 0, steps, False) == step_cost(cells, here, 0, steps, False) == 10_000
    assert step_cost(cells, here, 3, steps, False) == 14_142
