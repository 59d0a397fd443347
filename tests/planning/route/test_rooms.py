"""How the room beside a line is found in slices of time."""

from __future__ import annotations

import math

import numpy as np
import pytest

from waychair.calibration.chair_body import CHAIR_A
from waychair.planning.body.footprint import disc_tree
from waychair.planning.grid.costmap import LiveCostmap
from waychair.planning.route.rooms import can_turn, prepare_outlines, rooms_beside, turn_to
from waychair.resumable import finished
from waychair.types import FloatArray, OccupancyGrid, Pose2


def _corridor(cell: float) -> tuple[OccupancyGrid, FloatArray]:
    """Return a corridor 0.9 m wide and 4 m long with cells of a side [m], and poses in its middle."""
    cells = np.zeros((round(0.9 / cell) + 2, round(4.0 / cell)), np.int8)
    cells[[0, -1]] = 100
    along = np.arange(1.0, 3.0, 0.05)
    return OccupancyGrid(cells, cell), np.column_stack([along, np.full_like(along, 0.45 + cell), np.zeros_like(along)])


def test_a_stretch_counts_as_more_work_on_a_finer_map() -> None:
    grid, poses = _corridor(0.005)
    coarse, coarse_poses = _corridor(0.05)
    fine_work = list(rooms_beside(LiveCostmap(grid, CHAIR_A).costmap(), poses))
    coarse_work = list(rooms_beside(LiveCostmap(coarse, CHAIR_A).costmap(), coarse_poses))
    assert fine_work[0] > 4 * coarse_work[0]


def test_the_rooms_along_a_line_take_no_outline_that_was_not_prepared() -> None:
    grid, poses = _corridor(0.005)
    costmap = LiveCostmap(grid, CHAIR_A).costmap()
    disc_tree.cache_clear()
    prepare_outlines(CHAIR_A, grid)
    prepared = disc_tree.cache_info().misses
    rooms = finished(rooms_beside(costmap, poses))
    assert rooms.min() > 0.0
    assert disc_tree.cache_info().misses == prepared


@pytest.mark.parametrize("post", [False, True])
def test_where_the_shorter_turn_is_barred_the_longer_one_counts(post: bool) -> None:
    cells = np.zeros((80, 80), np.int8)
    if post:
        cells[49:51, 49:51] = 100  # half a metre ahead and to the left of a chair in the middle that looks along x
    costmap, middle = LiveCostmap(OccupancyGrid(cells, 0.05), CHAIR_A).costmap(), Pose2(2.0, 2.0, 0.0)
    turn = turn_to(costmap, middle, math.pi / 2, 0.03)
    assert turn == pytest.approx(math.pi / 2 - math.tau if post else math.pi / 2)
    assert can_turn(costmap, middle, math.pi / 2, 0.03)
