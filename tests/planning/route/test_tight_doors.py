"""Through tight doors the line is straight, and it is so before them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from waychair.calibration.chair_body import CHAIR_A
from waychair.planning.grid.costmap import Costmap, costmap_from_grid
from waychair.planning.route.global_planner import GlobalPlanner, plan
from waychair.planning.route.legs import DoorPassage, PathLeg
from waychair.planning.route.tight_doors import tight_doors
from waychair.types import FloatArray, OccupancyGrid, Pose2

CELL = 0.05


def doorway(width: float, corridor: float = 0.15) -> Costmap:
    """12 x 8 m with a wall at x = 5 m of a thickness [m] and an opening round y = 4 m."""
    cells = np.zeros((160, 240), np.int8)
    cells[[0, -1]], cells[:, [0, -1]] = 100, 100
    cells[:, 100 : 100 + round(corridor / CELL)] = 100
    half = round(width / CELL / 2)
    cells[80 - half : 80 + half, 100 : 100 + round(corridor / CELL)] = 0
    return costmap_from_grid(OccupancyGrid(cells, CELL), CHAIR_A)


@pytest.mark.parametrize("width", [0.8, 0.85])
@pytest.mark.parametrize(("x", "y"), [(2.0, 1.0), (2.0, 4.0), (3.0, 7.0)])
def test_the_line_is_on_a_tight_doors_axis_from_before_it_until_the_chair_is_through(
    width: float, x: float, y: float
) -> None:
    poses = plan(doorway(width), Pose2(x, y), Pose2(9.0, 5.5)).poses
    front = poses[:, 0] + CHAIR_A.front
    run = poses[(front > 4.9) & (poses[:, 0] - CHAIR_A.rear < 5.2)]
    assert len(run) > 8
    assert np.abs(run[:, 1] - 4.0).max() < 0.01
    assert np.abs(run[:, 2]).max() < math.radians(1)


def test_a_line_for_the_half_width_alone_cuts_the_corner() -> None:
    poses = plan(doorway(0.9), Pose2(3.0, 7.0), Pose2(9.0, 5.5), check_footprint=False).poses
    before = poses[(poses[:, 0] > 4.0) & (poses[:, 0] < 4.3)]
    assert np.abs(before[:, 1] - 4.0).max() > 0.2


def doors_of(costmap: Costmap, points: FloatArray) -> list[tuple[int, int, DoorPassage]]:
    return tight_doors(costmap, points, 0.6, 0.9)


def test_wide_openings_corridors_and_single_pillars_are_no_tight_doors() -> None:
    along = np.column_stack([np.arange(40.0, 200.0), np.full(160, 80.0)])
    assert not doors_of(doorway(2.0), along)
    assert not doors_of(doorway(1.0, 3.0), along)
    cells = np.zeros((160, 240), np.int8)
    cells[80:84, 100:104] = 100
    assert not doors_of(costmap_from_grid(OccupancyGrid(cells, CELL), CHAIR_A), along + np.array([0.0, 12.0]))


def test_a_tight_door_is_found_with_its_middle_its_axis_and_its_width() -> None:
    back = np.column_stack([np.arange(200.0, 40.0, -1.0), np.full(160, 80.5)])
    ((first, last, door),) = doors_of(doorway(0.8), back)
    assert 90 < back[last, 0] < back[first, 0] < 115
    at = door.map_from_door
    assert (at.x, at.y) == pytest.approx((5.075, 4.0), abs=0.06)
    assert abs(abs(at.theta) - math.pi) < 0.05, "it points where the line goes"
    assert door.width == pytest.approx(0.8, abs=0.06)


def corridor_with_door(width: float) -> Costmap:
    """A corridor 2 m wide along y = 2 m, and a room north of it, through a door round x = 6 m."""
    cells = np.zeros((120, 240), np.int8)
    cells[[0, -1]], cells[:, [0, -1]] = 100, 100
    cells[18:20], cells[60:62] = 100, 100
    half = round(width / CELL / 2)
    cells[60:62, 120 - half : 120 + half] = 0
    return costmap_from_grid(OccupancyGrid(cells, CELL), CHAIR_A)


def legs(costmap: Costmap, start: Pose2, goal: Pose2) -> tuple[PathLeg, ...]:
    planner = GlobalPlanner(goal)
    planner.replan(costmap, start)
    return planner.legs


@pytest.mark.parametrize("start", [2.0, 10.0])
def test_a_door_round_a_sharp_corner_is_passed_on_its_axis(start: float) -> None:
    way = legs(
        corridor_with_door(0.8), Pose2(start, 2.0, 0.0 if start < 6.0 else math.pi), Pose2(6.0, 5.0, math.pi / 2)
    )
    assert all(leg.is_line for leg in way)
    poses = np.concatenate([leg.path.poses for leg in way])
    through = poses[(poses[:, 1] + CHAIR_A.front > 3.0) & (poses[:, 1] - CHAIR_A.rear < 3.1)]
    assert np.abs(through[:, 0] - 6.0).max() < 0.06
    assert np.abs(through[:, 2] - math.pi / 2).max() < 0.05
    assert way[-1].doors[0].width == pytest.approx(0.8, abs=0.06)


def test_a_wide_door_is_passed_in_a_curve_without_a_stop() -> None:
    (way,) = legs(corridor_with_door(2.0), Pose2(2.0, 2.0), Pose2(6.0, 5.0, math.pi / 2))
    assert not way.doors


def test_a_straight_start_in_the_door_goes_on_from_there_and_a_goal_in_it_ends_there() -> None:
    costmap = doorway(0.8)
    begin = legs(costmap, Pose2(5.0, 4.0, 0.02), Pose2(9.0, 4.0))
    assert begin[0].path.poses[0, 0] == pytest.approx(5.0, abs=0.02)
    assert (np.diff(begin[0].path.poses[:, 0]) >= -1e-6).all()
    end = legs(costmap, Pose2(2.0, 4.0), Pose2(5.0, 4.0, 0.0))
    assert end[-1].path.poses[-1, 0] == pytest.approx(5.0, abs=0.02)
