"""A plan through a large hall takes many ticks of bounded work, and is the same plan."""

from __future__ import annotations

import numpy as np
import pytest

from waychair.calibration.chair_body import CHAIR_A
from waychair.planning.grid.costmap import Costmap, costmap_from_grid
from waychair.planning.grid.dstar_lite import CELLS_PER_STEP, POPS_PER_STEP, DStarLite
from waychair.planning.grid.grid_graph import FREE_PRICE, Prices
from waychair.planning.route.global_planner import GlobalPlanner
from waychair.resumable import finished
from waychair.types import OccupancyGrid, Pose2


@pytest.fixture(scope="module")
def hall() -> Costmap:
    """A hall of 150 m with a wall along its middle that ends 3 m before its far end."""
    cells = np.zeros((240, 1500), np.int8)
    cells[:2] = cells[-2:] = cells[:, :2] = cells[:, -2:] = 100
    cells[118:122, :-30] = 100
    return costmap_from_grid(OccupancyGrid(cells, 0.1), CHAIR_A)


def test_the_first_plan_in_a_hall_of_150_m_is_cut_into_bounded_parts_and_stays_the_same_path(hall: Costmap) -> None:
    start, goal = Pose2(3.0, 6.0, 0.0), Pose2(3.0, 18.0, 3.1)
    planner = GlobalPlanner(goal)
    work, pops = planner.replan_resumably(hall, lambda: start), []
    for _ in work:
        pops.append(planner.pops)
    assert planner.legs[-1].path.poses[-1] == pytest.approx(goal.array())
    assert np.diff([0, *pops, planner.pops]).max() <= POPS_PER_STEP
    assert len(pops) >= planner.pops // POPS_PER_STEP > 5
    whole = GlobalPlanner(goal)
    expected = finished(whole.replan_resumably(hall, lambda: start))
    assert planner.cost == whole.cost
    assert np.concatenate([leg.path.poses for leg in planner.legs]) == pytest.approx(
        np.concatenate([leg.path.poses for leg in whole.legs])
    )
    assert expected.length() > 290.0


def test_the_chair_may_move_and_obstacles_may_change_between_the_parts_of_a_search() -> None:
    rng = np.random.default_rng(6)
    prices: Prices = rng.integers(FREE_PRICE, 4 * FREE_PRICE, (400, 700)).astype(np.int32)
    prices[195:205, :-9] = 0
    goal, starts = (390, 5), [(5, 5), (6, 9), (9, 30)]
    search = DStarLite(prices, goal, starts[0])
    assert prices.size > CELLS_PER_STEP
    work, step = search.prepare(), 0
    for step, _ in enumerate(work, 1):
        if step in (3, 6):
            search.move_start(starts[step // 3])
        if step == 5:
            changed = np.vstack([np.argwhere(rng.random(prices.shape) < 0.01), [goal], [starts[2]]])
            prices[tuple(changed.T)] = 0
            prices[goal], prices[starts[2]] = FREE_PRICE, FREE_PRICE
            search.update(changed, prices[tuple(changed.T)])
    assert step > 6
    fresh = DStarLite(prices, goal, starts[2])
    assert search.replan() == fresh.replan()
    assert (search.path()[[0, -1]] == [starts[2], goal]).all()
