"""The log of a draft: `draft.jsonl` in the building's folder, one operation a line, so that no edit is lost.

    {"base": "..."}                    the building that the edits begin from: the hash of its files
    {"do": "add_node", ...}            an operation
    {"undo": true}, {"redo": true}     back and forth

A line is on the disk before the page is told that the edit is done. A last line that was cut off is left out, as the page
was not told of it.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import msgspec

from waychair.errors import BuildingError, OutputError, WaychairError
from waychair.files import is_file, os_error_text, read_bytes, remove, write_text
from waychair.maps.editing.arc_edits import Operation
from waychair.maps.editing.draft import Draft
from waychair.maps.editing.operations import applied, operation_of, words

LOG = "draft.jsonl"

KEPT_STEPS = 1000
"""Steps that can be undone; each holds what it changed only."""


@dataclass(frozen=True, slots=True)
class EditStep:
    """An operation that was done, and the draft after it."""

    operation: Operation
    draft: Draft


@dataclass(frozen=True, slots=True)
class History:
    """Drafts one after the other: that at the beginning, the steps since then, and how many of them hold now."""

    first: Draft
    steps: tuple[EditStep, ...] = ()
    done: int = 0

    @property
    def draft(self) -> Draft:
        """The present draft."""
        return self.steps[self.done - 1].draft if self.done else self.first

    @property
    def undoes(self) -> str:
        """What an undo would undo, in words; "" without a step."""
        return words(self.steps[self.done - 1].operation) if self.done else ""

    @property
    def redoes(self) -> str:
        """What a redo would do, in words; "" without a step."""
        return words(self.steps[self.done].operation) if self.done < len(self.steps) else ""

    def after(self, operation: Operation) -> History:
        """Return the history with an operation done; steps that were undone are gone. Raises as `applied`."""
        return self.with_step(EditStep(operation, applied(self.draft, operation)))

    def with_step(self, step: EditStep) -> History:
        """Return the history with a step that was done; steps that were undone are gone."""
        steps = (*self.steps[: self.done], step)
        extra = max(0, len(steps) - KEPT_STEPS)
        return History(steps[extra - 1].draft if extra else self.first, steps[extra:], len(steps) - extra)

    def undone(self) -> History:
        """Return the history one step back; the same at its beginning."""
        return History(self.first, self.steps, max(0, self.done - 1))

    def redone(self) -> History:
        """Return the history one step on; the same at its end."""
        return History(self.first, self.steps, min(len(self.steps), self.done + 1))


class EditLog:
    """The log file of one building's draft; one program at a time may write it."""

    def __init__(self, folder: Path) -> None:
        self.path = folder / LOG

    def begin(self, base: str) -> None:
        """Begin a new log, of a building with this hash; raises OutputError."""
        write_text(self.path, json.dumps({"base": base}) + "\n")

    def end(self) -> None:
        """Remove the log: there is no draft any more; raises OutputError."""
        remove(self.path)

    def add(self, operation: Operation) -> None:
        """Add an operation; it is on the disk when this returns. Raises OutputError; then the log is as before."""
        self._append(msgspec.json.encode(operation))

    def add_undo(self) -> None:
        """Add an undo; raises as `add`."""
        self._append(b'{"undo": true}')

    def add_redo(self) -> None:
        """Add a redo; raises as `add`."""
        self._append(b'{"redo": true}')

    def read(self) -> tuple[str, list[Operation | bool]] | None:
        """Return the base's hash and the entries: operations, False for undo, True for redo; None without a log.

        Raises:
            BuildingError: a line in the middle is damaged.
        """
        if not is_file(self.path, BuildingError):
            return None
        lines = read_bytes(self.path, BuildingError).split(b"\n")[:-1]  # what follows the last line feed was cut off
        rows = list(self._rows(lines))
        base = rows[0].get("base") if rows else None
        if not isinstance(base, str):
            raise BuildingError(f"{self.path} is damaged: its first line must name the building; move it away")
        return base, [_entry(row) for row in rows[1:]]

    def _rows(self, lines: list[bytes]) -> Iterator[dict[str, object]]:
        for number, line in enumerate(lines, start=1):
            try:
                row = json.loads(line)
            except ValueError:
                row = None
            if not isinstance(row, dict):
                raise BuildingError(f"{self.path}, line {number} is damaged: move the file away to begin a new draft")
            yield row

    def _append(self, line: bytes) -> None:
        try:
            with self.path.open("r+b") as file:
                size = self._whole(file.read())
                try:
                    file.truncate(size)
                    file.seek(size)
                    file.write(line + b"\n")
                    file.flush()
                    os.fsync(file.fileno())
                except OSError:
                    file.truncate(size)
                    raise
        except OSError as error:
            raise OutputError(f"the edit could not be kept in {self.path}: {os_error_text(error)}") from error

    @staticmethod
    def _whole(data: bytes) -> int:
        return data.rfind(b"\n") + 1


def _entry(row: dict[str, object]) -> Operation | bool:
    if "undo" in row or "redo" in row:
        return "redo" in row
    return operation_of(row)


def replayed(first: Draft, entries: list[Operation | bool]) -> tuple[History, list[str]]:
    """Return the history of a log's entries on a draft, and a sentence for each operation that cannot be done any more."""
    history, failed = History(first), list[str]()
    for entry in entries:
        if entry is True:
            history = history.redone()
        elif entry is False:
            history = history.undone()
        else:
            try:
                history = history.after(entry)
            except WaychairError as error:
                failed.append(f"{words(entry)}: {error}")
                history = history.with_step(EditStep(entry, history.draft))  # so that an undo of it undoes nothing else
    return history, failed
