"""Kind 4: bags that are cut, zeroed, flipped, packed badly, split, told wrongly, or hold messages of another type."""

from __future__ import annotations

import gzip
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np

from evaluation.corruptions.fault import Part, faults_of, file_fault, messages_fault
from evaluation.corruptions.messages import IMU, ODOM, SCAN, BagMessage, Messages, sound_messages, write_messages

Rng = np.random.Generator
_DAMAGE = "damage|cut|truncat|incomplete|zero|empty|corrupt|not a|neither|missing from the file"
_META = "metadata|yaml|damage|part|listed"
_TYPE = "type|damage|decode|std_msgs|no sensor_msgs|no nav_msgs|sizes?|contradict|finite|numbers"
_VALUES = "wild|no chair|jump|code|range_m|angles?|time_increment|stamps?"
_ALL: tuple[Part, ...] = ("file", "lidar", "odometry", "imu")
"""The parts whose messages lie in a file: bytes that are wrong in it may be those of any of them."""


def data_file(path: Path) -> Path:
    """Return the file with the messages of a bag."""
    return path if path.is_file() else next(file for file in sorted(path.iterdir()) if file.suffix in (".mcap", ".db3"))


def _without_metadata(path: Path, rng: Rng) -> None:
    """Half of the time a bag is a file alone."""
    if path.is_dir() and rng.random() < 0.5:
        (path / "metadata.yaml").unlink()


def _bytes_by(path: Path, rng: Rng, by: Callable[[bytearray], bytes | bytearray]) -> Path:
    _without_metadata(path, rng)
    file = data_file(path)
    file.write_bytes(by(bytearray(file.read_bytes())))
    return path


@file_fault(4, "file", _DAMAGE)
def file_is_cut(path: Path, rng: Rng) -> Path:
    share = float(rng.choice([0.001, 0.2, 0.5, 0.9, 0.999]))
    return _bytes_by(path, rng, lambda data: data[: int(share * len(data))])


@file_fault(4, _ALL, _DAMAGE + "|finite|" + _VALUES)
def file_holds_zeros(path: Path, rng: Rng) -> Path:
    def zeroed(data: bytearray) -> bytearray:
        first, size = int(rng.uniform(0.05, 0.8) * len(data)), int(rng.choice([64, 4096, 200_000]))
        data[first : first + size] = bytes(len(data[first : first + size]))
        return data

    return _bytes_by(path, rng, zeroed)


@file_fault(4, _ALL, _DAMAGE + "|finite|" + _VALUES)
def file_holds_other_bytes(path: Path, rng: Rng) -> Path:
    def flipped(data: bytearray) -> bytearray:
        for at in rng.integers(0, len(data), int(rng.choice([1, 20, 500]))):
            data[at] ^= int(rng.integers(1, 256))
        return data

    return _bytes_by(path, rng, flipped)


@file_fault(4, "file", _DAMAGE)
def file_is_empty(path: Path, rng: Rng) -> Path:
    return _bytes_by(path, rng, lambda data: data[: int(rng.choice([0, 3, 16]))])


@file_fault(4, "file", _DAMAGE)
def file_begins_otherwise(path: Path, rng: Rng) -> Path:
    size = int(rng.choice([8, 100, 4096]))
    return _bytes_by(path, rng, lambda data: rng.bytes(size) + data[size:])


@file_fault(4, "file", _DAMAGE)
def something_is_appended(path: Path, rng: Rng) -> Path:
    return _bytes_by(path, rng, lambda data: data + rng.bytes(int(rng.choice([10, 100_000]))))


@file_fault(4, "file", _DAMAGE + "|ending|suffix|name")
def file_has_another_ending(path: Path, rng: Rng) -> Path:
    file = data_file(path)
    other = path.parent / f"drive{rng.choice(['.bag', '.mcap', '.db3', '.log', '.clf', '', '.gz', '.dat'])}"
    shutil.copy(file, path.parent / "own")
    shutil.rmtree(path) if path.is_dir() else path.unlink()
    (path.parent / "own").rename(other)
    return other


