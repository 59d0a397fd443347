"""Files of other kinds than recordings: maps, graphs, clouds, videos and archives, named for what they are.

A kind is recognised by its content: by magic bytes, by the tables of a database, by the channels of an MCAP file, or by
the first line of a text. Only where the content tells nothing does the name's ending count. The magic bytes are those of
the formats' own documents; Cartographer's are in its io/proto_stream.cc, those of boost archives in boost/archive.
"""

from __future__ import annotations

import re
import sqlite3
import struct
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import NamedTuple

from waychair.recordings.packed import PACKED_ENDINGS


class OtherKind(NamedTuple):
    """A kind of file that is no recording: its name with an article, and the way on."""

    name: str
    advice: str

    def sentence(self, path: Path) -> str:
        """Return the sentence for a file of this kind."""
        return f"{path} is {self.name}, not a recording: {self.advice}"


_ITS_BAG = "give the bag or log that it was made from"
_AS_MAP = "to plan and drive on its map, give the map as map.yaml to plan and navigate"
_RECORD = "play it through the sensor's ROS driver, record a bag (ros2 bag record -a) and give that"
_UNPACK = "unpack it ({}) and give the recording in it"

RTABMAP = OtherKind(
    "a database of RTAB-Map",
    f"{_ITS_BAG}, or extract its pictures with rtabmap-databaseViewer (File, Extract images) and give the folder with rgb/ "
    "and depth/",
)
_PBSTREAM = OtherKind(
    "a map of Cartographer (.pbstream)", f"{_ITS_BAG}; {_AS_MAP} (cartographer_pbstream_to_ros_map writes one)"
)
_POSEGRAPH = OtherKind(
    "a pose graph of slam_toolbox (.posegraph and .data)",
    f"{_ITS_BAG}; {_AS_MAP} (ros2 run nav2_map_server map_saver_cli writes one)",
)
_CLOUD = OtherKind("a single point cloud", f"{_ITS_BAG}, with the scans or clouds of the whole drive")
_PACKETS = OtherKind("a capture of network packets", f"it holds a lidar's raw packets; {_RECORD}")
_GRAPH = OtherKind("a pose graph (g2o)", f"it holds no scans; {_ITS_BAG}")
_VIDEO = OtherKind("a video", "give a bag with depth pictures, or a folder with rgb/ and depth/")
_PICTURE = OtherKind("a picture", f"give the folder with rgb/ and depth/; {_AS_MAP}")
_ARRAYS = OtherKind("a file of arrays (NumPy, HDF5 or MATLAB)", f"{_ITS_BAG}")
_SVO = OtherKind("a recording of a ZED camera (.svo)", f"{_RECORD}, or export it as pictures with ZED's own tools")
_ONI = OtherKind("a recording of OpenNI (.oni)", _RECORD)
_ZIP = OtherKind("a packed file (zip)", _UNPACK.format("unzip"))
_TAR = OtherKind("a packed folder (tar)", _UNPACK.format("tar -xf"))
_RAR = OtherKind("a packed file (7z or rar)", _UNPACK.format("7z x"))
_LZ4 = OtherKind("a file packed by lz4", _UNPACK.format("unlz4"))
_LFS = OtherKind("only a pointer of Git LFS to the file", "fetch the file itself with git lfs pull")
_PAGE = OtherKind("a web page", "the download went wrong: download the recording again, logged in if need be")
_METADATA = OtherKind(
    "the description of a ROS 2 bag", "copy it beside the bag's .mcap or .db3 files, and give their folder"
)
_MAP_YAML = OtherKind("a map", "plan and navigate take it by --map; to make a map, give a bag or log")
_TRAJECTORY = OtherKind(
    "a trajectory (a stamp and a pose on each line)",
    "it holds no scans; evaluate takes it; to make a map, give a bag or log",
)
_RELATIONS = OtherKind(
    "a file of relations between poses", "evaluate takes it by --relations; to make a map, give a bag or log"
)
_PICTURE_LIST = OtherKind("a list of pictures", "give the folder in which it lies, with rgb/ and depth/")
_CSV = OtherKind("a table (.csv)", f"tables are not read; {_ITS_BAG}")
_DATA_TEXT = OtherKind("a structured text (JSON, YAML or XML)", f"{_ITS_BAG}")
_OLD_BAG = OtherKind("a ROS bag of the old version 1.1 or 1.2", "convert it with rosbag fix of ROS 1")
_DOCUMENT = OtherKind("a document (PDF)", "give a bag or log")
_PROGRAM = OtherKind("a program", "give a bag or log")
_MEMORY = OtherKind("the memory of places of a map (memory.db)", "give the bag or log that the map was made from")

