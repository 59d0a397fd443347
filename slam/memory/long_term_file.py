"""The file of the long-term memory: one SQLite database, every record with its own checksum.

WAL: a transaction is in the file as a whole or not at all, even if the process is killed, and readers do not wait for
the writer. `synchronous=FULL`: each commit is on disk when it returns. NORMAL would survive a killed process, but not a
chair switched off by its key: it may lose everything since the last checkpoint, minutes of a map. The writer's thread
waits for the disk, so FULL costs a frame nothing.
"""

from __future__ import annotations

import sqlite3
import struct
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from waychair.errors import LongTermError
from waychair.slam.memory.nodes import Link, LinkKind, MemoryNode, pack_evidence, pack_features, seal, unpack, unseal
from waychair.types import Bytes, FloatArray, IntArray, Pose2

SCHEMA = 1
_APPLICATION = 0x57434D45  # "WCME": the file is a memory of waychair
_HEADER = b"SQLite format 3\x00"

_TABLES = """
CREATE TABLE nodes (id INTEGER PRIMARY KEY, about BLOB NOT NULL, evidence BLOB NOT NULL, features BLOB NOT NULL);
CREATE TABLE states (id INTEGER PRIMARY KEY, data BLOB NOT NULL);
CREATE TABLE links (i INTEGER, j INTEGER, data BLOB NOT NULL, PRIMARY KEY (i, j)) WITHOUT ROWID;
CREATE TABLE words (id INTEGER PRIMARY KEY, data BLOB NOT NULL);
CREATE TABLE anchors (id INTEGER PRIMARY KEY, data BLOB NOT NULL);
"""

_ABOUT = struct.Struct("<qi3d")  # stamp [ns], map id, odometry
_STATE = struct.Struct("<i?i3di")
_LINK = struct.Struct("<b12d")
_POSE = struct.Struct("<3d")

_WAL_LIMIT = 16 * 2**20
"""Bytes to which the log is truncated once it is written into the file."""

_PARAMETERS = 500  # in one statement; SQLite's oldest versions allow 999

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class NodeState:
    """The changing part of a node: weight, awake or not, anchor.

    `parent` is 0, or in an older file the id of the node into which this one was merged.
    """

    id: int
    weight: int
    awake: bool
    anchor: int
    anchor_from_node: Pose2
    parent: int = 0


@dataclass(frozen=True, slots=True)
class Batch:
    """The changes of one transaction, written as a whole or not at all."""

    nodes: tuple[MemoryNode, ...] = ()
    rewritten: tuple[MemoryNode, ...] = ()
    """Nodes in the file whose words have new ids."""
    states: tuple[NodeState, ...] = ()
    links: tuple[Link, ...] = ()
    unlinked: tuple[tuple[int, int], ...] = ()
    gone: tuple[int, ...] = ()
    words: tuple[IntArray, Bytes] | None = None
    """New words: their ids (K,), and descriptors (K, D) as bytes."""
    anchors: tuple[IntArray, FloatArray] | None = None
    """Anchors with new poses: ids (K,), poses (K, 3)."""

    def holds(self, node: int) -> bool:
        """Return whether the batch writes a node."""
        return any(written.id == node for written in (*self.nodes, *self.rewritten))

    def holds_words(self, words: IntArray) -> bool:
        """Return whether the batch writes one of the words (K,)."""
        return self.words is not None and bool(np.isin(words, self.words[0]).any())


@dataclass(frozen=True, slots=True)
class StoredMemory:
    """The content of a file except the views themselves, without its `damaged` records."""

    nodes: tuple[tuple[int, int, int], ...] = ()
    """id, map id and stamp [ns], in ascending order."""
    states: tuple[NodeState, ...] = ()
    links: tuple[Link, ...] = ()
    anchors: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
    damaged: int = 0
    last: int = 0
    """The highest id in use, damaged or not."""


def find_damage(path: Path) -> str:
    """Return the damage of the file in words; '' where it is sound, empty or missing.

    Raises:
        LongTermError: the file cannot be read, or belongs to another program.
    """
    try:
        if not path.exists() or path.stat().st_size == 0:
            return ""
        with path.open("rb") as file:
            if file.read(len(_HEADER)) != _HEADER:
                return "it does not begin as an SQLite file does"
    except OSError as error:
        raise LongTermError(
            f"cannot read {path}: {error.strerror}; check its rights, or choose another file"
        ) from error
    try:
        connection = connect(path)
        try:
            application, schema = (_pragma(connection, name) for name in ("application_id", "user_version"))
            tables = {made for (made,) in connection.execute("SELECT sql FROM sqlite_master WHERE type = 'table'")}
            found = connection.execute("PRAGMA quick_check(1)").fetchone()[0].decode("utf-8", "replace")
        finally:
            connection.close()
    except sqlite3.OperationalError as error:
        raise LongTermError(f"cannot open {path}: {error}; close any other program that uses it") from error
    except (sqlite3.DatabaseError, UnicodeDecodeError) as error:  # the message may quote damaged text
        return str(error)
    if application == 0 and schema == 0 and not tables:
        return ""  # a database without any table
    if application != _APPLICATION:
        raise LongTermError(f"{path} is a database of another program; choose another file")
    if schema > SCHEMA:
        raise LongTermError(f"{path} has schema {schema}, this program reads {SCHEMA}; use the newer program")
    if schema < SCHEMA or tables != {made.strip().encode() for made in _TABLES.split(";")[:-1]}:
        return f"its tables are not those of schema {SCHEMA}"
    return "" if found == "ok" else found


