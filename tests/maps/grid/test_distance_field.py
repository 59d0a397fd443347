"""Distances to the nearest obstacle, against brute force."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waychair.maps.grid.distance_field import (
    distance_field,
    distances,
    interpolated,
    near_distances,
    update_near,
    window_distances,
)
from waychair.types import BoolArray, FloatArray, OccupancyGrid, Pose2


def brute_force(obstacles: BoolArray, resolution: float) -> FloatArray:
    cells = np.argwhere(obstacles)
    rows, columns = np.indices(obstacles.shape)
    away = np.hypot(rows[..., None] - cells[:, 0], columns[..., None] - cells[:, 1])
    result: FloatArray = away.min(axis=-1) * resolution
    return result


@given(st.integers(0, 2**32 - 1), st.integers(1, 25), st.integers(1, 25), st.floats(0.001, 0.9))
@settings(max_examples=60, deadline=None)
def test_distances_equal_brute_force(seed: int, height: int, width: int, density: float) -> None:
    rng = np.random.default_rng(seed)
    obstacles = rng.random((height, width)) < density
    obstacles[rng.integers(height), rng.integers(width)] = True
    np.testing.assert_allclose(distances(obstacles, 0.05), brute_force(obstacles, 0.05), rtol=1e-5, atol=1e-6)


def test_without_obstacles_the_distance_is_the_diagonal_of_the_grid() -> None:
    np.testing.assert_allclose(distances(np.zeros((30, 40), bool), 0.1), 5.0, rtol=1e-6)


def test_unknown_cells_are_no_obstacles_and_the_geometry_is_kept() -> None:
    cells = np.full((3, 5), -1, np.int8)
    cells[1, 0] = 100
    field = distance_field(OccupancyGrid(cells, 0.5, Pose2(1.0, 2.0, 0.3)))
    np.testing.assert_allclose(field.metres[1], [0.0, 0.5, 1.0, 1.5, 2.0])
    assert (field.resolution, field.map_from_grid) == (0.5, Pose2(1.0, 2.0, 0.3))


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=30, deadline=None)
def test_interpolation_is_at_most_015_cells_above_the_truth(seed: int) -> None:
    rng = np.random.default_rng(seed)
    obstacles = rng.random((12, 12)) < rng.choice([0.02, 0.1, 0.4])
    obstacles[rng.integers(12), rng.integers(12)] = True
    field = distances(obstacles, 1.0)
    centres = np.argwhere(obstacles) + 0.5
    for row, column in rng.uniform(0.5, 11.5, (100, 2)):
        truth = np.hypot(*(centres - (row, column)).T).min()
        assert interpolated(field, column, row) <= truth + 0.15


def test_the_interpolation_error_is_nearly_the_bound_between_four_centres() -> None:
    obstacles = np.zeros((3, 3), bool)
    obstacles[0, 0] = True
    worst = interpolated(distances(obstacles, 1.0), 1.0, 1.0) - math.sqrt(0.5)
    assert worst == pytest.approx(0.146, abs=1e-3)


@pytest.mark.parametrize(("column", "row"), [(-0.01, 1.0), (1.0, -0.01), (4.0, 1.0), (1.0, 3.0), (math.nan, 1.0)])
def test_outside_of_the_grid_nothing_is_free(column: float, row: float) -> None:
    assert interpolated(np.full((3, 4), 9.0, np.float32), column, row) == 0.0


@given(st.integers(0, 2**32 - 1), st.integers(1, 300), st.integers(1, 300), st.floats(0.01, 12.0))
@settings(max_examples=80, deadline=None)
def test_near_distances_are_exact_up_to_their_reach(seed: int, height: int, width: int, reach: float) -> None:
    rng = np.random.default_rng(seed)
    obstacles = rng.random((height, width)) < rng.choice([0.0, 0.0001, 0.01, 0.3])
    obstacles[rng.integers(height), rng.integers(width)] = True
    squares = np.rint(distances(obstacles, 1.0) ** 2)
    whole = np.sqrt(squares) * np.float32(0.05)
    np.testing.assert_array_equal(near_distances(obstacles, 0.05, reach), np.minimum(whole, np.float32(reach)))
    half = 0.05 * max(height, width) / 2
    np.testing.assert_array_equal(window_distances(obstacles, 0.05), np.minimum(whole, np.float32(half)))


@pytest.mark.parametrize("shape", [(0, 0), (0, 5), (5, 0)])
def test_a_window_off_the_map_has_no_cells(shape: tuple[int, int]) -> None:
    assert window_distances(np.zeros(shape, bool), 0.05).shape == shape


@pytest.mark.parametrize("reach", [8.9, 9.0])
def test_the_farthest_near_distances_do_not_overflow(reach: float) -> None:
    obstacles = np.zeros((400, 400), bool)
    obstacles[0, 0] = True
    metres = near_distances(obstacles, 0.05, reach)
    np.testing.assert_allclose(metres, np.minimum(brute_force(obstacles, 0.05), reach), rtol=1e-6)
    assert (near_distances(np.zeros((40, 30), bool), 0.05, reach) == np.float32(reach)).all()


@given(st.integers(0, 2**32 - 1), st.integers(1, 60), st.integers(1, 60), st.floats(0.05, 3.0))
@settings(max_examples=60, deadline=None)
def test_an_update_round_changed_cells_equals_the_transform_of_the_whole(
    seed: int, height: int, width: int, reach: float
) -> None:
    rng = np.random.default_rng(seed)
    obstacles = rng.random((height, width)) < rng.choice([0.0, 0.01, 0.2])
    metres = near_distances(obstacles, 0.1, reach)
    for _ in range(4):
        changed = np.unique(rng.integers(0, (height, width), (int(rng.integers(1, 6)), 2)), axis=0)
        obstacles[tuple(changed.T)] ^= True
        update_near(metres, obstacles, changed, 0.1, reach)
        np.testing.assert_array_equal(metres, near_distances(obstacles, 0.1, reach))


def test_only_cells_within_reach_of_a_change_are_computed_again() -> None:
    obstacles = np.zeros((400, 400), bool)
    metres = near_distances(obstacles, 0.05, 1.0)
    obstacles[[10, 380], [10, 380]] = True
    windows = update_near(metres, obstacles, np.argwhere(obstacles), 0.05, 1.0)
    assert sum(metres[window].size for window in windows) <= 2 * 41**2
    assert metres[200, 200] == 1.0
    assert metres[10, 20] == pytest.approx(0.5)
