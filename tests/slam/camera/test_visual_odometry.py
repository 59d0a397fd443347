"""Visual odometry: rendered motions are recovered, blind and lost frames are reported, and real pictures are
followed."""

from __future__ import annotations

import dataclasses
from itertools import islice
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.slam.rgbd_scene import CAMERA, noisy, pose, render, sway
from waychair.recordings.recording import read_recording
from waychair.recordings.rgbd_folders import read_truth
from waychair.slam.camera.bundle_adjustment import Bundle, adjust, chi_kernel
from waychair.slam.camera.dense_alignment import align_pictures
from waychair.slam.camera.patch_alignment import affine_kernel, align
from waychair.slam.camera.picture_registration import angle_between
from waychair.slam.camera.reprojection import NoiseModel, project
from waychair.slam.camera.tracked_picture import PictureOutcome
from waychair.slam.camera.visual_map import inverse_depths, pyramid_of
from waychair.slam.camera.visual_odometry import VisualOdometry, VisualOdometrySettings
from waychair.types import FloatArray, Pose3, RgbdFrame

STILL = Pose3(np.eye(3), np.zeros(3))


def followed(frames: list[RgbdFrame]) -> tuple[VisualOdometry, list[Pose3 | None], list[PictureOutcome]]:
    odometry = VisualOdometry(VisualOdometrySettings())
    tracked = [odometry.process(frame) for frame in frames]
    poses = [each.camera_from_map.inverse() if each.camera_from_map is not None else None for each in tracked]
    return odometry, poses, [each.state for each in tracked]


def errors(poses: list[Pose3 | None], truth: list[Pose3]) -> FloatArray:
    return np.array([np.linalg.norm(p.translation - t.translation) for p, t in zip(poses, truth, strict=True) if p])


@pytest.mark.nightly
def test_a_swaying_camera_is_followed_to_millimetres() -> None:
    truth = sway(40)
    odometry, poses, states = followed([noisy(render(p, k * 66_000_000), k) for k, p in enumerate(truth)])
    assert states == [PictureOutcome.STARTED] + [PictureOutcome.FOLLOWED] * 39
    assert errors(poses, truth).max() < 0.01
    last = poses[-1]
    assert last is not None
    assert angle_between(last, truth[-1]) < 0.005
    assert odometry.map is not None
    assert 2 <= len(odometry.map.key_frames) < 20


@pytest.mark.nightly
def test_a_rolling_shutter_does_not_bend_the_trajectory() -> None:
    """The same motion with rows exposed one after the other: with that setting, the odometry is several times as
    exact."""
    truth = sway(30, turn=0.6, way=0.1)
    frames = []
    for k, p in enumerate(truth):
        after = truth[min(k + 1, len(truth) - 1)].inverse() @ truth[max(k - 1, 0)]
        span = (min(k + 1, len(truth) - 1) - max(k - 1, 0)) * 0.066
        motion = np.concatenate([Rotation.from_matrix(after.rotation).as_rotvec(), after.translation]) / span
        frames.append(render(p, k * 66_000_000, motion))
    told = errors(followed(frames)[1], truth)
    untold = errors(followed([dataclasses.replace(frame, row_step=0.0) for frame in frames])[1], truth)
    assert told.mean() < 0.012
    assert told.mean() < 0.7 * untold.mean()


def test_black_overexposed_and_blank_frames_are_reported_and_the_camera_is_found_after_them() -> None:
    truth = sway(16)
    frames = [render(p, k * 66_000_000) for k, p in enumerate(truth)]
    for k, level in ((5, 0), (6, 255), (7, 128)):
        frames[k] = dataclasses.replace(frames[k], image=np.full_like(frames[k].image, level))
    _, poses, states = followed(frames)
    assert states[5:8] == [PictureOutcome.BLIND] * 3
    assert all(state in (PictureOutcome.FOLLOWED, PictureOutcome.FOUND) for state in states[8:])
    assert errors(poses, truth).max() < 0.02


