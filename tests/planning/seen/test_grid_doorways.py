"""Doorways of a map's grid are found at their place, with their width to a cell; closed ones and corridors are none."""

from __future__ import annotations

import math

import numpy as np
import pytest

from waychair.planning.seen.doorways import DoorState
from waychair.planning.seen.grid_doorways import doorways_in_grid
from waychair.types import Cells, OccupancyGrid, Pose2

CELL = 0.05


def _two_rooms(opening: float) -> Cells:
    """Return cells of two rooms of 4 by 5 m with a wall of 15 cm and an opening in its middle."""
    cells = np.zeros((104, 167), np.int8)
    cells[:2], cells[-2:], cells[:, :2], cells[:, -2:] = 100, 100, 100, 100
    cells[:, 82:85] = 100
    half = round(opening / 2 / CELL)
    cells[52 - half : 52 + half, 82:85] = 0
    return cells


@pytest.mark.parametrize("turn", [0.0, 0.4])
def test_an_opening_between_two_rooms_is_one_doorway_with_its_width_to_a_cell(turn: float) -> None:
    map_from_grid = Pose2(1.0, -2.0, turn)
    (door,) = doorways_in_grid(OccupancyGrid(_two_rooms(0.9), CELL, map_from_grid))
    truth = map_from_grid @ Pose2(83.5 * CELL, 52 * CELL, 0.0)
    assert math.hypot(door.pose.x - truth.x, door.pose.y - truth.y) < 0.1
    assert abs(math.remainder(door.pose.theta - truth.theta, math.pi)) < math.radians(2.0)
    assert abs(door.width - 0.9) <= door.error
    assert door.state is DoorState.UNKNOWN
    assert not door.wide_enough(0.5)


def test_a_wall_without_an_opening_has_no_doorway() -> None:
    assert doorways_in_grid(OccupancyGrid(_two_rooms(0.0), CELL, Pose2())) == ()
