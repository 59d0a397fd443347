"""Folders of colour and depth pictures: real ones, and every fault that one may have."""

from __future__ import annotations

import math
from collections import Counter
from pathlib import Path

import cv2
import numpy as np
import pytest

from waychair.errors import ConfigError, RecordingDamaged, RecordingNotFound
from waychair.recordings.recording import InputSettings, read_recording, write_tum
from waychair.recordings.rgbd_folders import (
    READOUT,
    RgbdSettings,
    camera_from_text,
    frames_of,
    read_rgbd_folder,
    read_truth,
)
from waychair.types import Trajectory3


def tum(folder: Path, count: int = 5, depth_late: float = 0.01) -> Path:
    """A folder of pictures without lists: the names are the stamps."""
    (folder / "rgb").mkdir(parents=True)
    (folder / "depth").mkdir()
    for k in range(count):
        cv2.imwrite(str(folder / "rgb" / f"{100 + k:.6f}.png"), np.full((480, 640, 3), (10 * k, 20, 30), np.uint8))
        depth = np.full((480, 640), 5000 * (k + 1), np.uint16)
        depth[0, 0] = 0
        cv2.imwrite(str(folder / "depth" / f"{100 + k + depth_late:.6f}.png"), depth)
    return folder


def numbered(folder: Path, count: int = 3) -> Path:
    folder.mkdir()
    for k in range(count):
        cv2.imwrite(str(folder / f"frame-{k:06d}.color.png"), np.zeros((6, 8, 3), np.uint8))
        depth = np.full((6, 8), 1500, np.uint16)
        depth[0, 0] = 65535
        cv2.imwrite(str(folder / f"frame-{k:06d}.depth.png"), depth)
    return folder


def test_the_real_folders_are_read_completely_with_their_cameras(data_dir: Path) -> None:
    desk = read_recording(data_dir / "rgbd_tum_fr1_rpy_head")
    assert desk.picture_count == 210
    assert "fr1" in desk.source
    assert desk.warnings == ()
    frame = next(desk.pictures())
    assert (frame.image.shape, frame.depth.shape) == ((480, 640, 3), (480, 640))
    assert frame.stamp_ns == 1305031229528748000
    assert frame.row_step * 480 == pytest.approx(READOUT)
    assert 0.5 < float(np.nanmedian(frame.depth)) < 5.0
    kitchen = read_recording(data_dir / "rgbd_tsdf_sample50")
    assert kitchen.picture_count == 50
    assert next(kitchen.pictures()).camera_matrix[0, 0] == 585.0
    assert len(read_truth(data_dir / "rgbd_tum_fr1_rpy_head").stamps_ns) == 1756
    assert len(read_truth(data_dir / "rgbd_tsdf_sample50").stamps_ns) == 50


def test_pictures_are_paired_by_name_with_depth_in_metres_and_colour_as_rgb(tmp_path: Path) -> None:
    recording = read_recording(tum(tmp_path / "rgbd_freiburg3_desk"))
    frames = list(recording.pictures())
    assert [frame.stamp_ns for frame in frames] == [(100 + k) * 10**9 for k in range(5)]
    assert frames[2].depth[3, 3] == 3.0
    assert math.isnan(frames[2].depth[0, 0])
    assert frames[2].image[3, 3].tolist() == [30, 20, 20]
    assert frames[0].camera_matrix[0, 0] == 535.4


def test_lists_are_followed_and_their_invalid_lines_named(tmp_path: Path) -> None:
    folder = tum(tmp_path / "fr2")
    for kind in ("rgb", "depth"):
        names = sorted((folder / kind).iterdir())
        (folder / f"{kind}.txt").write_text(
            "# stamp file\n" + "".join(f"{f.stem} {kind}/{f.name}\n" for f in names[:3])
        )
    assert read_recording(folder).picture_count == 3
    (folder / "associations.txt").write_text("100.01 depth/100.010000.png 100.0 rgb/100.000000.png\n")
    pair = read_rgbd_folder(folder, RgbdSettings()).pairs[0]
    assert (pair.colour.parent.name, pair.stamp_ns) == ("rgb", 100 * 10**9)
    (folder / "associations.txt").write_text("100.0 rgb/100.000000.png\n")
    with pytest.raises(RecordingDamaged, match="line 1 is not"):
        read_recording(folder)


