"""The social forces against the gradients of their potentials."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from waychair.simulation.people.social_force import (
    BEHIND,
    RELAXATION,
    SIGMA,
    STEP_TIME,
    U0,
    V0,
    WALL_RANGE,
    capped,
    goal_force,
    repulsion,
    veered,
    wall_repulsion,
    weight,
)

METRES = st.floats(-4.0, 4.0)
SPEEDS = st.floats(-1.5, 1.5)


def _potential(x: float, y: float, vx: float, vy: float, bodies: float) -> float:
    step = np.array([vx, vy]) * STEP_TIME
    place = np.array([x, y])
    both = np.linalg.norm(place) + np.linalg.norm(place - step)
    b = 0.5 * math.sqrt(max(float(both**2 - step @ step), 0.0))
    return V0 * math.exp((bodies - b) / SIGMA)


@given(METRES, METRES, SPEEDS, SPEEDS, st.floats(0.0, 0.6))
def test_repulsion_is_the_negative_gradient_of_its_elliptical_potential(
    x: float, y: float, vx: float, vy: float, bodies: float
) -> None:
    step = np.array([vx, vy]) * STEP_TIME
    # Between the foci, and at them, the potential has an edge that differences cannot follow.
    part = np.clip(np.dot([x, y], step) / max(float(step @ step), 1e-12), 0.0, 1.0)
    assume(np.linalg.norm(np.array([x, y]) - part * step) > 0.05)
    h = 1e-6
    slope_x = (_potential(x + h, y, vx, vy, bodies) - _potential(x - h, y, vx, vy, bodies)) / (2 * h)
    slope_y = (_potential(x, y + h, vx, vy, bodies) - _potential(x, y - h, vx, vy, bodies)) / (2 * h)
    assert repulsion(x, y, vx, vy, bodies) == pytest.approx((-slope_x, -slope_y), rel=1e-3, abs=1e-6)


def test_an_approaching_person_repels_from_farther_away_than_a_standing_one() -> None:
    standing, _ = repulsion(3.0, 0.1, 0.0, 0.0, 0.5)
    coming, _ = repulsion(3.0, 0.1, 1.3, 0.0, 0.5)
    leaving, _ = repulsion(3.0, 0.1, -1.3, 0.0, 0.5)
    assert coming > 10 * standing > 10 * leaving > 0.0


@pytest.mark.parametrize(("x", "y"), [(0.0, 0.0), (1.0, 0.0), (2.0, 0.0)])
def test_on_the_line_between_the_foci_the_force_is_zero_and_finite(x: float, y: float) -> None:
    assert repulsion(x, y, 1.0, 0.0, 0.5) == (0.0, 0.0)


@given(METRES, METRES)
def test_the_force_of_walls_is_the_negative_gradient_of_their_potential(x: float, y: float) -> None:
    assume(math.hypot(x, y) > 0.02)
    h = 1e-7
    slope_x, slope_y = (
        U0 * (math.exp(-math.hypot(x + a, y + b) / WALL_RANGE) - math.exp(-math.hypot(x - a, y - b) / WALL_RANGE))
        for a, b in ((h, 0.0), (0.0, h))
    )
    expected = (-slope_x / (2 * h), -slope_y / (2 * h))
    assert wall_repulsion(x, y) == pytest.approx(expected, rel=1e-3, abs=1e-5)


def test_a_person_at_the_wanted_velocity_feels_no_goal_force() -> None:
    assert goal_force(30.0, 40.0, 0.6, 0.8, 1.0) == pytest.approx((0.0, 0.0), abs=1e-12)
    assert goal_force(0.0, 5.0, 0.0, 0.0, 1.2) == pytest.approx((0.0, 1.2 / RELAXATION))


def test_the_wanted_speed_falls_to_zero_at_the_goal() -> None:
    assert goal_force(0.1, 0.0, 0.1 / RELAXATION, 0.0, 1.0) == pytest.approx((0.0, 0.0), abs=1e-12)
    assert goal_force(0.0, 0.0, 0.0, 0.0, 1.0) == (0.0, 0.0)


@pytest.mark.parametrize("degrees", range(0, 181, 5))
def test_a_force_from_behind_counts_half(degrees: int) -> None:
    bearing = math.radians(degrees)
    source = math.cos(bearing), math.sin(bearing)
    expected = 1.0 if degrees < 100 else BEHIND
    if degrees != 100:
        assert weight(2.0, 0.0, -source[0], -source[1]) == expected


def test_veering_leads_a_head_on_encounter_past_the_right() -> None:
    x, y = veered(-2.0, 0.0, 0.1)
    _, force_y = repulsion(x, y, -1.0, 0.0, 0.5)
    assert force_y < 0.0  # the right of a person who walks along x is at -y


@given(st.floats(-50, 50), st.floats(-50, 50), st.floats(0.1, 5.0))
def test_a_capped_vector_keeps_its_direction_and_is_no_longer_than_the_cap(x: float, y: float, limit: float) -> None:
    cx, cy = capped(x, y, limit)
    assert math.hypot(cx, cy) == pytest.approx(min(math.hypot(x, y), limit))
    assert cx * y == pytest.approx(cy * x, abs=1e-9)
    assert cx * x >= 0.0
    assert cy * y >= 0.0
