"""A bag whose colour and depth are of two cameras: told in the report of its map, and used by the estimate where asked."""

from __future__ import annotations

import importlib.util
import json
import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.slam.conftest import WALLS, scan_at
from tests.slam.flat_pictures import BASE_FROM_CAMERA, WALL_HEIGHT, picture_at
from waychair.cli.main import app
from waychair.maps.folders.depth_layer import load_depth_layer
from waychair.offline.camera_check import checked_pictures
from waychair.offline.cloud_export import PosedImage, posed_images
from waychair.offline.mapping import MappingSettings, map_recording
from waychair.offline.sessions import continue_map, load_state
from waychair.recordings.bags.ros_messages import CAMERA_FRAME, CAMERA_FROM_OPTICAL, LASER_FRAME
from waychair.recordings.bags.rosbag_writer import RecordingWriter
from waychair.recordings.recording import InputSettings, Recording, read_recording
from waychair.recordings.rgbd_folders import RgbdSettings
from waychair.slam.camera.camera_fit import PICTURES
from waychair.slam.camera.coloured_points import coloured_points
from waychair.slam.mapping.live_mapping import LiveMapping
from waychair.types import Json, Odometry, Pose2, Pose3, RgbdFrame

clouds = pytest.mark.skipif(importlib.util.find_spec("open3d") is None, reason="Open3D is not installed")

APART = Pose2(0.0, -0.05, -0.035)
"""The depth sensor from the colour sensor, in the chair's axes: 5 cm to the right of it, and turned by 2 degrees."""

START_NS, STEP_NS = 10**18, 100_000_000
MOUNTS = {
    LASER_FRAME: Pose3(np.eye(3), np.array([0.0, 0.0, 0.3])),
    CAMERA_FRAME: Pose3(BASE_FROM_CAMERA.rotation @ CAMERA_FROM_OPTICAL.rotation.T, BASE_FROM_CAMERA.translation),
}


def swaying(count: int) -> list[Pose2]:
    """Return poses of a chair that drives slowly, and looks left and right."""
    return [Pose2(1.5 + 0.02 * k, 1.8, 0.5 * math.sin(0.25 * k)) for k in range(count)]


def written(path: Path, depth_from: Pose2 | None, count: int = 40) -> Path:
    """Write a drive with scans, odometry and, unless `depth_from` is None, pictures whose depth is seen from there."""
    poses = swaying(count)
    with RecordingWriter(path, MOUNTS) as writer:
        for k, pose in enumerate(poses):
            stamp = START_NS + k * STEP_NS
            writer.write(Odometry(stamp, poses[0].inverse() @ pose))
            writer.write(scan_at(pose, stamp, noise=0.005, seed=k))
            if depth_from is not None:
                seen = picture_at(pose @ depth_from, stamp).depth
                writer.write(replace(picture_at(pose, stamp), depth=seen))
    return path