@pytest.mark.parametrize("depth_first", [False, True])
@pytest.mark.parametrize("folders", [("color", "aligned"), ("left", "depth_registered")])
def test_a_list_of_pairs_may_name_other_folders(tmp_path: Path, folders: tuple[str, str], depth_first: bool) -> None:
    tum(tmp_path / "drive")
    for old, new in zip(("rgb", "depth"), folders, strict=True):
        (tmp_path / "drive" / old).rename(tmp_path / "drive" / new)
    pairs = [
        [f"{100 + k:.6f} {folders[0]}/{100 + k:.6f}.png", f"{100.01 + k:.6f} {folders[1]}/{100.01 + k:.6f}.png"]
        for k in range(5)
    ]
    lines = [" ".join(pair[::-1] if depth_first else pair) for pair in pairs]
    (tmp_path / "drive" / "associations.txt").write_text("\n".join(lines))
    for given in (tmp_path / "drive", tmp_path):
        recording = read_recording(given)
        frames = list(recording.pictures())
        assert len(frames) == recording.listed == 5
        assert [float(frame.depth[1, 1]) for frame in frames] == pytest.approx([1.0, 2.0, 3.0, 4.0, 5.0])
        assert frames[3].image[0, 0].tolist() == [30, 20, 30]


def test_missing_damaged_and_wrong_pictures_are_left_out_and_counted(tmp_path: Path) -> None:
    folder = numbered(tmp_path / "room", 6)
    (folder / "frame-000001.depth.png").unlink()
    (folder / "frame-000002.color.png").write_bytes(b"\x89PNG broken")
    (folder / "frame-000003.color.png").write_bytes(b"")
    cv2.imwrite(str(folder / "frame-000004.depth.png"), np.full((3, 4), 1500, np.uint16))
    unread: Counter[str] = Counter()
    frames = list(frames_of(read_rgbd_folder(folder, RgbdSettings()), unread))
    assert [frame.stamp_ns for frame in frames] == [0, round(5 / 30 * 1e9)]
    assert unread == {
        "picture is missing": 1,
        "picture cannot be decoded": 2,
        "colour and depth differ in size": 1,
    }
    assert math.isnan(frames[0].depth[0, 0])
    assert frames[0].depth[1, 1] == pytest.approx(1.5)


def test_colour_without_depth_in_time_gives_a_warning_and_no_depth_at_all_is_refused(tmp_path: Path) -> None:
    folder = tum(tmp_path / "fr1")
    min((folder / "depth").iterdir()).unlink()
    alone = "1 colour pictures have no depth within 0.02 s: the nearest is 1.01 s away"
    assert read_recording(folder).warnings == (alone, "1 of 5 pictures are lost: 4 pairs are used")
    with pytest.raises(RecordingDamaged, match="no colour picture"):
        read_recording(tum(tmp_path / "late_fr1", depth_late=0.3))


