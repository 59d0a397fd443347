"""Salvaging a damaged ROS bag: truncated, without its index, or with corrupted bytes.

The reader walks the records from the start of the file (ROS bag format 2.0, the MCAP specification, and the tables of
rosbag2's sqlite3 storage). It skips damaged chunks, messages and pages, and ends where record lengths are impossible.
"""

from __future__ import annotations

import os
import shutil
import sqlite3
import struct
import tempfile
from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from contextlib import closing, contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

from rosbags.interfaces import Connection, ConnectionExtRosbag2, MessageDefinition, MessageDefinitionFormat
from rosbags.rosbag1.reader import decompressors as ROS1_DECOMPRESSORS
from rosbags.rosbag2.storage_mcap import DECOMPRESSORS as MCAP_DECOMPRESSORS
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore
from rosbags.typesys.msg import normalize_msgtype
from rosbags.typesys.store import Typestore

_LARGEST_CHUNK = 1 << 31
_LONGEST_JUMP = 1 << 22  # rows that are skipped at most in search of a readable one
_FORMATS = {"ros2msg": MessageDefinitionFormat.MSG, "ros2idl": MessageDefinitionFormat.IDL}
# Damaged bytes raise many kinds of errors in parsers and decompressors.
_PARSE_ERRORS = Exception


class _Topic(NamedTuple):
    key: int
    name: str
    msgtype: str
    definition: MessageDefinition


class _Message(NamedTuple):
    key: int
    log_ns: int
    data: bytes


_Record = _Topic | _Message


class SalvagedBag:
    """The readable part of a damaged bag, with the part of the interface of rosbags' `AnyReader` that `BagFile` needs.

    `lost` counts the skipped parts by kind: chunks, pages, and "end" if the rest of the file could not be read.
    """

    def __init__(self, members: Sequence[tuple[Path, str]]) -> None:
        """Open a bag by its files, each of a kind: .bag, .mcap, .db3, or '' for a folder of the latter two."""
        self.is2 = any(suffix != ".bag" for _, suffix in members)
        self.lost: Counter[str] = Counter()
        self._files = [
            each for path, suffix in members for each in (_storage_files(path) if suffix == "" else [(path, suffix)])
        ]
        topics: dict[tuple[int, int], _Topic] = {}
        counts: Counter[tuple[int, int]] = Counter()
        for file, record in self._records():
            if isinstance(record, _Topic):
                topics.setdefault((file, record.key), record)
            else:
                counts[file, record.key] += 1
        self.lost.clear()  # `messages` counts them again
        nothing = ConnectionExtRosbag2("cdr", [])
        self._by_key = {
            key: Connection(
                id=n,
                topic=t.name,
                msgtype=t.msgtype,
                msgdef=t.definition,
                digest="",
                msgcount=counts[key],
                ext=nothing,
                owner=self,
            )
            for n, (key, t) in enumerate(topics.items())
        }
        self.connections = list(self._by_key.values())
        self._types = _typestore(self.connections, self.is2)

    def messages(self, connections: Collection[Connection]) -> Iterator[tuple[Connection, int, bytes]]:
        """Yield connection, time of logging [ns] and bytes of every readable message, in file order."""
        self.lost.clear()
        wanted = {connection.id for connection in connections}
        for file, record in self._records():
            connection = self._by_key.get((file, record.key))
            if isinstance(record, _Message) and connection is not None and connection.id in wanted:
                yield connection, record.log_ns, record.data

    def deserialize(self, data: bytes, msgtype: str) -> Any:
        """Return the message of these bytes."""
        store = self._types
        return store.deserialize_cdr(data, msgtype) if self.is2 else store.deserialize_ros1(data, msgtype)

    def _records(self) -> Iterator[tuple[int, _Record]]:
        for number, (path, suffix) in enumerate(self._files):
            yield from ((number, record) for record in _WALKS[suffix](path, self.lost))


def _storage_files(folder: Path) -> list[tuple[Path, str]]:
    return [(path, path.suffix) for path in sorted(folder.iterdir()) if path.suffix in (".mcap", ".db3")]


