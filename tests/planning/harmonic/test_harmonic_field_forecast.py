"""People who cross: their prediction bends the path a little, and the chair waits where waiting is faster than a
detour."""

from __future__ import annotations

import math

import numpy as np
import pytest

from waychair.calibration.chair_body import CHAIR_A
from waychair.planning.grid.costmap import costmap_from_grid
from waychair.planning.route.global_planner import GlobalPlanner, PlannerSettings, plan
from waychair.planning.route.keep_right import KeepRightSettings
from waychair.planning.seen.forecast import (
    ExpectedPeople,
    ForecastSettings,
    arrival,
    meets_soon,
    predicted_occupancy,
    with_forecast,
)
from waychair.planning.seen.person_tracks import Track, transformed_tracks
from waychair.resumable import finished
from waychair.types import OccupancyGrid, Pose2

GRID = OccupancyGrid(np.zeros((120, 160), np.int8), 0.05, Pose2(-1.0, -1.0, 0.0))


def walker(x: float, y: float, vx: float, vy: float, sigma: float = 0.05) -> Track:
    covariance = np.diag([0.01, 0.01, sigma**2, sigma**2])
    return Track(1, 0, 0, 9, np.array([x, y]), np.array([vx, vy]), covariance, 0.3, 0)


def among(*walkers: Track, radius: float = 0.4) -> ExpectedPeople:
    return ExpectedPeople(walkers, radius)


def two_ways(longer: float) -> OccupancyGrid:
    """Return a corridor of 2 m, 10 m long, and one beside it that is longer by its bends by this length [m], with walls
    all round."""
    cells = np.full((round((6.0 + longer) / 0.05), 200), 100, np.int8)
    cells[2:42, 2:-2] = 0
    far = round((2.5 + longer / 2) / 0.05)
    cells[far : far + 40, 2:-2] = 0
    cells[2 : far + 40, 2:42] = 0
    cells[2 : far + 40, -42:-2] = 0
    return OccupancyGrid(cells, 0.05)


def test_a_standing_person_occupies_one_place_for_the_whole_window() -> None:
    share = predicted_occupancy(among(walker(2.0, 1.0, 0.0, 0.0, 0.0)), GRID)
    x, y = np.meshgrid(-1.0 + 0.05 * (np.arange(160) + 0.5), -1.0 + 0.05 * (np.arange(120) + 0.5))
    away = np.hypot(x - 2.0, y - 1.0)
    np.testing.assert_allclose(share[away < 0.38], 1.0, atol=1e-5)
    assert (share[away > 0.42] == 0.0).all()


def test_a_walking_person_occupies_each_place_for_a_part_of_the_window() -> None:
    share = predicted_occupancy(among(walker(0.0, 1.0, 1.0, 0.0)), GRID)
    assert 0.0 < share.max() < 0.3
    assert share[40, 100] > 0.0  # four seconds ahead on the walker's way
    assert share[40, 18] < share[40, 40]  # the walker comes from there and walks on
    assert predicted_occupancy(among(), GRID).max() == 0.0


def test_a_walker_outside_the_map_changes_nothing() -> None:
    assert predicted_occupancy(among(walker(50.0, 50.0, 0.0, 0.0)), GRID).max() == 0.0


@pytest.mark.parametrize("planner", ["harmonic", "dstar-lite"])
def test_the_forecast_makes_cells_more_expensive_but_closes_none(planner: str) -> None:
    costmap = costmap_from_grid(GRID, CHAIR_A)
    crossing = walker(2.5, 1.2, 0.0, 0.4)
    share = predicted_occupancy(among(crossing, radius=CHAIR_A.width / 2 + 0.3), GRID)
    expected = with_forecast(costmap, share)
    assert ((expected.prices > 0) == (costmap.prices > 0)).all()
    assert (expected.prices[share > 0] > costmap.prices[share > 0]).all()
    plain = plan(costmap, Pose2(0.5, 2.0, 0.0), Pose2(5.0, 2.0, 0.0), PlannerSettings(planner=planner))
    bent = plan(expected, Pose2(0.5, 2.0, 0.0), Pose2(5.0, 2.0, 0.0), PlannerSettings(planner=planner))
    assert bent.length() < 1.5 * plain.length()


LINE = np.column_stack([np.linspace(0.0, 5.0, 51), np.full(51, 1.0)])


def test_a_person_who_has_passed_before_the_chair_comes_costs_no_waiting() -> None:
    assert arrival(among(walker(4.5, 0.0, 0.0, 0.8)), LINE, 0.8) == (pytest.approx(6.25), 0.0)
    assert arrival(among(walker(2.5, 4.0, 0.0, 0.5)), LINE, 0.8) == (pytest.approx(6.25), 0.0)
    assert arrival(among(), LINE, 0.8) == (pytest.approx(6.25), 0.0)


