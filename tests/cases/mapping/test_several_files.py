"""A drive that was recorded as several files, packed, or beside other things is one recording; other mixtures are named."""

from __future__ import annotations

import bz2
import gzip
import lzma
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin

from tests.bags import SECOND, Bag
from tests.cli.command import refused, waychair
from waychair.errors import RecordingDamaged, RecordingError
from waychair.recordings.recording import Recording, read_recording
from waychair.types import Odometry, Pose2

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

START = 1_700_000_000 * SECOND
LEVEL = (0.0, 0.0, 0.0, 1.0)
SCANS = 45


def put(bag: Bag, k: int, *, scans: bool = True, odometry: bool = True, start: int = START) -> None:
    """Write the k-th tenth of a second of a straight drive at 0.8 m/s."""
    now = start + k * SECOND // 10
    if odometry:
        bag.odometry(now, 0.08 * k)
    if scans:
        bag.room(now, Pose2(2.0 + 0.08 * k, 3.0), "/scan", "laser")


def part(path: Path, ks: Sequence[int], *, ros: int = 1, start: int = START, storage: Any = StoragePlugin.MCAP) -> Path:
    """Write the part of a drive; the first part of each drive holds the laser's mount."""
    bag = Bag(path, ros, storage)
    if ks[0] == 0:
        bag.mount(start, ("base_link", "laser", (0.3, 0.0, 0.2), LEVEL))
    for k in ks:
        put(bag, k, start=start)
    bag.close()
    return path


def split(folder: Path, ros: int = 1) -> list[Path]:
    """Write a drive as a recorder that splits every 1.5 s does, and return its parts."""
    folder.mkdir()
    suffix = ".bag" if ros == 1 else ""
    return [part(folder / f"drive_{k}{suffix}", range(15 * k, 15 * k + 15), ros=ros) for k in range(3)]


def is_whole(recording: Recording) -> bool:
    """Return whether a recording holds the whole drive in order, with its odometry and mount."""
    stamps = [frame.stamp_ns for frame in recording.frames]
    readings = [frame.wheels[-1] for frame in recording.frames]
    xs = [reading.odom_from_base.x for reading in readings if isinstance(reading, Odometry)]
    return (
        stamps == [START + k * SECOND // 10 for k in range(SCANS)]
        and bool(np.allclose(xs, [0.08 * k for k in range(SCANS)], atol=1e-6))
        and recording.base_from_laser.x == pytest.approx(0.3)
    )


def test_the_parts_of_a_ros_1_bag_are_one_recording_as_a_folder_and_as_arguments(tmp_path: Path) -> None:
    parts = split(tmp_path / "drive")
    for given in ([tmp_path / "drive"], parts, [parts[2], parts[0], parts[1]]):
        recording = read_recording(given)
        assert is_whole(recording)
        assert recording.warnings == ()
        assert sorted(recording.parts) == parts
    inside = read_recording(tmp_path)
    assert is_whole(inside)
    assert inside.warnings == (f"{tmp_path} is no recording, but holds one: drive was read",)


def test_several_ros_2_bags_and_files_without_metadata_are_one_recording(tmp_path: Path) -> None:
    parts = split(tmp_path / "drive", ros=2)
    assert is_whole(read_recording(parts))
    files = [next(folder.glob("*.mcap")) for folder in parts]
    assert is_whole(read_recording(files))
    (tmp_path / "loose").mkdir()
    for file in files:
        shutil.copy(file, tmp_path / "loose")
    loose = read_recording(tmp_path / "loose")
    assert is_whole(loose)
    assert ["has no metadata.yaml" in warning for warning in loose.warnings] == [True]
    with pytest.raises(
        RecordingError, match="holds drive_0, drive_1, drive_2: give one of them, or the parts of one bag"
    ):
        read_recording(tmp_path / "drive")


def test_the_command_takes_the_parts_and_its_report_names_them(tmp_path: Path) -> None:
    parts = split(tmp_path / "drive")
    done = waychair("map", *parts, "-o", tmp_path / "map")
    assert done.returncode == 0, done.stderr
    assert f"{SCANS} scans over 4 m" in done.stdout
    assert all(str(each) in (tmp_path / "map" / "report.json").read_text() for each in parts)
    done = waychair("localize", *parts, "--map", tmp_path / "map", "--out", tmp_path / "on", "--start", "0,0,0")
    assert f"{SCANS} scans over 4 m" in done.stdout, done.stderr


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("ending", "packed"),
    [(".gz", gzip.compress), (".bz2", bz2.compress), (".xz", lzma.compress), (".zst", zstd.compress)],
)
def test_packed_bags_and_parts_are_read(tmp_path: Path, ending: str, packed: Any) -> None:
    for each in split(tmp_path / "drive"):
        each.with_name(each.name + ending).write_bytes(packed(each.read_bytes()))
        each.unlink()
    assert is_whole(read_recording(tmp_path / "drive"))
    assert is_whole(read_recording(sorted((tmp_path / "drive").iterdir())))


