"""The rider's habits: decisions at places and drives, recorded on the chair only, and only after the rider's yes.

One file, readable by its owner alone: lines of JSON, each written through to the disk before the next, so that a computer that
dies leaves whole lines and at most one broken end. There is no file before the yes, and none after `erase`. Places are kept by
their names and times by day and hour; no coordinate is ever written. Nothing of it goes to a black box, a topic or a log.
It is data about health: whoever runs the chair answers for it (GDPR, article 9).
"""

from __future__ import annotations

import csv
import io
import json
import os
import threading
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, fields
from datetime import datetime, timedelta
from pathlib import Path

from waychair.control.guidance.practice import BEFORE, Decision, DecisionMade, Practice, practised
from waychair.errors import HabitsError, OutputError
from waychair.files import is_file, os_error_text, read_bytes, remove, replacing, sync_folder
from waychair.planning.movements import MovementKind

KEPT_DAYS = 90
"""Days after which a row is forgotten."""

FAVOURITE_DAYS = 60
"""Days over which visits count for favourites."""

MOST_BYTES = 8_000_000
"""The longest file: about fifty thousand rows."""

_HEADER = {"kind": "habits", "version": 1}


@dataclass(frozen=True, slots=True)
class DecisionRow:
    """A decision: its day, its place by name, the movement proposed, what was done, the rest before it [s], and prompts."""

    day: str
    place: str
    proposed: str
    done: str
    hesitation_s: float
    prompts: int


@dataclass(frozen=True, slots=True)
class DriveRow:
    """A drive: its day and hour, its goal by name, and whether it was reached.

    `seconds` it took and `expected_s` by the graph; `stops` on the way; `reversals` of the stick; `interventions` of the
    monitor; `prompts` and `replans` of guidance.
    """

    day: str
    hour: int
    goal: str
    arrived: bool
    seconds: float
    expected_s: float
    stops: int
    reversals: int
    interventions: int
    prompts: int
    replans: int


Row = DecisionRow | DriveRow
_KINDS: Mapping[str, type[DecisionRow | DriveRow]] = {"decision": DecisionRow, "drive": DriveRow}


def default_path() -> Path:
    """Return the file of this chair's rider (`XDG_DATA_HOME`, else ~/.local/share)."""
    data = os.environ.get("XDG_DATA_HOME")
    return (Path(data) if data else Path.home() / ".local" / "share") / "waychair" / "habits.jsonl"