def test_frames_without_depth_start_no_map_but_are_followed_in_one() -> None:
    truth = sway(12)
    frames = [render(p, k * 66_000_000) for k, p in enumerate(truth)]
    holes = [dataclasses.replace(frame, depth=np.full_like(frame.depth, np.nan)) for frame in frames]
    assert followed(holes)[2] == [PictureOutcome.NO_DEPTH] * 12
    _, poses, states = followed([frames[0], frames[1], *holes[2:5], *frames[5:]])
    assert all(state in (PictureOutcome.FOLLOWED, PictureOutcome.FOUND) for state in states[1:])
    assert errors(poses, truth).max() < 0.02


def test_a_camera_turned_while_blind_is_lost_and_found_when_it_looks_back() -> None:
    there = [render(pose(at=(0.01 * k, 0, 0)), k * 66_000_000) for k in range(5)]
    away = [render(pose((0, 3.0 + 0.02 * k, 0)), (8 + k) * 66_000_000) for k in range(3)]
    back = [render(pose(at=(0.02 * k, 0, 0)), (12 + k) * 66_000_000) for k in range(3)]
    _, poses, states = followed([*there, *away, *back])
    assert states[5:8] == [PictureOutcome.LOST] * 3
    assert states[8] in (PictureOutcome.FOLLOWED, PictureOutcome.FOUND)
    assert states[9:] == [PictureOutcome.FOLLOWED] * 2
    found = poses[8]
    assert found is not None
    assert float(np.linalg.norm(found.translation)) < 0.02


def test_a_camera_lost_for_long_begins_a_new_piece() -> None:
    there = [render(pose(at=(0.01 * k, 0, 0)), k * 66_000_000) for k in range(4)]
    away = [render(pose((0, 3.0 + 0.02 * k, 0)), (60 + k) * 66_000_000) for k in range(3)]
    odometry, poses, states = followed([*there, *away])
    assert states[4:] == [PictureOutcome.STARTED, PictureOutcome.FOLLOWED, PictureOutcome.FOLLOWED]
    assert odometry.piece == 1
    assert None not in poses


def test_patches_are_found_to_a_tenth_of_a_pixel_under_rotation_and_scale() -> None:
    before, moved = render(pose()), pose((0.02, 0.03, 0.4), (0.03, 0.0, 0.1))
    now = render(moved)
    here = moved.inverse()
    rng = np.random.default_rng(3)
    at = rng.uniform((60, 50), (260, 190), (40, 2)).round()
    inverse = inverse_depths(before.depth, at)
    at, inverse = at[np.isfinite(inverse)], inverse[np.isfinite(inverse)]
    points = np.column_stack([(at - CAMERA[2:]) / CAMERA[:2], np.ones(len(at))]) / inverse[:, None]
    expected = project(points, here, CAMERA)[:, :2]
    affine = affine_kernel(points, np.eye(3), np.zeros(3), here.rotation, here.translation, CAMERA)
    old, new = pyramid_of(before.image), pyramid_of(now.image)
    found, level = align(old, new, at, affine, expected + rng.uniform(-2, 2, expected.shape), (2, 1, 0), 4.0, 0.8)
    fine = level == 0
    assert fine.mean() > 0.4  # the others lie where there is no texture: these are no corners
    assert np.median(np.linalg.norm(found[fine] - expected[fine], axis=1)) < 0.1
    delta = 1e-4  # the affine map is the derivative of the pixel of the surface that faces the camera
    shifted = points + np.array([delta, 0.0, 0.0]) / CAMERA[0] * points[:, 2:]
    derivative = (project(shifted, here, CAMERA)[:, :2] - expected) / delta
    np.testing.assert_allclose(affine[:, :, 0], derivative, atol=1e-3)


def test_a_change_of_exposure_shifts_no_patch_and_no_guess() -> None:
    before, moved = render(pose()), pose((0.0, 0.02, 0.0), (0.02, 0.0, 0.0))
    now = render(moved)
    darker = np.clip(np.rint(0.6 * now.image + 15.0), 0, 255).astype(np.uint8)
    corners = cv2.goodFeaturesToTrack(before.image, 60, 0.01, 12.0).reshape(-1, 2).astype(np.float64)
    inverse = inverse_depths(before.depth, corners)
    at, inverse = corners[np.isfinite(inverse)], inverse[np.isfinite(inverse)]
    points = np.column_stack([(at - CAMERA[2:]) / CAMERA[:2], np.ones(len(at))]) / inverse[:, None]
    expected = project(points, moved.inverse(), CAMERA)[:, :2]
    affine = np.tile(np.eye(2), (len(at), 1, 1))
    found = {}
    for name, image in (("same", now.image), ("darker", darker)):
        found[name] = align(pyramid_of(before.image), pyramid_of(image), at, affine, expected + 0.7, (1, 0), 4.0, 0.8)
    both = (found["same"][1] == 0) & (found["darker"][1] == 0)
    assert both.sum() > 20
    assert np.median(np.linalg.norm(found["darker"][0][both] - found["same"][0][both], axis=1)) < 0.03
    fit = align_pictures(pyramid_of(before.image), before.depth, pyramid_of(darker), CAMERA, STILL, (3, 2, 1))
    assert angle_between(fit.now_from_before, moved.inverse()) < 0.01