def test_unordered_pairs_are_sorted(tmp_path: Path) -> None:
    folder = tum(tmp_path / "fr1")
    lines = [f"{s} rgb/{s}.000000.png {s}.01 depth/{s}.010000.png\n" for s in (100, 102, 101, 101, 103)]
    (folder / "associations.txt").write_text("".join(lines))
    recording = read_recording(folder)
    assert [frame.stamp_ns // 10**9 for frame in recording.pictures()] == [100, 101, 102, 103]
    assert "not later than the one before" in recording.warnings[0]


def test_an_unknown_camera_gives_a_warning_and_one_can_be_given(tmp_path: Path) -> None:
    folder = tum(tmp_path / "office")
    assert "is not known" in read_recording(folder).warnings[0]
    named = InputSettings(rgbd=RgbdSettings(camera="500,501,320,240"))
    recording = read_recording(folder, named)
    assert recording.warnings == ()
    frame = next(recording.pictures())
    assert frame.camera_matrix[1, 1] == 501.0
    assert frame.row_step == 0.0
    (folder / "camera-intrinsics.txt").write_text("400 0 4\n0 400 3\n0 0 1\n")
    assert next(read_recording(folder).pictures()).camera_matrix[0, 0] == 400.0
    (folder / "camera-intrinsics.txt").write_text("400 0 4\n0 zero 3\n")
    with pytest.raises(RecordingDamaged, match="not a matrix"):
        read_recording(folder)


@pytest.mark.parametrize("text", ["fr9", "1,2,3", "500,-1,3,4", "a,b,c,d", "1,2,3,inf"])
def test_an_unreadable_camera_is_refused_with_advice(text: str) -> None:
    with pytest.raises(ConfigError, match="give fr1, fr2, fr3"):
        camera_from_text(text)


def test_lens_distortion_is_corrected(tmp_path: Path) -> None:
    """A straight line of the world, drawn as the lens bends it, is straight in the frame, in colour and in depth."""
    (tmp_path / "rgb").mkdir()
    (tmp_path / "depth").mkdir()
    camera = camera_from_text("fr1")
    image, depth = np.zeros((480, 640, 3), np.uint8), np.full((480, 640), 5000, np.uint16)
    line = np.column_stack([np.full(300, -0.4), np.linspace(-0.4, 0.4, 300), np.ones(300)])
    bent = cv2.projectPoints(line, np.zeros(3), np.zeros(3), camera.matrix, camera.distortion)[0].reshape(-1, 2)
    for x, y in bent.round().astype(int).tolist():
        if 0 <= y < 480:
            image[y, x - 1 : x + 2], depth[y, x - 1 : x + 2] = 255, 10000
    cv2.imwrite(str(tmp_path / "rgb" / "1.0.png"), image)
    cv2.imwrite(str(tmp_path / "depth" / "1.0.png"), depth)
    frame = next(read_recording(tmp_path, InputSettings(rgbd=RgbdSettings(camera="fr1"))).pictures())
    expected = camera.matrix[0, 2] - 0.4 * camera.matrix[0, 0]
    for picture in (frame.image[..., 0] > 100, frame.depth > 1.5):
        columns = [np.flatnonzero(picture[row]).mean() for row in range(60, 440) if picture[row].any()]
        assert len(columns) > 250
        assert np.abs(np.array(columns) - expected).max() < 2.0
    assert np.abs(bent[:, 0] - expected).min() > 3.0


def test_a_missing_or_invalid_truth_is_named(tmp_path: Path) -> None:
    folder = tum(tmp_path / "fr1")
    with pytest.raises(RecordingNotFound):
        read_truth(folder)
    (folder / "groundtruth.txt").write_text("1.0 0 0 0 0 0 0 0\n")
    with pytest.raises(RecordingDamaged, match="line 1"):
        read_truth(folder)
    with pytest.raises(RecordingNotFound):
        read_truth(numbered(tmp_path / "room"))


def test_a_folder_of_neither_kind_is_refused_with_the_valid_forms(tmp_path: Path) -> None:
    with pytest.raises(RecordingDamaged, match="rgb/"):
        read_recording(tmp_path)


def test_a_trajectory_in_3d_survives_writing_and_reading(tmp_path: Path) -> None:
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    (tmp_path / "rgb").mkdir()
    (tmp_path / "depth").mkdir()
    trajectory = Trajectory3(np.array([1_500_000_000]), turn[None], np.array([[1.0, 2.0, 3.0]]))
    write_tum(tmp_path / "groundtruth.txt", trajectory)
    again = read_truth(tmp_path)
    np.testing.assert_array_equal(again.stamps_ns, trajectory.stamps_ns)
    np.testing.assert_allclose(again.rotations, trajectory.rotations, atol=1e-8)
    np.testing.assert_allclose(again.positions, trajectory.positions)
