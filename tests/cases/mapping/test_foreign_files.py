"""Files that are no recordings are named for what they are, by their content, with what to do."""

from __future__ import annotations

import gzip
import io
import sqlite3
import struct
import tarfile
import zipfile
from pathlib import Path

import pytest

from tests.cli.command import refused, waychair
from waychair.errors import RecordingDamaged, RecordingUnknown
from waychair.recordings.recording import read_recording

PBSTREAM = struct.pack("<Q", 0x7B1D1F7B5BF501DB) + bytes(64)
POSEGRAPH = struct.pack("<Q", 22) + b"serialization::archive" + bytes(64)
PCD = b"# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS x y z\nDATA ascii\n0 0 0\n"
PCAP = b"\xd4\xc3\xb2\xa1\x02\x00\x04\x00" + bytes(40)
LAS = b"LASF" + bytes(200)
LFS = b"version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 12\n"
MAP = b"image: map.pgm\nresolution: 0.05\norigin: [0, 0, 0]\nnegate: 0\n"
POSES = b"1700000000.1 1 2 0 0 0 0 1\n1700000000.2 1 2 0 0 0 0 1\n"


@pytest.mark.parametrize(
    ("name", "content", "kind", "advice"),
    [
        ("floor.pbstream", PBSTREAM, "a map of Cartographer", "map.yaml"),
        ("floor.posegraph", POSEGRAPH, "a pose graph of slam_toolbox", "map.yaml"),
        ("floor.data", POSEGRAPH, "a pose graph of slam_toolbox", "give the bag or log"),
        ("graph.g2o", b"VERTEX_SE2 0 0 0 0\nEDGE_SE2 0 1 1 0 0 1 0 0 1 0 1\n", "a pose graph (g2o)", "holds no scans"),
        ("room.pcd", PCD, "a single point cloud", "give the bag"),
        ("room.ply", b"ply\nformat ascii 1.0\n", "a single point cloud", "give the bag"),
        ("room.las", LAS, "a single point cloud", "give the bag"),
        ("drive.pcap", PCAP, "a capture of network packets", "record a bag"),
        ("drive.svo2", b"\x00\x01\x02 anything", "a recording of a ZED camera", "record a bag"),
        ("metadata.yaml", b"rosbag2_bagfile_information:\n  version: 5\n", "the description of a ROS 2 bag", "folder"),
        ("map.yaml", MAP, "a map, not a recording", "plan and navigate"),
        ("map.pgm", b"P5\n4 4\n255\n" + bytes(16), "a picture", "map.yaml"),
        ("drive.csv", b"time,x,y\n1,2,3\n", "a table (.csv)", "give the bag"),
        ("drive.tum", POSES, "a trajectory", "evaluate takes it"),
        ("drive.bag", LFS, "only a pointer of Git LFS", "git lfs pull"),
        ("drive.bag", b"<!DOCTYPE html><html><body>Sign in</body></html>", "a web page", "download"),
        ("drive.mp4", b"\x00\x00\x00\x20ftypisom" + bytes(30), "a video", "depth pictures"),
        ("drive.bag", b"#ROSBAG V1.2\n", "a ROS bag of the old version", "rosbag fix"),
        ("drive.json", b'{"scans": []}', "a structured text", "give the bag"),
        ("drive.7z", b"7z\xbc\xaf\x27\x1c" + bytes(30), "a packed file", "unpack it"),
    ],
)
def test_a_file_is_named_for_what_it_is_whatever_its_name(
    tmp_path: Path, name: str, content: bytes, kind: str, advice: str
) -> None:
    for path in (tmp_path / name, tmp_path / f"{name}.gz"):
        path.write_bytes(gzip.compress(content) if path.suffix == ".gz" else content)
        with pytest.raises(RecordingUnknown) as caught:
            read_recording(path)
        assert kind.removesuffix(", not a recording") in str(caught.value)
        assert advice in str(caught.value)
    if 0 in content or content[:1] in b"#P%v":  # told by content alone
        (tmp_path / "nameless").write_bytes(content)
        if name not in ("drive.svo2",):
            with pytest.raises(RecordingUnknown, match=kind[:12].replace("(", r"\(")):
                read_recording(tmp_path / "nameless")


def database(path: Path, *tables: str) -> Path:
    with sqlite3.connect(path) as file:
        for table in tables:
            file.execute(f"CREATE TABLE {table} (id INTEGER PRIMARY KEY)")
    file.close()
    return path


