"""Tight bends of a rubber band are followed exactly: a chair that cuts such a bend gets stuck."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from waychair.calibration.chair_body import CHAIR_A
from waychair.planning.grid.costmap import costmap_from_grid
from waychair.planning.route.global_planner import GlobalPlanner, PlannerSettings
from waychair.planning.route.legs import DrivingManner, PathLeg
from waychair.types import OccupancyGrid, Pose2

CELL = 0.05


def corner(wide: float) -> OccupancyGrid:
    """A corridor [m] along the lower and the right side of a square of 12 m."""
    cells = np.zeros((240, 240), np.int8)
    cells[[0, -1]], cells[:, [0, -1]] = 100, 100
    cells[round(wide / CELL) :, : 240 - round(wide / CELL)] = 100
    return OccupancyGrid(cells, CELL)


def legs_round(wide: float, smooth: str) -> tuple[PathLeg, ...]:
    planner = GlobalPlanner(Pose2(12.0 - wide / 2, 10.5, np.pi / 2), PlannerSettings(planner="harmonic", smooth=smooth))
    planner.replan(costmap_from_grid(corner(wide), CHAIR_A), Pose2(1.5, wide / 2, 0.0))
    return planner.legs


def test_a_bend_of_a_corridor_is_followed_exactly_and_straight_parts_are_free() -> None:
    legs = legs_round(2.0, "band")
    free, exact = (
        [leg for leg in legs if leg.manner is manner] for manner in (DrivingManner.FREE, DrivingManner.EXACT)
    )
    assert [leg.manner for leg in legs] == [
        DrivingManner.FREE,
        DrivingManner.EXACT,
        DrivingManner.FREE,
        DrivingManner.EXACT,
    ]
    turns = [np.ptp(np.unwrap(leg.path.poses[:-1, 2])) for leg in legs]
    assert turns[1] > 1.2
    assert max(turns[0], turns[2], turns[3]) < 0.3
    assert all(leg.flows for leg in free)
    assert sum(leg.path.length() for leg in free) > 2 * sum(leg.path.length() for leg in exact[:1])
    for leg, following in pairwise(legs):
        np.testing.assert_array_equal(leg.path.poses[-1], following.path.poses[0])


@pytest.mark.parametrize(("wide", "smooth"), [(5.0, "band"), (2.0, "taut")])
def test_with_room_or_without_a_band_only_the_end_is_exact(wide: float, smooth: str) -> None:
    legs = legs_round(wide, smooth)
    assert [leg.manner for leg in legs] == [DrivingManner.FREE, DrivingManner.EXACT]
    assert legs[1].path.length() < 1.5


def test_a_bend_beside_the_end_is_one_exact_leg_with_it() -> None:
    planner = GlobalPlanner(Pose2(11.0, 3.2, np.pi / 2), PlannerSettings(planner="harmonic"))
    planner.replan(costmap_from_grid(corner(2.0), CHAIR_A), Pose2(1.5, 1.0, 0.0))
    assert [leg.manner for leg in planner.legs] == [DrivingManner.FREE, DrivingManner.EXACT]
    assert planner.legs[1].path.length() > 2.0
