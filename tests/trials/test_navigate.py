"""People for a drive on a saved map."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from waychair.errors import WorldError
from waychair.simulation.world import world_from_grid
from waychair.trials.navigate import with_walkers
from waychair.types import OccupancyGrid, Pose2


def hall(side: int) -> OccupancyGrid:
    cells = np.zeros((side, side), np.int8)
    cells[[0, -1]], cells[:, [0, -1]] = 100, 100
    return OccupancyGrid(cells, 0.05)


def test_walkers_stand_on_free_ground_apart_from_each_other_and_off_the_start() -> None:
    world = with_walkers(world_from_grid(hall(160), Pose2(4.0, 4.0)), 10, 3)
    points = [person.path[0] for person in world.people]
    assert len(points) == 10
    assert min(math.dist(a, b) for a, b in itertools.combinations(points, 2)) > 0.5
    assert min(math.dist(point, (4.0, 4.0)) for point in points) > 1.5
    assert all(0.3 < value < 7.7 for point in points for value in point)


def test_more_people_than_there_is_room_for_are_refused_with_advice() -> None:
    with pytest.raises(WorldError, match="take fewer"):
        with_walkers(world_from_grid(hall(60), Pose2(1.5, 1.5)), 50, 0)
