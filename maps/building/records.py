"""Lines of a building's text files: one record a line, `kind keyword=value ...`; comments begin with #.

    node id=c1 kind=cross x=1.2 y=3.4      # in front of the lift
    node id=e1 kind=end x=2 y=3.4 name="Waiting room"
    end

A value with spaces, quotes or # is in double quotes, with \\" and \\\\ inside. The last record is `end`, so that a file
that was cut off is refused. An error names the file and the line.
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from waychair.errors import BuildingError

END = "end"
"""The last record of every file."""

_VALUE = re.compile(r'\s*([A-Za-z_]\w*)=("(?:[^"\\]|\\.)*"|[^\s"#]+)(?=\s|$)')
_COMMENT = re.compile(r"\s*(#.*)?$")
_PLAIN = re.compile(r'[^\s"#\\]+')
_BILLION = 1_000_000_000


@dataclass(frozen=True, slots=True)
class Record:
    """One line: its file, its number from 1, its kind, and its values by keyword."""

    path: Path
    number: int
    kind: str
    values: Mapping[str, str]

    def error(self, sentence: str) -> BuildingError:
        """Return the error that this line causes."""
        return BuildingError(f"{self.path}, line {self.number}: {_LONG_WORD.sub(_shortened, sentence)}")

    def allow(self, keywords: frozenset[str]) -> None:
        """Refuse keywords that this kind of record does not have.

        Raises:
            BuildingError: there is one.
        """
        for key in self.values:
            if key not in keywords:
                near = difflib.get_close_matches(key, sorted(keywords), n=1, cutoff=0.0)
                raise self.error(f"'{key}' is no keyword of '{self.kind}'; did you mean {near[0] if near else 'none'}?")

    def text(self, key: str, default: str | None = None) -> str:
        """Return a value; without a default it must be there.

        Raises:
            BuildingError: it is not.
        """
        value = self.values.get(key, default)
        if value is None:
            raise self.error(f"'{self.kind}' lacks {key}=...: add it")
        return value

    def number_of(self, key: str, low: float, high: float, default: float | None = None) -> float:
        """Return a number in a closed range; without a default it must be there.

        Raises:
            BuildingError: it is not, or is no number, not finite or out of range.
        """
        written = self.values.get(key)
        if written is None and default is not None:
            return default
        if written is None:
            raise self.error(f"'{self.kind}' lacks {key}=...: add it")
        try:
            value = float(written)
        except ValueError:
            raise self.error(f"{key} is '{written}', which is no number: write digits, such as 1.25") from None
        if not low <= value <= high:  # False for nan
            raise self.error(f"{key} is {written}; it must lie in [{low:g}, {high:g}]")
        return value

    def maybe(self, key: str, low: float, high: float) -> float | None:
        """Return a number in a closed range, None where the line has none; raises as `number_of`."""
        return self.number_of(key, low, high) if key in self.values else None

    def flag(self, key: str) -> bool:
        """Return whether a keyword is `yes`; absent is no.

        Raises:
            BuildingError: it is neither yes nor no.
        """
        value = self.values.get(key, "no")
        if value not in ("yes", "no"):
            raise self.error(f"{key} is '{value}': write yes or no")
        return value == "yes"

    def time_ns(self, key: str) -> int | None:
        """Return a time in UTC [ns since 1970], None where the line has none.

        Raises:
            BuildingError: it is no time.
        """
        written = self.values.get(key)
        if written is None:
            return None
        whole, point, part = written.removesuffix("Z").partition(".")
        try:
            moment = datetime.fromisoformat(whole)
            fraction = int(part.ljust(9, "0")) if point else 0
        except ValueError:
            moment, fraction = None, 0
        if moment is None or moment.tzinfo is not None or not 0 <= fraction < _BILLION:
            raise self.error(f"{key} is '{written}': write a time in UTC, such as 2026-03-01T08:00:00Z")
        return int(moment.replace(tzinfo=UTC).timestamp()) * _BILLION + fraction


_LONG_WORD = re.compile(r"\S{80,}")


def _shortened(word: re.Match[str]) -> str:
    return f"{word[0][:40]}..."


def records(path: Path, text: str) -> Iterator[Record]:
    """Yield the records of a file up to `end`.

    Raises:
        BuildingError: a line is no record, or the file is cut off.
    """
    number, ended = 0, False
    for number, line in enumerate(text.split("\n"), start=1):
        found = _record(path, number, line)
        if found is None:
            continue
        if ended:
            raise found.error(f"'{found.kind}' follows the last record, '{END}': move it above")
        if found.kind == END:
            ended = True
            continue
        yield found
    if not ended:
        raise BuildingError(f"{path}, line {number}: the file is cut off: its last record must be '{END}'")


def record_of_line(path: Path, number: int, line: str) -> Record | None:
    """Return a line's record; None for a comment, an empty line or `end`.

    Raises:
        BuildingError: the line is no record.
    """
    found = _record(path, number, line)
    return None if found is None or found.kind == END else found


def line_of(kind: str, values: Iterable[tuple[str, object]]) -> str:
    """Return a record's line; values that are None or False are left out."""
    parts = [kind]
    for key, value in values:
        if value is None or value is False:
            continue
        parts.append(f"{key}={_written(value)}")
    return " ".join(parts)


def time_text(stamp_ns: int | None) -> str | None:
    """Return a time [ns since 1970] in UTC, with a fraction only where it has one."""
    if stamp_ns is None:
        return None
    seconds, fraction = divmod(stamp_ns, _BILLION)
    whole = datetime.fromtimestamp(seconds, UTC).strftime("%Y-%m-%dT%H:%M:%S")
    return f"{whole}.{fraction:09d}Z" if fraction else f"{whole}Z"


def _record(path: Path, number: int, line: str) -> Record | None:
    if '"' not in line and "#" not in line:  # nearly all lines; four times as fast
        parts = line.split()
        if not parts:
            return None
        values = {}
        for part in parts[1:]:
            key, equals, value = part.partition("=")
            if not equals or not key or not value or key in values:
                raise _broken(path, number, line, key if key in values else None)
            values[key] = value
        return Record(path, number, parts[0], values)
    if _COMMENT.match(line):
        return None
    kind, _, rest = line.strip().partition(" ")
    values, at = {}, 0
    while not _COMMENT.match(rest, at):
        found = _VALUE.match(rest, at)
        if found is None or found[1] in values:
            raise _broken(path, number, line, None if found is None else found[1])
        values[found[1]], at = _unquoted(found[2]), found.end()
    return Record(path, number, kind, values)


def _broken(path: Path, number: int, line: str, doubled: str | None) -> BuildingError:
    if doubled:
        return BuildingError(f"{path}, line {number}: {doubled} is given twice: give it once")
    shown = line.strip() if len(line) < 60 else f"{line.strip()[:57]}..."
    return BuildingError(
        f"{path}, line {number}: '{shown}' is no record: write KIND keyword=value ..., with \"quotes\" round spaces"
    )


def _unquoted(value: str) -> str:
    return re.sub(r"\\(.)", r"\1", value[1:-1]) if value.startswith('"') else value


def _written(value: object) -> str:
    if value is True:
        return "yes"
    if isinstance(value, float):
        return str(int(value)) if value.is_integer() and math.fabs(value) < 1e15 else repr(value)
    text = str(value)
    if _PLAIN.fullmatch(text):
        return text
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'
