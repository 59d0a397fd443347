"""Valid starts and ends of a path, and the errors at others."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

from waychair.calibration.chair_body import CHAIR_A
from waychair.errors import GoalOccupied, StartOccupied, StartOutsideMap
from waychair.planning.grid.costmap import Costmap, costmap_from_grid
from waychair.planning.route.global_planner import check_goal
from waychair.planning.route.path_ends import check_start
from waychair.types import OccupancyGrid, Pose2


def corridor(width: int, height: int = 200) -> Costmap:
    """An upward corridor with this number of cells of 5 cm, between walls."""
    cells = np.full((height, 100), 100, np.int8)
    cells[2:-2, 30 : 30 + width] = 0
    return costmap_from_grid(OccupancyGrid(cells, 0.05), CHAIR_A)


@pytest.mark.parametrize("heading", [0.0, math.pi / 2, 2.0])
@pytest.mark.parametrize("width", [18, 23, 40])
def test_at_an_advised_place_the_chair_fits_with_the_heading_of_the_goal(width: int, heading: float) -> None:
    costmap = corridor(width)
    with pytest.raises(GoalOccupied) as caught:
        check_goal(costmap, CHAIR_A, Pose2(1.4, 5.0, heading))
    advised = re.search(r"nearest place with room is \((.*), (.*)\)", str(caught.value))
    if advised is not None:
        check_goal(costmap, CHAIR_A, Pose2(float(advised[1]), float(advised[2]), heading))
        return
    assert "none was found near with room for its heading" in str(caught.value)
    assert heading != math.pi / 2
    for x in np.arange(1.525, 1.5 + width * 0.05, 0.05):
        with pytest.raises(GoalOccupied):
            check_goal(costmap, CHAIR_A, Pose2(float(x), 5.0, heading))


def test_a_start_with_the_outline_in_a_wall_is_refused_and_one_close_beside_it_is_not() -> None:
    costmap = corridor(40)  # from 1.5 to 3.5 m
    for x in (1.5 + 0.30 + 0.02, 3.5 - 0.30 - 0.02):
        check_start(costmap, CHAIR_A, Pose2(x, 5.0, math.pi / 2))
    for start in (Pose2(1.8 - 0.08, 5.0, math.pi / 2), Pose2(1.65, 5.0, 0.0), Pose2(0.5, 5.0)):
        with pytest.raises(StartOccupied, match="does not fit at its start"):
            check_start(costmap, CHAIR_A, start)
    coarse = costmap_from_grid(OccupancyGrid(np.zeros((9, 9), np.int8), 1.0), CHAIR_A)
    check_start(coarse, CHAIR_A, Pose2(4.5, 4.5))
    with pytest.raises(StartOutsideMap):
        check_start(costmap, CHAIR_A, Pose2(-1.0, 5.0))
