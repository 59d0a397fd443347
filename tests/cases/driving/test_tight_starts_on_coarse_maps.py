"""A chair that stands centimetres from a wall leaves it on maps of 5 cm cells as on fine ones."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from waychair.calibration.chair_body import CHAIR_A, CHAIR_A_MID, ROBOT, ChairBody
from waychair.geometry import transform_points
from waychair.maps.grid.distance_field import DistanceField
from waychair.planning.body.clearance import LEFT, MAP_DOUBT
from waychair.planning.grid.costmap import costmap_from_grid
from waychair.planning.grid.fine_distances import fine_field
from waychair.planning.route.global_planner import GlobalPlanner
from waychair.planning.route.leaving_a_wall import leading_out_path, standing_body
from waychair.resumable import finished
from waychair.types import FloatArray, OccupancyGrid, Pose2

CELL, SIDE = 0.05, 6.0


def room(offset: float) -> tuple[OccupancyGrid, float]:
    """A square room on 5 cm cells, and the place of its wall at +x.

    The cells that hold a part of the wall are occupied, so that they reach up to `offset` [m] into the room.
    """
    count = round(SIDE / CELL)
    cells = np.zeros((count, count), np.int8)
    cells[0], cells[-1], cells[:, 0], cells[:, -1] = 100, 100, 100, 100
    return OccupancyGrid(cells, CELL), SIDE - CELL + offset


def parked(body: ChairBody, wall: float, gap: float) -> Pose2:
    return Pose2(wall - gap - body.front, SIDE / 2, 0.0)


def field_round(grid: OccupancyGrid, pose: Pose2) -> DistanceField:
    return fine_field(grid, pose, 4.0)


def reach_ahead(body: ChairBody, poses: FloatArray) -> FloatArray:
    """(N,) the farthest x [m] of the corners."""
    return np.array([transform_points(Pose2(*pose), body.outline())[:, 0].max() for pose in poses])


@pytest.mark.parametrize("body", [CHAIR_A, CHAIR_A_MID], ids=lambda body: body.chair_id)
@pytest.mark.parametrize(("offset", "gap"), [(0.0, 0.03), (0.02, 0.03), (0.03, 0.015), (0.03, 0.02)])
def test_a_chair_with_its_front_just_before_a_wall_backs_off_and_comes_no_nearer(
    body: ChairBody, offset: float, gap: float
) -> None:
    grid, wall = room(offset)
    start = parked(body, wall, gap)
    poses = finished(leading_out_path(field_round(grid, start), body, start, MAP_DOUBT * CELL))
    assert poses is not None
    ahead = reach_ahead(body, poses)
    assert ahead.max() <= ahead[0] + 0.005
    assert ahead.max() < wall
    assert wall - ahead[-1] > LEFT - 0.01
    goal = Pose2(1.5, SIDE / 2, math.pi)
    planner = GlobalPlanner(goal)
    planner.replan(costmap_from_grid(grid, body), start)
    assert planner.legs[0].backwards


def test_a_chair_that_stands_deeper_in_a_wall_than_its_cells_explain_is_not_led_out() -> None:
    grid, wall = room(0.0)
    start = parked(CHAIR_A, wall, -0.045)
    assert finished(leading_out_path(field_round(grid, start), CHAIR_A, start, MAP_DOUBT * CELL)) is None


def test_fine_maps_are_believed_to_the_centimetre_and_sides_always() -> None:
    grid, wall = room(0.0)
    start = parked(CHAIR_A, wall, -0.01)
    field = field_round(grid, start)
    assert standing_body(field, CHAIR_A, start, MAP_DOUBT * 0.01) is None
    shorter = standing_body(field, CHAIR_A, start, MAP_DOUBT * CELL)
    assert shorter is not None
    assert CHAIR_A.front - shorter.front == pytest.approx(CHAIR_A.rear - shorter.rear)
    assert 0.01 <= CHAIR_A.front - shorter.front <= 0.03
    assert shorter.width == CHAIR_A.width
    beside = Pose2(SIDE / 2, SIDE - CELL - CHAIR_A.width / 2 + 0.01, 0.0)
    assert standing_body(field_round(grid, beside), CHAIR_A, beside, MAP_DOUBT * CELL) is None


def test_a_body_that_cannot_be_shortened_further_does_not_fit_and_nothing_is_raised() -> None:
    cells = np.full((60, 60), 100, np.int8)
    field = field_round(OccupancyGrid(cells, CELL), Pose2(1.5, 1.5))
    axle_at_the_rear = replace(CHAIR_A, axle_from_rear=0.0)
    for body in (ROBOT, axle_at_the_rear):
        assert standing_body(field, body, Pose2(1.5, 1.5), MAP_DOUBT * CELL) is None