def _typestore(connections: list[Connection], is2: bool) -> Typestore:
    """Return the types that the bag defines; where a definition is missing or broken, those of the distribution."""
    store = get_typestore(Stores.ROS2_JAZZY if is2 else Stores.ROS1_NOETIC)
    for connection in connections:
        definition = connection.msgdef
        if definition.format is MessageDefinitionFormat.NONE or connection.msgtype in store.types:
            continue
        try:
            if definition.format is MessageDefinitionFormat.MSG:
                store.register(get_types_from_msg(definition.data, connection.msgtype))
            else:
                store.register(get_types_from_idl(definition.data))
        except _PARSE_ERRORS:
            continue
    return store


def _ros1_walk(path: Path, lost: Counter[str]) -> Iterator[_Record]:
    with path.open("rb") as file:
        file.readline()  # the magic line
        for header, data in _ros1_records(file, path.stat().st_size, lost):
            if header.get(b"op") != b"\x05":
                yield from _ros1_record(header, data)
                continue
            try:
                chunk = ROS1_DECOMPRESSORS[header[b"compression"].decode()](data)
            except _PARSE_ERRORS:
                lost["chunks"] += 1
                continue
            for inner, content in _ros1_records(BytesIO(chunk), len(chunk), lost):
                yield from _ros1_record(inner, content)


def _ros1_records(file: BinaryIO, size: int, lost: Counter[str]) -> Iterator[tuple[dict[bytes, bytes], bytes]]:
    """Yield header fields and data of each record; of a truncated uncompressed chunk, the data so far."""
    while file.tell() < size:
        header = _sized(file, size, "<I")
        fields = dict(_ros1_fields(header)) if header is not None else {}
        keep_truncated = fields.get(b"compression") == b"none"  # the messages of such a chunk can be read one by one
        data = _sized(file, size, "<I", keep_truncated=keep_truncated) if header is not None else None
        if data is None:
            lost["end"] += 1
            return
        yield fields, data


def _ros1_fields(header: bytes) -> Iterator[tuple[bytes, bytes]]:
    at = 0
    while at + 4 <= len(header):
        (length,) = struct.unpack_from("<I", header, at)
        name, _, value = header[at + 4 : at + 4 + length].partition(b"=")
        yield name, value
        at += 4 + length


def _ros1_record(header: dict[bytes, bytes], data: bytes) -> Iterator[_Record]:
    try:
        if header.get(b"op") == b"\x07":
            fields = dict(_ros1_fields(data))
            definition = MessageDefinition(MessageDefinitionFormat.MSG, fields[b"message_definition"].decode())
            (key,) = struct.unpack("<I", header[b"conn"])
            yield _Topic(key, header[b"topic"].decode(), normalize_msgtype(fields[b"type"].decode()), definition)
        elif header.get(b"op") == b"\x02":
            (key,), (seconds, nanoseconds) = struct.unpack("<I", header[b"conn"]), struct.unpack("<II", header[b"time"])
            yield _Message(key, seconds * 1_000_000_000 + nanoseconds, data)
    except _PARSE_ERRORS:
        return


def _mcap_walk(path: Path, lost: Counter[str]) -> Iterator[_Record]:
    schemas: dict[int, tuple[str, MessageDefinition]] = {}
    with path.open("rb") as file:
        file.seek(8)  # the magic bytes
        for op, content in _mcap_records(file, path.stat().st_size, lost):
            if op == 0x0F:  # the end of the data; the index follows
                return
            if op != 0x06:
                yield from _mcap_record(op, content, schemas)
                continue
            try:
                chunk = _mcap_chunk(content)
            except _PARSE_ERRORS:
                lost["chunks"] += 1
                continue
            for inner, record in _mcap_records(BytesIO(chunk), len(chunk), lost):
                yield from _mcap_record(inner, record, schemas)


def _mcap_records(file: BinaryIO, size: int, lost: Counter[str]) -> Iterator[tuple[int, bytes]]:
    while file.tell() < size:
        op = file.read(1)[0]
        content = _sized(file, size, "<Q", keep_truncated=op == 0x06)
        if content is None:
            lost["end"] += 1
            return
        yield op, content


def _mcap_chunk(content: bytes) -> bytes:
    length, _, name_length = struct.unpack_from("<QII", content, 16)
    name = content[32 : 32 + name_length].decode()
    if length > _LARGEST_CHUNK:
        raise ValueError("no chunk is that large")
    return MCAP_DECOMPRESSORS[name](content[40 + name_length :], length)


