"""Keeping to one side when people are near: how far, where, and the way back to the middle."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.planning.window.test_dwa_people import walker
from waychair.calibration.chair_body import CHAIR_A
from waychair.maps.drawn.zones import Rule, Zone
from waychair.planning.body.footprint import fits
from waychair.planning.grid.costmap import Costmap, costmap_from_grid
from waychair.planning.route.global_planner import GlobalPlanner, PlannerSettings
from waychair.planning.route.keep_right import kept_right
from waychair.planning.seen.forecast import ExpectedPeople, arrival
from waychair.resumable import finished
from waychair.types import UNKNOWN, FloatArray, OccupancyGrid, Path, Pose2

START, GOAL = Pose2(1.0, 1.0), Pose2(9.0, 1.0, 0.3)
HERE = Pose2()


def corridor(width: float = 2.0, origin: Pose2 = HERE) -> OccupancyGrid:
    """10 m along x, with walls beside it and at its ends, in the middle of y = 1 m."""
    cells = np.full((60, 200), 100, np.int8)
    half = round(width / 2 / 0.05)
    cells[20 - half : 20 + half, 1:-1] = 0
    return OccupancyGrid(cells, 0.05, origin)


def line(y: float = 1.0, x0: float = 1.0, x1: float = 9.0) -> Path:
    x = np.arange(x0, x1, 0.1)
    return Path(np.column_stack([x, np.full(len(x), y), np.zeros(len(x))]))


def aside(path: Path, costmap: Costmap, **changed: float) -> FloatArray:
    """Return (N,) the shift [m] to the right of a path along x."""
    kept: FloatArray = path.poses[:, 1] - kept_right(path, costmap, **changed).poses[:, 1]
    return kept


def test_in_a_corridor_the_path_except_its_ends_is_as_far_to_the_right_as_possible() -> None:
    off = aside(line(), costmap_from_grid(corridor(), CHAIR_A))
    assert off[0] == off[-1] == 0.0
    np.testing.assert_allclose(off[20:-20], 0.4)  # 0.3 m are left to the wall
    assert np.abs(np.diff(off)).max() <= 0.3 * 0.1 + 1e-9


@pytest.mark.parametrize(("width", "most"), [(1.6, 0.25), (1.4, 0.15), (1.1, 0.0)])
def test_in_a_narrow_corridor_the_clearance_beside_the_chair_is_kept(width: float, most: float) -> None:
    off = aside(line(), costmap_from_grid(corridor(width), CHAIR_A))
    assert off.max() == pytest.approx(most, abs=0.051)
    assert off.max() <= max(0.0, width / 2 - 0.3 - 0.25) + 1e-9


def test_the_chair_keeps_left_or_in_the_middle_if_so_configured() -> None:
    costmap = costmap_from_grid(corridor(), CHAIR_A)
    np.testing.assert_allclose(aside(line(), costmap, aside=-0.4)[20:-20], -0.4)
    assert not aside(line(), costmap, aside=0.0).any()


def test_in_a_hall_the_path_stays_in_the_middle() -> None:
    cells = np.zeros((160, 200), np.int8)
    cells[[0, -1]], cells[:, [0, -1]] = 100, 100
    costmap = costmap_from_grid(OccupancyGrid(cells, 0.05), CHAIR_A)
    assert not aside(line(4.0), costmap)[6:-6].any()
    np.testing.assert_allclose(aside(line(1.2), costmap)[20:-20], 0.4)  # along its wall there is


def test_headings_follow_the_moved_path_but_for_the_last() -> None:
    path = line()
    path.poses[-1, 2] = 0.3
    poses = kept_right(path, costmap_from_grid(corridor(), CHAIR_A)).poses
    ahead = np.diff(poses[:, :2], axis=0)
    np.testing.assert_allclose(poses[:-1, 2], np.arctan2(ahead[:, 1], ahead[:, 0]))
    assert poses[-1, 2] == 0.3
    assert np.abs(poses[:-1, 2]).max() <= math.atan(0.3) + 1e-9


def test_the_chair_returns_to_the_middle_round_an_obstacle_on_the_right() -> None:
    bin_at_the_wall = np.array([[5.0, 0.45], [5.1, 0.45]])
    off = aside(line(), costmap_from_grid(corridor(), CHAIR_A, live_points=bin_at_the_wall))
    assert off[38:44].max() <= 0.05
    np.testing.assert_allclose([off[20], off[60]], 0.4, atol=0.02)


def test_the_path_moves_neither_to_unknown_cells_nor_onto_a_one_way_zone() -> None:
    grid = corridor()
    grid.cells[:17, 90:110] = UNKNOWN
    assert aside(line(), costmap_from_grid(grid, CHAIR_A))[40] == pytest.approx(0.1, abs=0.051)
    corners = np.array([[4.5, 0.2], [5.5, 0.2], [5.5, 0.85], [4.5, 0.85]])
    zone = Zone("up", Rule.ONE_WAY, corners, math.pi)
    assert aside(line(), costmap_from_grid(corridor(), CHAIR_A, zones=[zone]))[40] == pytest.approx(0.1, abs=0.051)


def test_outside_the_map_and_for_two_poses_the_path_stays_unchanged() -> None:
    costmap = costmap_from_grid(corridor(), CHAIR_A)
    assert not aside(line(-3.0), costmap).any()
    short = Path(np.array([[1.0, 1.0, 0.0], [1.1, 1.0, 0.0]]))
    assert kept_right(short, costmap) is short


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**31), st.floats(-math.pi, math.pi))
def test_the_moved_path_keeps_its_clearance_for_obstacles_anywhere(seed: int, turned: float) -> None:
    rng = np.random.default_rng(seed)
    origin = Pose2(3.0, -2.0, turned)
    grid = corridor(2.6, origin)
    things = np.argwhere(rng.random((60, 200)) < 0.001)
    grid.cells[things[:, 0], things[:, 1]] = 100
    costmap = costmap_from_grid(grid, CHAIR_A)
    flat = line()
    path = Path(np.array([(origin @ Pose2(*pose)).array() for pose in flat.poses]))
    moved = kept_right(path, costmap)
    for before, after in zip(path.poses, moved.poses, strict=True):
        off = float(np.hypot(*(after - before)[:2]))
        assert off <= 0.4 + 1e-9
        here = Pose2(after[0], after[1], before[2])
        if off > 0.05:  # one step was checked; beside the chair, not before it
            slim = replace(CHAIR_A, front=0.01, rear=0.01)
            assert fits(slim, 0.15, costmap.field, here)


def test_the_planner_keeps_right_among_people_and_in_the_middle_without_them() -> None:
    costmap = costmap_from_grid(corridor(), CHAIR_A)
    somebody = walker(30.0, 1.0, -1.0, 0.0)
    search = GlobalPlanner(GOAL, PlannerSettings())
    alone = finished(search.replan_among_people(costmap, lambda: START, ExpectedPeople((), 0.7), 0.8))
    among = finished(search.replan_among_people(costmap, lambda: START, ExpectedPeople((somebody,), 0.7), 0.8))
    middle, right = (path.poses[np.abs(path.poses[:, 0] - 5.0) < 1.0, 1] for path in (alone, among))
    np.testing.assert_allclose(middle, 1.0, atol=0.15)
    np.testing.assert_allclose(right, 0.6, atol=0.15)
    np.testing.assert_allclose(among.poses[-1], GOAL.array())
    assert sum(len(leg.path.poses) for leg in search.legs) == len(among.poses)


@pytest.mark.parametrize(("y", "side"), [(0.4, 1.4), (1.6, 0.6)])
def test_the_planner_passes_on_the_other_side_of_somebody_who_comes_along_its_own(y: float, side: float) -> None:
    costmap = costmap_from_grid(corridor(), CHAIR_A)
    somebody = ExpectedPeople((walker(7.0, y, -0.8, 0.0),), 0.7)
    search = GlobalPlanner(GOAL, PlannerSettings())
    path = finished(search.replan_among_people(costmap, lambda: START, somebody, 0.8))
    meeting = path.poses[np.abs(path.poses[:, 0] - 4.0) < 0.5, 1]
    np.testing.assert_allclose(meeting, side, atol=0.15)
    assert arrival(somebody, path.poses[:, :2], 0.8)[1] == 0.0
