"""Storage of a ROS 2 bag that stays intact when the disk fills up: accepted messages can always be written and closed.

A reserve file is allocated on the disk before the first message. When the disk is full, the reserve is freed, so that
the last chunk, the index and the metadata still fit.
"""

from __future__ import annotations

import errno
import io
import os
import shutil
import sqlite3
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from rosbags.interfaces import Connection
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.rosbag2.storage_mcap import McapWriter
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Writer

RESERVE = 16 << 20
"""Bytes of the reserve: more than the messages held in memory at any time plus the index of hours of driving."""

MIN_FREE = 64 << 20
"""Recording stops when fewer bytes than these are free, so that other programs keep working."""

CHECK_EVERY = 4 << 20
"""Bytes between two checks of the disk; in sqlite3 also between two commits."""

_FULL = (errno.ENOSPC, errno.EDQUOT)


class Reserve:
    """Reserved disk space, held by a file."""

    def __init__(self, path: Path) -> None:
        """
        Raises:
            OSError: the disk has no room for the reserve.
        """
        self._path = path
        self.used = False
        with path.open("xb") as file:
            os.posix_fallocate(file.fileno(), 0, RESERVE)

    def use(self) -> bool:
        """Free the reserve because the disk is full; return False if it was used before."""
        if self.used:
            return False
        self.used = True
        self.free()
        return True

    def free(self) -> None:
        """Remove the reserve file."""
        self._path.unlink(missing_ok=True)


class BagWriter(Writer):
    """A writer of ROS 2 bags; after each message, `full` tells whether the disk has no room for more."""

    def __init__(self, path: Path, storage: StoragePlugin) -> None:
        """Take the folder of the bag, which must not exist; the reserve file lies beside it."""
        super().__init__(path, version=9, storage_plugin=storage)
        if storage == StoragePlugin.MCAP:
            self.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)  # chunk by chunk
        self.full = False
        self.size = 0
        self._unchecked_bytes = 0

    def open(self) -> None:
        """Make the folder and begin the bag.

        Raises:
            OSError: the folder cannot be made, or its disk is full.
        """
        if shutil.disk_usage(self.path.parent).free < MIN_FREE + RESERVE:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        self.path.mkdir(mode=0o755)
        self._reserve = Reserve(self.path.with_name("reserve"))
        kind = _Mcap if self.storage_plugin == StoragePlugin.MCAP else _Sqlite3
        self.storage = self._store_file = kind(self.path, self.compression_mode, self._reserve)

    def write(self, connection: Connection, timestamp: int, data: bytes | memoryview) -> None:
        """Append a message of `timestamp` [ns] to a connection of this bag."""
        super().write(connection, timestamp, data)
        self.size += len(data)
        self._unchecked_bytes += len(data)
        if self._unchecked_bytes > CHECK_EVERY:
            self._unchecked_bytes = 0
            self.full = shutil.disk_usage(self.path).free < MIN_FREE
        self.full = self.full or self._reserve.used

    def flush(self) -> None:
        """Write all messages so far to the file, where they survive a crash of this process."""
        self._store_file.flush()


class _ReservedFile(io.FileIO):
    """A file that frees the reserve and continues when the disk is full."""

    def __init__(self, path: Path, reserve: Reserve) -> None:
        super().__init__(path, "ab")
        self._reserve = reserve

    def write(self, data: Any, /) -> int:
        try:
            return super().write(data)
        except OSError as error:
            if error.errno not in _FULL or not self._reserve.use():
                raise
        return super().write(data)


class _Mcap(McapWriter):
    """mcap storage whose chunks are always written completely, thanks to the reserve."""

    def __init__(self, path: Path, compression: CompressionMode, reserve: Reserve) -> None:
        super().__init__(path, compression)
        self.bio.close()
        self.bio = io.BufferedWriter(_ReservedFile(self.path, reserve))

    def flush(self) -> None:
        """End the current chunk, since the messages of an incomplete chunk cannot be read."""
        if self.chunk.bio.tell():
            self.close_chunk()
        self.bio.flush()


class _Sqlite3(Sqlite3Writer):
    """sqlite3 storage that commits regularly, and repeats a commit that failed on a full disk with the reserve freed."""

    def __init__(self, path: Path, compression: CompressionMode, reserve: Reserve) -> None:
        super().__init__(path, compression)
        self._reserve = reserve
        self._waiting: list[tuple[int, int, bytes]] = []
        self._waiting_bytes = 0

    def add_msgtype(self, connection: Connection) -> None:
        self._commit(partial(super().add_msgtype, connection))

    def add_connection(self, connection: Connection, offered_qos_profiles: str) -> None:
        self._commit(partial(super().add_connection, connection, offered_qos_profiles))

    def write(self, connection: Connection, timestamp: int, data: bytes | memoryview) -> None:
        self._waiting.append((connection.id, timestamp, bytes(data)))
        self._waiting_bytes += len(data)
        if self._waiting_bytes > CHECK_EVERY:
            self._store()

    def flush(self) -> None:
        """Commit the pending messages."""
        self._store()

    def close(self, version: int, metadata: str) -> None:
        self._store()
        self._reserve.free()
        super().close(version, metadata)

    def _store(self) -> None:
        insert = "INSERT INTO messages (topic_id, timestamp, data) VALUES (?, ?, ?)"
        self._commit(partial(self.conn.executemany, insert, self._waiting))
        self._waiting.clear()
        self._waiting_bytes = 0

    def _commit(self, change: Callable[[], object]) -> None:
        try:
            with self.conn:
                change()
        except sqlite3.OperationalError as error:
            if error.sqlite_errorcode != sqlite3.SQLITE_FULL or not self._reserve.use():
                raise
            with self.conn:
                change()