def _mcap_record(op: int, content: bytes, schemas: dict[int, tuple[str, MessageDefinition]]) -> Iterator[_Record]:
    try:
        if op == 0x05:
            key, _, log_ns = struct.unpack_from("<HIQ", content)
            yield _Message(key, log_ns, content[22:])
        elif op == 0x03:
            (key,) = struct.unpack_from("<H", content)
            (name, encoding, text), _ = _strings(content, 2, 3)
            schemas[key] = name, MessageDefinition(_FORMATS.get(encoding, MessageDefinitionFormat.NONE), text)
        elif op == 0x04:
            key, schema = struct.unpack_from("<HH", content)
            (topic, _), _ = _strings(content, 4, 2)
            yield _Topic(key, topic, *schemas[schema])
    except _PARSE_ERRORS:
        return


def _strings(content: bytes, at: int, count: int) -> tuple[list[str], int]:
    texts = []
    for _ in range(count):
        (length,) = struct.unpack_from("<I", content, at)
        texts.append(content[at + 4 : at + 4 + length].decode())
        at += 4 + length
    return texts, at


def _sized(file: BinaryIO, size: int, kind: str, *, keep_truncated: bool = False) -> bytes | None:
    """Read a length-prefixed block; at a truncated end return the bytes so far if `keep_truncated`, else None."""
    prefix = file.read(struct.calcsize(kind))
    if len(prefix) < struct.calcsize(kind):
        return None
    (length,) = struct.unpack(kind, prefix)
    left = size - file.tell()
    return file.read(min(length, left)) if length <= left or keep_truncated else None


def _sqlite_walk(path: Path, lost: Counter[str]) -> Iterator[_Record]:
    with _whole_pages(path, lost) as whole:
        uri = f"{whole.resolve().as_uri()}?mode=ro&immutable=1"
        with closing(sqlite3.connect(uri, uri=True)) as database:
            database.text_factory = lambda text: text.decode(errors="replace")
            # Without this, sqlite refuses a file with fewer pages than its header says.
            database.execute("PRAGMA writable_schema = ON")
            try:
                nothing = MessageDefinition(MessageDefinitionFormat.NONE, "")
                for key, name, kind in database.execute("SELECT id, name, type FROM topics"):
                    yield _Topic(key, name, kind, nothing)
            except sqlite3.Error:
                lost["pages"] += 1
            yield from _sqlite_messages(database, lost)


@contextmanager
def _whole_pages(path: Path, lost: Counter[str]) -> Iterator[Path]:
    """Yield the database, or a copy without its last page if that is truncated; sqlite would fill it with zeros."""
    size = path.stat().st_size
    whole = size - size % _page_size(path)
    if whole == size:
        yield path
        return
    lost["end"] += 1
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / path.name
        shutil.copyfile(path, copy)
        os.truncate(copy, whole)
        yield copy


def _page_size(path: Path) -> int:
    """Return the bytes of a page, from the database's header (offset 16; 1 means 65536)."""
    with path.open("rb") as file:
        header = file.read(18)
    size = int.from_bytes(header[16:18], "big")
    return 65536 if size == 1 else max(512, size)


def _sqlite_messages(database: sqlite3.Connection, lost: Counter[str]) -> Iterator[_Message]:
    """Yield the rows by ascending id, skipping unreadable ones."""
    query = "SELECT id, topic_id, timestamp, data FROM messages WHERE id > ? ORDER BY id"
    last, jump = 0, 0
    while jump < _LONGEST_JUMP:
        try:
            for row, key, log_ns, data in database.execute(query, (last + jump,)):
                if not isinstance(row, int) or row <= last:  # the tree of the table is broken
                    raise sqlite3.DatabaseError("rows are out of order")
                last, jump = row, 0
                if isinstance(data, bytes) and isinstance(log_ns, int):
                    yield _Message(key, log_ns, data)
            return
        except sqlite3.Error:
            lost["pages"] += 1
            jump = 2 * jump + 1


_WALKS = {".bag": _ros1_walk, ".mcap": _mcap_walk, ".db3": _sqlite_walk}
