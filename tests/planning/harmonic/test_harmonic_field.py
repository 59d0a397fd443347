"""The harmonic field: no descent is trapped on maps of any length, and an unreachable goal is an error."""

from __future__ import annotations

import math
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waychair.calibration.chair_body import CHAIR_A
from waychair.errors import ConfigError, NoPath, NotConverged, StartOutsideMap
from waychair.maps.grid.moving_ai import load_free_cells
from waychair.planning.body.footprint import fits
from waychair.planning.grid.costmap import costmap_from_grid
from waychair.planning.grid.grid_graph import FREE_PRICE, Cell, directions_against
from waychair.planning.harmonic import harmonic_field as harmonic
from waychair.planning.harmonic import harmonic_search
from waychair.planning.harmonic.harmonic_field import (
    LogField,
    count_summits,
    descend,
    gradient,
    log_field,
    log_field_resumably,
    streamline,
    summits,
)
from waychair.planning.harmonic.harmonic_search import HarmonicSearch, absorption_from_prices
from waychair.planning.harmonic.laplace_solvers import SolverOptions, laplace_problem, solve
from waychair.planning.harmonic.log_relay import breadth_first_order, cells_near_shortest, log_sweep
from waychair.planning.route.global_planner import GlobalPlanner, PlannerSettings, plan
from waychair.resumable import finished, in_time_slices
from waychair.types import BoolArray, FloatArray, OccupancyGrid, Pose2

REAL = ("real_intel", "real_freiburg-079")


def connected(free: BoolArray, goal: Cell) -> BoolArray:
    """Cells joined to the goal by straight steps, by flooding."""
    reached = np.zeros_like(free)
    reached[goal] = True
    while True:
        grown = reached.copy()
        grown[1:] |= reached[:-1]
        grown[:-1] |= reached[1:]
        grown[:, 1:] |= reached[:, :-1]
        grown[:, :-1] |= reached[:, 1:]
        grown &= free
        if (grown == reached).all():
            return reached
        reached = grown


def all_arrive(found: LogField) -> bool:
    """Return whether repeated steps to the best of four neighbours lead from every connected cell to the goal."""
    height, width = found.logs.shape
    padded = np.pad(found.logs, 1, constant_values=-np.inf)
    shifts = [(0, 1), (0, -1), (1, 0), (-1, 0)]
    around = np.stack([padded[1 + i : 1 + i + height, 1 + j : 1 + j + width] for i, j in shifts])
    steps = np.array([i * width + j for i, j in shifts])
    following = (
        np.arange(height * width) + np.where(around.max(axis=0) > found.logs, steps[around.argmax(axis=0)], 0).ravel()
    )
    for _ in range(math.ceil(math.log2(height * width))):
        following = following[following]
    goal = found.goal[0] * width + found.goal[1]
    return bool((following[np.isfinite(found.logs).ravel()] == goal).all())


@given(st.integers(0, 10_000), st.sampled_from([0.1, 0.3, 0.4]), st.sampled_from([0, 1, 1000]))
@settings(max_examples=40)
def test_the_descent_arrives_from_every_free_cell_connected_to_the_goal(seed: int, full: float, stages: int) -> None:
    rng = np.random.default_rng(seed)
    free = rng.random((24, 31)) > full
    goal = (int(rng.integers(24)), int(rng.integers(31)))
    free[goal] = True
    with patch.object(harmonic, "STAGES", stages):
        found = log_field(laplace_problem(free, goal))
    np.testing.assert_array_equal(np.isfinite(found.logs), connected(free, goal))
    assert count_summits(found) == 0
    for row, column in np.argwhere(np.isfinite(found.logs))[::17]:
        cells = descend(found, (int(row), int(column)))
        assert tuple(cells[-1]) == goal
        assert np.abs(np.diff(cells, axis=0)).max(initial=0) <= 1


@pytest.mark.parametrize("name", REAL)
def test_on_real_maps_the_descent_arrives_from_all_free_cells(name: str, data_dir: Path) -> None:
    free = load_free_cells(data_dir / "movingai" / f"{name}.map")
    cells = np.argwhere(free)
    found = log_field(laplace_problem(free, (int(cells[0, 0]), int(cells[0, 1]))))
    assert found.connected == len(cells) == found.solved.sum()
    assert found.logs[free].min() < -80  # float32 ends at -87, and u = 1 - v at -37
    assert count_summits(found) == 0
    assert all_arrive(found)


