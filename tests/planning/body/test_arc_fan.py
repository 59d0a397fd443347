"""Thousands of arcs at once: never a false "free", and the same results as single arcs."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.planning.body.test_footprint import CELL, field_of, gap, obstacle_squares, scattered
from waychair.calibration.chair_body import CHAIR_A, CHAIR_B, ChairBody
from waychair.geometry import transform_points
from waychair.planning.body.arc_fan import FINE, fill_table, free_times
from waychair.planning.body.footprint import along_arc, footprint, free_time, in_cells
from waychair.types import FloatArray, Pose2


def fan(most_v: float, most_omega: float) -> FloatArray:
    v, omega = np.linspace(-most_v / 4, most_v, 5), np.linspace(-most_omega, most_omega, 5)
    return np.stack(np.meshgrid(v, omega), axis=-1).reshape(-1, 2)


@given(st.integers(0, 2**32 - 1), st.sampled_from([CHAIR_A, CHAIR_B]))
@settings(max_examples=25, deadline=None)
def test_an_arc_called_free_is_free_at_every_instant_of_its_free_time(seed: int, body: ChairBody) -> None:
    rng = np.random.default_rng(seed)
    obstacles = scattered(rng, 0.002)
    field, squares = field_of(obstacles), obstacle_squares(obstacles)
    shape, candidates = footprint(body, 0.0, field), fan(0.9, 1.2)
    x, y, theta = rng.uniform((1.2, 1.2, -4), (2.8, 2.8, 4))
    times = free_times(shape, in_cells(field, Pose2(x, y, theta)), candidates, np.full(len(candidates), 2.5), 2.5)
    for (v, omega), free in zip(candidates, times, strict=True):
        assert 0 <= free <= 2.5
        for t in np.linspace(0, free, 60) if free > 0 else ():
            assert gap(body, Pose2(*along_arc(x, y, theta, v, omega, t)), squares) > 0


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=25, deadline=None)
def test_the_fan_finds_about_as_many_free_arcs_as_single_checks(seed: int) -> None:
    rng = np.random.default_rng(seed)
    field = field_of(scattered(rng, 0.001))
    shape, candidates = footprint(CHAIR_A, 0.0, field), fan(0.8, 0.8)
    start = in_cells(field, Pose2(*rng.uniform((1.2, 1.2, -4), (2.8, 2.8, 4))))
    many = free_times(shape, start, candidates, np.full(len(candidates), 2.5), 2.5)
    single = np.array([free_time(shape, start, v / CELL, omega, 2.5, 2.5) for v, omega in candidates])
    assert (many > single - 0.3).mean() > 0.9


def test_no_arc_is_free_where_the_body_does_not_fit_at_the_start() -> None:
    obstacles = np.zeros((80, 80), bool)
    obstacles[40, 45] = True
    field = field_of(obstacles)
    start = in_cells(field, Pose2(2.0, 2.0))
    assert not free_times(footprint(CHAIR_A, 0.0, field), start, fan(0.8, 0.8), np.full(25, 2.5), 2.5).any()


@pytest.mark.parametrize("omega", [0.0, 1e-9, 0.3, -1.5])
def test_the_table_holds_the_poses_of_the_arc(omega: float) -> None:
    table = np.empty((FINE + 1, 4))
    fill_table(table, 0.7, omega, 0.01)
    for k in (0, 1, 100, FINE):
        x, y, theta = along_arc(0.0, 0.0, 0.7, 1.0, omega, 0.01 * k)
        np.testing.assert_allclose(table[k], [math.cos(theta), math.sin(theta), x, y], atol=1e-9)


@given(st.floats(0.0, 1.0), st.floats(-1.0, 1.0), st.floats(0.001, 0.1))
@settings(max_examples=60, deadline=None)
def test_the_area_swept_between_two_poses_exceeds_them_by_no_more_than_the_bound(
    v: float, omega: float, dt: float
) -> None:
    """Points of the outline in between, against the two rectangles, by brute force."""
    body = CHAIR_A
    reach = (body.front - body.rear) / 2 + math.hypot(body.length / 2, body.width / 2)
    along, across = (v + abs(omega) * body.width / 2) * dt, abs(omega) * reach * dt
    reckoned = along * across / max(along + across, 1e-12) + (v + abs(omega) * reach) * abs(omega) * dt * dt / 8
    end = Pose2(*along_arc(0, 0, 0, v, omega, dt))
    corners = body.outline()
    sides = np.concatenate([np.linspace(a, b, 60) for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)])
    for part in np.linspace(0.05, 0.95, 10):
        points = transform_points(Pose2(*along_arc(0, 0, 0, v, omega, part * dt)), sides)
        outside = np.minimum(depth(body, points), depth(body, transform_points(end.inverse(), points)))
        assert outside.max() <= reckoned + 1e-9


def depth(body: ChairBody, points: FloatArray) -> FloatArray:
    """Distance [m] of points (N, 2) in the body's frame outside of its rectangle, 0 inside."""
    beyond = np.maximum(np.maximum(points[:, 0] - body.front, -body.rear - points[:, 0]), 0.0)
    away: FloatArray = np.hypot(beyond, np.maximum(np.abs(points[:, 1]) - body.width / 2, 0.0))
    return away
