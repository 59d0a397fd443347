"""D* Lite always finds the same cost as Dijkstra, after any changes of cells and start."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waychair.errors import NoPath
from waychair.planning.grid.dstar_lite import Consistency, DStarLite
from waychair.planning.grid.grid_graph import Cell, Prices
from waychair.planning.grid.grid_search import search
from waychair.types import IntArray


def reference_cost(prices: Prices, start: Cell, goal: Cell) -> int | None:
    try:
        return search(prices, start, goal, informed=False).cost
    except NoPath:
        return None


def replanned_cost(planner: DStarLite) -> int | None:
    try:
        return planner.replan()
    except NoPath:
        return None


def path_cost(prices: Prices, path: IntArray) -> int:
    """Sum of the steps' costs in plain arithmetic; refuses jumps and corner cutting."""
    total = 0
    for (r0, c0), (r1, c1) in zip(path[:-1].tolist(), path[1:].tolist(), strict=True):
        assert max(abs(r1 - r0), abs(c1 - c0)) == 1
        assert all((prices[r0, c0], prices[r1, c1], prices[r0, c1], prices[r1, c0]))
        both = int(prices[r0, c0]) + int(prices[r1, c1])
        total += 7071 * both // 1000 if r0 != r1 and c0 != c1 else 5 * both
    return total


def bar_across(path: IntArray, rng: np.random.Generator, shape: tuple[int, int]) -> IntArray:
    """Nine cells across the path somewhere ahead, or a 3 x 3 block on it."""
    i = int(rng.integers(1, len(path) - 1))
    along = path[i + 1] - path[i - 1]
    across = np.sign([-along[1], along[0]])
    if rng.random() < 0.3:
        cells = path[i] + np.stack(np.meshgrid([-1, 0, 1], [-1, 0, 1]), -1).reshape(-1, 2)
    else:
        cells = path[i] + np.arange(-4, 5)[:, None] * across
    inside: IntArray = cells[((cells >= 0) & (cells < shape)).all(axis=1)]
    return inside


def rooms(rng: np.random.Generator, size: int) -> Prices:
    """A floor of rooms with doors and a tenth of priced cells, like a costmap's."""
    prices = np.full((size, size), 1000, np.int32)
    prices[rng.random((size, size)) < 0.1] = int(rng.integers(1000, 6000))
    for wall in range(9, size, 10):
        prices[wall], prices[:, wall] = 0, 0
    for wall in range(9, size, 10):
        for room in range(0, size, 10):
            door = room + int(rng.integers(1, 7))
            prices[wall, door : door + 2], prices[door : door + 2, wall] = 1000, 1000
    return prices


def test_dstar_lite_equals_dijkstra_in_1000_random_closures() -> None:
    """Most changes close the current path; some reopen closed cells, some toggle at random cells; the start moves
    on."""
    rng = np.random.default_rng(20_05)
    checked = blocked = 0
    while checked < 1000:
        if rng.random() < 0.5:
            prices = rooms(rng, 50)
        else:
            prices = np.where(rng.random((50, 50)) < 0.2, 0, 1000).astype(np.int32)
        start, goal = (2, 2), (47, 47)
        prices[start] = prices[goal] = 1000
        planner = DStarLite(prices, goal, start)
        if replanned_cost(planner) is None:
            continue
        closed: list[tuple[IntArray, Prices]] = []
        for _ in range(25):
            cost = replanned_cost(planner)
            choice = rng.random()
            if closed and (cost is None or choice < 0.25):
                cells, new = closed.pop(int(rng.integers(len(closed))))
            elif cost is not None and choice < 0.85:
                path = planner.path()
                if len(path) < 12:
                    break
                start = (int(path[3, 0]), int(path[3, 1]))
                planner.move_start(start)
                cells = bar_across(path[3:], rng, (50, 50))
                new = np.zeros(len(cells), np.int32)
                closed.append((cells, prices[cells[:, 0], cells[:, 1]].copy()))
                blocked += 1
            else:
                cells = np.unique(rng.integers(0, 50, (20, 2)), axis=0)
                new = np.where(prices[cells[:, 0], cells[:, 1]] > 0, 0, 1000).astype(np.int32)
            keep = ~((cells == start) | (cells == goal)).all(axis=1)
            cells, new = cells[keep], new[keep]
            prices[cells[:, 0], cells[:, 1]] = new
            planner.update(cells, new)
            expected = reference_cost(prices, start, goal)
            assert replanned_cost(planner) == expected
            if expected is not None:
                path = planner.path()
                assert path_cost(prices, path) == expected
                assert (tuple(path[0]), tuple(path[-1])) == (start, goal)
            checked += 1
    assert blocked > 500


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=60, deadline=None)
def test_after_any_changes_and_jumps_of_the_start_the_cost_equals_that_of_dijkstra(seed: int) -> None:
    rng = np.random.default_rng(seed)
    shape = (int(rng.integers(2, 15)), int(rng.integers(2, 15)))
    prices = np.where(rng.random(shape) < 0.3, 0, rng.integers(1000, 3000, shape)).astype(np.int32)
    goal = (int(rng.integers(shape[0])), int(rng.integers(shape[1])))
    planner = DStarLite(prices, goal, (0, 0))
    start: Cell = (0, 0)
    for _ in range(12):
        for _ in range(int(rng.integers(0, 3))):
            cells = np.unique(np.stack([rng.integers(0, n, 6) for n in shape], -1), axis=0)
            new = np.where(rng.random(len(cells)) < 0.5, 0, rng.integers(1000, 3000, len(cells))).astype(np.int32)
            prices[cells[:, 0], cells[:, 1]] = new
            planner.update(cells, new)
            if rng.random() < 0.5:
                start = (int(rng.integers(shape[0])), int(rng.integers(shape[1])))
                planner.move_start(start)
        expected = reference_cost(prices, start, goal)
        assert replanned_cost(planner) == expected
        if expected is not None:
            assert path_cost(prices, planner.path()) == expected