_MAGIC: tuple[tuple[int, bytes, OtherKind], ...] = (
    (0, bytes.fromhex("db01f55b7b1f1d7b"), _PBSTREAM),
    (8, b"serialization::archive", _POSEGRAPH),
    (4, b"serialization::archive", _POSEGRAPH),
    (3, b"serialization::archive", _POSEGRAPH),
    (0, b"22 serialization::archive", _POSEGRAPH),
    (0, b"ply\n", _CLOUD),
    (0, b"ply\r", _CLOUD),
    (0, b"LASF", _CLOUD),
    (0, b"ASTM-E57", _CLOUD),
    (0, b"# .PCD", _CLOUD),
    (0, b"\xd4\xc3\xb2\xa1", _PACKETS),
    (0, b"\xa1\xb2\xc3\xd4", _PACKETS),
    (0, b"\x4d\x3c\xb2\xa1", _PACKETS),
    (0, b"\xa1\xb2\x3c\x4d", _PACKETS),
    (0, b"\x0a\x0d\x0d\x0a", _PACKETS),
    (0, b"PK\x03\x04", _ZIP),
    (0, b"PK\x05\x06", _ZIP),
    (257, b"ustar", _TAR),
    (0, b"7z\xbc\xaf\x27\x1c", _RAR),
    (0, b"Rar!", _RAR),
    (0, b"\x04\x22\x4d\x18", _LZ4),
    (0, b"\x89HDF", _ARRAYS),
    (0, b"\x93NUMPY", _ARRAYS),
    (0, b"MATLAB 5.0", _ARRAYS),
    (0, b"NI10", _ONI),
    (0, b"SVO", _SVO),
    (0, b"\x1a\x45\xdf\xa3", _VIDEO),
    (4, b"ftyp", _VIDEO),
    (8, b"AVI ", _VIDEO),
    (0, b"\x89PNG", _PICTURE),
    (0, b"\xff\xd8\xff", _PICTURE),
    (0, b"II*\x00", _PICTURE),
    (0, b"MM\x00*", _PICTURE),
    (0, b"P5\n", _PICTURE),
    (0, b"P2\n", _PICTURE),
    (0, b"P6\n", _PICTURE),
    (0, b"GIF8", _PICTURE),
    (0, b"%PDF", _DOCUMENT),
    (0, b"\x7fELF", _PROGRAM),
    (0, b"version https://git-lfs", _LFS),
    (0, b"#ROSBAG V1", _OLD_BAG),
    (0, b"#ROSRECORD", _OLD_BAG),
)

