"""Rows about a rider, kept on the chair only, and only after the rider's yes: files of habits and of guided drives.

One file, readable by its owner alone: lines of JSON, each written through to the disk before the next, so that a computer that
dies leaves whole lines and at most one broken end. Programs of one chair may share it (`look_again`). There is no file before the yes,
and none after `erase`. Nothing of it goes to a black box, a topic or a log. It is data about health: the chair's operator answers
for it (GDPR, article 9).
"""

from __future__ import annotations

import csv
import fcntl
import io
import json
import os
import threading
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, fields
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any, ClassVar, Generic, TypeVar

from waychair.errors import OutputError, WaychairError
from waychair.files import is_file, os_error_text, read_bytes, remove, replacing, sync_folder

KEPT_DAYS = 90
"""Days after which a row is forgotten."""

MOST_BYTES = 8_000_000
"""The longest file: about fifty thousand rows."""

Row = TypeVar("Row")


def data_folder() -> Path:
    """Return the folder of this chair's rider (`XDG_DATA_HOME`, else ~/.local/share)."""
    data = os.environ.get("XDG_DATA_HOME")
    return (Path(data) if data else Path.home() / ".local" / "share") / "waychair"


class ConsentedRows(Generic[Row]):
    """The record of one rider. Recording never raises: a fault is a sentence in `trouble`, and the chair drives on.

    A subclass gives the name of the file's kind, its dataclasses by the kind of row, each with a `day`, and its error.
    """

    NAME: ClassVar[str]
    KINDS: ClassVar[Mapping[str, type[Any]]]
    FAILURE: ClassVar[type[WaychairError]]

    def __init__(self, path: Path, now: Callable[[], datetime] = datetime.now) -> None:
        """`now`: the local time. A damaged file is not touched: `trouble` names it, and nothing is recorded."""
        self._path, self._now = path, now
        self._lock = threading.RLock()  # the chair's worker records while a page looks or erases
        self.trouble = ""
        self.wanted = False
        """Whether the rider has said yes."""
        self._said_no = False  # in this run, also where it could not be written
        self._rows: tuple[Row, ...] = ()
        self.look_again()

    def look_again(self) -> None:
        """Read the file anew, to which another program of this chair may have written: the rider's yes, or a row."""
        with self._lock:
            try:
                self._rows, said_yes = self._read()
                self._forget_old(said_yes)
            except (self.FAILURE, OutputError) as error:
                self.trouble, said_yes = str(error), False
            self.wanted = said_yes and not self._said_no

    def rows(self) -> tuple[Row, ...]:
        """Return everything that is recorded, in its order."""
        return self._rows

    def say_yes(self) -> None:
        """Record from now on, by the rider's own yes.

        Raises:
            WaychairError: the file is damaged.
            OutputError: the file cannot be written.
        """
        with self._lock:
            if self.trouble:
                self._rows, self.wanted = self._read()
                self.trouble = ""
            if not self.wanted:
                self._append({"kind": "yes"})
                self.wanted, self._said_no = True, False

    def say_no(self) -> None:
        """Record nothing more; what is recorded stays until `erase`.

        Raises:
            OutputError: the file cannot be written; nothing more is recorded in this run all the same.
        """
        with self._lock:
            if self.wanted:
                self.wanted, self._said_no = False, True
                self._append({"kind": "no"})

    def erase(self) -> None:
        """Erase everything, the yes included.

        Raises:
            OutputError: a file cannot be removed.
        """
        with self._lock:
            self.wanted, self._said_no, self._rows, self.trouble = False, False, (), ""
            left = [self._path, *self._path.parent.glob(f".{self._path.stem}.*")] if self._path.parent.is_dir() else []
            for path in left:
                if path.exists():
                    remove(path)
            if left:
                sync_folder(self._path.parent)

    def csv(self) -> str:
        """Return everything that is recorded as one table; fields that a row does not have are empty."""
        columns = ["kind", *dict.fromkeys(each.name for kind in self.KINDS.values() for each in fields(kind))]
        text = io.StringIO()
        writer = csv.DictWriter(text, columns, restval="", lineterminator="\n")
        writer.writeheader()
        for row in self._rows:
            writer.writerow(self._values(row))
        return text.getvalue()

    def _values(self, row: Any) -> dict[str, object]:
        """Return a row with its kind, as it is written."""
        return {"kind": next(kind for kind, made in self.KINDS.items() if isinstance(row, made)), **asdict(row)}

    def _check(self, values: Mapping[str, object]) -> None:
        """Check a row that was read beyond the types of its fields; raises ValueError for a damaged one."""

    def _note(self, row: Row) -> None:
        with self._lock:
            if not self.wanted:
                return
            try:
                self._append(self._values(row))
                self._rows = (*self._rows, row)
                self.trouble = ""
            except OutputError as error:
                self.trouble = f"{error}; the {self.NAME} of this drive are not kept"

    def _append(self, values: Mapping[str, object]) -> None:
        """Add a line and wait for the disk; a line that does not fit is taken back. Only a yes begins a file."""
        line = (json.dumps(values, allow_nan=False) + "\n").encode()
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            is_new = not self._path.exists()
            begins = os.O_CREAT if values["kind"] == "yes" else 0  # another program may have erased it
            with os.fdopen(os.open(self._path, os.O_RDWR | begins, 0o600), "r+b", buffering=0) as file:
                fcntl.flock(file, fcntl.LOCK_EX)
                size = _whole(file.read())
                if size + len(line) > MOST_BYTES:
                    raise OutputError(f"{self._path} is full: export it, then erase it")
                text = line if size else (json.dumps(self._header) + "\n").encode() + line
                try:
                    file.truncate(size)
                    file.seek(size)
                    if file.write(text) != len(text):
                        raise OSError(28, os.strerror(28))
                    os.fsync(file.fileno())
                except OSError:
                    file.truncate(size)
                    raise
            if is_new:
                sync_folder(self._path.parent)
        except OSError as error:
            if self._path.exists() and not self._path.stat().st_size:
                self._path.unlink()
            raise OutputError(f"cannot write {self._path}: {os_error_text(error)}") from error

    def _forget_old(self, said_yes: bool) -> None:
        """Forget rows older than `KEPT_DAYS`: the file is written anew without them, with the rider's last word."""
        since = f"{self._now() - timedelta(days=KEPT_DAYS):%Y-%m-%d}"
        kept = tuple(row for row in self._rows if str(getattr(row, "day", "")) >= since)
        if len(kept) == len(self._rows):
            return
        lines: list[Mapping[str, object]] = [self._header, {"kind": "yes" if said_yes else "no"}]
        lines += [self._values(row) for row in kept]
        with replacing(self._path, mode=0o600) as path:
            path.write_text("".join(json.dumps(line, allow_nan=False) + "\n" for line in lines), encoding="utf-8")
        self._rows = kept

    @property
    def _header(self) -> dict[str, object]:
        return {"kind": self.NAME, "version": 1}

    def _read(self) -> tuple[tuple[Row, ...], bool]:
        """Return the rows of the file and whether the rider's last word was yes; none and no without a file.

        Raises:
            WaychairError: a whole line is damaged, or the file is of another kind.
        """
        if not is_file(self._path, self.FAILURE):
            return (), False
        data = read_bytes(self._path, self.FAILURE)
        rows: list[Row] = []
        wanted = False
        for number, values in enumerate(self._lines(data[: _whole(data)]), 1):
            kind = values.pop("kind", None)
            if number == 1:
                if {"kind": kind, **values} != self._header:
                    raise self.FAILURE(
                        f"{self._path} is no record of {self.NAME} of this version: erase it on the page"
                    )
            elif kind in ("yes", "no"):
                wanted = kind == "yes"
            else:
                rows.append(self._row(number, str(kind), values))
        return tuple(rows), wanted

    def _lines(self, data: bytes) -> Iterator[dict[str, object]]:
        for number, line in enumerate(data.splitlines(), 1):
            try:
                values = json.loads(line)
            except ValueError:
                values = None
            if not isinstance(values, dict):
                raise self._damaged(number)
            yield values

    def _row(self, number: int, kind: str, values: Mapping[str, object]) -> Row:
        made = self.KINDS.get(kind)
        if made is None or set(values) != {each.name for each in fields(made)}:
            raise self._damaged(number)
        for each in fields(made):
            if not isinstance(values[each.name], _TYPES[str(each.type)]):
                raise self._damaged(number)
        try:
            self._check(values)
            row: Row = made(**values)
        except ValueError as error:
            raise self._damaged(number) from error
        return row

    def _damaged(self, number: int) -> WaychairError:
        return self.FAILURE(f"{self._path}:{number} is damaged: take the line out, or erase the record on the page")


_TYPES: Mapping[str, type | tuple[type, ...]] = {
    "str": str,
    "int": int,
    "float": (int, float),
    "bool": bool,
    "int | None": (int, type(None)),
}


def _whole(data: bytes) -> int:
    """Return the size of a file's whole lines [bytes]."""
    return data.rfind(b"\n") + 1