def test_a_corridor_too_long_for_float64_is_exact_in_logarithms() -> None:
    found = log_field(laplace_problem(np.ones((1, 1500), np.bool_), (0, 0)))
    decay = math.log(2 + math.sqrt(3))
    assert found.logs[0, -1] < -1900  # of float64 the least is e^-745
    np.testing.assert_allclose(-np.diff(found.logs[0, 1:1400]), decay, rtol=1e-6)


def test_logarithms_equal_those_of_the_exact_solution() -> None:
    free = np.random.default_rng(0).random((60, 70)) > 0.25
    free[30, 20] = True
    problem = laplace_problem(free, (30, 20))
    exact = solve(problem, SolverOptions(solver="direct"))
    with patch.object(harmonic, "TRUSTED", 1e-6):
        found = log_field(problem)
    told = exact.v > 1e-250
    assert found.logs[told].min() < -60
    np.testing.assert_allclose(found.logs[told], np.log(exact.v[told]), atol=1e-5)


def test_a_warm_start_gives_the_same_field_as_a_cold_one() -> None:
    free = np.random.default_rng(3).random((60, 70)) > 0.25
    goal = (30, 20)
    free[goal] = True
    first = log_field(laplace_problem(free, goal))
    free[10:14, 40:44] = False
    cold, warm = log_field(laplace_problem(free, goal)), log_field(laplace_problem(free, goal), warm_start=first)
    told = np.isfinite(cold.logs)
    np.testing.assert_allclose(warm.logs[told], cold.logs[told], atol=1e-4)
    assert warm.sweeps < cold.sweeps


def test_solving_in_stages_ends_at_the_start_and_the_remaining_cells_still_lead_to_the_goal() -> None:
    free = np.ones((5, 400), np.bool_)
    whole = log_field(laplace_problem(free, (2, 0)))
    part = log_field(laplace_problem(free, (2, 0)), until=(2, 60))
    assert part.stages < whole.stages
    assert part.solved.sum() < part.connected == free.size
    assert all_arrive(part)
    assert tuple(descend(part, (4, 399))[-1]) == (2, 0)


def test_only_cells_near_short_paths_are_solved_and_every_descent_still_arrives() -> None:
    free = np.random.default_rng(8).random((40, 60)) > 0.2
    goal, start, detour = (20, 5), (20, 50), 6
    free[goal] = free[start] = True
    with patch.object(harmonic, "DETOUR", detour):
        part = log_field(laplace_problem(free, goal), until=start)
    to_goal, to_start = steps_to(free, goal), steps_to(free, start)
    within = to_goal + to_start <= to_goal[start] + detour
    assert part.solved[start]
    assert not (part.solved & ~within).any()
    np.testing.assert_array_equal(between_on(free, goal, start, detour), within)
    assert count_summits(part) == 0
    assert all_arrive(part)


def steps_to(free: BoolArray, cell: Cell) -> FloatArray:
    """(H, W) least number of steps between four neighbours to a cell, by relaxation; infinite where there is no way."""
    steps = np.full(free.shape, np.inf)
    steps[cell] = 0.0
    while True:
        padded = np.pad(steps, 1, constant_values=np.inf)
        near = np.minimum.reduce([padded[1:-1, 2:], padded[1:-1, :-2], padded[2:, 1:-1], padded[:-2, 1:-1]]) + 1
        better = np.where(free, np.minimum(steps, near), np.inf)
        if (better == steps).all():
            return steps
        steps = better


def between_on(free: BoolArray, goal: Cell, start: Cell, detour: int) -> BoolArray:
    """`cells_near_shortest` on a grid (H, W)."""
    order, numbers = finished(
        breadth_first_order(laplace_problem(free, goal).absorption, np.empty((0, 0), np.uint8), goal)
    )
    at = int(np.flatnonzero(order == start[0] * free.shape[1] + start[1])[0])
    cells = np.zeros(free.shape, np.bool_)
    cells.ravel()[order[cells_near_shortest(numbers, at, detour)]] = True
    return cells


def test_a_start_far_from_the_solved_cells_causes_a_new_solve_and_one_beside_them_does_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    prices = np.full((30, 400), FREE_PRICE, np.int32)
    prices[15, :-20] = 0  # two corridors, joined at the far end
    monkeypatch.setattr(harmonic, "DETOUR", 10)
    search = HarmonicSearch(prices, (5, 2), (5, 200))
    search.replan()
    solved = search.pops
    assert solved > 0
    search.move_start((9, 190))
    search.replan()
    assert search.pops == solved
    search.move_start((25, 100))
    search.replan()
    assert search.pops > solved
    assert tuple(search.path()[0]) == (25, 100)
    assert tuple(search.path()[-1]) == (5, 2)