@pytest.mark.nightly
@pytest.mark.parametrize(
    "packed",
    [
        gzip.compress,
        *(pytest.param(by, marks=pytest.mark.nightly) for by in (bz2.compress, lzma.compress, zstd.compress)),
    ],
)
def test_packed_logs_are_read_up_to_a_cut(tmp_path: Path, packed: Any) -> None:
    line = "FLASER 4 1 2 2 1 0 0 0 0 0 0 {0} h {0}\n"
    data = packed("".join(line.format(f"{k}.{k * 7919 % 1000:03d}") for k in range(20_000)).encode())
    (tmp_path / "drive").write_bytes(data)
    assert len(read_recording(tmp_path / "drive").frames) == 20_000
    (tmp_path / "cut").write_bytes(data[:-100])
    cut = read_recording(tmp_path / "cut")
    assert 0 < len(cut.frames) < 20_000
    assert any("is cut short or damaged" in warning for warning in cut.warnings)


def test_a_packed_file_of_a_ros_2_bag_is_read_whatever_its_name(tmp_path: Path) -> None:
    bag = part(tmp_path / "bag", range(SCANS), ros=2)
    (tmp_path / "drive.mcap.zstd").write_bytes(zstd.compress(next(bag.glob("*.mcap")).read_bytes()))
    assert is_whole(read_recording(tmp_path / "drive.mcap.zstd"))
    (tmp_path / "drive.mcap.zstd").rename(tmp_path / "drive")
    assert is_whole(read_recording(tmp_path / "drive"))
    assert waychair("map", tmp_path / "drive", "-o", tmp_path / "map").returncode == 0


