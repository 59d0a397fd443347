"""The RGB-D mapper: loops join separate pieces, every placed frame has a pose, real pictures within the limits."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

from tests.slam.rgbd_scene import noisy, pose, render, sway
from waychair.errors import NoPictures
from waychair.offline.rgbd_mapping import RgbdMappingSettings, map_pictures, save_pictures_map
from waychair.recordings.recording import InputSettings, Recording, read_recording
from waychair.recordings.rgbd_folders import RgbdSettings, read_truth
from waychair.slam.camera import visual_odometry
from waychair.slam.camera.feature_settings import FeatureSettings
from waychair.slam.camera.features import extract, extract_sized
from waychair.slam.camera.picture_registration import angle_between
from waychair.slam.camera.tracked_picture import PictureOutcome
from waychair.slam.camera.visual_map import KeyFrame
from waychair.slam.memory import memory_manager as memory
from waychair.slam.memory.memory_manager import NodeMemory
from waychair.slam.rgbd import rgbd_mapper
from waychair.slam.rgbd.key_places import KeyPlaces, planar_information, planar_pose, planar_poses
from waychair.slam.rgbd.rgbd_mapper import RgbdMapper
from waychair.slam.rgbd.spatial_graph import SpatialEdge, solve_spatial
from waychair.slam.words.recognition_settings import RecognitionSettings
from waychair.types import Pose2, Pose3, RgbdFrame, Trajectory3

STEP = 66_000_000


@pytest.mark.nightly
def test_a_piece_started_elsewhere_is_joined_when_the_camera_returns(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two walls seen apart, the motion between them unseen; then the camera turns from the second to the first."""
    monkeypatch.setattr(rgbd_mapper, "LOOP_INLIERS", 25)
    monkeypatch.setattr(visual_odometry, "KEY_ANGLE", 0.12)
    monkeypatch.setattr(memory, "STM_SIZE", 2)
    first = [render(pose((0, 0.05 * k, 0)), k * STEP) for k in range(6)]
    second = [render(pose((0, 1.9 - 0.05 * k, 0)), (60 + k) * STEP) for k in range(36)]
    mapper = RgbdMapper()
    states = [mapper.process(frame).state for frame in [*first, *second]]
    assert states[6] is PictureOutcome.STARTED
    result = mapper.result()
    assert set(result.pieces) == {0}
    assert len(result.loops) >= 1
    turns = [1.9 - 0.05 * k for k in range(36)]
    for k, turn in enumerate(turns, start=6):
        expected = pose((0, turn, 0))
        found = Pose3(result.trajectory.rotations[k], result.trajectory.positions[k])
        assert angle_between(found, expected) < 0.05
        assert float(np.linalg.norm(found.translation)) < 0.1


@pytest.mark.parametrize(("before", "after"), [(-1.0, 0.0), (0.0, -1.0)])
def test_a_camera_carried_to_half_or_twice_the_distance_is_found_at_once(before: float, after: float) -> None:
    """A wall 2 m behind the origin is seen from 1 m and from 2 m."""
    mapper = RgbdMapper()
    for k in range(4):
        mapper.process(render(pose((0, math.pi, 0), (0.05 * k, 0, before)), k * STEP))
    carried = pose((0, math.pi - 0.05, 0), (0.1, 0, after))
    tracked = mapper.process(render(carried, 40 * STEP))
    assert tracked.state in (PictureOutcome.FOUND, PictureOutcome.FOLLOWED)
    assert tracked.camera_from_map is not None
    first = pose((0, math.pi, 0), (0, 0, before))
    error = tracked.camera_from_map @ first.inverse() @ carried
    assert float(np.linalg.norm(error.translation)) < 0.03


def test_no_frames_give_an_empty_map() -> None:
    result = RgbdMapper().result()
    assert result.trajectory.positions.shape == (0, 3)
    assert result.counts["key_frames"] == 0


def places_of(poses: list[Pose3]) -> KeyPlaces:
    """Key frames at these poses."""
    settings = FeatureSettings(upright=False)
    places, keys = KeyPlaces(RecognitionSettings(features=settings), NodeMemory()), list[KeyFrame]()
    for k, at in enumerate(poses):
        frame = render(at, k * STEP)
        nothing = np.empty(0, np.int64), np.empty((0, 4))
        pyramid, depth = (frame.image,), frame.depth[::4, ::4]
        features, sized = extract(frame, settings), extract_sized(frame, settings)
        keys.append(KeyFrame(frame.stamp_ns, at.inverse(), pyramid, *nothing, features, sized, depth))
        places.add(keys[-1], np.eye(3), planar_poses(keys), 0.0)
    return places


