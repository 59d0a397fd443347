"""The odometry filter's equations against their own differences."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from waychair.geometry import arc
from waychair.slam.odometry.odometry_model import (
    OMEGA,
    SIZE,
    THETA,
    OdometrySettings,
    V,
    forward,
    initial_covariance,
    motion_since_mark,
    predict_step,
    turn_by_wheels,
)
from waychair.types import FloatArray, Pose2

SETTINGS = OdometrySettings()
ways, turns = st.floats(-0.5, 0.5), st.floats(-1.0, 1.0)


def drawn_state(seed: int) -> FloatArray:
    """A state in which every component has an effect."""
    rng = np.random.default_rng(seed)
    scale = np.array([5, 5, 2, 1, 0.5, 0.01, 0.02, 0.02, 0.02, 0.01, 5, 5, 2])
    return np.asarray(scale * rng.standard_normal(SIZE))


def differences(function: Callable[[FloatArray], FloatArray], state: FloatArray) -> FloatArray:
    """Jacobian by central differences."""
    step = 1e-6
    columns = [(function(state + step * axis) - function(state - step * axis)) / (2 * step) for axis in np.eye(SIZE)]
    return np.stack(columns, axis=-1)


@pytest.mark.parametrize("wheels", [None, arc(0.3, 0.2), Pose2(0.1, -0.05, -0.4), Pose2()])
@pytest.mark.parametrize("gyro", [None, 0.25])
def test_the_jacobian_of_a_step_is_that_of_its_motion(wheels: Pose2 | None, gyro: float | None) -> None:
    for seed in range(5):
        state = drawn_state(seed)
        step = predict_step(state, 0.2, wheels, gyro, SETTINGS)
        numeric = differences(lambda x: predict_step(x, 0.2, wheels, gyro, SETTINGS).state, state)
        assert step.jacobian == pytest.approx(numeric, abs=1e-6)
        assert np.linalg.eigvalsh(step.noise).min() > -1e-12


@pytest.mark.parametrize("seed", range(5))
def test_jacobians_of_measurements_equal_their_differences(seed: int) -> None:
    state, wheels = drawn_state(seed), arc(0.3, 0.2)
    row = differences(lambda x: np.array([turn_by_wheels(x, 0.2, wheels, SETTINGS)[0]]), state)
    assert turn_by_wheels(state, 0.2, wheels, SETTINGS)[1] == pytest.approx(row[0], abs=1e-6)
    ends = Pose2(0.1, 0.02, 0.1), Pose2(-0.05, 0.01, -0.2)
    numeric = differences(lambda x: unwrapped(motion_since_mark(x, *ends)[0], state), state)
    assert motion_since_mark(state, *ends)[1] == pytest.approx(numeric, abs=1e-5)


def unwrapped(motion: FloatArray, state: FloatArray) -> FloatArray:
    """Its angle mapped to a turn that does not jump within a difference."""
    angle = motion[2] - (state[THETA] - state[SIZE - 1])
    return np.array([motion[0], motion[1], motion[2] - 2 * np.pi * np.round(angle / (2 * np.pi))])


@given(ways, turns)
def test_the_length_of_an_arc_is_recovered(way: float, turn: float) -> None:
    assert forward(arc(way, turn)) == pytest.approx(way, abs=1e-12)


@given(ways, turns)
def test_wheels_without_error_are_followed_exactly(way: float, turn: float) -> None:
    step = predict_step(np.zeros(SIZE), 0.5, arc(way, turn), None, SETTINGS)
    expected = arc(way, turn).array()
    assert step.state[:3] == pytest.approx(expected, abs=1e-12)
    assert step.state[[V, OMEGA]] == pytest.approx([2 * way, 2 * turn], abs=1e-12)
    assert np.count_nonzero(step.state) <= 5


def test_without_readings_the_twist_continues_and_the_covariance_grows() -> None:
    state = np.zeros(SIZE)
    state[[V, OMEGA]] = 0.5, 0.2
    step = predict_step(state, 0.4, None, None, SETTINGS)
    assert step.state[:3] == pytest.approx(arc(0.2, 0.08).array(), rel=1e-3)  # by its chord
    assert step.state[[V, OMEGA]] == pytest.approx([0.5, 0.2])
    start = initial_covariance(SETTINGS)
    after = step.jacobian @ start @ step.jacobian.T + step.noise
    assert np.linalg.det(after[:3, :3]) > np.linalg.det(start[:3, :3])
