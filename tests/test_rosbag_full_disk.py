"""A full disk, and an interrupt by the user: the recording so far is closed and stays readable."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
from collections import namedtuple
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from waychair.errors import OutputError
from waychair.recordings.bags import rosbag_storage, rosbag_writer
from waychair.recordings.bags.rosbag_writer import RecordingWriter
from waychair.types import Odometry, Pose2, RgbdFrame, Scan

START_NS = 1_700_000_000 * 10**9
NAMES = ("drive.mcap", "drive.db3", "drive")
_Usage = namedtuple("_Usage", "total used free")


def odometry_at(k: int) -> Odometry:
    return Odometry(START_NS + k * 20_000_000, Pose2(0.01 * k, 0.0, 0.0))


def picture(k: int) -> RgbdFrame:
    """About 0.4 MB that cannot be compressed."""
    rng = np.random.default_rng(k)
    image = rng.integers(0, 256, (240, 320, 3), np.uint8)
    depth = rng.uniform(0.3, 8.0, (240, 320)).astype(np.float32)
    return RgbdFrame(START_NS + k * 20_000_000, image, depth, np.eye(3))


def count(path: Path, topic: str = "/odom") -> int:
    """Messages that can be read and parsed."""
    with AnyReader([path]) as reader:
        connections = [c for c in reader.connections if c.topic == topic]
        read = [reader.deserialize(data, c.msgtype) for c, _, data in reader.messages(connections)]
        assert sum(c.msgcount for c in connections) == len(read)
    return len(read)


def record_until_full(path: Path, most: int = 400) -> tuple[int, str]:
    """Write pictures and odometry until the writer refuses; return their number and the error."""
    taken = 0
    try:
        with RecordingWriter(path, Pose2()) as writer:
            for k in range(most):
                writer.write(odometry_at(k))
                taken = k + 1
                writer.write(picture(k))
    except OutputError as refusal:
        return taken, str(refusal)
    pytest.fail(f"{most} pictures were taken without a word")


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A real disk of 40 MB, in memory."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=40m", "tmpfs", str(folder)]
    if shutil.which("mount") is None or subprocess.run(mount, capture_output=True, check=False).returncode != 0:
        pytest.skip("mounting a small disk takes an administrator")
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


@pytest.mark.parametrize("name", NAMES)
def test_a_full_disk_keeps_all_accepted_messages(small_disk: Path, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rosbag_storage, "MIN_FREE", 0)  # another program fills the disk between two checks
    taken, message = record_until_full(small_disk / name)
    assert 20 < taken < 110
    part = small_disk / name.replace("drive", "drive.part")
    assert str(part) in message
    assert " MB recorded so far" in message
    assert [path.name for path in small_disk.iterdir()] == [part.name]
    assert count(part) == taken
    assert count(part, "/camera/color/image_raw") in (taken - 1, taken)


@pytest.mark.parametrize("name", NAMES)
def test_recording_stops_before_the_disk_is_full(tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    room = iter([1 << 30, 1 << 30, 1 << 30, rosbag_storage.MIN_FREE - 1])
    monkeypatch.setattr(rosbag_storage.shutil, "disk_usage", lambda path: _Usage(1 << 40, 0, next(room)))
    taken, message = record_until_full(tmp_path / name)
    part = tmp_path / name.replace("drive", "drive.part")
    assert f"the disk of {tmp_path / name} is full" in message
    assert taken * picture(0).image.nbytes * 5 / 3 > 3 * rosbag_storage.CHECK_EVERY
    assert count(part) == taken
    assert [path.name for path in tmp_path.iterdir()] == [part.name]


def test_the_reserve_is_used_once_and_then_a_full_disk_is_an_error(tmp_path: Path) -> None:
    full = Path("/dev/full")
    if not full.exists():
        pytest.skip("this system has no /dev/full")
    reserve = rosbag_storage.Reserve(tmp_path / "reserve")
    assert (tmp_path / "reserve").stat().st_blocks * 512 >= rosbag_storage.RESERVE
    with rosbag_storage._ReservedFile(full, reserve) as file, pytest.raises(OSError, match="No space left"):
        file.write(b"0")
    assert reserve.used
    assert not (tmp_path / "reserve").exists()
    assert not reserve.use()


def test_a_disk_without_space_is_refused_before_the_drive(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rosbag_storage.shutil, "disk_usage", lambda path: _Usage(1 << 40, 0, 10_000))
    with pytest.raises(OutputError, match="No space left on device"), RecordingWriter(tmp_path / "drive", Pose2()):
        pass
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", NAMES)
def test_an_interrupted_recording_is_kept_and_its_path_reported(tmp_path: Path, name: str) -> None:
    (tmp_path / name.replace("drive", "drive.part")).touch()  # of another day

    def drive() -> None:
        with RecordingWriter(tmp_path / name, Pose2()) as writer:
            for k in range(30):
                writer.write(odometry_at(k))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt) as stop:
        drive()
    part = tmp_path / name.replace("drive", "drive.part1")
    assert stop.value.__notes__ == [f"what was recorded so far is in {part}"]
    assert count(part) == 30
    assert not (tmp_path / name).exists()


def test_an_interrupt_before_the_first_message_leaves_no_file(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt), RecordingWriter(tmp_path / "drive.mcap", Pose2()):
        raise KeyboardInterrupt
    assert list(tmp_path.iterdir()) == []


def test_an_interrupt_in_the_middle_of_a_message_waits_for_its_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = RecordingWriter._put_scan

    def interrupted(writer: RecordingWriter, scan: Scan) -> None:
        os.kill(os.getpid(), signal.SIGINT)
        whole(writer, scan)

    def drive() -> None:
        with RecordingWriter(tmp_path / "drive.mcap", Pose2()) as writer:
            writer.write(Scan(START_NS, np.full(90, 2.0, np.float32), -1.5, 3.0 / 90))
            pytest.fail("the interrupt was lost")

    monkeypatch.setitem(rosbag_writer._PUTS, Scan, interrupted)  # type: ignore[index]
    with pytest.raises(KeyboardInterrupt):
        drive()
    assert count(tmp_path / "drive.part.mcap", "/scan") == 1
