"""Recordings on the command line: damaged and unusual ones, interrupted and resumed runs, localising, evaluating."""

from __future__ import annotations

import json
import math
import signal
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.bags import SECOND, Bag, room_ranges
from tests.cli.command import refused, waychair
from tests.full_disk import content, files_up_to
from waychair.errors import OutputError
from waychair.offline.mapping import MappingSettings, map_recording, save_mapping
from waychair.recordings.recording import InputSettings, Recording, read_recording, read_tum
from waychair.types import Pose2


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a ROS 1 bag of a drive through the room, with motion and mount only in /tf."""
    path = tmp_path_factory.mktemp("bag") / "drive.bag"
    bag = Bag(path, ros=1)
    turn = (0.0, 0.0, math.sin(0.1), math.cos(0.1))
    bag.mount(SECOND, ("base_link", "laser", (0.3, 0.0, 0.2), turn))
    for k in range(60):
        now, pose = (k + 1) * SECOND // 10, Pose2(2.0 + 0.08 * k, 3.0, 0.01 * k)
        quaternion = (0.0, 0.0, math.sin(pose.theta / 2), math.cos(pose.theta / 2))
        bag.mount(now, ("odom", "base_link", (pose.x, pose.y, 0.0), quaternion), topic="/tf")
        bag.room(now, pose @ Pose2(0.3, 0.0, 0.2), "/scan", "laser")
    bag.close()
    return path


def test_a_truncated_bag_is_mapped_and_the_damage_named(drive: Path, tmp_path: Path) -> None:
    data = drive.read_bytes()
    (tmp_path / "cut.bag").write_bytes(data[: 2 * len(data) // 3])
    done = waychair("map", tmp_path / "cut.bag", "--out", tmp_path / "map")
    assert done.returncode == 0, done.stderr
    assert "cut.bag is damaged (" in done.stderr.replace("\n", " ")
    report = json.loads((tmp_path / "map" / "report.json").read_text())
    assert 30 < report["frames"] < 60
    assert any("scans that can be read" in warning for warning in report["warnings"])
    assert "Warnings" in (tmp_path / "map" / "report.html").read_text()


def test_a_map_with_drawings_is_not_overwritten_by_another_one(drive: Path, tmp_path: Path) -> None:
    out = tmp_path / "map"
    assert waychair("map", drive, "--out", out).returncode == 0
    assert waychair("places", "--map", out, "--add", "desk", "0.5,0,0").returncode == 0
    again = waychair("map", drive, "--out", out)
    assert again.returncode == 0, again.stderr
    before = (out / "map.pgm").read_bytes()
    other = carmen(tmp_path / "other.clf", [(100.0 + 0.2 * k, "") for k in range(25)])
    sentence = refused(waychair("map", other, "--out", out))
    assert "are those of another map: choose another folder with --out, or join the drive" in sentence
    assert (out / "map.pgm").read_bytes() == before
    assert "desk" in waychair("places", "--map", out).stdout
    elsewhere = tmp_path / "elsewhere"
    assert waychair("map", other, "--out", elsewhere).returncode == 0
    assert "choose another folder with --out" in refused(waychair("map", drive, "--session", elsewhere, "--out", out))


def carmen(path: Path, rows: list[tuple[float, str]]) -> Path:
    """Write a CARMEN log with these stamps and ranges (one text for all beams; the room's if empty)."""
    lines = []
    for k, (stamp, text) in enumerate(rows):
        x = 2.0 + 0.1 * k
        ranges = room_ranges(Pose2(x, 3.0), np.radians(np.arange(-90.0, 90.0)))
        numbers = " ".join([text] * 180 if text else [f"{value:.3f}" for value in ranges])
        lines.append(f"FLASER 180 {numbers} {x} 3 0 {x} 3 0 {stamp:.3f} host {stamp:.3f}")
    path.write_text("\n".join(lines) + "\n")
    return path


def test_stamps_that_step_back_and_empty_scans_give_warnings(tmp_path: Path) -> None:
    rows = [(100.0 + 0.2 * k - (3.0 if k == 10 else 0.0), {4: "nan", 5: "inf", 6: "-1"}.get(k, "")) for k in range(25)]
    done = waychair("map", carmen(tmp_path / "log.clf", rows), "--out", tmp_path / "map")
    assert done.returncode == 0, done.stderr
    told = " ".join(done.stderr.split())
    assert "warning: stamps step backwards 1 times" in told
    assert "warning: 3 of 25 scans hold no distance at all" in told


def test_a_log_without_a_range_reading_is_refused(tmp_path: Path) -> None:
    log = carmen(tmp_path / "blind.clf", [(100.0 + k, "inf") for k in range(5)])
    sentence = refused(waychair("map", log, "--out", tmp_path / "map"))
    assert "none of the 5 scans" in sentence
    assert "check the laser" in sentence
    assert not (tmp_path / "map").exists()


def test_missing_topics_and_a_bad_mount_are_refused_with_the_valid_ones(drive: Path, tmp_path: Path) -> None:
    out = tmp_path / "map"
    assert "only /scan (sensor_msgs/msg/LaserScan), /tf" in refused(
        waychair("map", drive, "--out", out, "--odom", "/odom")
    )
    assert "/scan (sensor" in refused(waychair("map", drive, "--out", out, "--scan", "/scan", "--scan", "/back"))
    assert "X,Y,YAW" in refused(waychair("map", drive, "--out", out, "--base-from-laser", "left"))
    assert "give one for each" in refused(
        waychair("map", drive, "--out", out, "--base-from-laser", "0,0,0", "--base-from-laser=-1,0,0")
    )
    assert not out.exists()


def test_a_mount_that_contradicts_the_motion_is_corrected_with_a_warning(data_dir: Path, tmp_path: Path) -> None:
    log = data_dir / "wheelchair_sena" / "sena_one_loop.clf.gz"
    done = waychair("map", log, "--out", tmp_path / "map", "--base-from-laser", "0.78,0,3.14159")
    assert done.returncode == 0, done.stderr
    told = " ".join(done.stderr.split())
    assert "the lidar: its mount is not as told" in told
    yaw = float(told.partition("They agree best with --base-from-laser ")[2].split(",")[2])
    assert abs(yaw) < 0.05


def interrupted(recording: Recording, settings: MappingSettings, folder: Path, at: float) -> KeyboardInterrupt:
    """Map up to a share of the recording, where the user interrupts it."""

    def stop(share: float) -> None:
        if share >= at:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt) as caught:
        map_recording(recording, settings, stop, keep_in=folder)
    return caught.value