class Habits:
    """The record of one rider. Recording never raises: a fault is a sentence in `trouble`, and the chair drives on."""

    def __init__(self, path: Path, now: Callable[[], datetime] = datetime.now) -> None:
        """`now`: the local time. A damaged file is not touched: `trouble` names it, and nothing is recorded."""
        self._path, self._now = path, now
        self._lock = threading.RLock()  # the chair's worker records while a page looks or erases
        self.trouble = ""
        self.wanted = False
        """Whether the rider has said yes."""
        self._rows: tuple[Row, ...] = ()
        try:
            self._rows, self.wanted = _read(path)
            self._forget_old()
        except (HabitsError, OutputError) as error:
            self.trouble, self.wanted = str(error), False

    def rows(self) -> tuple[Row, ...]:
        """Return everything that is recorded, in its order."""
        return self._rows

    def say_yes(self) -> None:
        """Record from now on, by the rider's own yes.

        Raises:
            HabitsError: the file is damaged.
            OutputError: the file cannot be written.
        """
        with self._lock:
            if self.trouble:
                self._rows, self.wanted = _read(self._path)
                self.trouble = ""
            if not self.wanted:
                self._append({"kind": "yes"})
                self.wanted = True

    def say_no(self) -> None:
        """Record nothing more; what is recorded stays until `erase`.

        Raises:
            OutputError: the file cannot be written; nothing more is recorded in this run all the same.
        """
        with self._lock:
            if self.wanted:
                self.wanted = False
                self._append({"kind": "no"})

    def erase(self) -> None:
        """Erase everything, the yes included.

        Raises:
            OutputError: a file cannot be removed.
        """
        with self._lock:
            self.wanted, self._rows, self.trouble = False, (), ""
            left = [self._path, *self._path.parent.glob(f".{self._path.stem}.*")] if self._path.parent.is_dir() else []
            for path in left:
                if path.exists():
                    remove(path)
            if left:
                sync_folder(self._path.parent)

    def note_decision(self, made: DecisionMade) -> None:
        """Record a decision of guidance."""
        day = f"{self._now():%Y-%m-%d}"
        row = DecisionRow(day, made.place, made.proposed, made.decision, round(made.hesitation_s, 1), made.prompts)
        self._note("decision", row)

    def note_drive(
        self, goal: str, *, arrived: bool, seconds: float, expected_s: float, counts: Mapping[str, int]
    ) -> None:
        """Record a drive that has ended; `counts` are its stops, reversals, interventions, prompts and replans."""
        now = self._now()
        known = {name: int(counts.get(name, 0)) for name in _COUNTS}
        row = DriveRow(f"{now:%Y-%m-%d}", now.hour, goal, arrived, round(seconds, 1), round(expected_s, 1), **known)
        self._note("drive", row)

    def practice(self, level: int = BEFORE) -> dict[str, Practice]:
        """Return the practice at each place, of all its decisions; `level` is that of the first one."""
        found: dict[str, Practice] = {}
        for row in self._rows:
            if isinstance(row, DecisionRow):
                made = DecisionMade(
                    row.place, MovementKind(row.proposed), Decision(row.done), row.hesitation_s, row.prompts
                )
                found[row.place] = practised(found.get(row.place, Practice(min(level, BEFORE))), made)
        return found

    def visits(self) -> Counter[str]:
        """Return how often each goal was reached in the last `FAVOURITE_DAYS`."""
        since = f"{self._now() - timedelta(days=FAVOURITE_DAYS):%Y-%m-%d}"
        return Counter(row.goal for row in self._rows if isinstance(row, DriveRow) and row.arrived and row.day >= since)

    def csv(self) -> str:
        """Return everything that is recorded as one table; fields that a row does not have are empty."""
        columns = ["kind", *dict.fromkeys(each.name for kind in _KINDS.values() for each in fields(kind))]
        text = io.StringIO()
        writer = csv.DictWriter(text, columns, restval="", lineterminator="\n")
        writer.writeheader()
        for row in self._rows:
            writer.writerow({"kind": _kind(row), **asdict(row)})
        return text.getvalue()

    def _note(self, kind: str, row: Row) -> None:
        with self._lock:
            if not self.wanted:
                return
            try:
                self._append({"kind": kind, **asdict(row)})
                self._rows = (*self._rows, row)
                self.trouble = ""
            except OutputError as error:
                self.trouble = f"{error}; the habits of this drive are not kept"

    def _append(self, values: Mapping[str, object]) -> None:
        """Add a line and wait for the disk; a line that does not fit is taken back."""
        line = (json.dumps(values, allow_nan=False) + "\n").encode()
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            is_new = not self._path.exists()
            with os.fdopen(os.open(self._path, os.O_RDWR | os.O_CREAT, 0o600), "r+b", buffering=0) as file:
                size = _whole(file.read())
                if size + len(line) > MOST_BYTES:
                    raise OutputError(f"{self._path} is full: export it, then erase it")
                text = line if size else (json.dumps(_HEADER) + "\n").encode() + line
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

    def _forget_old(self) -> None:
        """Forget rows older than `KEPT_DAYS`: the file is written anew without them."""
        since = f"{self._now() - timedelta(days=KEPT_DAYS):%Y-%m-%d}"
        kept = tuple(row for row in self._rows if row.day >= since)
        if len(kept) == len(self._rows):
            return
        lines: list[Mapping[str, object]] = [_HEADER, {"kind": "yes" if self.wanted else "no"}]
        lines += [{"kind": _kind(row), **asdict(row)} for row in kept]
        with replacing(self._path, mode=0o600) as path:
            path.write_text("".join(json.dumps(line, allow_nan=False) + "\n" for line in lines), encoding="utf-8")
        self._rows = kept


_COUNTS = ("stops", "reversals", "interventions", "prompts", "replans")


def _kind(row: Row) -> str:
    return "decision" if isinstance(row, DecisionRow) else "drive"


def _whole(data: bytes) -> int:
    """Return the size of a file's whole lines [bytes]."""
    return data.rfind(b"\n") + 1


def _read(path: Path) -> tuple[tuple[Row, ...], bool]:
    """Return the rows of a file and whether the rider's last word was yes; none and no without a file.

    Raises:
        HabitsError: a whole line is damaged, or the file is none of habits.
    """
    if not is_file(path, HabitsError):
        return (), False
    data = read_bytes(path, HabitsError)
    rows: list[Row] = []
    wanted = False
    for number, values in enumerate(_lines(path, data[: _whole(data)]), 1):
        kind = values.pop("kind", None)
        if number == 1:
            if (kind, values) != ("habits", {"version": 1}):
                raise HabitsError(f"{path} is no record of habits of this version: erase it on the page")
        elif kind in ("yes", "no"):
            wanted = kind == "yes"
        else:
            rows.append(_row(path, number, str(kind), values))
    return tuple(rows), wanted


def _lines(path: Path, data: bytes) -> Iterator[dict[str, object]]:
    for number, line in enumerate(data.splitlines(), 1):
        try:
            values = json.loads(line)
        except ValueError:
            values = None
        if not isinstance(values, dict):
            raise _damaged(path, number)
        yield values


def _row(path: Path, number: int, kind: str, values: Mapping[str, object]) -> Row:
    made = _KINDS.get(kind)
    if made is None or set(values) != {each.name for each in fields(made)}:
        raise _damaged(path, number)
    types: dict[str, type | tuple[type, ...]] = {"str": str, "int": int, "float": (int, float), "bool": bool}
    for each in fields(made):
        if not isinstance(values[each.name], types[str(each.type)]):
            raise _damaged(path, number)
    try:
        if kind == "decision":
            MovementKind(str(values["proposed"])), Decision(str(values["done"]))
        return made(**values)  # type: ignore[arg-type]
    except ValueError as error:
        raise _damaged(path, number) from error


def _damaged(path: Path, number: int) -> HabitsError:
    return HabitsError(f"{path}:{number} is damaged: take the line out, or erase the record on the page")