def test_databases_are_told_by_their_tables(tmp_path: Path) -> None:
    rtabmap = database(tmp_path / "map.db", "Node", "Data", "Link", "Word", "Feature")
    sentence = refused(waychair("map", rtabmap, "-o", tmp_path / "out"))
    assert "is a database of RTAB-Map, not a recording" in sentence
    assert "rtabmap-databaseViewer" in sentence
    assert "damaged" not in sentence
    assert not (tmp_path / "out").exists()
    with pytest.raises(RecordingUnknown, match="SQLite database with the tables cookies, urls"):
        read_recording(database(tmp_path / "other.db3", "urls", "cookies"))
    with pytest.raises(RecordingUnknown, match=r"memory of places of a map"):
        read_recording(database(tmp_path / "m.db", "nodes", "states", "links", "words", "anchors"))
    (tmp_path / "folder").mkdir()
    rtabmap.rename(tmp_path / "folder" / "map.db")
    with pytest.raises(RecordingDamaged, match=r"it holds map.db, a database of RTAB-Map"):
        read_recording(tmp_path / "folder")


def test_an_archive_is_named_with_the_command_that_unpacks_it(tmp_path: Path) -> None:
    (tmp_path / "drive.bag").write_bytes(b"#ROSBAG V2.0\n")
    with zipfile.ZipFile(tmp_path / "drive.zip", "w") as file:
        file.write(tmp_path / "drive.bag", "day/drive.bag")
    with pytest.raises(RecordingUnknown, match=r"zip\) that holds day/drive.bag.*unpack it \(unzip\)"):
        read_recording(tmp_path / "drive.zip")
    for name, mode in (("drive.tar", "w"), ("drive.tar.gz", "w:gz"), ("drive.tar.xz", "w:xz")):
        with tarfile.open(tmp_path / name, mode) as archive:  # type: ignore[call-overload]
            archive.add(tmp_path / "drive.bag")
        with pytest.raises(RecordingUnknown, match=r"packed folder \(tar\).*unpack it \(tar -xf\)"):
            read_recording(tmp_path / name)


def record(op: int, content: bytes) -> bytes:
    return bytes([op]) + struct.pack("<Q", len(content)) + content


def text(value: str) -> bytes:
    return struct.pack("<I", len(value)) + value.encode()


@pytest.mark.parametrize(("encoding", "told"), [("protobuf", "Protobuf messages"), ("ros1", "ROS 1 messages")])
def test_an_mcap_file_of_other_messages_is_no_damaged_bag(tmp_path: Path, encoding: str, told: str) -> None:
    """A file by the MCAP specification: a header, a schema, a channel, and a message."""
    file = io.BytesIO()
    file.write(b"\x89MCAP0\r\n" + record(0x01, text("") + text("other")))
    file.write(record(0x03, struct.pack("<H", 1) + text("foxglove.LaserScan") + text(encoding) + text("")))
    file.write(record(0x04, struct.pack("<HH", 1, 1) + text("/scan") + text(encoding) + struct.pack("<I", 0)))
    file.write(record(0x05, struct.pack("<HIQQ", 1, 0, 1, 1) + b"\x08\x01"))
    file.write(record(0x0F, struct.pack("<I", 0)) + record(0x02, struct.pack("<QQI", 0, 0, 0)) + b"\x89MCAP0\r\n")
    (tmp_path / "drive.mcap").write_bytes(file.getvalue())
    with pytest.raises(RecordingUnknown, match=f"an MCAP file of {told}"):
        read_recording(tmp_path / "drive.mcap")


def test_a_file_of_noise_and_a_folder_of_other_things_say_which_would_be_right(tmp_path: Path) -> None:
    (tmp_path / "noise.bag").write_bytes(bytes(range(256)) * 8)
    with pytest.raises(RecordingUnknown, match=r"neither a text log nor a bag: give a .clf"):
        read_recording(tmp_path / "noise.bag")
    (tmp_path / "noise.bag").rename(tmp_path / "noise.bin")
    with pytest.raises(RecordingUnknown, match="bare numbers"):
        read_recording(tmp_path / "noise.bin")
    (tmp_path / "prose.txt").write_text("Nothing that a lidar has seen.\n")
    with pytest.raises(RecordingUnknown, match=r"prose.txt is neither a CARMEN"):
        read_recording(tmp_path / "prose.txt")


def test_the_metadata_of_a_bag_stands_for_its_folder(tmp_path: Path) -> None:
    from tests.cases.mapping.test_several_files import SCANS, part

    bag = part(tmp_path / "drive", range(SCANS), ros=2)
    recording = read_recording(bag / "metadata.yaml")
    assert len(recording.frames) == SCANS
    assert "its folder was read" in recording.warnings[0]