def test_an_interrupted_run_resumes_only_with_the_same_input_and_settings(drive: Path, tmp_path: Path) -> None:
    recording, settings = read_recording(drive), MappingSettings(checkpoint_interval=0.0)
    stop = interrupted(recording, settings, tmp_path, 0.5)
    assert stop.__notes__ == ["run the same command again to resume from its checkpoint"]
    resumed = map_recording(recording, settings, keep_in=tmp_path)
    assert resumed.report["resumed_at_frame"] >= 1
    whole = map_recording(recording, settings)
    np.testing.assert_array_equal(resumed.result.trajectory.poses, whole.result.trajectory.poses)
    np.testing.assert_array_equal(resumed.grid.cells, whole.grid.cells)
    other = MappingSettings(checkpoint_interval=0.0, input=InputSettings(mounts=("0,0,0",)))
    assert map_recording(recording, other, keep_in=tmp_path).report["resumed_at_frame"] == 0
    save_mapping(tmp_path, resumed, settings)
    assert not (tmp_path / "checkpoint.npz").exists()


def signal_at(at: float) -> Callable[[float], None]:
    """Return a progress that presses Ctrl-C once, when a share of the recording is mapped."""
    waiting = [at]

    def press(share: float) -> None:
        if waiting and share >= waiting[0]:
            waiting.clear()
            signal.raise_signal(signal.SIGINT)

    return press


def test_an_interrupt_from_the_keyboard_saves_the_run_where_it_is(drive: Path, tmp_path: Path) -> None:
    recording, settings = read_recording(drive), MappingSettings(checkpoint_interval=1e6)
    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt) as caught:
        map_recording(recording, settings, signal_at(0.41), keep_in=tmp_path)
    assert signal.getsignal(signal.SIGINT) is before
    assert caught.value.__notes__ == ["run the same command again to resume from its checkpoint"]
    assert map_recording(recording, settings, keep_in=tmp_path).report["resumed_at_frame"] == 26


def test_a_full_disk_ends_the_run_in_one_sentence_and_keeps_the_checkpoint_before(drive: Path, tmp_path: Path) -> None:
    recording, settings = read_recording(drive), MappingSettings(checkpoint_interval=1e6)
    with pytest.raises(KeyboardInterrupt):
        map_recording(recording, settings, signal_at(0.3), keep_in=tmp_path)
    before = content(tmp_path)
    room = (tmp_path / "checkpoint.npz").stat().st_size + 500  # a checkpoint grows with the map
    told = rf"^cannot write {tmp_path}/checkpoint\.npz: .+ disk\. The same command goes on from the checkpoint before"
    with files_up_to(room), pytest.raises(OutputError, match=told):
        map_recording(recording, settings, signal_at(0.8), keep_in=tmp_path)
    assert content(tmp_path) == before
    resumed, whole = map_recording(recording, settings, keep_in=tmp_path), map_recording(recording, settings)
    assert resumed.report["resumed_at_frame"] == 19
    np.testing.assert_array_equal(resumed.result.trajectory.poses, whole.result.trajectory.poses)


