"""All planners on the grid have one interface, and a setting selects one."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waychair.errors import (
    ConfigError,
    GoalOccupied,
    GoalOutsideMap,
    NoFreeSpace,
    NoPath,
    PlanningError,
    StartOccupied,
    StartOutsideMap,
)
from waychair.planning.grid.grid_graph import Cell, Prices, directions_against
from waychair.planning.route.grid_planner import GRID_PLANNERS, GridPlanner, grid_planner, plan_on_cells
from waychair.types import Bytes

BAD = (
    ((-1, 0), (1, 1), StartOutsideMap, "the start in column 0, row -1 lies outside"),
    ((0, 0), (1, 4), GoalOutsideMap, "the goal in column 4, row 1 lies outside the map of 4 columns and 3 rows"),
    ((0, 1), (1, 1), StartOccupied, "the start in column 1, row 0 is occupied"),
    ((1, 1), (0, 1), GoalOccupied, "the goal in column 1, row 0 is occupied"),
    ((0, 0), (2, 3), NoPath, "no path leads from column 0, row 0 to column 3, row 2"),
)


def plain_cost(prices: Prices, barred: Bytes, start: Cell, goal: Cell) -> int | None:
    """Bellman and Ford's relaxation of every step, until nothing gets cheaper."""
    height, width = prices.shape
    directions = [(0, 1), (1, 1), (1, 0), (1, -1), (0, -1), (-1, -1), (-1, 0), (-1, 1)]
    best = {start: 0} if prices[start] else {}
    changed = True
    while changed:
        changed = False
        for (row, column), cost in list(best.items()):
            for d, (dr, dc) in enumerate(directions):
                r, c = row + dr, column + dc
                if not (0 <= r < height and 0 <= c < width and prices[r, c] and prices[row, c] and prices[r, column]):
                    continue
                if (barred[row, column] | barred[r, c]) >> d & 1:
                    continue
                both = int(prices[row, column]) + int(prices[r, c])
                through = cost + (7071 * both // 1000 if dr and dc else 5 * both)
                if through < best.get((r, c), 1 << 62):
                    best[r, c], changed = through, True
    return best.get(goal)


def answer(planner: GridPlanner) -> int | None:
    try:
        return planner.replan()
    except NoPath:
        return None


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=40, deadline=None)
def test_all_planners_agree_with_plain_relaxation_through_changes_and_one_way_zones(seed: int) -> None:
    rng = np.random.default_rng(seed)
    shape = (int(rng.integers(2, 9)), int(rng.integers(2, 9)))
    prices = np.where(rng.random(shape) < 0.2, 0, rng.integers(1000, 4000, shape)).astype(np.int32)
    barred = np.where(rng.random(shape) < 0.4, directions_against(float(rng.uniform(-3, 3))), 0).astype(np.uint8)
    start, goal = ((int(rng.integers(shape[0])), int(rng.integers(shape[1]))) for _ in range(2))
    planners = [make(prices, goal, start, barred) for make in GRID_PLANNERS.values()]
    for _ in range(5):
        expected = plain_cost(prices, barred, start, goal)
        assert [answer(planner) for planner in planners] == [expected] * 3
        if expected is not None:
            for planner in planners:
                path = planner.path()
                assert (tuple(path[0]), tuple(path[-1])) == (start, goal)
        start = (int(rng.integers(shape[0])), int(rng.integers(shape[1])))
        cells = np.unique(rng.integers(0, shape, (3, 2)), axis=0)
        new = np.where(rng.random(len(cells)) < 0.5, 0, 2000).astype(np.int32)
        prices[tuple(cells.T)] = new
        for planner in planners:
            planner.move_start(start)
            planner.update(cells, new)


@pytest.mark.parametrize("name", GRID_PLANNERS)
@pytest.mark.parametrize(("start", "goal", "error", "said"), BAD)
def test_every_planner_refuses_the_same_inputs_with_the_same_message(
    name: str, start: Cell, goal: Cell, error: type[PlanningError], said: str
) -> None:
    prices = np.array([[1000, 0, 1000, 1000], [1000, 1000, 0, 0], [1000, 1000, 0, 1000]], np.int32)
    with pytest.raises(error, match=said):
        plan_on_cells(prices, start, goal, name)


@pytest.mark.parametrize("name", GRID_PLANNERS)
def test_every_planner_refuses_impossible_changes_and_old_plans(name: str) -> None:
    prices = np.full((3, 3), 1000, np.int32)
    planner = grid_planner(name)(prices, (2, 2), (0, 0))
    with pytest.raises(NoPath, match="replan first"):
        planner.path()
    assert planner.replan() == 28_284
    for cells, new in (([[3, 0]], [0]), ([[0, 0]], [5]), ([[0, 0]], [0, 0])):
        with pytest.raises(ValueError, match=r"grid|price"):
            planner.update(np.array(cells), np.array(new, np.int32))
    assert len(planner.path()) == 3
    assert (prices == 1000).all()
    with pytest.raises(ValueError, match="outside"):
        planner.move_start((0, 3))
    assert planner.pops > 0


def test_a_map_without_a_free_cell_and_an_unknown_planner_are_refused() -> None:
    with pytest.raises(NoFreeSpace, match="no free cell"):
        plan_on_cells(np.zeros((3, 3), np.int32), (0, 0), (1, 1))
    with pytest.raises(ConfigError, match="no planner 'astra'; choose dstar-lite, astar, dijkstra"):
        grid_planner("astra")