def test_nothing_is_solved_for_a_start_without_a_path() -> None:
    prices = np.full((30, 40), FREE_PRICE, np.int32)
    prices[15] = 0
    search = HarmonicSearch(prices, (5, 2), (25, 30))
    for _ in range(2):
        with pytest.raises(NoPath, match="not connected"):
            search.replan()
    assert search.pops == 0


def test_a_field_solved_in_slices_equals_one_solved_at_once() -> None:
    free = np.random.default_rng(3).random((60, 70)) > 0.25
    free[30, 20] = True
    problem = laplace_problem(free, (30, 20))
    whole = log_field(problem)
    visits: list[int] = list(log_field_resumably(problem))
    slices = in_time_slices(log_field_resumably(problem), 50_000)
    count = 0
    while True:
        try:
            next(slices)
        except StopIteration as done:
            np.testing.assert_array_equal(done.value.logs, whole.logs)
            break
        count += 1
    assert max(visits) <= 12 * free.size  # no part is much more than a sweep over the map
    assert sum(visits) // (50_000 + max(visits)) <= count <= sum(visits) // 50_000


def test_an_abandoned_solve_leaves_the_previous_field_unchanged(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(harmonic_search, "CELLS_PER_STEP", 1)
    prices = np.full((40, 60), FREE_PRICE, np.int32)
    search = HarmonicSearch(prices, (12, 50), (12, 5))
    cost = search.replan()
    search.update(np.array([[12, 30]]), np.array([0], np.int32))
    work = search.prepare()
    next(work)
    work.close()
    search.update(np.array([[12, 30]]), np.array([FREE_PRICE], np.int32))
    assert search.replan() == pytest.approx(cost, rel=1e-3)
    slow = HarmonicSearch(prices, (12, 50), (12, 5))
    with pytest.raises(NotConverged, match="allow more sweeps or time"):
        finished(slow.prepare(lambda: False))


def test_sweeps_in_logarithms_equal_plain_python() -> None:
    free = np.random.default_rng(5).random((9, 12)) > 0.2
    free[4, 4] = True
    problem = laplace_problem(free, (4, 4))
    order, numbers = finished(breadth_first_order(problem.absorption, np.empty((0, 0), np.uint8), (4, 4)))
    logs = -np.arange(len(order)) / 3.0
    plain = logs.copy()
    for k in range(1, len(order)):
        near = [plain[n] for n in numbers[k] if n >= 0]
        plain[k] = math.log(sum(math.exp(value) for value in near) / 4.0)
    log_sweep(logs, numbers, np.full(len(order), 4.0, np.float32), 1, len(order), True)
    np.testing.assert_allclose(logs, plain, rtol=1e-12)
    lacking = sum(all(plain[n] <= plain[k] for n in numbers[k] if n >= 0) for k in range(1, len(order)))
    assert summits(logs, numbers) == lacking


def test_the_gradient_is_that_of_the_interpolated_field() -> None:
    found = log_field(laplace_problem(np.ones((20, 20), np.bool_), (10, 14)))

    def v(x: float, y: float) -> float:
        j, i = math.floor(x - 0.5), math.floor(y - 0.5)
        a, b = x - 0.5 - j, y - 0.5 - i
        w: FloatArray = np.exp(found.logs[i : i + 2, j : j + 2])
        return float((1 - b) * ((1 - a) * w[0, 0] + a * w[0, 1]) + b * ((1 - a) * w[1, 0] + a * w[1, 1]))

    top = math.exp(found.logs[7:9, 5:7].max())
    x, y, h = 6.2, 8.1, 1e-5
    expected = ((v(x + h, y) - v(x - h, y)) / (2 * h * top), (v(x, y + h) - v(x, y - h)) / (2 * h * top))
    assert gradient(found.logs, x, y) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("seed", range(5))
def test_a_streamline_reaches_the_goal_and_touches_no_wall(seed: int) -> None:
    rng = np.random.default_rng(seed)
    free = rng.random((40, 50)) > 0.25
    free[20, 25] = True
    found = log_field(laplace_problem(free, (20, 25)))
    for row, column in np.argwhere(np.isfinite(found.logs))[::97]:
        line = streamline(found, np.array([column + 0.3, row + 0.6]))
        assert line[-1].tolist() == [25.5, 20.5]
        steps = np.hypot(*np.diff(line, axis=0).T)
        assert steps.max() <= 2.0
        assert free[line[:, 1].astype(int), line[:, 0].astype(int)].all()


def test_a_start_that_is_not_connected_or_outside_is_refused() -> None:
    free = np.ones((10, 10), np.bool_)
    free[:, 5] = False
    found = log_field(laplace_problem(free, (2, 2)))
    for trace in (lambda cell: descend(found, cell), lambda cell: streamline(found, np.array(cell[::-1]) + 0.5)):
        with pytest.raises(NoPath, match="column 8, row 3 is not connected to the goal"):
            trace((3, 8))
        with pytest.raises(StartOutsideMap, match="outside the map of 10 columns and 10 rows"):
            trace((10, 3))


def test_a_one_way_zone_is_never_passed_backwards() -> None:
    free = np.ones((21, 30), np.bool_)
    free[:, 15] = False
    free[3, 15] = free[17, 15] = True  # two gaps; through the upper one only to the right, away from the goal
    barred = np.zeros(free.shape, np.uint8)
    barred[2:5, 13:18] = directions_against(0.0)
    found = log_field(laplace_problem(free, (3, 3)), barred=barred)
    cells = descend(found, (3, 25))
    assert tuple(cells[-1]) == (3, 3)
    assert [17, 15] in cells.tolist()
    assert [3, 15] in descend(log_field(laplace_problem(free, (3, 3))), (3, 25)).tolist()


def test_expensive_floor_is_avoided() -> None:
    prices = np.full((40, 40), FREE_PRICE, np.int32)
    prices[18:22, 10:30] = 0
    dear = prices.copy()
    dear[:18, 10:30][dear[:18, 10:30] > 0] = 10 * FREE_PRICE
    plain = HarmonicSearch(prices, (20, 35), (17, 4))
    wary = HarmonicSearch(dear, (20, 35), (17, 4))
    plain.replan()
    wary.replan()
    assert plain.path()[:, 0].max() < 22
    assert wary.path()[:, 0].max() >= 22
    assert absorption_from_prices(dear)[0, 20] == pytest.approx(0.018)


def test_the_search_handles_changes_and_moves_like_d_star_lite() -> None:
    prices = np.full((40, 60), FREE_PRICE, np.int32)
    prices[:, 30] = 0
    prices[10, 30] = prices[30, 30] = FREE_PRICE
    search = HarmonicSearch(prices, (12, 50), (12, 5))
    first = search.replan()
    assert first > 0
    assert [10, 30] in search.path().tolist()
    search.update(np.array([[10, 30]]), np.array([0], np.int32))
    with pytest.raises(NoPath, match="call replan"):
        search.path()
    search.replan()
    assert [30, 30] in search.path().tolist()
    search.move_start((12, 45))
    assert search.replan() < first
    search.move_start((12, 5))
    search.update(np.array([[30, 30]]), np.array([0], np.int32))
    with pytest.raises(NoPath):
        search.replan()


def house() -> OccupancyGrid:
    """Two rooms of 4 x 6 m with a door of 1.2 m between."""
    cells = np.zeros((120, 162), np.int8)
    cells[[0, -1]], cells[:, [0, -1]], cells[:, 80:82] = 100, 100, 100
    cells[48:72, 80:82] = 0
    return OccupancyGrid(cells, 0.05)


def test_one_setting_makes_the_global_planner_harmonic() -> None:
    costmap = costmap_from_grid(house(), CHAIR_A)
    start, goal = Pose2(1.0, 1.0, 0.0), Pose2(7.0, 5.0, 1.0)
    harmonic = plan(costmap, start, goal, PlannerSettings(planner="harmonic"))
    lite = plan(costmap, start, goal)
    assert harmonic.length() < 1.25 * lite.length()
    np.testing.assert_allclose(harmonic.poses[-1], goal.array())
    assert all(fits(CHAIR_A, 0.02, costmap.field, Pose2(*pose)) for pose in harmonic.poses[1:-1])


def test_the_harmonic_planner_replans_round_a_new_obstacle() -> None:
    settings = PlannerSettings(planner="harmonic")
    planner = GlobalPlanner(Pose2(6.0, 3.0, 0.0), settings)
    costmap = costmap_from_grid(house(), CHAIR_A)
    planner.replan(costmap, Pose2(1.0, 3.0, 0.0))
    thing = np.array([[2.5, 3.0]])
    among = costmap_from_grid(house(), CHAIR_A, live_points=thing)
    path = planner.replan(among, Pose2(1.0, 3.0, 0.0))
    assert np.hypot(*(path.poses[:, :2] - thing[0]).T).min() > CHAIR_A.width / 2


def test_an_unknown_planner_is_refused() -> None:
    with pytest.raises(ConfigError, match="there is no planner 'harmonics'"):
        PlannerSettings(planner="harmonics")
