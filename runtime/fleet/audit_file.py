"""The audit's log of a warden: a line of JSON for each decision. A full disk costs lines, never the order."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from pathlib import Path

from waychair.errors import FleetError
from waychair.types import Json

AGAIN_AFTER_NS = 10_000_000_000
"""ns; after a failure the next try comes so much later, so that a broken disk delays no step."""


class AuditFile:
    """A log to which lines are added. Chairs are numbers in it; there are no names of people."""

    def __init__(self, path: Path) -> None:
        """Open the log, to add to it if it is there.

        Raises:
            FleetError: it cannot be opened.
        """
        self.path = path
        self.lost = 0
        self._again_ns = 0
        self._broken = False
        try:
            self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
        except OSError as problem:
            raise FleetError(
                f"the audit's log {path} cannot be written: {problem.strerror}; give another path, or make room"
            ) from None

    def add(self, records: Sequence[Json], now_ns: int) -> str:
        """Add records; return a sentence for people when lines begin to be lost, and when they are written again."""
        if not records:
            return ""
        if self._broken and now_ns < self._again_ns:
            self.lost += len(records)
            return ""
        size = os.fstat(self._file).st_size
        lines = "".join(json.dumps(record) + "\n" for record in records).encode()
        try:
            if os.write(self._file, lines) < len(lines):
                raise OSError(0, "no space left")
        except OSError as problem:
            return self._lose(len(records), size, problem, now_ns)
        if not self._broken:
            return ""
        self._broken = False
        return f"The audit's log {self.path} is written again; {self.lost} lines are missing."

    def _lose(self, count: int, size: int, problem: OSError, now_ns: int) -> str:
        """Take down that lines are lost, and cut off the half of one."""
        os.ftruncate(self._file, size)
        self.lost += count
        self._again_ns = now_ns + AGAIN_AFTER_NS
        if self._broken:
            return ""
        self._broken = True
        return f"The audit's log {self.path} cannot be written ({problem.strerror}): orders go on without it; make room on the disk."

    def close(self) -> None:
        """Close the log."""
        os.close(self._file)
