"""Rails: the line that a person walks, and its permitted speed."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from waychair.simulation.people.rails import (
    ACCELERATION,
    CORNER_CUT,
    CORNER_RADIUS,
    SLOWEST,
    SPACING,
    rail_at,
    rail_from_path,
)
from waychair.types import FloatArray

PATHS = st.lists(st.tuples(st.floats(0.0, 6.0), st.floats(0.0, 6.0)), min_size=2, max_size=6).map(
    lambda points: np.array(points, float)
)


def _distance_to(path: FloatArray, point: FloatArray) -> float:
    best = math.inf
    for a, b in pairwise(path):
        square = float((b - a) @ (b - a))
        part = np.clip(np.dot(point - a, b - a) / square, 0.0, 1.0) if square > 0.0 else 0.0
        best = min(best, float(np.linalg.norm(point - a - part * (b - a))))
    return best


@given(PATHS, st.floats(0.2, 1.5))
def test_a_rail_keeps_to_its_path_and_its_speed_to_the_limits(path: FloatArray, speed: float) -> None:
    rail = rail_from_path(path, speed)
    along, points, limit = rail[:, 0], rail[:, 1:3], rail[:, 4]
    if len(rail) > 1:
        # A rail ends at the end of its path, except for points that repeat the one before.
        assert np.linalg.norm(points[-1] - path[-1]) < 1e-5
    assert points[0] == pytest.approx(path[0])
    assert np.diff(along) == pytest.approx(np.hypot(*np.diff(points, axis=0).T))
    assert np.diff(along).max(initial=0.0) <= SPACING + 1e-9
    assert max(_distance_to(path, point) for point in points) <= CORNER_CUT + 1e-6
    assert max(np.hypot(*(points - corner).T).min() for corner in path) <= CORNER_CUT + SPACING
    assert (limit <= speed + 1e-12).all()
    assert (limit >= min(SLOWEST, speed) - 1e-12).all()
    rise = np.abs(np.diff(np.maximum(limit, SLOWEST) ** 2))
    assert (rise <= 2 * ACCELERATION * np.diff(along) + 1e-9).all()


@given(PATHS, st.floats(-1.0, 30.0))
def test_a_place_on_a_rail_is_interpolated_between_its_rows(path: FloatArray, along: float) -> None:
    before, rail = rail_from_path(path[::-1], 0.7), rail_from_path(path, 1.2)
    rails, first = np.concatenate([before, rail]), len(before)
    expected = [float(np.interp(along, rail[:, 0], rail[:, column])) for column in range(1, 5)]
    # Where rows coincide, either is the place.
    if np.diff(rail[:, 0]).min(initial=1.0) > 1e-9:
        assert rail_at(rails, first, len(rails), along) == pytest.approx(expected)


def test_a_right_angle_becomes_a_quarter_circle() -> None:
    rail = rail_from_path(np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 3.0]]), 1.5)
    bend = (rail[:, 3] > 1e-9) & (rail[:, 3] < math.pi / 2 - 1e-9)
    middle = np.array([3.0 - CORNER_RADIUS, CORNER_RADIUS])
    assert np.hypot(*(rail[bend, 1:3] - middle).T) == pytest.approx(CORNER_RADIUS)
    assert rail[-1, 0] == pytest.approx(6.0 - (2.0 - math.pi / 2) * CORNER_RADIUS, abs=0.01)
    assert rail[bend, 4].max() == pytest.approx(math.sqrt(ACCELERATION * CORNER_RADIUS), rel=0.01)
    assert rail[:, 4].max() == pytest.approx(1.5)


def test_a_path_that_returns_on_itself_turns_near_its_far_end() -> None:
    rail = rail_from_path(np.array([[0.0, 0.0], [2.0, 0.0], [0.0, 0.0]]), 1.0)
    assert rail[:, 1].max() == pytest.approx(2.0 - CORNER_CUT)
    assert rail[np.argmax(rail[:, 1]), 4] == pytest.approx(SLOWEST)
    assert rail[-1, 3] - rail[0, 3] == pytest.approx(math.pi)


@pytest.mark.parametrize("path", [[[1.0, 2.0]], [[1.0, 2.0], [1.0, 2.0], [1.0, 2.0]]])
def test_a_path_of_one_place_gives_a_rail_of_one_row(path: list[list[float]]) -> None:
    rail = rail_from_path(np.array(path), 1.0)
    assert rail[:, :4] == pytest.approx(np.array([[0.0, 1.0, 2.0, 0.0]]))
    assert rail_at(rail, 0, 1, 0.7)[:3] == (1.0, 2.0, 0.0)
