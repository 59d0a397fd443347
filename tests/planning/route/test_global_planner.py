"""Paths in map coordinates, and errors with advice."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waychair.calibration.chair_body import CHAIR_A
from waychair.errors import GoalOccupied, GoalOutsideMap, NoPath, StartOccupied, StartOutsideMap
from waychair.maps.grid.cells import cells_from_points
from waychair.planning.grid.costmap import Costmap, costmap_from_grid
from waychair.planning.grid.grid_graph import FREE_PRICE, Prices
from waychair.planning.grid.smoothing import line_cost, round_corners
from waychair.planning.route.global_planner import GlobalPlanner, plan
from waychair.types import FloatArray, OccupancyGrid, Pose2

ORIGIN = Pose2(-3.0, 5.0, 0.0)


def house(door: bool = True, origin: Pose2 = ORIGIN) -> OccupancyGrid:
    """Two rooms of 4 x 6 m, walls round them and one between, with a door of 0.9 m in its middle."""
    cells = np.zeros((120, 162), np.int8)
    cells[[0, -1]], cells[:, [0, -1]], cells[:, 80:82] = 100, 100, 100
    if door:
        cells[51:69, 80:82] = 0
    return OccupancyGrid(cells, 0.05, origin)


def at(x: float, y: float, theta: float = 0.0, origin: Pose2 = ORIGIN) -> Pose2:
    """A pose given from the house's corner."""
    return origin @ Pose2(x, y, theta)


def clearances(costmap: Costmap, points: FloatArray) -> FloatArray:
    rows, columns = cells_from_points(costmap.grid, points).T
    return costmap.clearance[rows, columns].astype(float)


@pytest.mark.parametrize("origin", [ORIGIN, Pose2(2.0, -7.0, 0.7)])
def test_a_path_leads_from_the_start_through_the_door_to_the_heading_of_the_goal(origin: Pose2) -> None:
    costmap = costmap_from_grid(house(origin=origin), CHAIR_A)
    start, goal = at(1.0, 1.0, 2.0, origin), at(7.0, 5.0, -1.0, origin)
    poses = plan(costmap, start, goal).poses
    np.testing.assert_allclose(poses[0, :2], [start.x, start.y], atol=1e-9)
    np.testing.assert_allclose(poses[-1], goal.array(), atol=1e-9)
    ahead = np.diff(poses[:, :2], axis=0)
    assert np.hypot(*ahead.T).max() <= 0.1 + 1e-6
    # Headings follow the path, except the first of two poses at one place: there the chair turns.
    goes = np.hypot(*ahead.T) > 0.0
    np.testing.assert_allclose(poses[:-1, 2][goes], np.arctan2(ahead[goes, 1], ahead[goes, 0]), atol=0.08)
    assert clearances(costmap, poses[:, :2]).min() >= 0.35
    assert plan(costmap, start, goal).length() < 1.25 * (math.hypot(3.1, 2.0) + math.hypot(2.9, 2.0))


def test_a_path_passes_a_door_near_its_middle() -> None:
    poses = plan(costmap_from_grid(house(), CHAIR_A), at(1.0, 1.0), at(7.0, 5.0)).poses
    door = poses[np.abs(poses[:, 0] - at(4.05, 0.0).x) < 0.1]
    assert len(door) > 0
    assert np.abs(door[:, 1] - at(0.0, 3.0).y).max() <= 0.076


@pytest.mark.parametrize(
    ("start", "goal", "error", "advice"),
    [
        (at(-0.5, 1), at(7, 5), StartOutsideMap, "localise the chair or extend the map"),
        (at(1, 1), at(7, 6.2), GoalOutsideMap, "choose one inside it"),
        (at(0.02, 1), at(7, 5), StartOccupied, "drive it out by hand or correct its pose"),
        (at(1, 1), at(4.05, 1), GoalOccupied, r"the nearest place with room is \("),
        (at(1, 1), at(7.95, 5), GoalOccupied, r"the nearest place with room is \("),
    ],
)
def test_impossible_starts_and_goals_are_refused_with_advice(
    start: Pose2, goal: Pose2, error: type[Exception], advice: str
) -> None:
    with pytest.raises(error, match=advice) as caught:
        plan(costmap_from_grid(house(), CHAIR_A), start, goal)
    culprit = start if "start" in str(caught.value) else goal
    assert f"({culprit.x:.2f}, {culprit.y:.2f})" in str(caught.value)


def test_rooms_without_a_door_are_not_connected() -> None:
    with pytest.raises(NoPath, match="clear the way or choose another goal"):
        plan(costmap_from_grid(house(door=False), CHAIR_A), at(1, 1), at(7, 5))