@pytest.mark.parametrize("damage", [b"", b"PK\x03\x04 nonsense", None])
def test_a_damaged_checkpoint_is_ignored(drive: Path, tmp_path: Path, damage: bytes | None) -> None:
    recording, settings = read_recording(drive), MappingSettings(checkpoint_interval=0.0)
    interrupted(recording, settings, tmp_path, 0.3)
    path = tmp_path / "checkpoint.npz"
    path.write_bytes(path.read_bytes()[:-100] if damage is None else damage)
    assert map_recording(recording, settings, keep_in=tmp_path).report["resumed_at_frame"] == 0


def test_a_recording_is_followed_on_its_own_map_and_evaluated(drive: Path, tmp_path: Path) -> None:
    assert waychair("map", drive, "--out", tmp_path / "map", "--quiet").returncode == 0
    done = waychair("localize", drive, "--map", tmp_path / "map", "--out", tmp_path / "followed", "--start", "0,0,0")
    assert done.returncode == 0, done.stderr
    assert "60 scans over 5 m: " in done.stdout
    report = json.loads((tmp_path / "followed" / "report.json").read_text())
    assert report["states"]["lost"] == 0
    assert report["times_real_time"] > 1.0
    assert set(report["cpu_seconds"]) == {"checking", "localising", "total"}
    assert len(read_tum(tmp_path / "followed" / "trajectory.tum").stamps_ns) == 60
    arguments = "evaluate", tmp_path / "followed" / "trajectory.tum", "--truth", tmp_path / "map" / "trajectory.tum"
    assert "60 of 60 poses, RMSE 0.0" in waychair(*arguments).stdout
    values = json.loads(waychair(*arguments, "--json").stdout)
    assert values["rmse_m"] < 0.05
    assert values["errors"]["count"] == 60


def test_options_about_a_camera_that_change_nothing_are_told(drive: Path, tmp_path: Path) -> None:
    done = waychair("map", drive, "--register", "auto", "--depth-scale", "1000", "-o", tmp_path / "map")
    assert done.returncode == 0, done.stderr
    assert "warning: --depth-scale changes nothing: it is about folders of pictures, and this is none" in done.stderr
    assert "warning: --register changes nothing: no pictures of colour and depth are used here" in done.stderr


def test_localising_never_overwrites_the_map_and_needs_a_map(drive: Path, tmp_path: Path) -> None:
    assert waychair("map", drive, "--out", tmp_path / "map", "--quiet").returncode == 0
    before = (tmp_path / "map" / "trajectory.tum").read_bytes()
    for given in (tmp_path / "map", tmp_path / "map" / "map.yaml"):
        done = waychair("localize", drive, "--map", given, "--out", tmp_path / "map")
        assert "the map's folder" in refused(done)
    assert (tmp_path / "map" / "trajectory.tum").read_bytes() == before
    assert "no map at" in refused(waychair("localize", drive, "--map", tmp_path / "none", "--out", tmp_path / "out"))


def test_an_impossible_evaluation_gives_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "t.tum").write_text("1 0 0 0 0 0 0 1\n2 1 0 0 0 0 0 1\n")
    (tmp_path / "r.relations").write_text("5 6 0 0 0 0 0 0\n")
    tum = tmp_path / "t.tum"
    assert "either --relations or --truth" in refused(waychair("evaluate", tum))
    assert "none of the 1 relations" in refused(waychair("evaluate", tum, "--relations", tmp_path / "r.relations"))
    assert "only 2 of 2 poses" in refused(waychair("evaluate", tum, "--truth", tum))
    assert "none.tum" in refused(waychair("evaluate", tmp_path / "none.tum", "--truth", tum))
    assert "there is no relations file" in refused(waychair("evaluate", tum, "--relations", tmp_path / "none"))


@pytest.mark.nightly
def test_another_drive_joins_a_map_or_leaves_it_unchanged(data_dir: Path, drive: Path, tmp_path: Path) -> None:
    log, folder = data_dir / "wheelchair_sena" / "sena_one_loop.clf.gz", tmp_path / "map"
    assert waychair("map", log, "--out", folder, "--quiet").returncode == 0
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    done = waychair("map", log, "--session", folder, "-o", tmp_path / "both")
    assert done.returncode == 0, done.stderr
    assert "drive 2 added" in done.stdout
    keys = [json.loads((each / "report.json").read_text())["key_scans"] for each in (folder, tmp_path / "both")]
    assert keys[0] <= keys[1] <= 1.1 * keys[0]
    assert "drive 3 added" in waychair("map", log, "--session", tmp_path / "both" / "map.yaml").stdout
    for wrong, told in ((drive, "map it by itself"), (tmp_path / "none", "none")):
        assert told in refused(waychair("map", wrong, "--session", folder))
    assert "--out FOLDER" in refused(waychair("map", log))
    assert "no map folder" in refused(waychair("map", log, "--session", tmp_path / "nowhere"))
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before
    assert {path.name for path in tmp_path.iterdir()} == {"map", "both"}
