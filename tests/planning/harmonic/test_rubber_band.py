"""The rubber band: no sharp turns, no longer path, and never less than the permitted clearance."""

from __future__ import annotations

import math
from itertools import pairwise
from unittest.mock import patch

import numpy as np
import pytest
from evaluation.speed.harmonic import CELL, SCENES, BandScene, bands, costmap_of, rectangle_fits
from hypothesis import given, settings
from hypothesis import strategies as st

from waychair.calibration.chair_body import CHAIR_A
from waychair.errors import NoPath, PlanningError
from waychair.maps.drawn.zones import Rule, Zone
from waychair.planning.grid.costmap import Costmap, costmap_from_grid
from waychair.planning.grid.resumable import finished
from waychair.planning.grid.smoothing import line_cost
from waychair.planning.harmonic import rubber_band
from waychair.planning.harmonic.harmonic_field import log_field
from waychair.planning.harmonic.laplace_solvers import laplace_problem
from waychair.planning.harmonic.rubber_band import (
    _sharpest_about,
    band,
    log_between,
    polyline_length,
    resampled,
    turning_angles,
)
from waychair.planning.route.global_planner import PlannerSettings, plan
from waychair.planning.route.grid_planner import plan_on_cells
from waychair.types import FloatArray, OccupancyGrid, Pose2


def sharpest(points: FloatArray) -> float:
    """Sharpest turn [deg] at every 0.10 m."""
    return math.degrees(turning_angles(resampled(points, 0.10 / CELL)).max())


@pytest.mark.parametrize("scene", SCENES, ids=lambda scene: scene.name)
def test_after_the_band_no_turn_is_sharp_no_path_longer_and_the_chair_fits(scene: BandScene) -> None:
    lines = bands(scene)
    assert sharpest(lines.descent) > 35
    assert sharpest(lines.ours) <= 15
    assert polyline_length(lines.ours) <= polyline_length(lines.descent)
    assert rectangle_fits(lines.costmap, lines.ours)
    np.testing.assert_allclose(lines.ours[[0, -1]], lines.descent[[0, -1]])


@pytest.mark.parametrize("scene", SCENES, ids=lambda scene: scene.name)
def test_the_papers_band_softens_the_turns_and_shortens_the_path(scene: BandScene) -> None:
    lines = bands(scene)
    assert sharpest(lines.paper) < 0.6 * sharpest(lines.descent)
    assert polyline_length(lines.paper) <= polyline_length(lines.descent)
    rows, columns = np.floor(lines.paper[:, ::-1]).astype(int).T
    assert np.isfinite(lines.found.logs[rows, columns]).all()


@given(st.integers(0, 1000))
@settings(max_examples=15)
def test_on_paths_of_d_star_lite_the_band_crosses_no_obstacle_and_is_never_longer(seed: int) -> None:
    rng = np.random.default_rng(seed)
    cells = np.zeros((100, 120), np.int8)
    for row, column in rng.integers(15, 100, (5, 2)):
        cells[row : row + 6, column : column + 6] = 100
    costmap = costmap_from_grid(OccupancyGrid(cells, CELL), CHAIR_A)
    try:
        chain = plan_on_cells(costmap.prices, (8, 8), (90, 110)).cells[:, ::-1] + 0.5
    except PlanningError:
        return
    with patch.object(rubber_band, "PASSES", 100):
        line = finished(band(costmap, chain))
    assert polyline_length(line) <= polyline_length(chain) + 1e-9
    fine = resampled(line, 0.2)
    rows, columns = np.floor(fine[:, ::-1]).astype(int).T
    assert (costmap.prices[rows, columns] > 0).all()


