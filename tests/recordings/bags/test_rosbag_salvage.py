"""Damaged bags, truncated or corrupted anywhere: the readable part is read, and the damage is named."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin

from tests.bags import SECOND, Bag
from waychair.errors import RecordingDamaged, RecordingError
from waychair.recordings.bags.rosbag_salvage import SalvagedBag
from waychair.recordings.bags.rosbag_writer import RecordingWriter
from waychair.recordings.recording import read_recording
from waychair.types import Odometry, Pose2, Scan

SCANS = 400
KINDS = {".bag": "drive.bag", ".mcap": "drive/drive.mcap", ".db3": "drive/drive.db3"}


def ranges_of(k: int) -> list[float]:
    return [*np.random.default_rng(k).uniform(1.0, 7.0, 59).tolist(), 1.0 + k * 0.01]


def long_bag(folder: Path, suffix: str) -> Path:
    """A bag with SCANS scans, each between two odometry messages, and nothing compressed."""
    storage = StoragePlugin.MCAP if suffix == ".mcap" else StoragePlugin.SQLITE3
    name = folder / KINDS[suffix]
    bag = Bag(name if suffix == ".bag" else name.parent, ros=1 if suffix == ".bag" else 2, storage=storage)
    for k in range(SCANS):
        bag.odometry((k + 1) * SECOND, 0.1 * k)
        bag.scan((k + 1) * SECOND, ranges_of(k))
    bag.close()
    return name


def readable(path: Path) -> int | None:
    """Number of scans that are read; None when the bag is refused, in one sentence."""
    try:
        return len(read_recording(path).frames)
    except RecordingError as error:
        if "\n" in str(error):
            raise
        return None


@pytest.mark.parametrize("suffix", KINDS)
def test_a_truncated_bag_is_read_up_to_the_cut(tmp_path: Path, suffix: str) -> None:
    data = long_bag(tmp_path, suffix).read_bytes()
    counts = []
    for share in (0.3, 0.5, 0.8, 0.97):
        path = tmp_path / f"cut{suffix}"
        path.write_bytes(data[: int(share * len(data))])
        recording = read_recording(path)
        counts.append(len(recording.frames))
        assert recording.warnings[0].startswith(f"{path} is damaged (")
        assert f"only the {counts[-1]} scans that can be read are used" in recording.warnings[0]
        stamps = [frame.stamp_ns for frame in recording.frames]
        assert stamps == sorted(set(stamps))
        for frame in recording.frames:  # a page of a database may be missing among those that are there
            k = frame.stamp_ns // SECOND - 1
            assert frame.scan is not None
            np.testing.assert_allclose(frame.scan.ranges, ranges_of(k), rtol=1e-6)
            assert isinstance(frame.wheels[-1], Odometry)
            assert frame.wheels[-1].odom_from_base.x == pytest.approx(0.1 * k)
    assert counts == sorted(counts)
    assert counts[0] > 0.2 * SCANS
    assert counts[-1] > 0.85 * SCANS


@pytest.mark.parametrize("suffix", KINDS)
def test_a_bag_damaged_anywhere_loses_little_or_gives_one_sentence(tmp_path: Path, suffix: str) -> None:
    data = long_bag(tmp_path, suffix).read_bytes()
    path = tmp_path / f"bad{suffix}"
    read, refused = [], 0
    for at in np.linspace(64, len(data) - 9, 14).astype(int).tolist():
        path.write_bytes(data[:at] + bytes(byte ^ 0xFF for byte in data[at : at + 8]) + data[at + 8 :])
        count = readable(path)
        refused += count is None
        read.append(count or 0)
    assert max(read) >= SCANS - 2
    assert all(count <= SCANS for count in read)
    assert refused <= 4


@pytest.mark.parametrize("name", ["drive.mcap", "drive.db3"])
def test_a_small_compressed_bag_truncated_or_changed_anywhere_gives_an_error_or_a_warning(
    tmp_path: Path, name: str
) -> None:
    path = tmp_path / name
    with RecordingWriter(path, Pose2()) as writer:
        for k in range(10):
            writer.write(Odometry(k * SECOND, Pose2()))
            writer.write(Scan(k * SECOND, np.full(90, 2.0, np.float32), -1.5, 3.0 / 90))
    data = path.read_bytes()
    damaged = [data[:end] for end in np.linspace(20, len(data) - 1, 10).astype(int).tolist()]
    for at in np.linspace(20, len(data) - 9, 10).astype(int).tolist():
        damaged.append(data[:at] + bytes(byte ^ 0xFF for byte in data[at : at + 8]) + data[at + 8 :])
    refused = 0
    for bad in damaged:
        path.write_bytes(bad)
        count = readable(path)
        assert count is None or count <= 10
        refused += count is None
    assert refused > 0


def test_a_damaged_chunk_is_left_out_and_counted(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    with RecordingWriter(path, Pose2()) as writer:
        rng = np.random.default_rng(0)
        for k in range(600):  # enough for several chunks
            writer.write(Odometry(k * SECOND, Pose2()))
            writer.write(Scan(k * SECOND, (rng.integers(1000, 1200, 3000) / 1000).astype(np.float32), -1.5, 0.002))
    data = path.read_bytes()
    middle = len(data) // 2
    path.write_bytes(data[:middle] + bytes(200) + data[middle + 200 :])
    recording = read_recording(path)
    assert 200 < len(recording.frames) < 600
    assert "without 1 damaged chunks" in recording.warnings[0]


def test_a_folder_without_its_metadata_is_read_from_its_files(tmp_path: Path) -> None:
    path = long_bag(tmp_path, ".mcap")
    (path.parent / "metadata.yaml").unlink()
    recording = read_recording(path.parent)
    assert len(recording.frames) == SCANS
    assert "has no metadata.yaml" in recording.warnings[0]


def test_salvaging_an_undamaged_bag_gives_all_of_its_messages(tmp_path: Path, data_dir: Path) -> None:
    from rosbags.highlevel import AnyReader

    for name, suffix in (("husky_imu_odom_gps.bag", ".bag"), ("nav2_turtlebot.mcap", ".mcap")):
        path = data_dir / "ros_bags" / name
        salvaged = SalvagedBag([(path, suffix)])
        with AnyReader([path]) as whole:
            counts = {connection.topic: connection.msgcount for connection in whole.connections}
            assert {connection.topic: connection.msgcount for connection in salvaged.connections} == counts
            expected = {(connection.topic, log_ns, bytes(data)) for connection, log_ns, data in whole.messages()}
        found = {
            (connection.topic, log_ns, data) for connection, log_ns, data in salvaged.messages(salvaged.connections)
        }
        assert found == expected
        assert not salvaged.lost


def test_a_real_bag_truncated_anywhere_is_salvaged_up_to_the_cut(tmp_path: Path, data_dir: Path) -> None:
    for name, suffix in (("husky_imu_odom_gps.bag", ".bag"), ("nav2_turtlebot.mcap", ".mcap")):
        data = (data_dir / "ros_bags" / name).read_bytes()
        path, last = tmp_path / name, 0
        for share in (0.1, 0.4, 0.7, 0.95):
            path.write_bytes(data[: int(share * len(data))])
            salvaged = SalvagedBag([(path, suffix)])
            count = sum(connection.msgcount for connection in salvaged.connections)
            for connection, _, content in salvaged.messages(salvaged.connections):
                salvaged.deserialize(content, connection.msgtype)
            assert count >= last
            last = count
        whole = sum(
            connection.msgcount for connection in SalvagedBag([(data_dir / "ros_bags" / name, suffix)]).connections
        )
        assert 0.8 * whole < last <= whole


def test_an_unreadable_bag_is_refused_with_advice(tmp_path: Path) -> None:
    path = long_bag(tmp_path, ".db3")
    shutil.copy(path, tmp_path / "bad.db3")
    data = path.read_bytes()
    (tmp_path / "bad.db3").write_bytes(data[:16] + bytes(len(data) - 16))
    with pytest.raises(RecordingDamaged, match=r"is a damaged bag .*copy it again from its source"):
        read_recording(tmp_path / "bad.db3")
