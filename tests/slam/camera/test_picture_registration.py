"""Registration of images and of depth: known motions are recovered, and rejected pairs have a reason."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.slam.rgbd_scene import CAMERA, noisy, pose, render
from waychair.slam.camera.depth_icp import IcpRefusal, cloud_kernel, refine_by_depth
from waychair.slam.camera.feature_settings import FeatureSettings
from waychair.slam.camera.features import ImageFeatures, extract, extract_sized
from waychair.slam.camera.picture_registration import RegistrationRefusal, angle_between, register
from waychair.slam.camera.reprojection import NoiseModel, fit_pose, project, residual_kernel, unrolled
from waychair.types import FloatArray, Pose3


def features_at(place: Pose3) -> ImageFeatures:
    return extract(render(place), FeatureSettings(upright=False))


def away(a: Pose3, b: Pose3) -> tuple[float, float]:
    return float(np.linalg.norm(a.translation - b.translation)), angle_between(a, b)


@pytest.mark.parametrize(
    "moved", [pose(), pose((0, 0.1, 0), (0.1, 0, 0)), pose((0.05, -0.1, 0.3), (0, 0.05, 0.2)), pose((0, 0, 1.2))]
)
def test_the_motion_between_two_pictures_is_recovered(moved: Pose3) -> None:
    found = register(features_at(pose()), features_at(moved), CAMERA)
    assert found.old_from_new is not None
    metres, radians = away(found.old_from_new, moved)
    assert metres < 0.02
    assert radians < 0.01
    assert found.inliers >= 20
    deviations = np.sqrt(np.diag(found.covariance))
    assert (deviations[3:] > metres / 5).all()  # the covariance is not far from the truth
    assert (deviations < 0.1).all()


def test_matches_agree_with_their_pose_and_not_with_one_beside_it() -> None:
    found = register(features_at(pose()), features_at(pose((0, 0.05, 0))), CAMERA)
    assert found.old_from_new is not None
    assert found.inlier_share(found.old_from_new, CAMERA) > 0.95
    assert found.inlier_share(found.old_from_new @ pose((0, 0.03, 0)), CAMERA) < 0.5
    assert dataclasses.replace(found, points=np.empty((0, 3))).inlier_share(found.old_from_new, CAMERA) == 0.0


def test_a_guess_gives_the_same_pose_and_a_wrong_guess_is_ignored() -> None:
    moved = pose((0, 0.08, 0), (0.1, 0.02, 0.05))
    old, new = features_at(pose()), features_at(moved)
    for guess in (moved, pose((0, 1.0, 0), (1.0, 0, 0))):
        found = register(old, new, CAMERA, guess)
        assert found.old_from_new is not None
        assert away(found.old_from_new, moved)[0] < 0.02


def test_pictures_of_different_walls_are_refused_with_a_reason() -> None:
    found = register(features_at(pose()), features_at(pose((0, math.pi, 0))), CAMERA)
    assert found.old_from_new is None
    assert found.refusal in (
        RegistrationRefusal.FEW_MATCHES,
        RegistrationRefusal.NO_POSE,
        RegistrationRefusal.FEW_INLIERS,
        RegistrationRefusal.CONTRADICTED,
    )


def test_an_empty_picture_and_one_without_depth_are_refused() -> None:
    old = features_at(pose())
    nothing = old.take(np.zeros(len(old), bool))
    blind = dataclasses.replace(old, points=np.full_like(old.points, np.nan))
    assert register(old, nothing, CAMERA).refusal is RegistrationRefusal.FEW_FEATURES
    assert register(blind, old, CAMERA).refusal is RegistrationRefusal.FEW_FEATURES
    assert register(old, blind, CAMERA).old_from_new is not None  # only the first one needs depth


def test_pictures_too_far_apart_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("waychair.slam.camera.picture_registration._MAX_DISTANCE", 0.05)
    assert (
        register(features_at(pose()), features_at(pose((0, 0, 0), (0.2, 0, 0))), CAMERA).refusal
        is RegistrationRefusal.TOO_FAR
    )


def test_matches_in_one_spot_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("waychair.slam.camera.picture_registration._MIN_SPREAD", 0.1)
    assert register(features_at(pose()), features_at(pose()), CAMERA).refusal is RegistrationRefusal.CLUSTERED


@settings(max_examples=25)
@given(st.integers(0, 10_000), st.floats(0.0, 0.4))
def test_a_pose_is_found_among_outliers(seed: int, share: float) -> None:
    rng = np.random.default_rng(seed)
    points = np.column_stack([rng.uniform(-1, 1, 120), rng.uniform(-0.8, 0.8, 120), rng.uniform(1.0, 4.0, 120)])
    truth = pose(tuple(rng.normal(0, 0.1, 3)), tuple(rng.normal(0, 0.1, 3))).inverse()
    seen = np.column_stack([project(points, truth, CAMERA), np.ones(120)])
    seen[:, :2] += rng.normal(0, 0.3, (120, 2))
    false = rng.random(120) < share
    seen[false, :2] += rng.uniform(20, 60, (int(false.sum()), 2)) * rng.choice([-1, 1], (int(false.sum()), 2))
    seen[rng.random(120) < 0.3, 2] = np.nan
    fit = fit_pose(points, seen, CAMERA, Pose3(np.eye(3), np.zeros(3)), NoiseModel())
    assert away(fit.camera_from_map, truth)[0] < 0.02
    assert not fit.inliers[false].any()


def test_the_derivatives_of_residuals_equal_finite_differences() -> None:
    rng = np.random.default_rng(1)
    point, truth = np.array([0.3, -0.2, 2.0]), pose((0.1, 0.2, -0.1), (0.1, 0, 0.2)).inverse()
    seen, sigma = np.array([150.0, 100.0, 0.45, 2.0]), np.array([0.7, 0.05, 100.0])

    def error_at(step: FloatArray) -> FloatArray:
        turned = pose(tuple(step[:3])).rotation
        out = np.empty(3), np.empty((3, 6)), np.empty((3, 3))
        residual_kernel(
            point, seen, CAMERA, turned @ truth.rotation, turned @ truth.translation + step[3:], sigma, *out
        )
        return out[0].copy()

    error, by_pose, by_point = np.empty(3), np.empty((3, 6)), np.empty((3, 3))
    residual_kernel(point, seen, CAMERA, truth.rotation, truth.translation, sigma, error, by_pose, by_point)
    for k in range(6):
        step = np.zeros(6)
        step[k] = 1e-6 * rng.choice([1.0, 2.0])
        np.testing.assert_allclose(
            (error_at(step) - error_at(-step)) / (2 * step[k]), by_pose[:, k], rtol=1e-4, atol=1e-4
        )
    u, v, inverse = project(point[None], truth, CAMERA)[0]
    np.testing.assert_allclose(error, [(u - 150) / 1.4, (v - 100) / 1.4, (inverse - 0.45) / 0.05])


def test_points_of_rows_exposed_in_turn_are_moved_to_one_time() -> None:
    rng = np.random.default_rng(2)
    points = np.column_stack([rng.uniform(-1, 1, 50), rng.uniform(-0.8, 0.8, 50), rng.uniform(1.0, 4.0, 50)])
    velocity, time = np.array([0.5, -1.0, 0.7, 0.2, 0.1, -0.3]), rng.uniform(-0.01, 0.01, 50)
    moved = [pose(tuple(velocity[:3] * t), tuple(velocity[3:] * t)) for t in time]
    rolled = np.array([project(p[None], step, CAMERA)[0] for p, step in zip(points, moved, strict=True)])
    at_once = project(points, Pose3(np.eye(3), np.zeros(3)), CAMERA)
    found = unrolled(np.column_stack([rolled, np.ones(50)]), velocity, time, CAMERA)[:, :3]
    assert np.abs(rolled - at_once)[:, :2].max() > 2.0
    assert np.abs(found - at_once)[:, :2].max() < 0.1


@pytest.mark.parametrize("wrong", [pose((0.02, -0.02, 0.01), (0.03, -0.02, 0.02)), pose((0, 0.04, 0), (0, 0.05, 0))])
def test_depth_pictures_are_aligned_with_each_other(wrong: Pose3) -> None:
    corner, moved = pose((0.5, 0.6, 0.0)), pose((0.02, 0.05, 0.0), (0.05, 0.0, 0.05))
    old, new = render(corner).depth, render(corner @ moved).depth
    fit = refine_by_depth(old, new, CAMERA, moved @ wrong)
    assert fit.refusal is None
    assert away(fit.old_from_new, moved)[0] < 0.005
    assert away(fit.old_from_new, moved)[1] < 0.004


def test_a_flat_wall_and_an_empty_or_distant_depth_leave_the_guess_unchanged() -> None:
    room, guess = render(pose()).depth, pose((0, 0, 0), (0.01, 0, 0))
    flat = np.full_like(room, 2.0)
    for old, new, why in (
        (flat, flat, IcpRefusal.FLAT),
        (room, np.full_like(room, np.nan), IcpRefusal.NO_DEPTH),
        (room, room + 1.0, IcpRefusal.FEW_MEET),
    ):
        fit = refine_by_depth(old, new, CAMERA, guess)
        assert fit.refusal is why
        assert fit.old_from_new is guess


def test_normals_are_those_of_the_walls() -> None:
    frame = render(pose())
    points, normals = cloud_kernel(frame.depth, CAMERA)
    known = np.isfinite(normals[..., 0])
    assert known.mean() > 0.9
    np.testing.assert_allclose(np.abs(normals[known]).max(axis=1), 1.0, atol=0.01)  # all walls are along the axes
    assert (np.einsum("ni,ni->n", normals[known], points[known]) < 0).all()


@pytest.mark.parametrize("ratio", [1.5, 2.0])
def test_a_place_seen_from_up_to_twice_the_distance_is_registered_both_ways(ratio: float) -> None:
    """A wall from 1 m and from up to 2 m: each patch is described at its size in metres."""
    turning = FeatureSettings(upright=False)
    near_at, far_at = pose((0, math.pi, 0), (0, 0, -1.0)), pose((0, math.pi - 0.05, 0), (0.05, 0, ratio - 2.0))
    near, far = (extract_sized(noisy(render(at), seed), turning) for seed, at in enumerate((near_at, far_at)))
    for old, new, old_at, new_at in ((near, far, near_at, far_at), (far, near, far_at, near_at)):
        found = register(old, new, CAMERA)
        assert found.old_from_new is not None, (found.refusal, found.matches, found.inliers)
        error = found.old_from_new.inverse() @ old_at.inverse() @ new_at
        assert float(np.linalg.norm(error.translation)) < 0.05