def test_a_closed_door_is_avoided_and_its_opening_restores_the_cost() -> None:
    prices = np.full((20, 41), 1000, np.int32)
    prices[:, 20] = 0
    prices[3, 20] = prices[16, 20] = 1000
    planner = DStarLite(prices, (4, 38), (4, 2))
    through_near = planner.replan()
    planner.update(np.array([[3, 20]]), np.array([0], np.int32))
    through_far = planner.replan()
    assert through_far > through_near
    assert [16, 20] in planner.path().tolist()
    planner.update(np.array([[16, 20]]), np.array([0], np.int32))
    with pytest.raises(NoPath, match=r"cells \(4, 2\) and \(4, 38\) are not connected"):
        planner.replan()
    planner.update(np.array([[3, 20]]), np.array([1000], np.int32))
    assert planner.replan() == through_near


def test_a_diagonal_gap_between_two_blocked_cells_is_closed() -> None:
    prices = np.array([[1000, 0], [0, 1000]], np.int32)
    with pytest.raises(NoPath):
        DStarLite(prices, (1, 1), (0, 0)).replan()


def test_a_path_goes_round_a_corner_and_does_not_cut_it() -> None:
    prices = np.array([[1000, 0], [1000, 1000]], np.int32)
    planner = DStarLite(prices, (1, 1), (0, 0))
    assert planner.replan() == 20_000
    assert planner.path().tolist() == [[0, 0], [1, 0], [1, 1]]


def test_the_three_states_of_figure_6_are_reproduced() -> None:
    prices = np.full((1, 6), 1000, np.int32)
    planner = DStarLite(prices, (0, 5), (0, 0))
    assert planner.consistency((0, 5)) is Consistency.OVERCONSISTENT
    planner.replan()
    assert planner.consistency((0, 3)) is Consistency.CONSISTENT
    planner.update(np.array([[0, 3]]), np.array([0], np.int32))
    assert planner.consistency((0, 3)) is Consistency.UNDERCONSISTENT


def test_replanning_after_a_change_far_from_the_path_does_no_work() -> None:
    prices = np.full((100, 100), 1000, np.int32)
    planner = DStarLite(prices, (50, 95), (50, 5))
    planner.replan()
    before = planner.pops
    planner.update(np.array([[2, 2]]), np.array([0], np.int32))
    planner.replan()
    assert planner.pops == before


def test_start_and_goal_in_one_cell_cost_nothing() -> None:
    planner = DStarLite(np.full((3, 3), 1000, np.int32), (1, 1), (1, 1))
    assert planner.replan() == 0
    assert planner.path().tolist() == [[1, 1]]


@pytest.mark.parametrize("blocked", [(0, 0), (2, 2)])
def test_a_blocked_start_or_goal_is_no_path(blocked: Cell) -> None:
    prices = np.full((3, 3), 1000, np.int32)
    prices[blocked] = 0
    with pytest.raises(NoPath):
        DStarLite(prices, (2, 2), (0, 0)).replan()


@pytest.mark.parametrize("change", ["start", "prices", "nothing yet"])
def test_a_path_is_refused_until_the_plan_is_updated(change: str) -> None:
    planner = DStarLite(np.full((3, 3), 1000, np.int32), (2, 2), (0, 0))
    if change != "nothing yet":
        planner.replan()
    if change == "start":
        planner.move_start((0, 1))
    if change == "prices":
        planner.update(np.array([[1, 1]]), np.array([0], np.int32))
    with pytest.raises(NoPath, match="replan first"):
        planner.path()


@pytest.mark.parametrize(
    ("cells", "prices", "match"),
    [([[3, 0]], [0], "must lie in"), ([[0, -1]], [0], "must lie in"), ([[0, 0]], [0, 0], "1 cells but 2 prices")],
)
def test_impossible_changes_are_refused(cells: list[list[int]], prices: list[int], match: str) -> None:
    planner = DStarLite(np.full((3, 3), 1000, np.int32), (2, 2), (0, 0))
    with pytest.raises(ValueError, match=match):
        planner.update(np.array(cells), np.array(prices, np.int32))


def test_memory_stays_below_32_bytes_a_cell_on_a_large_map() -> None:
    prices = np.full((1000, 1000), 1000, np.int32)
    prices[::20, 5:] = 0
    planner = DStarLite(prices, (990, 990), (5, 5))
    planner.replan()
    assert planner.nbytes < 32e6
