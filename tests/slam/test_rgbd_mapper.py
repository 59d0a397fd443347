"""The map of pictures: loops join what was seen apart, every placed frame has a pose, real pictures within the bars."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from tests.slam.rgbd_scene import pose, render
from waychair.errors import NoPictures
from waychair.recording import InputSettings, Recording, read_recording
from waychair.rgbd_folders import RgbdSettings, read_truth
from waychair.runtime.rgbd_mapping import RgbdMappingSettings, map_pictures, save_pictures_map
from waychair.slam.features import FeatureSettings, extract
from waychair.slam.key_frame_vote import KeyFrameVote
from waychair.slam.registration import angle_between
from waychair.slam.rgbd_mapper import RgbdMapper, RgbdMapperSettings
from waychair.slam.spatial_graph import SpatialEdge, SpatialSettings, solve_spatial
from waychair.slam.visual_odometry import OdometrySettings, Track
from waychair.types import Pose2, Pose3, RgbdFrame, Trajectory3

STEP = 66_000_000


def test_a_piece_begun_elsewhere_is_joined_when_the_camera_comes_back() -> None:
    """Two walls seen apart, the motion between them unseen; then the camera turns from the second to the first."""
    often = RgbdMapperSettings(loop_gap=2, loop_every=1, loop_inliers=25, odometry=OdometrySettings(key_angle=0.12))
    first = [render(pose((0, 0.05 * k, 0)), k * STEP) for k in range(6)]
    second = [render(pose((0, 1.9 - 0.05 * k, 0)), (60 + k) * STEP) for k in range(36)]
    mapper = RgbdMapper(often)
    states = [mapper.process(frame).state for frame in [*first, *second]]
    assert states[6] is Track.STARTED
    result = mapper.result()
    assert set(result.pieces) == {0}
    assert len(result.loops) >= 1
    turns = [1.9 - 0.05 * k for k in range(36)]
    for k, turn in enumerate(turns, start=6):
        expected = pose((0, turn, 0))
        found = Pose3(result.trajectory.rotations[k], result.trajectory.positions[k])
        assert angle_between(found, expected) < 0.05
        assert float(np.linalg.norm(found.translation)) < 0.1


def test_no_frames_give_an_empty_map() -> None:
    result = RgbdMapper().result()
    assert result.trajectory.positions.shape == (0, 3)
    assert result.counts["key_frames"] == 0


def test_key_frames_that_look_alike_are_named_first_and_the_excluded_never() -> None:
    vote, settings = KeyFrameVote(), FeatureSettings(upright=False)
    views = [extract(render(pose((0, 0.8 * k, 0))), settings) for k in range(6)]
    for features in views:
        vote.add(features)
    asked = extract(render(pose((0, 1.62, 0), (0.02, 0, 0))), settings)
    assert vote.candidates(asked)[0] == 2
    assert 2 not in vote.candidates(asked, excluded=[2])
    assert vote.candidates(asked.take(np.zeros(len(asked), bool))) == []
    assert KeyFrameVote().candidates(asked) == []


def test_a_loop_bends_a_drifted_way_back_and_a_false_one_shows() -> None:
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
    solved = solve_spatial(poses, [*chain, loop], SpatialSettings())
    assert np.linalg.norm(solved.poses[20].translation - truth[20].translation) < 0.01
    assert np.linalg.norm(poses[20].translation - truth[20].translation) > 0.05
    assert solved.errors.max() < 3.0
    false = dataclasses.replace(loop, i_from_j=pose((0, 1.0, 0), (2.0, 1.0, 0)))
    assert solve_spatial(poses, [*chain, false], SpatialSettings()).errors.max() > 3.0


def rmse(trajectory: Trajectory3, truth: Trajectory3) -> float:
    """Absolute trajectory error after rigid alignment."""
    near = [int(np.abs(truth.stamps_ns - stamp).argmin()) for stamp in trajectory.stamps_ns]
    p, q = trajectory.positions, truth.positions[near]
    a, b = p - p.mean(axis=0), q - q.mean(axis=0)
    u, _, v = np.linalg.svd(b.T @ a)
    turn = u @ np.diag([1, 1, np.sign(np.linalg.det(u @ v))]) @ v
    return float(np.sqrt(((b - a @ turn.T) ** 2).sum(axis=1).mean()))


def test_the_real_numbered_frames_are_within_the_bar_and_written(data_dir: Path, tmp_path: Path) -> None:
    folder = data_dir / "rgbd_tsdf_sample50"
    mapping = map_pictures(read_recording(folder), RgbdMappingSettings())
    assert mapping.report["placed"] == 50
    assert rmse(mapping.result.trajectory, read_truth(folder)) < 0.03
    save_pictures_map(tmp_path, mapping, RgbdMappingSettings())
    assert {file.name for file in tmp_path.iterdir()} == {"trajectory.tum", "config.yaml", "report.json"}
    lines = (tmp_path / "trajectory.tum").read_text().splitlines()
    assert len(lines) == 50
    assert all(len(line.split()) == 8 for line in lines)


def test_pictures_in_which_nothing_is_to_be_seen_are_refused_in_one_sentence() -> None:
    frame = render(pose())
    black = dataclasses.replace(frame, image=np.zeros_like(frame.image))
    recording = Recording(Path("dark"), (), Pose2(), "test", pictures=lambda: iter([black, black]))
    with pytest.raises(NoPictures, match="1 nothing to be seen in it"):
        map_pictures(recording, RgbdMappingSettings())


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
