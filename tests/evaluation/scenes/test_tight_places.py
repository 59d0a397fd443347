"""Doors, the corner and the dead end: a small sample of `evaluation.figures.driving.scenes`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from evaluation.scenes.tight_places import (
    CORRIDOR,
    corner_scene,
    door_error,
    door_scene,
    drive_variants,
    map_of,
    parked_scene,
    run_scene,
)

from waychair.calibration.chair_body import CHAIR_A, CHAIR_B
from waychair.errors import NoPath
from waychair.maps.grid.cells import cells_from_points, occupied
from waychair.planning.grid.costmap import costmap_from_grid
from waychair.planning.route.global_planner import plan
from waychair.types import Pose2

B = drive_variants(CHAIR_B)


@pytest.mark.nightly
def test_the_chair_passes_the_tightest_door_from_the_side_without_a_contact() -> None:
    result = run_scene(door_scene(0.80, 90.0, B["rear"], 1), 1)
    assert (result.reached, result.contacts) == (True, 0), result.reason
    assert result.door_error_m is not None
    assert result.door_error_m <= 0.02


@pytest.mark.nightly
def test_a_chair_parked_in_a_corner_leaves_it_without_a_contact() -> None:
    result = run_scene(parked_scene("tail in", B["rear"], 1), 1)
    assert (result.reached, result.contacts) == (True, 0), result.reason
    assert result.min_clearance_m > 0.005


@pytest.mark.nightly
def test_a_chair_without_room_names_the_side_and_stays_in_place() -> None:
    scene = parked_scene("nose in", B["rear"], 0)
    touching = Pose2(4.2 - 0.004 - scene.body.front, 0.2 + 0.02 + scene.body.width / 2, 0.0)
    result = run_scene(replace(scene, world=replace(scene.world, start=touching)), 0)
    assert not result.reached
    assert result.reason == "an obstacle ahead leaves the chair no room to turn; drive it a little away by hand"
    assert result.seconds < 5.0
    assert result.contacts == 0


@pytest.mark.nightly
def test_the_larger_chair_is_refused_since_it_does_not_fit_round_the_corner() -> None:
    scene = corner_scene(B["rear"], 0)
    with pytest.raises(NoPath, match="does not fit"):
        plan(costmap_from_grid(map_of(scene.world), scene.body), scene.world.start, scene.goal.pose)


@pytest.mark.nightly
def test_starts_are_at_their_requested_places_and_depend_on_their_seed_only() -> None:
    for seed in range(20):
        scene = door_scene(0.8, 60.0, B["rear"], seed)
        assert scene.door is not None
        assert 1.5 <= scene.door.x - scene.world.start.x <= 3.0
        assert abs(abs(np.degrees(scene.world.start.theta)) - 60.0) <= 5.0
        assert scene.world.start == door_scene(0.8, 60.0, B["rear"], seed).world.start


def test_the_corridor_has_its_stated_width_to_a_cell_and_a_sharp_corner() -> None:
    grid = corner_scene(CHAIR_A, 0).world.grid
    points = np.column_stack([np.full(1000, 2.0), np.linspace(0.0, 2.0, 1000)])
    free = ~occupied(grid)[tuple(cells_from_points(grid, points).T)]
    inside = points[free & (points[:, 1] > 0.19) & (points[:, 1] < 1.2), 1]
    assert np.ptp(inside) == pytest.approx(CORRIDOR, abs=0.011)
    assert not occupied(grid)[tuple(cells_from_points(grid, np.array([[3.15, 1.10]]))[0])]


def test_the_door_error_is_measured_at_the_middle_line_in_the_wall() -> None:
    door = Pose2(4.0, 2.0, 0.0)
    truth = np.array([[2.0, 2.5, 0.0], [3.5, 2.01, 0.0], [4.0, 2.0, 0.02], [6.0, 2.5, 0.0]])
    assert door_error(truth, CHAIR_A, door) == pytest.approx(0.01, abs=1e-9)
    assert door_error(truth[:1], CHAIR_A, door) is None
