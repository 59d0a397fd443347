"""The long-term memory: every node on disk (SQLite), written in the background one node at a time.

A node goes to the writer when it joins the memory, not when it is put to sleep, and the next node waits until it is on
disk. So a killed process loses at most its last node, and not its whole STM and WM as RTAB-Map does. Only if the disk
hangs for longer than a second do nodes queue up, so that the chair does not wait for the disk.

A damaged file is moved aside and a new one begun. If writing fails because the disk is full or removed, the memory
continues in RAM and reports it (F27 of the fault table). No file is ever half written.
"""

from __future__ import annotations

import contextlib
import sqlite3
import struct
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

import numpy as np

from waychair.errors import LongTermDamaged, LongTermError
from waychair.slam.memory.long_term_file import (
    Batch,
    StoredMemory,
    connect,
    find_damage,
    prepare_writer,
    quarantine,
    read_all,
    read_evidence,
    read_node,
    read_words,
    write,
)
from waychair.slam.memory.nodes import MemoryNode, NodeScan, unpack_evidence, unseal
from waychair.types import Bytes, IntArray

T = TypeVar("T")


class LongTermStore:
    """The memory's file. `notes` holds the findings on opening, `fault` the reason why writing has stopped."""

    def __init__(self, path: Path | None = None, most_bytes: int | None = None, patience_s: float = 1.0) -> None:
        """Open the file, or make it; without a path keep everything in RAM.

        Args:
            path: the file, or None.
            most_bytes: the largest size of the file; a node that does not fit counts as a full disk.
            patience_s: the longest wait of `write` for the disk; after that, batches queue in RAM.

        Raises:
            LongTermError: the file cannot be read or written, or belongs to another program.
        """
        self.path = path
        self.notes: tuple[str, ...] = ()
        self.fault: LongTermError | None = None
        self._patience_s = patience_s
        self._waiting: list[Batch] = []
        self._handed: list[Batch] = []
        self._done: Future[None] = Future()  # of the handed batches
        self._spill: sqlite3.Connection | None = None
        if path is not None:
            self._move_damaged_aside(path)
        try:
            self._writer = connect(path)
            prepare_writer(self._writer, most_bytes)
            self._reader = self._writer if path is None else connect(path)
        except sqlite3.Error as error:
            raise LongTermError(f"cannot use {path}: {error}; move it away, or choose another folder") from error
        self._thread = ThreadPoolExecutor(1, "long-term-memory") if path is not None else None

    @classmethod
    def in_ram(cls, fault: LongTermError) -> LongTermStore:
        """Return a memory without a file, because of a fault of the disk."""
        store = cls()
        store.fault = fault
        return store

    def load(self) -> StoredMemory:
        """Return the content of earlier sessions, except the views themselves.

        Raises:
            LongTermError: it cannot be read.
        """
        try:
            stored = read_all(self._reader)
        except sqlite3.Error as error:
            raise LongTermError(f"cannot read {self.path}: {error}; move the file away to begin anew") from error
        if stored.damaged:
            self.notes += (f"{stored.damaged} damaged records of {self.path} were left out; the rest is in use",)
        return stored

    def write(self, batch: Batch) -> None:
        """Hand a batch to the writer once the previous one is on disk; wait for that at most `patience_s`."""
        self._waiting.append(batch)
        self._hand_over(self._patience_s)

    def flush(self) -> None:
        """Wait until all batches are on disk, or there is a `fault`."""
        while self._waiting or self._handed:
            self._hand_over(None)

    def _hand_over(self, timeout_s: float | None) -> None:
        """Give the waiting batches to the writer if it finishes the previous ones within the timeout."""
        if self._handed and not self._has_settled(timeout_s):
            return
        batches, self._waiting = self._waiting, []
        if self._spill is not None:
            _write_all(self._spill, batches)
        elif self._thread is None:
            _write_all(self._writer, batches)
        elif batches:
            self._handed = batches
            self._done = self._thread.submit(_write_all, self._writer, batches)

    def _has_settled(self, timeout_s: float | None) -> bool:
        """Return whether the writer has finished. If writing failed, keep this and all later batches in RAM."""
        try:
            self._done.result(timeout_s)
        except TimeoutError:
            return False
        except sqlite3.Error as error:
            where = f"cannot write {self.path}: {error}"
            self.fault = LongTermError(
                f"{where}; new nodes are lost when the program ends: make room on the disk and restart"
            )
            self._spill = connect(None)
            prepare_writer(self._spill, None)
            _write_all(self._spill, self._handed)
        self._handed = []
        return True

    def node(self, node: int) -> MemoryNode:
        """Return a node as it was added.

        Raises:
            LongTermDamaged: its record is damaged or missing.
            LongTermError: the file cannot be read.
        """
        found = self._read(read_node, node, "node")
        if found is None:
            raise LongTermDamaged(f"node {node} is not in {self.path or 'RAM'}: a part of the memory was lost")
        return replace(found, evidence=self.evidence(node))

    def evidence(self, node: int) -> NodeScan | None:
        """Return only the scan of a node; None where it has none, or the node does not exist.

        Raises:
            LongTermDamaged: its record is damaged.
            LongTermError: the file cannot be read.
        """
        data = self._read(read_evidence, node, "node")
        return unpack_evidence(data) if data else None

    def words(self, ids: IntArray) -> tuple[IntArray, Bytes]:
        """Return the ids among (K,) that are stored, and their descriptors (L, D) as bytes.

        Raises:
            LongTermDamaged: a record is damaged.
            LongTermError: the file cannot be read.
        """
        if any(batch.holds_words(ids) for batch in (*self._handed, *self._waiting)):
            self.flush()
        wanted = ids.tolist()
        records: dict[int, bytes] = {}
        try:
            for source in [self._reader] if self._spill is None else [self._reader, self._spill]:
                records |= read_words(source, wanted)
        except sqlite3.OperationalError as error:
            raise self._unreadable(error) from error
        except sqlite3.Error as error:
            raise LongTermDamaged(f"the words of {self.path} are damaged: {error}") from error
        rows = {word: records[word] for word in wanted if word in records}
        try:
            found = [np.frombuffer(unseal(word, data), np.uint8) for word, data in rows.items()]
        except ValueError as error:
            raise LongTermDamaged(f"a word of {self.path} is damaged: {error}") from error
        return np.array(list(rows), np.int64), np.array(found, np.uint8)

    def newest_word(self) -> int:
        """Return the highest id of a stored word, 0 without any.

        Raises:
            LongTermError: the file cannot be read.
        """
        try:
            return int(self._reader.execute("SELECT max(id) FROM words").fetchone()[0] or 0)
        except sqlite3.Error as error:
            raise LongTermError(f"cannot read {self.path}: {error}; move the file away to begin anew") from error

    def close(self) -> None:
        """Write the rest, fold the log into the file and close it."""
        self.flush()
        if self._thread is not None:
            self._thread.shutdown()
            self._reader.close()
            with contextlib.suppress(sqlite3.Error):  # the log is read at the next opening
                self._writer.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        self._writer.close()
        if self._spill is not None:
            self._spill.close()

    def _move_damaged_aside(self, path: Path) -> None:
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise LongTermError(f"cannot write {path}: {error.strerror}; choose another folder") from error
        wrong = find_damage(path)
        if wrong:
            aside = quarantine(path)
            self.notes = (f"{path} is damaged ({wrong}): it was moved to {aside}, and a new memory is begun",)

    def _read(self, read: Callable[[sqlite3.Connection, int], T | None], number: int, what: str) -> T | None:
        """Return the record read from any source that has it, or None."""
        try:
            found = (read(source, number) for source in self._sources(number))
            return next((record for record in found if record is not None), None)
        except sqlite3.OperationalError as error:
            raise self._unreadable(error) from error
        except (ValueError, struct.error, sqlite3.Error) as error:
            raise LongTermDamaged(f"{what} {number} of {self.path} is damaged: {error}") from error

    def _unreadable(self, error: sqlite3.Error) -> LongTermError:
        self.fault = self.fault or LongTermError(f"cannot read {self.path}: {error}; check that the disk is connected")
        return self.fault

    def _sources(self, number: int) -> list[sqlite3.Connection]:
        """Return the databases that may hold a node, latest first, after writing a batch that holds it."""
        if any(batch.holds(number) for batch in (*self._handed, *self._waiting)):
            self.flush()
        return [self._reader] if self._spill is None else [self._spill, self._reader]


def _write_all(connection: sqlite3.Connection, batches: list[Batch]) -> None:
    for batch in batches:
        write(connection, batch)