def test_similar_key_frames_are_returned_first_and_none_for_a_blank_picture() -> None:
    places = places_of([pose((0, 0.8 * k, 0)) for k in range(8)])
    asked = extract_sized(render(pose((0, 1.62, 0), (0.02, 0, 0))), FeatureSettings(upright=False))
    assert places.likeliest(asked)[0] == 2
    assert places.likeliest(asked.take(np.zeros(len(asked), bool))) == []
    assert places_of([]).likeliest(asked) == []


@pytest.mark.parametrize(("near_first", "wall"), [(True, 1), (True, 3), (False, 1), (False, 2)])
def test_a_view_of_a_wall_from_half_or_twice_the_distance_resembles_that_wall_most(near_first: bool, wall: int) -> None:
    def view(wall: int, near: bool) -> Pose3:
        turn = 0.5 * math.pi * wall
        way = 1.0 if near else 0.0
        return pose((0, turn, 0), (way * math.sin(turn), 0, way * math.cos(turn)))

    places = places_of([view(wall, near_first) for wall in (1, 2, 3)])
    asked = extract_sized(noisy(render(view(wall, not near_first)), 1), FeatureSettings(upright=False))
    assert places.likeliest(asked)[0] == wall - 1


def test_a_query_picture_does_not_change_the_vocabulary() -> None:
    places = places_of([pose((0, 0.8 * k, 0)) for k in range(4)])
    words = len(places.places.recognition.vocabulary)
    places.likeliest(extract(render(pose((0, 3.0, 0))), FeatureSettings(upright=False)))
    assert len(places.places.recognition.vocabulary) == words


def test_the_planar_pose_of_a_level_camera_is_that_of_a_base_below_it() -> None:
    """The optical frame looks along z and turns about its y axis, which points down."""
    ahead_and_left = pose((0, -0.3, 0), (-0.2, 0.5, 1.0))
    assert planar_pose(ahead_and_left).array() == pytest.approx([1.0, 0.2, 0.3])
    covariance = np.diag([1.0, 2.0, 3.0, 4.0, 5.0, 6.0])  # x, y, z of the optical frame: rotations, then translations
    np.testing.assert_allclose(np.linalg.inv(planar_information(covariance)), np.diag([6.0, 4.0, 2.0]))


@pytest.mark.nightly
def test_a_camera_on_a_second_lap_adds_few_key_frames() -> None:
    once = sway(24, turn=0.2, way=0.15)
    mapper, counts = RgbdMapper(), list[int]()
    for k in range(60):
        mapper.process(noisy(render(once[k % 24], k * STEP), k))
        if k % 24 == 11:
            counts.append(len(mapper.map.key_frames))
    assert counts[2] <= 1.3 * counts[1]
    errors = [np.linalg.norm(p - once[k % 24].translation) for k, p in enumerate(mapper.result().trajectory.positions)]
    assert max(errors) < 0.02


def test_the_weight_of_a_loop_falls_with_its_residual() -> None:
    """Of two loops that contradict each other by half a metre, the path on which three agree is kept."""
    poses = [pose(at=(0.1 * k, 0, 0)) for k in range(21)]
    loose, tight = np.diag([0.02**2] * 6), np.diag([0.01**2] * 6)
    chain = [SpatialEdge(k, k + 1, poses[k].inverse() @ poses[k + 1], loose) for k in range(20)]
    right = [SpatialEdge(k, 20 - k, poses[k].inverse() @ poses[20 - k], tight, True) for k in range(3)]
    wrong = SpatialEdge(0, 20, pose(at=(1.5, 0, 0)), tight)

    def bent_by(loop: bool) -> float:
        edge = dataclasses.replace(wrong, loop=loop)
        solved = solve_spatial(poses, [*chain, *right, edge])
        return float(np.linalg.norm(solved.poses[20].translation - poses[20].translation))

    assert bent_by(loop=True) < 0.01
    assert bent_by(loop=True) < 0.5 * bent_by(loop=False)


