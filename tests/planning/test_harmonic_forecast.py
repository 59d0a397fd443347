"""People who cross: where they will be bends the way a little, and what is shorter than going round is waited for."""

from __future__ import annotations

import math

import numpy as np
import pytest

from waychair.calibration.chair import CHAIR_A
from waychair.planning.costmap import costmap_from_grid
from waychair.planning.forecast import ForecastSettings, passing_time, predicted_occupancy, waits, with_forecast
from waychair.planning.global_planner import PlannerSettings, plan
from waychair.planning.tracks import Track
from waychair.types import OccupancyGrid, Pose2

GRID = OccupancyGrid(np.zeros((120, 160), np.int8), 0.05, Pose2(-1.0, -1.0, 0.0))


def walker(x: float, y: float, vx: float, vy: float, sigma: float = 0.05) -> Track:
    covariance = np.diag([0.01, 0.01, sigma**2, sigma**2])
    return Track(1, 0, 0, 9, np.array([x, y]), np.array([vx, vy]), covariance, 0.3, 0)


def test_somebody_who_stands_takes_up_all_of_the_window_where_they_stand_and_nothing_elsewhere() -> None:
    share = predicted_occupancy([walker(2.0, 1.0, 0.0, 0.0, 0.0)], GRID, 0.4)
    x, y = np.meshgrid(-1.0 + 0.05 * (np.arange(160) + 0.5), -1.0 + 0.05 * (np.arange(120) + 0.5))
    away = np.hypot(x - 2.0, y - 1.0)
    np.testing.assert_allclose(share[away < 0.38], 1.0, atol=1e-5)
    assert (share[away > 0.42] == 0.0).all()


def test_somebody_who_walks_takes_up_each_place_for_a_part_of_the_window() -> None:
    share = predicted_occupancy([walker(0.0, 1.0, 1.0, 0.0)], GRID, 0.4)
    assert 0.0 < share.max() < 0.3
    assert share[40, 100] > 0.0  # four seconds ahead on their way
    assert share[40, 18] < share[40, 40]  # they come from there, and are going on
    assert predicted_occupancy([], GRID, 0.4).max() == 0.0


def test_a_walker_outside_the_map_changes_nothing() -> None:
    assert predicted_occupancy([walker(50.0, 50.0, 0.0, 0.0)], GRID, 0.4).max() == 0.0


@pytest.mark.parametrize("planner", ["harmonic", "dstar-lite"])
def test_the_forecast_makes_cells_dearer_but_bars_none(planner: str) -> None:
    costmap = costmap_from_grid(GRID, CHAIR_A)
    crossing = walker(2.5, 1.2, 0.0, 0.4)
    share = predicted_occupancy([crossing], GRID, CHAIR_A.width / 2 + 0.3)
    expected = with_forecast(costmap, share)
    assert ((expected.prices > 0) == (costmap.prices > 0)).all()
    assert (expected.prices[share > 0] > costmap.prices[share > 0]).all()
    plain = plan(costmap, Pose2(0.5, 2.0, 0.0), Pose2(5.0, 2.0, 0.0), PlannerSettings(planner=planner))
    bent = plan(expected, Pose2(0.5, 2.0, 0.0), Pose2(5.0, 2.0, 0.0), PlannerSettings(planner=planner))
    assert bent.length() < 1.5 * plain.length()


def test_what_is_shorter_than_going_round_is_waited_for() -> None:
    straight = np.column_stack([np.linspace(0.0, 5.0, 51), np.full(51, 1.0)])
    settings = ForecastSettings()
    wait = passing_time([walker(2.5, 0.4, 0.0, 0.8)], straight, 0.6, settings)
    assert 1.0 < wait < 2.5
    assert waits(5.0, 8.0, wait, 0.8)
    assert not waits(5.0, 5.2, wait, 0.8)
    assert passing_time([walker(2.5, 1.0, 0.0, 0.0)], straight, 0.6, settings) == math.inf
    assert not waits(5.0, 8.0, math.inf, 0.8)
    assert waits(5.0, math.inf, math.inf, 0.8)
    assert passing_time([walker(2.5, 4.0, 0.0, 0.5)], straight, 0.6, settings) == 0.0
