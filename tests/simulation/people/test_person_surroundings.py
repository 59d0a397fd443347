"""Distances from a person to walls and to the chair, against plain geometry."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from waychair.calibration.chair_body import CHAIR_A
from waychair.geometry import transform_points
from waychair.simulation.people.person_surroundings import (
    FAR,
    chair_rectangle,
    nearest_on_chair,
    nearest_wall,
    nearest_walls,
    velocity_at,
    walls_from_grid,
)
from waychair.types import FloatArray, OccupancyGrid, Pose2, Twist

RESOLUTION = 0.1
ORIGINS = st.sampled_from([Pose2(), Pose2(-2.0, 1.0, 0.0), Pose2(3.0, -1.0, 0.7)])


def _grid(cells: list[tuple[int, int]], origin: Pose2) -> OccupancyGrid:
    values = np.zeros((24, 30), np.int8)
    for row, col in cells:
        values[row, col] = 100
    return OccupancyGrid(values, RESOLUTION, origin)


def _vectors(cells: list[tuple[int, int]], point: FloatArray) -> FloatArray:
    """From the nearest point of every solid cell, and of every cell round the grid, to a point of the grid's frame."""
    ring = [(row, col) for row in range(-1, 25) for col in range(-1, 31) if row in (-1, 24) or col in (-1, 30)]
    low = np.array([(col, row) for row, col in cells + ring]) * RESOLUTION
    vectors: FloatArray = point - np.clip(point, low, low + RESOLUTION)
    return vectors


CELLS = st.lists(st.tuples(st.integers(0, 23), st.integers(0, 29)), max_size=8)


@given(CELLS, st.floats(0.05, 2.95), st.floats(0.05, 2.35), st.floats(0.1, 1.2), ORIGINS)
def test_nearest_walls_of_the_four_quarters_equal_a_search_through_all_cells(
    cells: list[tuple[int, int]], x: float, y: float, reach: float, origin: Pose2
) -> None:
    vectors = _vectors(cells, np.array([x, y]))
    # On the border between two quarters, and just at `reach`, either answer is right.
    assume((np.abs(np.abs(vectors[:, 0]) - np.abs(vectors[:, 1])) > 1e-6).all())
    place = origin @ Pose2(x, y)
    found = transform_points(
        Pose2(theta=-origin.theta), nearest_walls(walls_from_grid(_grid(cells, origin)), place.x, place.y, reach)
    )
    lengths = np.hypot(*vectors.T)
    across = np.abs(vectors[:, 0]) > np.abs(vectors[:, 1])
    for quarter, (axis, sign) in enumerate([(0, 1), (0, -1), (1, 1), (1, -1)]):
        within = (across if axis == 0 else ~across) & (sign * vectors[:, axis] > 0)
        best = float(lengths[within].min(initial=math.inf))
        if best < reach - 1e-9:
            assert np.hypot(*found[quarter]) == pytest.approx(best)
            assert sign * found[quarter, axis] > 0
        elif best > reach + 1e-9:
            assert np.hypot(*found[quarter]) > FAR / 2
    distance, away_x, away_y = nearest_wall(walls_from_grid(_grid(cells, origin)), place.x, place.y, reach)
    if lengths.min() < reach - 1e-9:
        assert distance == pytest.approx(lengths.min())
        assert math.hypot(away_x, away_y) == pytest.approx(1.0)
    elif lengths.min() > reach + 1e-9:
        assert distance == FAR


def test_within_a_solid_cell_the_distance_to_the_wall_is_zero() -> None:
    assert nearest_wall(walls_from_grid(_grid([(5, 5)], Pose2())), 0.55, 0.55, 0.3) == (0.0, 0.0, 0.0)


POSES = st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(-math.pi, math.pi)).map(lambda pose: Pose2(*pose))


@given(POSES, st.floats(-3, 3), st.floats(-3, 3))
def test_the_distance_to_the_chair_is_that_to_its_nearest_side(pose: Pose2, x: float, y: float) -> None:
    corners = transform_points(pose, CHAIR_A.outline())
    point, sides = np.array([x, y]), np.roll(corners, -1, axis=0) - corners
    parts = np.clip(((point - corners) * sides).sum(axis=1) / (sides**2).sum(axis=1), 0.0, 1.0)
    nearest = corners + parts[:, None] * sides
    to_sides = np.hypot(*(point - nearest).T)
    local = transform_points(pose.inverse(), point[None])[0]
    within = -CHAIR_A.rear < local[0] < CHAIR_A.front and abs(local[1]) < CHAIR_A.width / 2
    chair = chair_rectangle(CHAIR_A, pose, Twist())
    distance, away_x, away_y = nearest_on_chair(chair, x, y)
    assert distance == pytest.approx(-to_sides.min() if within else to_sides.min(), abs=1e-9)
    assert math.hypot(away_x, away_y) == pytest.approx(1.0)
    # Back along the vector is the outline, and on along it is farther away.
    assert nearest_on_chair(chair, x - distance * away_x, y - distance * away_y)[0] == pytest.approx(0.0, abs=1e-9)
    assert nearest_on_chair(chair, x + 0.1 * away_x, y + 0.1 * away_y)[0] == pytest.approx(distance + 0.1, abs=1e-9)


@given(POSES, st.floats(-1, 1), st.floats(-1, 1), st.floats(-1, 1), st.floats(-1, 1))
def test_a_point_of_the_chair_moves_with_the_chair(pose: Pose2, x: float, y: float, v: float, omega: float) -> None:
    dt = 1e-7
    body = np.array([[x, y]])
    before, after = (transform_points(pose @ Pose2(sign * v * dt, 0.0, sign * omega * dt), body)[0] for sign in (-1, 1))
    at = transform_points(pose, body)[0]
    velocity = velocity_at(chair_rectangle(CHAIR_A, pose, Twist(v, omega)), at[0], at[1])
    assert velocity == pytest.approx(tuple((after - before) / (2 * dt)), abs=1e-5)
