"""Rays among segments and circles, against a search of each of them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waychair.simulation.scene.scene import Slice
from waychair.simulation.sensors.rays import (
    Scenery,
    cosine_of_incidence,
    nearest_circle,
    nearest_segment,
    scenery_from_slice,
)
from waychair.types import FloatArray


def _scenery(segments: FloatArray) -> Scenery:
    return scenery_from_slice(Slice(segments, np.zeros(len(segments), np.int64)))


def _plain(segments: FloatArray, x: float, y: float, dx: float, dy: float, limit: float) -> tuple[float, int]:
    """Solve for the meeting point with each segment."""
    best, hit = math.inf, -1
    for i, (x0, y0, x1, y1) in enumerate(segments.tolist()):
        matrix = np.array([[dx, x0 - x1], [dy, y0 - y1]])
        if abs(np.linalg.det(matrix)) < 1e-12:
            continue
        distance, part = np.linalg.solve(matrix, [x0 - x, y0 - y])
        if 0.0 <= part <= 1.0 and 0.0 <= distance < best:
            best, hit = float(distance), i
    return (best, hit) if best <= limit else (math.inf, -1)


@settings(max_examples=100)
@given(st.integers(0, 2**32 - 1), st.integers(1, 60), st.sampled_from([2.0, 10.0, 1000.0]))
def test_the_first_segment_hit_is_that_of_a_plain_search(seed: int, count: int, limit: float) -> None:
    rng = np.random.default_rng(seed)  # random places: at an end, hit or miss are both right
    begins = rng.uniform(-5.0, 5.0, (count, 2))
    straight = rng.random(count) < 0.5
    along = rng.uniform(-3.0, 3.0, (count, 2)) * np.where(straight[:, None], [[1.0, 0.0]], 1.0)
    segments = np.hstack([begins, begins + along])
    scenery = _scenery(segments)
    for x, y, angle in rng.uniform((-9.0, -9.0, -math.pi), (9.0, 9.0, math.pi), (20, 3)).tolist():
        dx, dy = math.cos(angle), math.sin(angle)
        distance, hit = nearest_segment(scenery, x, y, dx, dy, 0.0, limit)
        expected, number = _plain(segments, x, y, dx, dy, limit)
        assert distance == pytest.approx(expected, abs=1e-9)
        assert hit == number


@pytest.mark.parametrize("turn", [0.0, math.pi / 2, math.pi, -math.pi / 2])
@pytest.mark.parametrize("count", [1, 7, 100])
def test_no_ray_slips_through_a_wall_of_many_pieces(turn: float, count: int) -> None:
    ends = np.linspace(-3.0, 3.0, count + 1)
    pieces = np.column_stack([np.full(count, 2.0), ends[:-1], np.full(count, 2.0), ends[1:]])
    c, s = math.cos(turn), math.sin(turn)
    turned = np.hstack([pieces[:, k : k + 2] @ np.array([[c, s], [-s, c]]) for k in (0, 2)])
    scenery = _scenery(turned)
    for end in ends[1:-1]:  # straight at the joint of two pieces
        angle = math.atan2(end, 2.0) + turn
        distance, hit = nearest_segment(scenery, 0.0, 0.0, math.cos(angle), math.sin(angle), 0.0, 100.0)
        assert distance == pytest.approx(math.hypot(2.0, end), abs=1e-6)
        assert hit >= 0


def test_a_distant_ray_along_the_axes_hits_the_scene_and_one_beside_it_does_not() -> None:
    scenery = _scenery(np.array([[0.0, 0.0, 0.0, 1.0], [2.0, 0.0, 2.0, 1.0]]))
    assert nearest_segment(scenery, -50.0, 0.5, 1.0, 0.0, 0.0, math.inf) == (50.0, 0)
    assert nearest_segment(scenery, 60.0, 0.5, -1.0, 0.0, 0.0, math.inf) == (58.0, 1)
    for x, y, dx, dy in (
        (-50.0, 1.5, 1.0, 0.0),
        (-50.0, 0.5, -1.0, 0.0),
        (1.0, -50.0, 0.0, -1.0),
        (3.0, 9.0, 0.0, -1.0),
    ):
        assert nearest_segment(scenery, x, y, dx, dy, 0.0, math.inf) == (math.inf, -1)


def test_hits_before_the_least_distance_are_skipped() -> None:
    scenery = _scenery(np.array([[1.0, -1.0, 1.0, 1.0], [3.0, -1.0, 3.0, 1.0]]))
    assert nearest_segment(scenery, 1.0, 0.0, 1.0, 0.0, 0.0, 9.0) == (0.0, 0)
    assert nearest_segment(scenery, 1.0, 0.0, 1.0, 0.0, 1e-7, 9.0) == (2.0, 1)


def test_an_empty_scene_has_nothing_to_hit() -> None:
    assert nearest_segment(_scenery(np.zeros((0, 4))), 0.3, 0.3, 1.0, 0.0, 0.0, math.inf) == (math.inf, -1)


@settings(max_examples=200)
@given(
    st.floats(-math.pi, math.pi),
    st.floats(0.01, 2.0),
    st.tuples(st.floats(-4, 4), st.floats(-4, 4)),
    st.tuples(st.floats(-4, 4), st.floats(-4, 4)),
    st.floats(0.0, 1.0),
)
def test_a_circle_on_the_ray_is_hit_on_its_rim(
    angle: float, radius: float, begin: tuple[float, float], end: tuple[float, float], part: float
) -> None:
    dx, dy = math.cos(angle), math.sin(angle)
    circles = [np.array([[*place, radius]]) for place in (begin, end)]
    distance = nearest_circle(*circles, part, 0.0, 0.0, dx, dy, 0.0)
    centre = np.array(begin) + part * (np.array(end) - np.array(begin))
    steps = np.linspace(0.0, 12.0, 2401)
    inside = np.hypot(steps * dx - centre[0], steps * dy - centre[1]) <= radius - 1e-9  # on the rim, either is right
    if inside.any():
        assert distance <= steps[inside.argmax()] + 1e-9
        assert distance > steps[inside.argmax()] - 0.006
    elif distance < math.inf:  # so short a chord that it fell between two steps
        assert math.hypot(distance * dx - centre[0], distance * dy - centre[1]) == pytest.approx(radius, abs=1e-6)


@pytest.mark.parametrize("degrees", [0.0, 3.0, 45.0, 89.0])
def test_incidence_is_measured_from_the_normal(degrees: float) -> None:
    angle = math.radians(degrees)
    cosine = cosine_of_incidence(np.array([2.0, -1.0, 2.0, 5.0]), math.cos(angle), math.sin(angle))
    assert cosine == pytest.approx(math.cos(angle))