def test_a_packed_bag_that_is_cut_is_read_up_to_the_cut_and_one_of_nothing_is_refused(tmp_path: Path) -> None:
    bag = part(tmp_path / "drive.bag", range(SCANS))
    data = gzip.compress(bag.read_bytes())
    (tmp_path / "cut.bag.gz").write_bytes(data[: 2 * len(data) // 3])
    cut = read_recording(tmp_path / "cut.bag.gz")
    assert 10 < len(cut.frames) < SCANS
    assert any("is cut short or damaged" in warning for warning in cut.warnings)
    (tmp_path / "none.bag.gz").write_bytes(data[:12])
    with pytest.raises(RecordingDamaged, match=r"none.bag.gz"):
        read_recording(tmp_path / "none.bag.gz")


def test_one_damaged_part_leaves_the_others(tmp_path: Path) -> None:
    parts = split(tmp_path / "drive")
    data = parts[1].read_bytes()
    parts[1].write_bytes(data[: len(data) // 2])
    recording = read_recording(tmp_path / "drive")
    stamps = [frame.stamp_ns for frame in recording.frames]
    assert stamps == sorted(stamps)
    assert {0, 14, 30, 44} <= {(stamp - START) * 10 // SECOND for stamp in stamps}
    assert "is damaged" in recording.warnings[0]


def test_two_recorders_of_one_drive_are_one_recording(tmp_path: Path) -> None:
    (tmp_path / "drive").mkdir()
    for name, kind in (("lidar.bag", {"odometry": False}), ("base.bag", {"scans": False})):
        bag = Bag(tmp_path / "drive" / name, ros=1)
        bag.mount(START, ("base_link", "laser", (0.3, 0.0, 0.2), LEVEL))
        for k in range(SCANS):
            put(bag, k, **kind)
        bag.close()
    assert is_whole(read_recording(tmp_path / "drive"))


def test_copies_beside_the_bag_are_left_out(tmp_path: Path) -> None:
    parts = split(tmp_path / "drive")
    shutil.copy(parts[0], tmp_path / "drive" / "drive_0.orig.bag")  # of rosbag reindex
    (tmp_path / "drive" / "drive_1.bag.gz").write_bytes(gzip.compress(parts[1].read_bytes()))
    assert is_whole(read_recording(tmp_path / "drive"))
    shutil.copy(parts[2], tmp_path / "drive" / "again.bag")
    twice = read_recording(tmp_path / "drive")
    assert is_whole(twice)
    assert len(twice.warnings) == 1
    assert "is a copy of" in twice.warnings[0]


def test_a_missing_part_is_told_and_drives_of_their_own_are_refused_in_a_folder(tmp_path: Path) -> None:
    folder = tmp_path / "drive"
    folder.mkdir()
    first, third = part(folder / "a_0.bag", range(15)), part(folder / "a_2.bag", range(60, 75))
    assert [warning[:45] for warning in read_recording(folder).warnings] == [
        "nothing was recorded for 5 s between a_0.bag ",
        f"{folder}: the parts of this recording"[:45],
    ]
    assert "there is no usable part 1:" in read_recording(folder).warnings[1]
    day = 86_400 * SECOND
    later = part(folder / "b_0.bag", range(15), start=START + day)
    with pytest.raises(
        RecordingError, match=r"holds 2 drives.*a_0.bag to a_2.bag of 2023-11-14.*b_0.bag of 2023-11-15"
    ):
        read_recording(folder)
    chosen = read_recording([first, third, later])
    assert len(chosen.frames) == 45
    assert "join the second with --session" in " ".join(chosen.warnings)


def test_files_that_are_no_parts_of_one_recording_are_refused_by_name(tmp_path: Path) -> None:
    one = part(tmp_path / "one.bag", range(SCANS))
    other = part(tmp_path / "other.bag", range(1, SCANS))
    with pytest.raises(RecordingError, match=r"one.bag and other.bag both hold /odom for the same 4 s"):
        read_recording([one, other])
    two = part(tmp_path / "two", range(60, 75), ros=2)
    with pytest.raises(RecordingError, match=r"one.bag is a bag of ROS 1 and two of ROS 2"):
        read_recording([one, two])
    (tmp_path / "log.clf").write_text("FLASER 2 1 1 0 0 0 0 0 0 1 h 1\n")
    with pytest.raises(RecordingError, match=r"log.clf is a text log and can only be given alone"):
        read_recording([one, tmp_path / "log.clf"])
    assert "there is no recording at" in refused(waychair("map", one, tmp_path / "none.bag", "-o", tmp_path / "map"))


def test_a_folder_that_holds_one_log_is_read_and_several_are_listed(tmp_path: Path) -> None:
    line = "FLASER 4 1 2 2 1 0 0 0 0 0 0 {0} h {0}\n"
    (tmp_path / "a.log").write_text("".join(line.format(k) for k in range(5)))
    (tmp_path / "README.md").write_text("# A drive\n")
    assert len(read_recording(tmp_path).frames) == 5
    (tmp_path / "b.log").write_text(line.format(9))
    with pytest.raises(RecordingError, match=r"holds a.log, b.log: give one of them"):
        read_recording(tmp_path)


def test_scans_of_several_echoes_map_by_the_nearest_echo(tmp_path: Path) -> None:
    bag = Bag(tmp_path / "drive", storage=StoragePlugin.MCAP)
    make = bag.types
    for k in range(5):
        now = START + k * SECOND // 10
        bag.odometry(now, 0.08 * k)
        echoes = [[1.0, 2.5], [], [0.001, 2.0], [3.0]]
        beams = [make["sensor_msgs/msg/LaserEcho"](np.array(each, np.float32)) for each in echoes]
        message = make["sensor_msgs/msg/MultiEchoLaserScan"](
            bag.header(now, "laser"), -0.15, 0.15, 0.1, 0.0, 0.1, 0.1, 8.0, beams, []
        )
        bag.put("/echoes", now, message)
    bag.close()
    recording = read_recording(tmp_path / "drive")
    assert "scans /echoes" in recording.source
    for frame in recording.frames:
        assert frame.scan is not None
        np.testing.assert_allclose(frame.scan.ranges, [1.0, np.nan, 2.0, 3.0], atol=1e-6)