def test_a_loop_corrects_a_drifted_path_and_a_false_one_is_found() -> None:
    steps = [pose((0, 0.1, 0), (0.1, 0, 0))] * 20
    truth = [pose()]
    for step in steps:
        truth.append(truth[-1] @ step)
    drift = pose((0, 0.004, 0), (0.003, 0, 0))
    poses = [pose()]
    for step in steps:
        poses.append(poses[-1] @ step @ drift)
    loose, tight = np.diag([0.01**2] * 6), np.diag([0.005**2] * 6)
    chain = [SpatialEdge(k, k + 1, poses[k].inverse() @ poses[k + 1], loose) for k in range(20)]
    loop = SpatialEdge(0, 20, truth[0].inverse() @ truth[20], tight)
    solved = solve_spatial(poses, [*chain, loop])
    assert np.linalg.norm(solved.poses[20].translation - truth[20].translation) < 0.01
    assert np.linalg.norm(poses[20].translation - truth[20].translation) > 0.05
    assert solved.errors.max() < 3.0
    false = dataclasses.replace(loop, i_from_j=pose((0, 1.0, 0), (2.0, 1.0, 0)))
    assert solve_spatial(poses, [*chain, false]).errors.max() > 3.0


def rmse(trajectory: Trajectory3, truth: Trajectory3) -> float:
    """Absolute trajectory error after rigid alignment."""
    near = [int(np.abs(truth.stamps_ns - stamp).argmin()) for stamp in trajectory.stamps_ns]
    p, q = trajectory.positions, truth.positions[near]
    a, b = p - p.mean(axis=0), q - q.mean(axis=0)
    u, _, v = np.linalg.svd(b.T @ a)
    turn = u @ np.diag([1, 1, np.sign(np.linalg.det(u @ v))]) @ v
    return float(np.sqrt(((b - a @ turn.T) ** 2).sum(axis=1).mean()))


def test_the_real_numbered_frames_are_within_the_limit_and_written(data_dir: Path, tmp_path: Path) -> None:
    folder = data_dir / "rgbd_tsdf_sample50"
    mapping = map_pictures(read_recording(folder), RgbdMappingSettings(), keep_in=tmp_path)
    assert mapping.report["placed"] == 50
    assert mapping.report["times_real_time"] > 0.0
    search = mapping.report["loop_search"]
    assert search["proposed"] >= search["verified"] >= search["closed"] + search["rejected"]
    assert rmse(mapping.result.trajectory, read_truth(folder)) < 0.03
    save_pictures_map(tmp_path, mapping, RgbdMappingSettings())
    assert {file.name for file in tmp_path.iterdir()} == {"trajectory.tum", "config.yaml", "report.json", "memory.db"}
    kept = NodeMemory.opened(tmp_path / "memory.db")
    counts = mapping.report["memory"]["memory"]
    assert len(kept.skeleton.ids()) == counts["stm"] + counts["wm"] > 5
    assert len(kept.node(1).words) > 100
    kept.close()
    lines = (tmp_path / "trajectory.tum").read_text().splitlines()
    assert len(lines) == 50
    assert all(len(line.split()) == 8 for line in lines)


def test_pictures_without_features_are_refused_in_one_sentence(tmp_path: Path) -> None:
    frame = render(pose())
    black = dataclasses.replace(frame, image=np.zeros_like(frame.image))
    recording = Recording(Path("dark"), (), Pose2(), "test", pictures=lambda: iter([black, black]))
    with pytest.raises(NoPictures, match=r"nothing to be seen in it .*: 1"):
        map_pictures(recording, RgbdMappingSettings(), keep_in=tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_pictures_out_of_order_are_left_out_and_counted() -> None:
    frames: list[RgbdFrame] = [render(pose(at=(0.01 * k, 0, 0)), k * STEP) for k in (0, 1, 3, 2, 4)]
    recording = Recording(Path("mixed"), (), Pose2(), "test", pictures=lambda: iter(frames))
    report = map_pictures(recording, RgbdMappingSettings()).report
    assert report["placed"] == 4
    assert report["warnings"] == ["1 pictures left out: picture is not later than the one before"]


def test_a_camera_named_in_the_settings_is_used(data_dir: Path) -> None:
    settings = InputSettings(rgbd=RgbdSettings(camera="fr3"))
    frame = next(read_recording(data_dir / "rgbd_tum_fr1_rpy_head", settings).pictures())
    assert frame.camera_matrix[0, 0] == 535.4