@file_fault(4, "file", _DAMAGE + "|gz|pack")
def packed_file_is_damaged(path: Path, rng: Rng) -> Path:
    packed = bytearray(gzip.compress(data_file(path).read_bytes(), 1))
    if rng.random() < 0.5:
        packed = packed[: int(rng.uniform(0.2, 0.95) * len(packed))]
    else:
        at = int(rng.uniform(0.2, 0.9) * len(packed))
        packed[at : at + 200] = rng.bytes(200)
    other = path.parent / f"drive{data_file(path).suffix}.gz"
    other.write_bytes(packed)
    return other


@file_fault(4, "file", _META)
def metadata_is_wrong(path: Path, rng: Rng) -> Path:
    if path.is_file():
        return _bytes_by(path, rng, lambda data: data[: int(0.7 * len(data))])
    meta = path / "metadata.yaml"
    text = meta.read_text()
    changes: list[Callable[[str], str]] = [
        lambda t: "",
        lambda t: t[: len(t) // 2],
        lambda t: t.replace("message_count:", "message_count: 1 #"),
        lambda t: t.replace(SCAN, "/front_scan"),
        lambda t: t.replace("LaserScan", "PointCloud2"),
        lambda t: t.replace("mcap", "sqlite3") if "mcap" in t else t.replace("sqlite3", "mcap"),
        lambda t: t.replace("relative_file_paths:", "relative_file_paths:\n  - gone_1.mcap"),
        lambda t: t.replace("version: 9", "version: 99"),
        lambda t: t.replace("nanoseconds", "seconds"),
        lambda t: "\x00" * 100,
        lambda t: "- 1\n- 2\n",
    ]
    meta.write_text(changes[int(rng.integers(len(changes)))](text))
    return path


@file_fault(4, "file", "part is missing|no usable part|nothing was recorded")
def a_part_is_missing(path: Path, rng: Rng) -> Path:
    folder, parts = _parts(path)
    parts[int(rng.integers(len(parts)))].unlink()
    return folder


@file_fault(4, "file", "part|twice|same|overlap|copy|split|several|drives")
def a_part_is_there_twice(path: Path, rng: Rng) -> Path:
    folder, parts = _parts(path)
    part = parts[int(rng.integers(len(parts)))]
    shutil.copy(part, part.with_name(f"copy_{part.name}"))
    return folder


@file_fault(4, "file", _DAMAGE + "|part")
def a_part_is_damaged(path: Path, rng: Rng) -> Path:
    folder, parts = _parts(path)
    part = parts[int(rng.integers(len(parts)))]
    data = part.read_bytes()
    part.write_bytes([b"", data[: len(data) // 2], bytes(len(data))][int(rng.integers(3))])
    return folder


@file_fault(4, "file", "holds|no recording|neither|folder|other|gz|text|part|drives|several|kind")
def something_else_lies_beside_it(path: Path, rng: Rng) -> Path:
    folder, _ = _parts(path)
    name = str(rng.choice(["notes.txt", "map.pgm", "._part_0.mcap", ".DS_Store", "drive_0.mcap.tmp", "part_9.bag"]))
    (folder / name).write_bytes(rng.bytes(1000))
    return folder


def _parts(path: Path) -> tuple[Path, list[Path]]:
    """Return a folder with the drive in three files, as a recorder splits it, and those files."""
    ros2, suffix = path.is_dir(), data_file(path).suffix
    messages = sound_messages(2 if ros2 else 1)
    folder, files, size = path.parent / "parts", [], -(-len(messages.events) // 3)
    folder.mkdir()
    for k in range(3):
        part = Messages(messages.ros, messages.events[k * size : (k + 1) * size])
        to = folder / f"part_{k}{suffix}"
        if ros2:
            whole = path.parent / f"whole_{k}"
            write_messages(whole, part, "mcap" if suffix == ".mcap" else "db3")
            shutil.move(data_file(whole), to)
            shutil.rmtree(whole)
        else:
            write_messages(to, part, "bag")
        files.append(to)
    return folder, files


def _some(events: list[BagMessage], rng: Rng) -> list[BagMessage]:
    share = float(rng.choice([0.0, 0.1, 1.0]))
    chosen = [event for event in events if rng.random() < share]
    return chosen or [events[int(rng.integers(len(events)))]]


def _topic(rng: Rng) -> str:
    return str(rng.choice([SCAN, SCAN, ODOM, IMU]))


@messages_fault(4, ("file", "lidar", "odometry", "imu"), _TYPE)
def a_topic_tells_another_type(messages: Messages, rng: Rng) -> None:
    kind = str(
        rng.choice(["std_msgs/msg/String", "nav_msgs/msg/Path", "sensor_msgs/msg/Range", "geometry_msgs/msg/Twist"])
    )
    for event in messages.of(_topic(rng)):
        event.kind = kind


@messages_fault(4, ("file", "lidar", "odometry", "imu"), _TYPE)
def a_topic_holds_other_messages(messages: Messages, rng: Rng) -> None:
    """The told type is right, but the bytes are those of another message."""
    topic = _topic(rng)
    other = messages.of(IMU if topic != IMU else ODOM)[0].body
    kind = messages.of(topic)[0].body.__msgtype__
    for event in _some(messages.of(topic), rng):
        event.body, event.kind = other, kind


@messages_fault(4, ("file", "lidar", "odometry", "imu"), _TYPE)
def messages_are_cut(messages: Messages, rng: Rng) -> None:
    share = float(rng.choice([0.0, 0.1, 0.6, 0.95]))
    for event in _some(messages.of(_topic(rng)), rng):
        event.raw = lambda data: data[: int(share * len(data))]


@messages_fault(4, ("file", "lidar", "odometry", "imu"), _TYPE)
def messages_hold_zeros(messages: Messages, rng: Rng) -> None:
    for event in _some(messages.of(_topic(rng)), rng):
        event.raw = lambda data: data[:4] + bytes(len(data) - 4)


@messages_fault(4, _ALL, _TYPE + "|" + _VALUES)
def messages_hold_other_bytes(messages: Messages, rng: Rng) -> None:
    count = int(rng.choice([1, 8, 60]))

    def flipped(data: bytes) -> bytes:
        changed = bytearray(data)
        for at in rng.integers(4, len(data), count):
            changed[at] ^= int(rng.integers(1, 256))
        return bytes(changed)

    for event in _some(messages.of(_topic(rng)), rng):
        event.raw = flipped


@messages_fault(4, ("file", "lidar", "odometry", "imu"), _TYPE)
def messages_tell_huge_sizes(messages: Messages, rng: Rng) -> None:
    size = int(rng.choice([10_000_000, 0x7FFFFFFF, 0xFFFFFFFF])).to_bytes(4, "little")

    def told(data: bytes) -> bytes:
        count = (180).to_bytes(4, "little")
        at = data.rfind(count, 0, 120)  # of the ranges; elsewhere the length of the frame's name
        at = at if at >= 0 else 12
        return data[:at] + size + data[at + 4 :]

    for event in _some(messages.of(SCAN if rng.random() < 0.7 else ODOM), rng):
        event.raw = told


@messages_fault(4, ("file", "lidar", "odometry", "clock"), "recording|order|stamp|clock")
def times_of_recording_are_wrong(messages: Messages, rng: Rng) -> None:
    which = int(rng.integers(3))
    for k, event in enumerate(messages.events):
        event.log_ns = [0, 1_000_000_000 + k, event.log_ns - int(rng.integers(0, 10**9))][which]


@messages_fault(4, "lidar", "no laser|no scan|holds no|choose|LaserScan|lidar|/scan")
def scans_are_not_recorded(messages: Messages, rng: Rng) -> None:
    messages.remove(messages.of(SCAN))


@messages_fault(4, ("lidar", "file"), "few|holds|only|too|scan|short")
def only_some_messages_are_there(messages: Messages, rng: Rng) -> None:
    count = int(rng.choice([0, 1, 2, 5]))
    if rng.random() < 0.5:
        messages.remove(messages.of(SCAN)[count:])
    else:
        messages.events = messages.events[: 2 + 10 * count]


FILE_FAULTS = faults_of(globals())