def test_a_chair_too_close_to_a_wall_may_leave_it() -> None:
    start = at(0.3, 3.0)
    costmap = costmap_from_grid(house(), CHAIR_A)
    row, column = cells_from_points(costmap.grid, np.array([[start.x, start.y]]))[0]
    assert costmap.prices[row, column] == 0
    poses = plan(costmap, start, at(2.0, 3.0)).poses
    np.testing.assert_allclose(poses[0, :2], [start.x, start.y], atol=1e-9)
    assert poses[0, 2] == pytest.approx(0.0, abs=0.3)


def test_a_chair_enclosed_by_live_obstacles_gets_its_own_message() -> None:
    ring = np.array([[math.cos(a), math.sin(a)] for a in np.linspace(0, math.tau, 60)]) * 0.33
    start = at(2.0, 3.0)
    costmap = costmap_from_grid(house(), CHAIR_A, live_points=ring + np.array([start.x, start.y]))
    with pytest.raises(StartOccupied, match=r"no free place within 0\.30 m"):
        plan(costmap, start, at(7.0, 5.0))


def test_a_free_place_behind_a_thin_wall_does_not_count_as_a_way_out() -> None:
    cells = np.zeros((60, 80), np.int8)
    cells[:, 38] = 100  # a wall one cell thick ...
    cells[:, 30] = 100  # ... and another 0.35 m before it, the chair stands between
    costmap = costmap_from_grid(OccupancyGrid(cells, 0.05), CHAIR_A)
    with pytest.raises(StartOccupied):
        GlobalPlanner(Pose2(3.0, 1.5)).replan(costmap, Pose2(1.725, 1.5))


def test_closing_and_opening_a_door_are_planned_with_little_work() -> None:
    goal, start = at(7.0, 5.0), at(1.0, 1.0)
    planner = GlobalPlanner(goal)
    free = costmap_from_grid(house(), CHAIR_A)
    length = planner.replan(free, start).length()
    first_pops = planner.pops
    door = np.array([[at(4.05, 3.0).x, at(4.05, 3.0).y]])
    with pytest.raises(NoPath):
        planner.replan(costmap_from_grid(house(), CHAIR_A, live_points=door), start)
    closing_pops = planner.pops
    assert planner.replan(free, start).length() == pytest.approx(length)
    assert planner.pops - closing_pops < first_pops


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=20, deadline=None)
def test_replanning_with_live_obstacles_gives_the_cost_of_a_new_plan(seed: int) -> None:
    rng = np.random.default_rng(seed)
    goal, start = at(7.0, 5.0), at(1.0, 1.0)
    planner = GlobalPlanner(goal, check_footprint=False)  # the footprint's checks are tested with the route
    for _ in range(4):
        points = np.array([ORIGIN.x, ORIGIN.y]) + rng.uniform((0.5, 1.8), (7.5, 4.2), (4, 2))
        costmap = costmap_from_grid(house(), CHAIR_A, live_points=points)
        anew = GlobalPlanner(goal, check_footprint=False)
        try:
            path = anew.replan(costmap, start)
        except (NoPath, StartOccupied) as error:
            with pytest.raises(type(error)):
                planner.replan(costmap, start)
            continue
        poses = planner.replan(costmap, start).poses
        assert planner.cost == anew.cost
        left_the_start = np.hypot(*(poses[:, :2] - poses[0, :2]).T) > 0.4
        assert clearances(costmap, poses[left_the_start, :2]).min() >= 0.35
        assert len(path.poses) > 10
        start = Pose2(*poses[min(8, len(poses) - 2)])


def test_another_map_geometry_starts_a_new_plan() -> None:
    planner = GlobalPlanner(Pose2(3.0, 1.0))
    wide = costmap_from_grid(OccupancyGrid(np.zeros((40, 80), np.int8), 0.05), CHAIR_A)
    grown = costmap_from_grid(OccupancyGrid(np.zeros((60, 100), np.int8), 0.05, Pose2(-0.5, -0.5)), CHAIR_A)
    assert planner.replan(wide, Pose2(0.5, 1.0)).length() == pytest.approx(2.5, rel=0.01)
    assert planner.replan(grown, Pose2(0.5, 1.0)).length() == pytest.approx(2.5, rel=0.01)


def test_a_goal_at_the_start_gives_a_path_of_one_pose() -> None:
    poses = plan(costmap_from_grid(house(), CHAIR_A), at(2, 3, 1.0), at(2, 3, -0.5)).poses
    np.testing.assert_allclose(poses[:, :2], np.tile([at(2, 3).x, at(2, 3).y], (2, 1)), atol=1e-9)
    assert poses[-1, 2] == -0.5


