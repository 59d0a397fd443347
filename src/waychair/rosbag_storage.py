"""Storage of a ROS 2 bag that stays whole when its disk fills up: what was accepted can always be written and closed.

A reserve is set aside on the disk before the first message. When the system says that the disk is full, the reserve
is given back, so that the last chunk, the index and the metadata still find room.
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
"""Bytes set aside: more than what is held in memory at any time, and the index of hours of driving."""

LEAST_FREE = 64 << 20
"""Recording stops when fewer bytes than these are free, so that the rest of the machine can go on."""

LOOK_EVERY = 4 << 20
"""Bytes between two looks at the disk; in sqlite3 also between two commits."""

_FULL = (errno.ENOSPC, errno.EDQUOT)


class Reserve:
    """Room on the disk, held by a file of its own."""

    def __init__(self, path: Path) -> None:
        """
        Raises:
            OSError: there is not even room for the reserve.
        """
        self._path = path
        self.used = False
        with path.open("xb") as file:
            os.posix_fallocate(file.fileno(), 0, RESERVE)

    def use(self) -> bool:
        """Gives the room back because the disk is full; False when it was used before."""
        if self.used:
            return False
        self.used = True
        self.free()
        return True

    def free(self) -> None:
        """Gives the room back."""
        self._path.unlink(missing_ok=True)


class BagWriter(Writer):
    """Writes ROS 2 bags; `full` says after each message whether it was the last one that the disk has room for."""

    def __init__(self, path: Path, storage: StoragePlugin) -> None:
        """The folder of the bag, which must not exist; its own folder holds the reserve meanwhile."""
        super().__init__(path, version=9, storage_plugin=storage)
        if storage == StoragePlugin.MCAP:
            self.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)  # chunk by chunk
        self.full = False
        self.size = 0
        self._unseen = 0

    def open(self) -> None:
        """
        Raises:
            OSError: the folder cannot be made, or there is no room on its disk.
        """
        if shutil.disk_usage(self.path.parent).free < LEAST_FREE + RESERVE:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        self.path.mkdir(mode=0o755)
        self._reserve = Reserve(self.path.with_name("reserve"))
        kind = _Mcap if self.storage_plugin == StoragePlugin.MCAP else _Sqlite3
        self.storage = self._held = kind(self.path, self.compression_mode, self._reserve)

    def write(self, connection: Connection, timestamp: int, data: bytes | memoryview) -> None:
        """Appends a message of `timestamp` [ns] to a connection of this bag."""
        super().write(connection, timestamp, data)
        self.size += len(data)
        self._unseen += len(data)
        if self._unseen > LOOK_EVERY:
            self._unseen = 0
            self.full = shutil.disk_usage(self.path).free < LEAST_FREE
        self.full = self.full or self._reserve.used

    def flush(self) -> None:
        """Brings all messages so far to the file, where they outlive this process."""
        self._held.flush()


class _ReservedFile(io.FileIO):
    """A file that goes on writing out of the reserve when the disk is full."""

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
    """Chunks are never torn, since their file goes on out of the reserve."""

    def __init__(self, path: Path, compression: CompressionMode, reserve: Reserve) -> None:
        super().__init__(path, compression)
        self.bio.close()
        self.bio = io.BufferedWriter(_ReservedFile(self.path, reserve))

    def flush(self) -> None:
        """Ends the chunk at hand; the messages of a torn one could not be read."""
        if self.chunk.bio.tell():
            self.close_chunk()
        self.bio.flush()


class _Sqlite3(Sqlite3Writer):
    """Commits as it goes; when the disk is full, once more what sqlite has rolled back."""

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
        if self._waiting_bytes > LOOK_EVERY:
            self._store()

    def flush(self) -> None:
        """Commits what waits."""
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