@pytest.mark.parametrize("moved", [pose((0, 0.1, 0)), pose((0.03, -0.05, 0.1), (0.05, 0.02, 0.05))])
def test_whole_pictures_give_the_motion_without_corners(moved: Pose3) -> None:
    before, now = render(pose()), render(moved)
    fit = align_pictures(pyramid_of(before.image), before.depth, pyramid_of(now.image), CAMERA, STILL, (3, 2, 1))
    assert angle_between(fit.now_from_before, moved.inverse()) < 0.01
    assert float(np.linalg.norm(fit.now_from_before.translation - moved.inverse().translation)) < 0.02


def test_bundle_adjustment_recovers_poses_and_points() -> None:
    rng = np.random.default_rng(4)
    points = np.column_stack([rng.uniform(-1, 1, 80), rng.uniform(-0.8, 0.8, 80), rng.uniform(1.5, 4.0, 80)])
    truth = [pose(tuple(rng.normal(0, 0.05, 3)), tuple(rng.normal(0, 0.1, 3))).inverse() for _ in range(5)]
    frame, landmark = np.tile(np.arange(5), 80), np.repeat(np.arange(80), 5)
    seen = np.array(
        [[*project(points[n][None], truth[k], CAMERA)[0], 1.0] for k, n in zip(frame, landmark, strict=True)]
    )
    turns = np.array([p.rotation for p in truth])
    shifts = np.array([p.translation for p in truth])
    free = np.array([False, True, True, True, True])
    wrong = shifts + np.where(free[:, None], rng.normal(0, 0.03, (5, 3)), 0.0)
    bundle = Bundle(turns, wrong, free, points + rng.normal(0, 0.05, points.shape), frame, landmark, seen)
    adjusted, chi = adjust(bundle, CAMERA, NoiseModel(), iterations=20)
    np.testing.assert_allclose(adjusted.translations, shifts, atol=1e-4)
    np.testing.assert_allclose(adjusted.landmarks, points, atol=1e-3)
    assert chi.max() < 1e-2
    starts, sigma = np.arange(0, 401, 5), np.array([0.7, 0.005, 1.5])
    plain = [
        (
            ((project(bundle.landmarks[n][None], Pose3(turns[k], wrong[k]), CAMERA)[0] - seen[e, :3])[:2] / 0.7) ** 2
        ).sum()
        for e, (k, n) in enumerate(zip(frame, landmark, strict=True))
    ]
    kernel, _ = chi_kernel(turns, wrong, bundle.landmarks, frame, starts, seen, CAMERA, sigma)
    np.testing.assert_allclose(kernel, plain, rtol=1e-9)


@pytest.mark.nightly
def test_the_beginning_of_real_pictures_of_a_camera_that_rolls_is_followed(data_dir: Path) -> None:
    folder = data_dir / "rgbd_tum_fr1_rpy_head"
    frames = list(islice(read_recording(folder).pictures(), 40))
    _, poses, states = followed(frames)
    assert states == [PictureOutcome.STARTED] + [PictureOutcome.FOLLOWED] * 39
    truth = read_truth(folder)
    near = [int(np.abs(truth.stamps_ns - frame.stamp_ns).argmin()) for frame in frames]
    world_from_first = Pose3(truth.rotations[near[0]], truth.positions[near[0]])
    end = world_from_first @ poses[-1]  # type: ignore[operator]
    assert float(np.linalg.norm(end.translation - truth.positions[near[-1]])) < 0.05