@pytest.fixture(scope="module")
def unregistered(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(tmp_path_factory.mktemp("bags") / "unregistered.mcap", APART)


def mapped(bag: Path, out: Path, *options: str) -> Json:
    app(["map", str(bag), "--out", str(out), "--vision", "off", *options])
    report: Json = json.loads((out / "report.json").read_text())
    return report


def test_depth_that_is_not_registered_is_told_in_the_report_and_on_standard_error(
    unregistered: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    report = mapped(unregistered, tmp_path)
    camera, seconds, warnings = report["camera"], report["cpu_seconds"], report["warnings"]
    assert (camera["registered"], camera["focal_right"], camera["estimate_used"]) == (False, True, False)
    assert camera["offset_m"][0] == pytest.approx(0.05, abs=0.006)
    assert camera["rotation_deg"] == pytest.approx(2.0, abs=0.3)
    assert 0.0 < seconds["camera"] < seconds["total"]
    (told,) = [warning for warning in warnings if "not registered" in warning]
    assert told.endswith("--register auto uses the estimate")
    assert f"warning: {told}" in capsys.readouterr().err


def off_the_walls(images: Iterator[PosedImage]) -> float:
    """Return the mean distance [m] of a cloud's points from the nearest wall of the flat."""
    clouds = [coloured_points(image.picture, image.map_from_camera, 4.0)[0] for image in images]
    points = np.concatenate(clouds)[::20]
    points = points[(points[:, 2] > 0.2) & (points[:, 2] < WALL_HEIGHT)]
    start = swaying(1)[0]
    at = points[:, :2] + (start.x, start.y)  # the map begins at the chair, which looks along x
    way = WALLS[:, 2:] - WALLS[:, :2]
    offset = at[:, None] - WALLS[:, :2]
    share = np.clip((offset * way).sum(axis=2) / (way**2).sum(axis=1), 0.0, 1.0)
    return float(np.linalg.norm(offset - share[..., None] * way, axis=2).min(axis=1).mean())


@pytest.mark.nightly
def test_with_auto_the_estimate_is_used_by_the_map_and_by_the_cloud(
    unregistered: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    report = mapped(unregistered, tmp_path, "--register", "auto")
    camera, warnings = report["camera"], report["warnings"]
    assert camera["estimate_used"]
    assert any("not registered" in warning and warning.endswith("this is used") for warning in warnings)
    assert "changes nothing" not in capsys.readouterr().err
    auto = MappingSettings(input=InputSettings(rgbd=RgbdSettings(register="auto")))
    errors = {}
    for name, source, settings in (
        ("as told", unregistered, MappingSettings()),
        ("by the estimate", unregistered, auto),
        ("of the map", tmp_path, MappingSettings()),  # which was made with the estimate
    ):
        images, (told,) = posed_images(source, settings)
        errors[name] = off_the_walls(images)
        assert told.endswith("--register auto uses the estimate" if name == "as told" else "this is used")
    assert errors["by the estimate"] < 0.6 * errors["as told"]
    assert errors["of the map"] == pytest.approx(errors["by the estimate"], rel=0.05)


@pytest.mark.nightly
def test_a_map_of_depth_alone_is_made_by_the_estimated_camera(unregistered: Path, tmp_path: Path) -> None:
    camera = mapped(unregistered, tmp_path, "--depth", "only", "--register", "auto")["camera"]
    assert (camera["registered"], camera["estimate_used"]) == (False, True)


def test_a_map_with_depth_is_taken_up_with_its_depth_for_a_further_drive(unregistered: Path, tmp_path: Path) -> None:
    kept = mapped(unregistered, tmp_path)["depth"]["kept"]
    live = LiveMapping(MappingSettings(), Pose2(), base_from_camera=BASE_FROM_CAMERA)
    grid = continue_map(live, load_state(tmp_path))
    assert len(live.depth.assembly) == kept > 0
    layer = load_depth_layer(tmp_path, grid)
    taken_up = live.layered_grid()[1]
    assert layer is not None
    assert taken_up is not None
    np.testing.assert_array_equal(taken_up.cells > 0, layer.cells > 0)


@clouds
def test_an_exported_cloud_tells_that_the_camera_does_not_fit(
    unregistered: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    app(["export", str(unregistered), "--ply", str(tmp_path / "cloud.ply")])
    assert "warning: depth is not registered to colour" in capsys.readouterr().err


def test_a_bag_whose_camera_fits_gets_no_warning(tmp_path: Path) -> None:
    recording = read_recording(written(tmp_path / "fits.mcap", Pose2()))
    checked = checked_pictures(recording, "auto")
    assert checked.data()["registered"]
    assert checked.data()["focal_right"]
    assert checked.sentences() == []
    assert checked.recording is recording


def test_a_recording_whose_pictures_are_not_used_is_not_checked(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    report = mapped(written(tmp_path / "blind.mcap", None, 12), tmp_path / "map", "--register", "auto")
    assert "camera" not in {*report, *report["cpu_seconds"]}
    assert "--register changes nothing: no pictures of colour and depth are used here" in capsys.readouterr().err
    read: list[str] = []

    def pictures() -> Iterator[RgbdFrame]:
        read.append("read")
        return iter(())

    settings = MappingSettings(vision="off")
    recording = replace(read_recording(tmp_path / "blind.mcap"), pictures=pictures)
    map_recording(recording, replace(settings, depth=replace(settings.depth, use="off")))
    assert read == []


def counted(pictures: Callable[[int], RgbdFrame], seen: list[int]) -> Iterator[RgbdFrame]:
    for k in range(1000):
        seen.append(k)
        yield pictures(k)


def test_a_drive_without_a_turn_is_read_no_further_than_the_first_pictures() -> None:
    still, seen = picture_at(swaying(1)[0], 0), list[int]()
    small = replace(still, image=still.image[:60, :80], depth=still.depth[:60, :80])
    recording = Recording(
        Path("still"),
        (),
        Pose2(),
        "made",
        pictures=lambda: counted(lambda k: replace(small, stamp_ns=k * STEP_NS), seen),
    )
    checked = checked_pictures(recording, "auto")
    assert "too few" in checked.data()["turns"]
    assert checked.recording is recording
    assert len(seen) == PICTURES