def test_a_band_in_many_parts_equals_one_in_few_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rubber_band, "PASSES", 82)
    costmap = costmap_of(SCENES[0])
    points = bands(SCENES[0]).descent
    length = len(resampled(points, rubber_band.SPACING / CELL))
    whole = finished(band(costmap, points))
    monkeypatch.setattr(rubber_band, "_PART", 3 * length)
    work = band(costmap, points)
    parts: list[int] = []
    while True:
        try:
            parts.append(next(work))
        except StopIteration as done:
            np.testing.assert_array_equal(done.value, whole)
            break
    assert len(parts) >= 4 * (20 // 4)
    assert max(parts) <= 300 * 4 * length


def test_a_path_in_contact_is_not_moved_nearer() -> None:
    costmap = costmap_of(SCENES[0])
    along = np.column_stack([np.full(40, 38.2), np.linspace(20.0, 58.0, 40)])  # beside the box, half a chair away
    along[1:-1:2, 0] -= 0.8
    line = finished(band(costmap, along))
    assert (line[:, 0] <= 38.2 + 1e-9).all()


def test_lines_of_one_or_two_points_are_returned_unchanged() -> None:
    costmap = costmap_of(SCENES[0])
    short = np.array([[20.0, 20.0], [21.0, 20.0]])
    np.testing.assert_allclose(finished(band(costmap, short)), short)


def test_turns_about_a_point_equal_those_of_the_polyline() -> None:
    line = np.random.default_rng(0).normal(size=(9, 2)).cumsum(axis=0)
    turns = turning_angles(line)
    for k in range(1, 8):
        near = [turns[m - 1] for m in (k - 1, k, k + 1) if 1 <= m <= 7]
        assert _sharpest_about(line, k) == pytest.approx(max(near))


def test_the_logarithm_between_cell_centres_is_that_of_the_interpolated_field() -> None:
    found = log_field(laplace_problem(np.ones((9, 9), np.bool_), (4, 6)))
    v = np.exp(found.logs)
    x, y = 2.9, 3.7
    a, b = x - 2.5, y - 3.5
    expected = (1 - b) * ((1 - a) * v[3, 2] + a * v[3, 3]) + b * ((1 - a) * v[4, 2] + a * v[4, 3])
    assert log_between(found.logs, x, y) == pytest.approx(math.log(expected))
    assert log_between(found.logs, -0.1, 3.0) == -math.inf


def test_the_path_of_d_star_lite_is_smoothed_by_the_band_on_request() -> None:
    costmap = costmap_of(SCENES[1])
    start, goal = Pose2(1.0, 1.0, 1.2), Pose2(7.0, 5.0, 1.2)
    plain = plan(costmap, start, goal)
    soft = plan(costmap, start, goal, PlannerSettings(smooth="band"))
    assert soft.length() <= plain.length() + 0.02
    assert sharpest(soft.poses[:, :2] / CELL) <= max(15.0, sharpest(plain.poses[:, :2] / CELL))


def house(door: float) -> OccupancyGrid:
    """Two rooms of 4 x 6 m with a door [m] in the middle of the wall between."""
    cells = np.zeros((120, 162), np.int8)
    cells[[0, -1]], cells[:, [0, -1]], cells[:, 80:82] = 100, 100, 100
    half = round(door / CELL / 2)
    cells[60 - half : 60 + half, 80:82] = 0
    return OccupancyGrid(cells, CELL)


@pytest.mark.parametrize("door", [0.9, 1.2])
def test_the_whole_path_through_a_door_is_smooth_and_no_longer_and_fits(door: float) -> None:
    """Through the narrow one the chair goes on the door's axis: the band swings into it, and out of it."""
    costmap = costmap_from_grid(house(door), CHAIR_A)
    start, goal = Pose2(1.0, 1.0, 0.8), Pose2(7.0, 5.0, 0.5)
    soft = plan(costmap, start, goal, PlannerSettings(planner="harmonic"))
    stiff = plan(costmap, start, goal, PlannerSettings(planner="harmonic", smooth="none"))
    assert sharpest(stiff.poses[:, :2] / CELL) > 25
    assert sharpest(soft.poses[:, :2] / CELL) <= 15
    assert soft.length() <= stiff.length()
    assert rectangle_fits(costmap, soft.poses[1:-1, :2] / CELL)


def test_a_chair_that_comes_from_beside_a_narrow_door_turns_on_the_spot_before_it() -> None:
    costmap = costmap_from_grid(house(0.9), CHAIR_A)
    path = plan(costmap, Pose2(3.2, 0.8, 1.5), Pose2(5.4, 4.6, 1.0), PlannerSettings(planner="harmonic"))
    even = resampled(path.poses[:, :2] / CELL, 0.10 / CELL)
    sharp = np.flatnonzero(np.degrees(turning_angles(even)) > 15)
    assert 1 <= len(sharp) <= 3
    assert np.hypot(*(even[sharp + 1] * CELL - [2.5, 3.0]).T).max() < 0.3


def beside_a_zone(seed: int) -> Costmap:
    """A room with the end of a wall to drive round, and a one-way zone near it."""
    rng = np.random.default_rng(seed)
    cells = np.zeros((120, 200), np.int8)
    cells[[0, -1]], cells[:, [0, -1]] = 100, 100
    wall = round(rng.uniform(3.0, 6.0) / CELL)
    cells[: round(rng.uniform(2.0, 3.2) / CELL), wall : wall + 4] = 100
    (x, y), (long, deep) = rng.uniform((2.0, 1.0), (6.0, 4.5)), rng.uniform((0.5, 0.4), (3.0, 1.5))
    corners = np.array([[x, y], [x + long, y], [x + long, y + deep], [x, y + deep]])
    heading = float(rng.choice([0.0, math.pi, math.pi / 2, -math.pi / 2]))
    zone = Zone("ramp", Rule.ONE_WAY, corners, heading)
    return costmap_from_grid(OccupancyGrid(cells, CELL), CHAIR_A, zones=[zone])


@pytest.mark.parametrize("planner", ["dstar-lite", "harmonic"])
@pytest.mark.parametrize("seed", range(20))
def test_a_band_does_not_extend_into_a_one_way_zone_beside_it(planner: str, seed: int) -> None:
    costmap = beside_a_zone(seed)
    settings = PlannerSettings(planner=planner, smooth="band")
    try:
        points = plan(costmap, Pose2(1.2, 1.5, 0.0), Pose2(8.5, 1.5, 0.0), settings).poses[:, :2] / CELL
    except NoPath:
        return
    against = [
        line_cost(costmap.prices, a, b, c, d, costmap.barred) > line_cost(costmap.prices, a, b, c, d, None)
        for (a, b), (c, d) in pairwise(points.tolist())
    ]
    assert sum(against) <= 1, "a path may touch the corner of a cell, and no more"