def plain_line_cost(prices: Prices, a: FloatArray, b: FloatArray) -> float:
    count = max(math.ceil(4 * math.dist(a, b)), 1)
    samples = [a + (b - a) * (i + 0.5) / count for i in range(count)]
    found = [int(prices[math.floor(p[1]), math.floor(p[0])]) for p in samples]
    return math.inf if 0 in found else math.dist(a, b) * float(np.mean(found)) / 1000


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=60, deadline=None)
def test_the_cost_of_a_line_equals_the_plain_reference(seed: int) -> None:
    rng = np.random.default_rng(seed)
    prices = np.where(rng.random((12, 15)) < 0.05, 0, rng.integers(1000, 9000, (12, 15))).astype(np.int32)
    a, b = rng.uniform(0, (15, 12), (2, 2))
    assert line_cost(prices, *a, *b, None) == pytest.approx(plain_line_cost(prices, a, b))


@pytest.mark.parametrize("end", [(15.0, 3.0), (-0.1, 3.0), (3.0, 12.0), (3.0, -0.1), (40.0, 40.0)])
def test_no_line_leads_outside_of_the_map(end: tuple[float, float]) -> None:
    prices = np.full((12, 15), FREE_PRICE, np.int32)
    assert line_cost(prices, 5.0, 5.0, *end, None) == math.inf
    assert line_cost(prices, *end, 5.0, 5.0, None) == math.inf
    assert line_cost(prices, 5.0, 5.0, 14.9, 11.9, None) < math.inf


def test_a_corner_is_not_rounded_against_a_one_way_zone() -> None:
    prices, barred = np.full((20, 20), FREE_PRICE, np.int32), np.zeros((20, 20), np.uint8)
    points = np.array([[2.5, 2.5], [10.5, 2.5], [10.5, 12.5]])
    assert (round_corners(prices, points, 4)[1] != points[1]).any()
    barred[3:, :10] = 0xFF  # within the corner
    np.testing.assert_array_equal(round_corners(prices, points, 4, barred), points)


@given(st.floats(0.9, 4.4), st.floats(0.3, 3.0), st.floats(0.80, 0.95))
@settings(max_examples=30, deadline=None)
def test_a_plan_from_inside_a_corridor_ends_at_its_goal_and_not_at_the_end_of_the_narrow_place(
    x: float, way: float, width: float
) -> None:
    cells = np.full((70, 320), 100, np.int8)
    cells[35 - round(width / 0.04) : 35 + round(width / 0.04), 4:-4] = 0
    costmap = costmap_from_grid(OccupancyGrid(cells, 0.02, Pose2()), CHAIR_A)
    start, goal = Pose2(x, 0.7, 0.0), Pose2(min(x + way, 5.4), 0.7, 0.0)
    planner = GlobalPlanner(goal)
    poses = planner.replan(costmap, start).poses
    np.testing.assert_allclose(poses[-1], goal.array(), atol=0.02)
    assert np.hypot(*np.diff(poses[:, :2], axis=0).T).max() <= 0.1 + 1e-6
    np.testing.assert_allclose(planner.legs[-1].path.poses[-1], goal.array(), atol=0.02)


def bent_gap(opened: bool = False, long_way: bool = True) -> Costmap:
    """A wall whose gap leads into a passage as narrow as the chair, which is as wide as two chairs once it is `opened`.

    The other way round the wall is 20 m longer.
    """
    cells = np.zeros((320, 160), np.int8)
    cells[[0, -1]], cells[:, [0, -1]], cells[:, 80:82] = 100, 100, 100
    cells[20:38, 80:82] = 0
    cells[:60, 97:99] = 0 if opened else 100
    if long_way:
        cells[270:300, 80:82] = 0
    return costmap_from_grid(OccupancyGrid(cells, 0.05), CHAIR_A)


def test_a_gap_that_only_half_the_width_passes_is_refused_at_once_for_a_longer_way() -> None:
    start, goal = Pose2(2.0, 1.45, 0.0), Pose2(7.0, 1.45, 0.0)
    planner = GlobalPlanner(goal)
    assert planner.replan(bent_gap(), start).length() > 24.0
    pops = planner.pops
    assert planner.replan(bent_gap(), start).length() > 24.0
    assert planner.pops - pops < pops / 10  # it is known
    assert planner.replan(bent_gap(opened=True), start).length() < 6.0


def test_a_gap_that_every_way_leads_through_is_refused_with_its_place() -> None:
    with pytest.raises(NoPath, match="not even with a multi-point turn") as refused:
        plan(bent_gap(long_way=False), Pose2(2.0, 1.45, 0.0), Pose2(7.0, 1.45, 0.0))
    assert refused.value.place == pytest.approx((4.4, 1.6), abs=0.6)