_ENDINGS: dict[str, OtherKind] = {
    ".pbstream": _PBSTREAM,
    ".posegraph": _POSEGRAPH,
    ".data": _POSEGRAPH,
    ".g2o": _GRAPH,
    ".graph": _GRAPH,
    ".pcd": _CLOUD,
    ".ply": _CLOUD,
    ".las": _CLOUD,
    ".laz": _CLOUD,
    ".e57": _CLOUD,
    ".xyz": _CLOUD,
    ".pts": _CLOUD,
    ".bin": OtherKind("bare numbers without a description (.bin)", f"{_ITS_BAG}"),
    ".pcap": _PACKETS,
    ".pcapng": _PACKETS,
    ".svo": _SVO,
    ".svo2": _SVO,
    ".oni": _ONI,
    ".klg": OtherKind("a recording of ElasticFusion (.klg)", "unpack it into rgb/ and depth/ and give that folder"),
    ".rawlog": OtherKind("a recording of MRPT (.rawlog)", "convert its scans to a CARMEN log or a bag"),
    ".alog": OtherKind("a log of MOOS (.alog)", "convert its scans to a CARMEN log or a bag"),
    ".zip": _ZIP,
    ".tar": _TAR,
    ".tgz": _TAR,
    ".7z": _RAR,
    ".rar": _RAR,
    ".csv": _CSV,
    ".tum": _TRAJECTORY,
    ".npz": _ARRAYS,
    ".npy": _ARRAYS,
    ".mat": _ARRAYS,
    ".h5": _ARRAYS,
    ".mp4": _VIDEO,
    ".avi": _VIDEO,
    ".mkv": _VIDEO,
}

_GRAPH_WORDS = re.compile(rb"(VERTEX_SE[23]|EDGE_SE[23]|VERTEX_XY|EDGE_SE2_XY|VERTEX_TRACKXYZ|PARAMS_SE3OFFSET|FIX )")
_CLOUD_WORDS = re.compile(rb"(VERSION \.?\d|FIELDS [a-z])")
_PICTURE_LINE = re.compile(rb"^[\d.eE+-]+[\s,;]+\S+\.(png|jpe?g|tiff?)\b")
_SINCE_1970 = 1e8  # s; a larger number is a stamp
_MCAP_ENCODINGS = {b"ros1": "ROS 1 messages", b"protobuf": "Protobuf messages", b"json": "JSON messages"}


def other_kind(path: Path, head: bytes) -> OtherKind | None:
    """Return the kind of a file that is certainly no recording, by its first bytes; None for anything else.

    A file with the beginning of a SQLite database or of an MCAP file is opened. 512 bytes of `head` are enough.
    """
    if head.startswith(b"SQLite format 3\x00"):
        return _database_kind(path)
    if head.startswith(b"\x89MCAP"):
        return _mcap_kind(path)
    for at, magic, kind in _MAGIC:
        if head[at : at + len(magic)] == magic:
            return _in_zip(path) if kind is _ZIP else kind
    first = _first_line(head)
    if _GRAPH_WORDS.match(first):
        return _GRAPH
    return _CLOUD if _CLOUD_WORDS.match(first) else None


def likely_kind(path: Path, head: bytes) -> OtherKind | None:
    """Return the kind of a file that no reader understands: by the form of its text, else by its ending."""
    text = head.lstrip(b"\xef\xbb\xbf \t\r\n")
    lower = text[:4096].lower()
    if lower.startswith((b"<!doctype html", b"<html")):
        return _PAGE
    if b"rosbag2_bagfile_information" in text:
        return _METADATA
    if re.search(rb"^image\s*:", text, re.MULTILINE) and re.search(rb"^resolution\s*:", text, re.MULTILINE):
        return _MAP_YAML
    ending = Path(path.stem if path.suffix.lower() in PACKED_ENDINGS else path.name).suffix.lower()
    if ending in _ENDINGS:
        return _ENDINGS[ending]
    if text.startswith((b"{", b"[", b"<?xml", b"---", b"%YAML")) or ending in (".yaml", ".yml", ".json"):
        return _DATA_TEXT
    first = _first_line(head)
    if _PICTURE_LINE.search(first):
        return _PICTURE_LIST
    numbers = _numbers(first.split())
    if len(numbers) == 8:
        two_stamps = numbers[0] > _SINCE_1970 and abs(numbers[1] - numbers[0]) < numbers[0] / 2
        return _RELATIONS if two_stamps else _TRAJECTORY
    return _CSV if _is_table(first) else None


