"""Tables of stamps and other fields as text, as people and other programs write them.

One parser for lists of pictures and for trajectories: fields separated by blanks, tabs, commas or semicolons, decimal
commas beside semicolons, a heading, comments, a byte order mark; stamps in seconds, milliseconds, microseconds or
nanoseconds, plain or with an exponent (numpy.savetxt), always exact to the nanosecond.
"""

from __future__ import annotations

import gzip
import math
import re
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from itertools import pairwise
from pathlib import Path

import numpy as np

from waychair.errors import RecordingDamaged, RecordingError, RecordingNotFound
from waychair.types import FloatArray, IntArray

UNITS = {"s": 9, "ms": 6, "us": 3, "ns": 0}
"""Names of the units of stamps, and the decimal places of a nanosecond in each."""

UNIT_NAMES = {"s": "seconds", "ms": "milliseconds", "us": "microseconds", "ns": "nanoseconds"}

_NANOSECONDS = UNITS["s"]
_LONGEST_NS = 1 << 63
_LONGEST_S = _LONGEST_NS // 10**_NANOSECONDS
_EPOCHS = (("ns", 17), ("us", 14), ("ms", 11))
"""Units by the power of ten that a stamp since 1970 exceeds in them: 1e17 ns and 1e14 us are both 1973."""

_STEPS = (("ns", 10**6), ("us", 10**4), ("ms", 10))
"""Units by the least median step of whole-number stamps that do not count from 1970: 1 ms, 10 ms, 10 ms."""

_GZIP = b"\x1f\x8b"
_COMMENTS = ("#", "%", "//")
_NUMBER_WITH_COMMA = re.compile(r"[-+]?\d+,\d+(?:[eE][-+]?\d+)?")
_DECIMAL_COMMA = re.compile(r"(?<=\d),(?=\d)")


@dataclass(frozen=True, slots=True)
class Row:
    """The fields of a line of a table, and the line's number from 1."""

    number: int
    fields: tuple[str, ...]


def stamp_from_text(text: str, unit: str = "s") -> int:
    """Return a decimal number as whole nanoseconds, without rounding through a float.

    Raises:
        ValueError: not a finite decimal number, or beyond 292 years (int64 nanoseconds).
    """
    try:
        time = Decimal(text)
    except InvalidOperation as error:
        raise ValueError(f"'{text}' is not a time in seconds") from error
    if not time.is_finite() or time.copy_abs() >= _LONGEST_S * 10 ** (_NANOSECONDS - UNITS[unit]):
        raise ValueError(f"'{text}' is not a time in seconds")
    return round(time.scaleb(UNITS[unit]))


def number_from_text(text: str) -> float:
    """Return a finite number.

    Raises:
        ValueError: the text is not a number, or it is infinite or nan.
    """
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"'{text}' is not a finite number")
    return value


def unit_of_stamps(texts: Sequence[str]) -> str:
    """Return the unit of a column of stamps: "s", "ms", "us" or "ns".

    Stamps that count from 1970 tell it by their size. Other stamps are seconds, unless all are whole numbers whose
    median step would be a very long time in seconds. Texts that are no numbers are ignored.
    """
    times = [(time, text) for text in texts if (time := _decimal(text)) is not None]
    largest = max((abs(time) for time, _ in times), default=Decimal(0))
    for unit, power in _EPOCHS:
        if largest >= Decimal(10) ** power:
            return unit
    if any(time != time.to_integral_value() or ("." in text and "e" not in text.lower()) for time, text in times):
        return "s"
    steps = sorted(b - a for (a, _), (b, _) in pairwise(times) if b > a)
    middle = steps[len(steps) // 2] if steps else Decimal(0)
    return next((unit for unit, least in _STEPS if middle >= least), "s")


def rows_of(text: str) -> list[Row]:
    """Return the rows of a table without comments, empty lines and a heading.

    The heading is a first line without a number, such as the column names of a CSV file.
    """
    rows = [Row(number, _fields(line)) for number, line in enumerate(text.lstrip("\ufeff").splitlines(), start=1)]
    rows = [row for row in rows if row.fields and not row.fields[0].startswith(_COMMENTS)]
    return rows[1:] if rows and not any(map(_is_number, rows[0].fields)) else rows


def read_rows(path: Path) -> list[Row]:
    """Return the rows of a file, plain or gzipped (`rows_of`).

    Raises:
        RecordingNotFound: the file does not exist.
        RecordingDamaged: the file is empty, or a damaged gzip file.
        RecordingError: the file cannot be opened.
    """
    try:
        data = path.read_bytes()
    except FileNotFoundError as error:
        raise RecordingNotFound(f"there is no recording at {path}; check the path") from error
    except OSError as error:
        raise RecordingError(f"cannot read {path}: {error.strerror}") from error
    if not data:
        raise RecordingDamaged(f"{path} is empty; copy it again from its source")
    if data.startswith(_GZIP):
        try:
            data = gzip.decompress(data)
        except (OSError, EOFError, zlib.error) as error:
            raise RecordingDamaged(f"{path} is a damaged gzip file ({error}); copy it again from its source") from error
    encoding = "utf-16" if data[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8"
    return rows_of(data.decode(encoding, errors="replace"))


def read_pose_rows(path: Path) -> tuple[IntArray, FloatArray]:
    """Return the stamps (N,) [ns] and x y z qx qy qz qw (N, 7) of a trajectory in TUM's form, in file order.

    Raises:
        RecordingNotFound: the file does not exist.
        RecordingDamaged: a line does not hold eight finite numbers with a quaternion in the last four, or the file is
            empty.
    """
    rows = read_rows(path)
    unit = unit_of_stamps([row.fields[0] for row in rows])
    stamps, poses = [], []
    for row in rows:
        try:
            stamps.append(stamp_from_text(row.fields[0], unit))
            poses.append([number_from_text(field) for field in row.fields[1:]])
            if len(poses[-1]) != 7:
                raise ValueError(f"it has {len(row.fields)} fields")
            if not any(poses[-1][3:]):
                raise ValueError("its quaternion is zero")
        except ValueError as error:
            raise RecordingDamaged(f"{path} line {row.number} is not `stamp x y z qx qy qz qw`: {error}") from error
    return np.array(stamps, np.int64), np.array(poses, np.float64).reshape(-1, 7)


def _fields(line: str) -> tuple[str, ...]:
    if ";" in line:
        parts = [_DECIMAL_COMMA.sub(".", field).strip() for field in line.split(";")]
    elif "," not in line:
        parts = line.split()
    elif _has_decimal_commas(line):
        parts = [part.replace(",", ".") if _NUMBER_WITH_COMMA.fullmatch(part) else part for part in line.split()]
    else:
        # Blanks may separate too, as in `1.0, rgb/1.png 1.01 depth/1.png`; in a file's name they belong to it.
        fields = [field.strip() for field in line.split(",")]
        parts = [part for field in fields for part in (field.split() if _is_list(field) else [field])]
    while parts and not parts[-1]:
        parts.pop()
    return tuple(parts)


def _has_decimal_commas(line: str) -> bool:
    """Return whether a line is separated by blanks, and its commas stand for decimal points."""
    parts = line.split()
    return len(parts) > 1 and all(_NUMBER_WITH_COMMA.fullmatch(part) for part in parts if "," in part)


def _is_list(field: str) -> bool:
    """Return whether the text between two commas is itself a list of fields, one of them a number."""
    parts = field.split()
    return len(parts) > 1 and any(map(_is_number, parts))


def _decimal(text: str) -> Decimal | None:
    try:
        time = Decimal(text)
    except InvalidOperation:
        return None
    return time if time.is_finite() else None


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
