"""Writing a ROS 2 bag in a hidden folder and moving it to its path when it is complete."""

from __future__ import annotations

import itertools
import shutil
import sqlite3
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Literal

from rosbags.interfaces import Connection, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.interfaces import Qos as BagQos
from rosbags.rosbag2 import StoragePlugin

from waychair.errors import OutputError
from waychair.recordings.bags.ros_messages import TYPES
from waychair.recordings.bags.ros_topics import Qos
from waychair.recordings.bags.rosbag_storage import BagWriter

_STORAGES = {"mcap": StoragePlugin.MCAP, "sqlite3": StoragePlugin.SQLITE3}
_SUFFIXES = {"mcap": ".mcap", "sqlite3": ".db3"}
_FOREVER = QosTime(0x7FFFFFFF, 0xFFFFFFFF)


class BagOutput:
    """A bag that is written to a folder beside its path until `finish`. A topic is declared by its first message.

    A path that ends in .mcap or .db3 becomes a single file, any other path the folder of a bag. mcap chunks are
    compressed (zstd). Until `finish`, the bag is at `temporary_path`. Flushed messages survive a crash of this process, and
    `read_recording` reads them although the index is missing.
    """

    def __init__(self, path: Path, storage: Literal["mcap", "sqlite3"] | None = None) -> None:
        """
        Raises:
            OutputError: the suffix of the path contradicts `storage`.
        """
        by_suffix = next((name for name, suffix in _SUFFIXES.items() if suffix == path.suffix), None)
        if storage is not None and by_suffix not in (None, storage):
            raise OutputError(f"{path} ends in {path.suffix} but {storage} was requested; leave one of the two out")
        self.path = path
        self._storage = storage or by_suffix or "mcap"
        self._single_file = by_suffix is not None
        self._connections: dict[str, Connection] = {}

    def open(self) -> None:
        """Begin the bag.

        Raises:
            OutputError: the path exists, cannot be written to, or its disk is full.
        """
        path = self.path
        self._refuse_existing()
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._folder = Path(tempfile.mkdtemp(prefix=f".{path.stem}.", dir=path.parent))
        except OSError as error:
            raise OutputError(f"cannot write {path}: {error.strerror}; choose another folder") from error
        try:
            self._writer = BagWriter(self._folder / path.stem, _STORAGES[self._storage])
            self._writer.open()
        except OSError as error:
            self._remove()
            raise OutputError(f"cannot write {path}: {error.strerror}; choose another disk") from error

    @property
    def temporary_path(self) -> Path:
        """Return the path of the messages until the bag is finished."""
        bag = self._writer.path
        return bag / f"{bag.name}{_SUFFIXES[self._storage]}"

    @property
    def size(self) -> int:
        """Return the bytes of all messages so far."""
        return self._writer.size

    @property
    def is_open(self) -> bool:
        """Return whether the bag accepts messages: it is neither finished, nor kept as a part, nor discarded."""
        return self._writer.storage is not None

    def write(self, topic: str, msgtype: str, qos: Qos, log_ns: int, data: bytes | memoryview) -> None:
        """Append a message's CDR bytes with its time of logging; `qos` is the one that its publisher offers.

        Raises:
            OutputError: the disk cannot be written to.
        """
        with self._naming_disk_errors():
            if topic not in self._connections:
                self._connections[topic] = self._writer.add_connection(
                    topic, msgtype, typestore=TYPES, offered_qos_profiles=(_offered(qos),)
                )
            self._writer.write(self._connections[topic], log_ns, data)

    def flush(self) -> None:
        """Write all messages so far to the file.

        Raises:
            OutputError: the disk cannot be written to.
        """
        with self._naming_disk_errors():
            self._writer.flush()

    def end_if_full(self) -> None:
        """End the bag if the disk is full. To be called after each group of messages that belong together.

        Raises:
            OutputError: the disk is full; the bag so far was closed and kept beside the path.
        """
        if self._writer.full:
            megabytes = self.size / 1e6
            raise OutputError(
                f"the disk of {self.path} is full: the {megabytes:.0f} MB recorded so far are in {self.keep_part()}; "
                "make room on it"
            )

    def finish(self) -> Path:
        """Close the bag and move it to its path.

        Raises:
            OutputError: the path exists meanwhile (the bag is kept beside it), or the disk cannot be written to.
        """
        if self.path.exists():
            raise OutputError(f"{self.path} was created meanwhile: the bag is in {self.keep_part()}")
        try:
            return self._close(self.path)
        finally:
            self._remove()

    def keep_part(self) -> Path:
        """Close the incomplete bag, keep it beside the path with the same suffix, and return its path.

        Raises:
            OutputError: the disk cannot be written to.
        """
        try:
            names = (f"{self.path.stem}.part{k or ''}{self.path.suffix}" for k in itertools.count())
            return self._close(next(path for path in map(self.path.with_name, names) if not path.exists()))
        finally:
            self._remove()

    def discard(self) -> None:
        """Abort, and remove everything that was written."""
        try:
            with self._naming_disk_errors():
                self._writer.abort()
        finally:
            self._remove()

    def _close(self, path: Path) -> Path:
        with self._naming_disk_errors():
            self._writer.close()
            return (self.temporary_path if self._single_file else self._writer.path).rename(path)

    def _remove(self) -> None:
        shutil.rmtree(self._folder, ignore_errors=True)

    def _refuse_existing(self) -> None:
        if self.path.exists():
            raise OutputError(f"{self.path} exists already; remove it or choose another name")

    @contextmanager
    def _naming_disk_errors(self) -> Iterator[None]:
        try:
            yield
        except (OSError, sqlite3.Error) as error:
            raise OutputError(f"cannot write {self.path}: {error}; choose another disk") from error


def _offered(qos: Qos) -> BagQos:
    """Return the QoS as rosbag2 stores it."""
    return BagQos(
        history=QosHistory.KEEP_LAST,
        depth=qos.depth,
        reliability=QosReliability.RELIABLE if qos.reliable else QosReliability.BEST_EFFORT,
        durability=QosDurability.TRANSIENT_LOCAL if qos.latched else QosDurability.VOLATILE,
        deadline=_FOREVER,
        lifespan=_FOREVER,
        liveliness=QosLiveliness.AUTOMATIC,
        liveliness_lease_duration=_FOREVER,
        avoid_ros_namespace_conventions=False,
    )
