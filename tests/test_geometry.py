"""Planar poses: composition, inverse, wrapping."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from waychair.geometry import (
    arc,
    arc_lengths,
    arcs,
    compose,
    in_space,
    interpolate,
    invert,
    limit_slope,
    pose_from_array,
    quaternions,
    rectangle,
    rotation,
    rotations,
    transform_points,
    wrap_angle,
    wrap_angles,
)
from waychair.types import Path, Pose2, Pose3

metres = st.floats(-100, 100)
angles = st.floats(-10, 10)
poses = st.builds(Pose2, metres, metres, angles)


@given(angles)
def test_wrapped_angles_are_in_the_half_open_circle_and_keep_their_direction(angle: float) -> None:
    wrapped = wrap_angle(angle)
    assert -math.pi < wrapped <= math.pi
    assert math.cos(wrapped) == pytest.approx(math.cos(angle), abs=1e-9)
    assert math.sin(wrapped) == pytest.approx(math.sin(angle), abs=1e-9)
    assert wrap_angles(np.array([angle]))[0] == pytest.approx(wrapped, abs=1e-9)


@pytest.mark.parametrize("angle", [math.pi, -math.pi, 3 * math.pi])
def test_half_a_turn_is_plus_pi(angle: float) -> None:
    assert wrap_angle(angle) == pytest.approx(math.pi)
    assert wrap_angles(np.array([angle]))[0] == pytest.approx(math.pi)


@given(poses, poses, poses)
def test_composition_is_associative(a: Pose2, b: Pose2, c: Pose2) -> None:
    left, right = (a @ b) @ c, a @ (b @ c)
    assert (left.x, left.y) == pytest.approx((right.x, right.y), abs=1e-6)
    assert wrap_angle(left.theta - right.theta) == pytest.approx(0.0, abs=1e-6)


@given(poses)
def test_a_pose_and_its_inverse_cancel(a: Pose2) -> None:
    unit = a @ a.inverse()
    assert unit.array() == pytest.approx(np.zeros(3), abs=1e-6)


@given(st.lists(st.tuples(poses, poses), min_size=1, max_size=5))
def test_arrays_of_poses_compose_and_invert_as_single_ones(pairs: list[tuple[Pose2, Pose2]]) -> None:
    a = np.array([first.array() for first, _ in pairs])
    b = np.array([second.array() for _, second in pairs])
    for row, (first, second) in zip(compose(a, b), pairs, strict=True):
        expected = first @ second
        assert row[:2] == pytest.approx([expected.x, expected.y], abs=1e-6)
        assert wrap_angle(row[2] - expected.theta) == pytest.approx(0.0, abs=1e-6)
    assert compose(a, invert(a)) == pytest.approx(np.zeros_like(a), abs=1e-6)


@given(poses, metres, metres)
def test_points_transform_as_the_origins_of_poses(a: Pose2, x: float, y: float) -> None:
    moved = a @ Pose2(x, y, 0.0)
    assert transform_points(a, np.array([[x, y]]))[0] == pytest.approx([moved.x, moved.y], abs=1e-9)


def test_interpolation_takes_the_short_way_round() -> None:
    middle = interpolate(Pose2(0, 0, math.radians(170)), Pose2(2, 4, math.radians(-170)), 0.5)
    assert (middle.x, middle.y) == (1.0, 2.0)
    assert abs(middle.theta) == pytest.approx(math.pi)


def test_the_planar_part_of_a_3d_pose_has_its_yaw() -> None:
    turn = np.eye(3)
    turn[:2, :2] = rotation(0.7)
    assert Pose3(turn, np.array([1.0, 2.0, 3.0])).planar().array() == pytest.approx([1.0, 2.0, 0.7])


def test_the_length_of_a_path_is_that_of_its_steps() -> None:
    assert Path(np.array([[0, 0, 0], [3, 4, 0], [3, 5, 1]], float)).length() == pytest.approx(6.0)


def test_a_rectangle_is_counter_clockwise() -> None:
    corners = rectangle(0.75, 0.25, 0.3)
    x, y = corners.T
    assert 0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y) == pytest.approx(0.6)
    assert pose_from_array(np.array([1.0, 2.0, 3.0])) == Pose2(1.0, 2.0, 3.0)


@given(poses, poses, st.floats(0.0, 3.0))
def test_3d_poses_compose_and_invert_like_planar_ones(a: Pose2, b: Pose2, height: float) -> None:
    both = in_space(a, height) @ in_space(b)
    assert both.translation == pytest.approx([*(a @ b).array()[:2], height], abs=1e-9)
    assert wrap_angle(both.planar().theta - (a @ b).theta) == pytest.approx(0.0, abs=1e-9)
    home = both.inverse() @ both
    assert home.rotation == pytest.approx(np.eye(3), abs=1e-9)
    assert home.translation == pytest.approx(np.zeros(3), abs=1e-9)


@given(st.floats(-5, 5), st.floats(-3, 3))
def test_an_arc_driven_in_two_halves_is_the_same_arc(distance: float, turn: float) -> None:
    whole, half = arc(distance, turn), arc(distance / 2, turn / 2)
    assert (half @ half).array() == pytest.approx(whole.array(), abs=1e-9)


@given(st.lists(st.tuples(st.floats(-5, 5), st.floats(-3, 3)), min_size=1))
def test_many_arcs_at_once_equal_single_ones(motions: list[tuple[float, float]]) -> None:
    distances, turns = np.array(motions).T
    assert arcs(distances, turns) == pytest.approx(np.array([arc(*motion).array() for motion in motions]), abs=1e-12)


def test_a_quarter_circle_ends_beside_its_middle() -> None:
    assert arc(math.pi, math.pi / 2).array() == pytest.approx([2.0, 2.0, math.pi / 2])


def test_the_distance_along_points_starts_at_zero_and_sums_their_steps() -> None:
    assert arc_lengths(np.array([[0.0, 0.0], [3.0, 4.0], [3.0, 4.0], [3.0, 2.0]])) == pytest.approx(
        [0.0, 5.0, 5.0, 7.0]
    )
    assert arc_lengths(np.array([[1.0, 2.0]])) == pytest.approx([0.0])


@given(st.lists(st.tuples(st.floats(0.0, 5.0), st.floats(0.0, 1.0)), min_size=1, max_size=20))
def test_an_eased_profile_is_the_least_that_any_place_allows(places: list[tuple[float, float]]) -> None:
    most, steps = np.array(places).T
    rise = np.cumsum(steps)
    allowed = most[None] + np.abs(rise[:, None] - rise[None])
    assert limit_slope(most, rise) == pytest.approx(allowed.min(axis=1), abs=1e-9)


def test_quaternions_and_rotations_are_those_of_scipy_with_each_component_the_largest() -> None:
    drawn = np.concatenate([np.eye(4), np.random.default_rng(0).normal(size=(200, 4))])
    turns = Rotation.from_quat(drawn)
    assert np.allclose(rotations(3.0 * drawn), turns.as_matrix(), atol=1e-14)
    back = quaternions(turns.as_matrix())
    assert np.allclose(np.abs((back * turns.as_quat()).sum(axis=1)), 1.0, atol=1e-14)
    assert (back[np.arange(len(back)), np.abs(back).argmax(axis=1)] > 0).all()
    assert quaternions(np.zeros((0, 3, 3))).shape == (0, 4)
    assert rotations(np.zeros((0, 4))).shape == (0, 3, 3)