def quarantine(path: Path) -> Path:
    """Move the file and its log to a free name beside it; return that name.

    Raises:
        LongTermError: the file cannot be moved.
    """
    number = 1
    while (aside := path.with_name(f"{path.name}.damaged-{number}")).exists():
        number += 1
    try:
        for suffix in ("-wal", "-shm", ""):
            part = path.with_name(path.name + suffix)
            if part.exists():
                part.rename(aside.with_name(aside.name + suffix))
    except OSError as error:
        raise LongTermError(f"cannot move the damaged {path} aside: {error.strerror}; move it by hand") from error
    return aside


def connect(path: Path | None) -> sqlite3.Connection:
    """Return a connection to the file, or to a database in RAM without a path."""
    name = ":memory:" if path is None else str(path)
    connection = sqlite3.connect(name, timeout=10.0, isolation_level=None, check_same_thread=False)
    connection.text_factory = bytes  # damaged text may not be UTF-8
    return connection


def prepare_writer(connection: sqlite3.Connection, most_bytes: int | None) -> None:
    """Prepare a connection for writing, and create the tables if they are missing."""
    connection.execute("PRAGMA journal_mode=WAL")
    connection.execute("PRAGMA synchronous=FULL")
    connection.execute(f"PRAGMA journal_size_limit={_WAL_LIMIT}")
    if most_bytes is not None:
        pages = max(1, most_bytes // _pragma(connection, "page_size"))
        connection.execute(f"PRAGMA max_page_count={pages}")
    if _pragma(connection, "user_version") == 0:
        made = f"{_TABLES} PRAGMA application_id={_APPLICATION}; PRAGMA user_version={SCHEMA};"
        connection.executescript(f"BEGIN; {made} COMMIT;")


def write(connection: sqlite3.Connection, batch: Batch) -> None:
    """Write the batch in one transaction.

    Raises:
        sqlite3.Error: writing failed; nothing was written.
    """
    connection.execute("BEGIN IMMEDIATE")
    try:
        run = connection.executemany
        run("INSERT INTO nodes VALUES (?, ?, ?, ?)", (_node_row(node) for node in batch.nodes))
        run("REPLACE INTO nodes VALUES (?, ?, ?, ?)", (_node_row(node) for node in batch.rewritten))
        run("REPLACE INTO states VALUES (?, ?)", (_state_row(state) for state in batch.states))
        run("DELETE FROM links WHERE i = ? AND j = ?", ((min(ends), max(ends)) for ends in batch.unlinked))
        run("REPLACE INTO links VALUES (?, ?, ?)", (_link_row(link) for link in batch.links))
        for table in ("nodes", "states"):
            run(f"DELETE FROM {table} WHERE id = ?", ((node,) for node in batch.gone))
        if batch.words is not None:
            pairs = zip(batch.words[0].tolist(), batch.words[1], strict=True)
            run("REPLACE INTO words VALUES (?, ?)", ((word, seal(word, row.tobytes())) for word, row in pairs))
        if batch.anchors is not None:
            places = zip(batch.anchors[0].tolist(), batch.anchors[1].tolist(), strict=True)
            run("REPLACE INTO anchors VALUES (?, ?)", ((k, seal(k, _POSE.pack(*pose))) for k, pose in places))
        connection.execute("COMMIT")
    except BaseException:
        if connection.in_transaction:
            connection.execute("ROLLBACK")
        raise


def read_all(connection: sqlite3.Connection) -> StoredMemory:
    """Return everything but the views.

    Raises:
        sqlite3.Error: the file cannot be read.
    """
    damaged: list[int] = []

    def sound(rows: Iterable[tuple[Any, ...]], make: Callable[..., T]) -> Iterator[T]:
        for row in rows:
            try:
                yield make(*row)
            except (ValueError, struct.error):
                damaged.append(1)

    nodes = tuple(sound(connection.execute("SELECT id, about FROM nodes ORDER BY id"), _node_of))
    states = tuple(sound(connection.execute("SELECT id, data FROM states ORDER BY id"), _state_of))
    links = tuple(sound(connection.execute("SELECT i, j, data FROM links"), _link_of))
    places = dict(sound(connection.execute("SELECT id, data FROM anchors"), _place_of))
    anchors = np.full((max(places, default=-1) + 1, 3), np.nan)
    for number, pose in places.items():
        anchors[number] = pose
    last = connection.execute("SELECT max(id) FROM (SELECT id FROM nodes UNION SELECT id FROM states)").fetchone()[0]
    return StoredMemory(nodes=nodes, states=states, links=links, anchors=anchors, damaged=len(damaged), last=last or 0)


def read_node(connection: sqlite3.Connection, node: int) -> MemoryNode | None:
    """Return a node without its scan, or None where there is no such node.

    Raises:
        ValueError, struct.error: its record is damaged.
        sqlite3.Error: the file cannot be read.
    """
    row = connection.execute("SELECT about, features FROM nodes WHERE id = ?", (node,)).fetchone()
    if row is None:
        return None
    stamp, map_id, x, y, theta = _ABOUT.unpack(unseal(node, row[0]))
    words, pixels, points, descriptors, surface = unpack(unseal(node, row[1]))
    return MemoryNode(
        stamp_ns=stamp,
        odom_from_base=Pose2(x, y, theta),
        words=words,
        pixels=pixels,
        points=points,
        descriptors=descriptors,
        surface=surface,
        evidence=None,
        id=node,
        map_id=map_id,
    )


def read_evidence(connection: sqlite3.Connection, node: int) -> bytes | None:
    """Return a node's packed scan, or None where there is no such node; raise as `read_node`."""
    row = connection.execute("SELECT evidence FROM nodes WHERE id = ?", (node,)).fetchone()
    return None if row is None else unseal(node, row[0])


def read_words(connection: sqlite3.Connection, words: Sequence[int]) -> dict[int, bytes]:
    """Return the sealed records of the words that are stored, by id.

    Raises:
        sqlite3.Error: the file cannot be read.
    """
    found: dict[int, bytes] = {}
    for first in range(0, len(words), _PARAMETERS):
        part = words[first : first + _PARAMETERS]
        marks = ", ".join("?" * len(part))
        found.update(connection.execute(f"SELECT id, data FROM words WHERE id IN ({marks})", part))
    return found


def _node_row(node: MemoryNode) -> tuple[int, bytes, bytes, bytes]:
    odom = node.odom_from_base
    about = _ABOUT.pack(node.stamp_ns, node.map_id, odom.x, odom.y, odom.theta)
    parts = (about, pack_evidence(node.evidence), pack_features(node))
    return node.id, *(seal(node.id, part) for part in parts)  # type: ignore[return-value]


def _node_of(node: int, about: bytes) -> tuple[int, int, int]:
    stamp, map_id, *_ = _ABOUT.unpack(unseal(node, about))
    return node, map_id, stamp


def _state_row(state: NodeState) -> tuple[int, bytes]:
    pose = state.anchor_from_node
    data = _STATE.pack(state.weight, state.awake, state.anchor, pose.x, pose.y, pose.theta, state.parent)
    return state.id, seal(state.id, data)


def _state_of(node: int, data: bytes) -> NodeState:
    weight, awake, anchor, x, y, theta, parent = _STATE.unpack(unseal(node, data))
    return NodeState(
        id=node, weight=weight, awake=awake, anchor=anchor, anchor_from_node=Pose2(x, y, theta), parent=parent
    )


def _link_row(link: Link) -> tuple[int, int, bytes]:
    link = link.from_node(min(link.i, link.j))
    numbers = (link.i_from_j.x, link.i_from_j.y, link.i_from_j.theta, *link.information.ravel().tolist())
    return link.i, link.j, seal(_ends(link.i, link.j), _LINK.pack(link.kind, *numbers))


def _link_of(i: int, j: int, data: bytes) -> Link:
    kind, x, y, theta, *information = _LINK.unpack(unseal(_ends(i, j), data))
    return Link(i, j, LinkKind(kind), Pose2(x, y, theta), np.array(information).reshape(3, 3))


def _place_of(number: int, data: bytes) -> tuple[int, tuple[float, ...]]:
    return number, _POSE.unpack(unseal(number, data))


def _ends(i: int, j: int) -> int:
    """Return one number for the two ends of a link, for its seal."""
    return (i * 2_654_435_761 + j) & 0xFFFFFFFF


def _pragma(connection: sqlite3.Connection, name: str) -> int:
    return int(connection.execute(f"PRAGMA {name}").fetchone()[0])
