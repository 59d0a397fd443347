"""`waychair map --depth` and `waychair export --ply` on a small bag with pictures."""

from __future__ import annotations

import importlib.util
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from evaluation.scenes.maps.depth_drive import drive_with_pictures

from waychair.calibration.chair_body import CHAIR_A
from waychair.cli.main import app
from waychair.errors import MapError, MissingExtra, NoPictures, RecordingNotFound
from waychair.offline import cloud_export
from waychair.offline.cloud_export import export_cloud
from waychair.recordings.bags.rosbag_writer import RecordingWriter
from waychair.recordings.recording import read_recording
from waychair.simulation.plan.world import load_world
from waychair.simulation.sensors.renderer import renderer_problem
from waychair.trials.record import mounts_of
from waychair.types import RgbdFrame, SensorFrame

rendered = pytest.mark.skipif(renderer_problem() is not None, reason="this machine cannot render pictures")
clouds = pytest.mark.skipif(importlib.util.find_spec("open3d") is None, reason="Open3D is not installed")


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a bag of five seconds past a stairwell, with small pictures twice a second."""
    path, world = tmp_path_factory.mktemp("bags") / "stairs.mcap", load_world("stairs")
    messages: list[SensorFrame | RgbdFrame] = []
    drive_with_pictures(world, world.route(), messages.append, camera_hz=2.0, size=(160, 120), until_ns=5_000_000_000)
    with RecordingWriter(path, mounts_of(CHAIR_A, 0.4), ticks_per_turn=CHAIR_A.ticks_per_turn) as writer:
        for message in messages:
            each = (message,) if isinstance(message, RgbdFrame) else (*message.wheels, *message.imu, message.scan)
            for one in each:
                assert one is not None
                writer.write(replace(one, stamp_ns=one.stamp_ns + 10**18))
    return path


@rendered
def test_the_camera_mount_is_read_from_the_bag(bag: Path) -> None:
    mount = read_recording(bag).camera_mount()
    assert mount is not None
    np.testing.assert_allclose(mount.rotation, CHAIR_A.base_from_camera.rotation, atol=1e-9)
    np.testing.assert_allclose(mount.translation, CHAIR_A.base_from_camera.translation, atol=1e-9)


@rendered
def test_the_pictures_of_a_bag_are_drawn_unless_they_are_switched_off(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for use in ("on", "off"):
        app(["map", str(bag), "--out", str(tmp_path / use), "--depth", use])
    report = json.loads((tmp_path / "on" / "report.json").read_text())
    assert report["depth"]["kept"] >= 4
    assert (tmp_path / "on" / "depth.yaml").is_file()
    assert not (tmp_path / "off" / "depth.yaml").exists()
    assert "pictures with" in capsys.readouterr().out


@rendered
@clouds
def test_the_cloud_of_a_bag_and_of_its_map_is_written_completely(bag: Path, tmp_path: Path) -> None:
    app(["map", str(bag), "--out", str(tmp_path / "map"), "--quiet"])
    done = [export_cloud(source, tmp_path / f"{k}.ply") for k, source in enumerate((bag, tmp_path / "map"))]
    assert done[0] == done[1]
    assert done[0].points > 1000
    assert (tmp_path / "0.ply").read_bytes().startswith(b"ply")
    assert sorted(path.name for path in tmp_path.glob("*")) == ["0.ply", "1.ply", "map"]


def test_without_open3d_one_sentence_says_how_to_install_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(name: str) -> None:
        raise ImportError(f"No module named '{name}'")

    monkeypatch.setattr(cloud_export.importlib, "import_module", missing)
    with pytest.raises(MissingExtra, match=r"pip install .*\[clouds\]"):
        export_cloud(tmp_path, tmp_path / "cloud.ply")
    assert not (tmp_path / "cloud.ply").exists()


@clouds
def test_an_impossible_export_is_refused_and_leaves_no_file(tmp_path: Path, data_dir: Path) -> None:
    cloud = tmp_path / "cloud.ply"
    with pytest.raises(RecordingNotFound):
        export_cloud(tmp_path / "nothing.mcap", cloud)
    made = tmp_path / "map"
    made.mkdir()
    (made / "trajectory.tum").write_text("")
    (made / "report.json").write_text("{}")
    with pytest.raises(MapError, match="make the map again"):
        export_cloud(made, cloud)
    (made / "report.json").write_text(json.dumps({"input": str(tmp_path / "gone.mcap")}))
    with pytest.raises(RecordingNotFound):
        export_cloud(made, cloud)
    with pytest.raises(NoPictures):
        export_cloud(data_dir / "lidar_fr079" / "fr079_laser.clf.gz", cloud)
    assert not cloud.exists()