def test_somebody_is_met_soon_only_within_the_window() -> None:
    window = ForecastSettings(window=4.0)  # 3.2 m of way
    assert meets_soon(among(walker(4.5, 1.0, -0.8, 0.0)), LINE, 0.8, window)
    assert meets_soon(among(walker(3.0, 1.0, 0.0, 0.0)), LINE, 0.8, window)
    assert not meets_soon(among(walker(4.5, 1.0, 0.0, 0.0)), LINE, 0.8, window)
    assert not meets_soon(among(walker(2.0, 1.0, 0.8, 0.0)), LINE, 0.8, window)
    assert not meets_soon(among(), LINE, 0.8, window)


def test_the_chair_waits_for_a_crossing_person_only_until_the_way_is_free() -> None:
    done, wait = arrival(among(walker(2.5, -1.0, 0.0, 0.7)), LINE, 0.8)
    assert (
        0.2 <= wait <= 1.6
    )  # the person is within 0.4 m of the line from 2.3 s to 3.5 s, the chair is there at 2.6 to 3.6 s
    assert done == pytest.approx(6.25 + wait)


def test_the_chair_waits_for_a_person_who_stands_in_the_way_unless_the_window_is_zero() -> None:
    stays = among(walker(2.5, 1.0, 0.0, 0.0))
    assert arrival(stays, LINE, 0.8) == (pytest.approx(16.25), 10.0)
    assert arrival(stays, LINE, 0.8, ForecastSettings(window=0.0)) == (pytest.approx(6.25), 0.0)


START, GOAL = Pose2(1.0, 1.1, 0.0), Pose2(9.0, 1.1, 0.0)


def planned(planner: str, people: ExpectedPeople, longer: float) -> tuple[float, float, float]:
    """Return lengths [m] of the direct path, of that among people, and of that by their forecast alone."""
    costmap = costmap_from_grid(two_ways(longer), CHAIR_A)
    in_the_middle = KeepRightSettings(aside=0.0)  # so that the same way has the same length
    search = GlobalPlanner(GOAL, PlannerSettings(planner=planner, keep_right=in_the_middle))
    direct = search.replan(costmap, START)
    chosen = finished(search.replan_among_people(costmap, lambda: START, people, 0.8))
    expected = with_forecast(costmap, predicted_occupancy(people, costmap.grid))
    forced = finished(search.replan_resumably(expected, lambda: START, among_people=True))  # no band, as the chosen one
    return direct.length(), chosen.length(), forced.length()


@pytest.mark.parametrize("planner", ["harmonic", "dstar-lite"])
def test_a_person_who_crosses_far_ahead_does_not_change_the_route(planner: str) -> None:
    """People come out of the other side of the wall, as in the source paper, and are gone when the chair arrives."""
    for x in (4.0, 5.5, 7.0):
        direct, chosen, _ = planned(planner, among(walker(x, 2.0, 0.0, -0.9), radius=0.7), 1.0)
        assert chosen == pytest.approx(direct, abs=1e-9)


@pytest.mark.parametrize("planner", ["harmonic", "dstar-lite"])
def test_a_detour_is_taken_only_when_it_is_faster_than_waiting(planner: str) -> None:
    crowd = among(*(walker(3.6 + 0.4 * k, 1.1, 0.02, 0.0) for k in range(8)), radius=0.7)
    direct, chosen, forced = planned(planner, crowd, 0.2)
    assert forced > direct + 2.0
    assert chosen == pytest.approx(forced, rel=1e-9)
    passing = among(walker(3.4, -0.2, 0.0, 0.6), radius=0.7)
    direct, chosen, _ = planned(planner, passing, 0.2)
    assert chosen == pytest.approx(direct, abs=1e-9)


def test_the_legs_of_the_plan_make_up_the_chosen_path() -> None:
    costmap = costmap_from_grid(two_ways(0.2), CHAIR_A)
    search = GlobalPlanner(GOAL)
    path = finished(
        search.replan_among_people(costmap, lambda: START, among(walker(3.4, -0.2, 0.0, 0.6), radius=0.7), 0.8)
    )
    np.testing.assert_allclose(search.legs[-1].path.poses[-1], path.poses[-1])
    assert sum(leg.path.length() for leg in search.legs) == pytest.approx(path.length())


def test_tracks_in_another_frame_give_the_same_forecast() -> None:
    track = walker(2.0, 1.0, 0.5, 0.0)
    map_from_odom = Pose2(1.0, -2.0, math.pi / 2)
    (seen,) = transformed_tracks(map_from_odom, [track])
    np.testing.assert_allclose(seen.position, [0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(seen.velocity, [0.0, 0.5], atol=1e-12)
    (back,) = transformed_tracks(map_from_odom.inverse(), [seen])
    np.testing.assert_allclose(back.row(1.5), track.row(1.5), atol=1e-12)
    np.testing.assert_allclose(back.covariance, track.covariance, atol=1e-12)