def is_text(head: bytes) -> bool:
    """Return whether a file begins as a text does: without zero bytes, and mostly without control characters."""
    control = sum(byte < 32 and byte not in (9, 10, 12, 13) for byte in head)
    return 0 not in head and control * 50 <= len(head)


def _first_line(head: bytes) -> bytes:
    lines = (line.strip() for line in head.split(b"\n"))
    return next((line for line in lines if line and not line.startswith(b"#")), b"")


def _is_table(line: bytes) -> bool:
    """Return whether a line is of short fields between commas or semicolons."""
    fields = re.split(rb"[,;]", line)
    return len(fields) > 2 and all(len(field.split()) <= 3 for field in fields)


def _numbers(fields: list[bytes]) -> list[float]:
    """Return the fields as numbers; none if one is not."""
    try:
        return [float(field) for field in fields]
    except ValueError:
        return []


def _database_kind(path: Path) -> OtherKind | None:
    """Return the kind of a SQLite database that is no bag; None for a bag and for a damaged database."""
    try:
        with closing(sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro&immutable=1", uri=True)) as database:
            names = {str(name) for (name,) in database.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
    except sqlite3.Error:
        return None
    lower = {name.lower() for name in names}
    if not lower or {"topics", "messages"} & lower:
        return None
    if {"node", "link"} <= lower:
        return RTABMAP
    if {"nodes", "links", "words", "anchors"} <= lower:
        return _MEMORY
    told = ", ".join(sorted(names)[:5])
    return OtherKind(f"a SQLite database with the tables {told}", f"a ROS 2 bag has topics and messages; {_ITS_BAG}")


def _mcap_kind(path: Path) -> OtherKind | None:
    """Return the kind of an MCAP file all of whose channels hold other messages than ROS 2's; None for a bag."""
    encodings = set(_mcap_encodings(path))
    if not encodings or b"cdr" in encodings:
        return None
    names = " and ".join(sorted(_MCAP_ENCODINGS.get(name, name.decode(errors="replace")) for name in encodings))
    if path.suffix.lower() in (".svo", ".svo2"):
        return _SVO
    return OtherKind(
        f"an MCAP file of {names}",
        "only those of ROS 2 messages (cdr) are read: give the bag that it was made from, or convert it to a ROS 2 bag",
    )


def _mcap_encodings(path: Path) -> Iterator[bytes]:
    """Yield the message encodings of the channels in an MCAP file's summary, or in its uncompressed beginning."""
    try:
        with path.open("rb") as file:
            size = path.stat().st_size
            file.seek(max(0, size - 37))  # a footer record of 29 bytes, and 8 magic bytes
            footer = file.read(37)
            start = struct.unpack_from("<Q", footer, 9)[0] if footer[:1] == b"\x02" else 0
            file.seek(start if 8 <= start < size else 8)
            data = file.read(1 << 20)
    except (OSError, struct.error):
        return
    at = 0
    while at + 9 <= len(data):
        op, (length,) = data[at], struct.unpack_from("<Q", data, at + 1)
        content = data[at + 9 : at + 9 + length]
        if op == 0x04 and len(content) == length:
            try:
                (topic_length,) = struct.unpack_from("<I", content, 4)
                (name_length,) = struct.unpack_from("<I", content, 8 + topic_length)
            except struct.error:
                return
            yield content[12 + topic_length : 12 + topic_length + name_length]
        at += 9 + length


def _in_zip(path: Path) -> OtherKind:
    """Return the kind of a ZIP file, with the recordings in it by name."""
    import zipfile

    try:
        with zipfile.ZipFile(path) as file:
            names = file.namelist()
    except (OSError, zipfile.BadZipFile):
        return _ZIP
    if names and all(name.endswith(".npy") for name in names):
        return _ARRAYS
    inside = [name for name in names if name.endswith((".bag", ".mcap", ".db3", ".clf", ".log", "metadata.yaml"))]
    return _ZIP._replace(name=f"a packed file (zip) that holds {inside[0]}") if inside else _ZIP
