"""Leaving a parked place: an independent check keeps the chair's ends off the wall until it can turn."""

from __future__ import annotations

import math

import numpy as np
import pytest

from waychair.calibration.chair_body import CHAIR_A_FRONT, CHAIR_A_MID, CHAIR_B, ChairBody
from waychair.geometry import transform_points
from waychair.maps.grid.distance_field import DistanceField
from waychair.planning.grid.costmap import costmap_from_grid
from waychair.planning.grid.fine_distances import fine_field
from waychair.planning.route.global_planner import GlobalPlanner
from waychair.planning.route.leaving_a_wall import leading_out_path, reason_for_cramped
from waychair.resumable import finished
from waychair.types import FloatArray, OccupancyGrid, Pose2

WALL, SIDE = 0.2, 5.0
"""Thickness of the walls and side of the square [m]."""


def square() -> OccupancyGrid:
    """Four walls round a floor, on cells of 1 cm."""
    cells, wall = np.zeros((500, 500), np.int8), round(WALL / 0.01)
    cells[:wall], cells[-wall:], cells[:, :wall], cells[:, -wall:] = 100, 100, 100, 100
    return OccupancyGrid(cells, 0.01)


def field_round(pose: Pose2) -> DistanceField:
    return fine_field(square(), pose, 4.0)


def parked(body: ChairBody, gap: float, place: str) -> Pose2:
    """The wall on the right; in a nook one ahead, too, or behind."""
    y = WALL + gap + body.width / 2
    if place == "beside":
        return Pose2(2.5, y, 0.0)
    if place == "nose in":
        return Pose2(SIDE - WALL - gap - body.front, y, 0.0)
    return Pose2(WALL + gap + body.rear, y, 0.0)


def gaps(body: ChairBody, poses: FloatArray) -> FloatArray:
    """(N,) least distance [m] of the four corners to the four walls, negative in one."""
    points = np.array([transform_points(Pose2(*pose), body.outline()) for pose in poses])
    return np.minimum(points - WALL, SIDE - WALL - points).min(axis=(1, 2))


@pytest.mark.parametrize("place", ["beside", "nose in", "tail in"])
@pytest.mark.parametrize("body", [CHAIR_B, CHAIR_A_MID, CHAIR_A_FRONT], ids=lambda body: body.chair_id)
def test_a_chair_two_centimetres_from_a_wall_leaves_it_and_swings_no_end_into_it(body: ChairBody, place: str) -> None:
    start = parked(body, 0.02, place)
    poses = finished(leading_out_path(field_round(start), body, start))
    assert poses is not None
    assert poses[0] == pytest.approx(start.array())
    assert gaps(body, poses).min() > 0.008
    assert gaps(body, poses[-1:])[0] > 0.06
    steps = np.diff(poses, axis=0)
    middle = poses[:-1, 2] + steps[:, 2] / 2
    assert np.abs(np.cos(middle) * steps[:, 1] - np.sin(middle) * steps[:, 0]).max() < 1e-9, "it never moves sideways"
    assert np.hypot(*steps[:, :2].T) == pytest.approx(0.05)
    assert np.abs(steps[:, 2]).max() < 0.05


def test_the_end_that_swings_out_comes_nearer_by_no_more_than_a_third() -> None:
    start = parked(CHAIR_B, 0.028, "beside")
    poses = finished(leading_out_path(field_round(start), CHAIR_B, start))
    assert poses is not None
    assert 0.028 * 2 / 3 - 0.01 < gaps(CHAIR_B, poses).min() < 0.028, "every turn starts small"


def test_a_chair_with_room_or_in_contact_or_enclosed_gets_no_such_path() -> None:
    for gap in (0.1, -0.01):
        start = parked(CHAIR_B, gap, "beside")
        assert finished(leading_out_path(field_round(start), CHAIR_B, start)) is None
    box = np.full((200, 200), 100, np.int8)
    body = CHAIR_B
    box[20 : 20 + math.ceil(body.width / 0.01) + 5, 20 : 20 + math.ceil(body.length / 0.01) + 5] = 0
    grid, start = OccupancyGrid(box, 0.01), Pose2(0.225 + body.rear, 0.225 + body.width / 2, 0.0)
    field = fine_field(grid, start, 2.0)
    assert reason_for_cramped(field, body, start) is not None
    assert finished(leading_out_path(field, body, start)) is None


def test_the_plan_of_a_parked_chair_leads_out_before_a_turn() -> None:
    start = parked(CHAIR_B, 0.02, "beside")
    planner = GlobalPlanner(Pose2(2.5, 3.5, math.pi))
    planner.replan(costmap_from_grid(square(), CHAIR_B), start)
    first = planner.legs[0]
    assert first.is_line
    for leg in planner.legs:
        assert gaps(CHAIR_B, leg.path.poses).min() > 0.008
    assert gaps(CHAIR_B, first.path.poses[-1:])[0] > 0.03


@pytest.mark.parametrize(("x", "y", "theta", "side"), [
    (2.5, WALL + 0.36, 0.0, "on its right"),
    (2.5, WALL + 0.36, math.pi, "on its left"),
    (2.5, WALL + CHAIR_B.front + 0.01, -math.pi / 2, "ahead"),
    (2.5, WALL + CHAIR_B.rear + 0.01, math.pi / 2, "behind"),
    (2.5, 2.5, 1.0, None),
])  # fmt: skip
def test_the_rider_is_told_the_side_without_room(x: float, y: float, theta: float, side: str | None) -> None:
    pose = Pose2(x, y, theta)
    why = None if side is None else f"an obstacle {side} leaves the chair no room to turn"
    assert reason_for_cramped(field_round(pose), CHAIR_B, pose) == why
