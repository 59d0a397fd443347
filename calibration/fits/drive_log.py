"""The log of a calibration drive: the counts on the lines and the chair's speeds, and its holds."""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from waychair.errors import CalibrationError, ThinData
from waychair.files import replacing
from waychair.types import FloatArray, IntArray

COLUMNS = ("stamp_ns", "forward_counts", "turn_counts", "v", "omega")
"""Columns of the CSV form: ns, counts, counts, m/s (forward positive), rad/s (left positive)."""

_FASTEST = (5.0, 10.0)  # m/s, rad/s; no wheelchair is faster, so a larger value is a measurement fault


@dataclass(frozen=True, slots=True)
class SweepLog:
    """A drive logged with one converter: stamps_ns (N,) rising, counts (N, 2) forward and turn, twists (N, 2).

    A twist [m/s, rad/s] is of its stamp's time, and the counts are those on the lines at that time.
    """

    stamps_ns: IntArray
    counts: IntArray
    twists: FloatArray
    bits: int
    volts_max: float
    volts_min: float = 0.0

    @property
    def volts(self) -> FloatArray:
        """Volts on the lines, (N, 2)."""
        span = self.volts_max - self.volts_min
        volts: FloatArray = self.volts_min + self.counts * (span / (2**self.bits - 1))
        return volts


@dataclass(frozen=True, slots=True)
class Holds:
    """Stretches of constant counts in which the chair settled: volts (K, 2), mean twists (K, 2) of their last part.

    `first`, `last` (K,) are rows of the log, the last one exclusive. `short` and `unsettled` count the stretches left
    out: rests between levels and the like, and stretches in which the speed still changed.
    """

    volts: FloatArray
    twists: FloatArray
    first: IntArray
    last: IntArray
    short: int
    unsettled: int

    def __len__(self) -> int:
        return len(self.first)


def read_sweep_log(path: Path, bits: int, volts_max: float, volts_min: float = 0.0) -> SweepLog:
    """Read a log from a CSV file whose first line names `COLUMNS`, in any order; other columns are ignored.

    Raises:
        CalibrationError: the file cannot be read, lacks a column, or has a wrong line (the error gives its number).
    """
    try:
        with path.open(encoding="utf-8", newline="") as file:
            reader = csv.DictReader(file)
            missing = [name for name in COLUMNS if name not in (reader.fieldnames or ())]
            if missing:
                raise CalibrationError(f"{path} lacks the column {missing[0]}: its first line must name {COLUMNS}")
            rows = [_row(path, reader.line_num, row, 2**bits - 1) for row in reader]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise CalibrationError(f"cannot read {path}: {error}; give a CSV file with the columns {COLUMNS}") from error
    if not rows:
        raise ThinData(f"{path} holds no samples: log a sweep with the columns {COLUMNS}")
    stamps = np.array([row[0] for row in rows], np.int64)
    if (back := np.flatnonzero(np.diff(stamps) <= 0)).size:
        raise CalibrationError(f"{path}, sample {back[0] + 2}: the stamp does not rise; sort the lines by time")
    counts = np.array([row[1:3] for row in rows], np.int64)
    return SweepLog(
        stamps_ns=stamps,
        counts=counts,
        twists=np.array([row[3:] for row in rows], float),
        bits=bits,
        volts_max=volts_max,
        volts_min=volts_min,
    )


def write_sweep_log(path: Path, log: SweepLog) -> None:
    """Write a log atomically as a CSV file that `read_sweep_log` reads.

    Raises:
        OutputError: it cannot be written.
    """
    with replacing(path) as aside, aside.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        for stamp, counts, twist in zip(log.stamps_ns.tolist(), log.counts.tolist(), log.twists.tolist(), strict=True):
            writer.writerow((stamp, *counts, *(f"{speed:.5f}" for speed in twist)))


def _row(path: Path, line: int, row: dict[str, str | None], counts_max: int) -> tuple[int, int, int, float, float]:
    try:
        stamp, forward, turn = (int(row[name] or "") for name in COLUMNS[:3])
        v, omega = (float(row[name] or "") for name in COLUMNS[3:])
    except ValueError:
        raise CalibrationError(
            f"{path}, line {line}: cannot be read as numbers of {COLUMNS}; correct or delete the line"
        ) from None
    for count in (forward, turn):
        if not 0 <= count <= counts_max:
            raise CalibrationError(f"{path}, line {line}: {count} counts lie outside 0..{counts_max}; check the bits")
    for name, speed, fastest in zip(COLUMNS[3:], (v, omega), _FASTEST, strict=True):
        if not (math.isfinite(speed) and abs(speed) <= fastest):
            raise CalibrationError(f"{path}, line {line}: {name} = {speed:g} is no speed of a chair; delete the line")
    return stamp, forward, turn, v, omega


def steady_holds(log: SweepLog, measure_s: float, steady: tuple[float, float]) -> Holds:
    """Return the holds of a log, each with the mean of its last `measure_s` seconds.

    A stretch is left out if it is shorter than twice that, or if the halves of the measured part differ by more than
    `steady` (m/s, rad/s), because the chair was then still speeding up.
    """
    changed = np.flatnonzero((np.diff(log.counts, axis=0) != 0).any(axis=1)) + 1
    starts, ends = np.append(0, changed), np.append(changed, len(log.stamps_ns))
    rows, twists, short = [], [], 0
    for first, last in zip(starts.tolist(), ends.tolist(), strict=True):
        seconds = (log.stamps_ns[first:last] - log.stamps_ns[last - 1]) * 1e-9
        part = log.twists[first:last][seconds > -measure_s - 1e-9]
        half = len(part) // 2
        if -seconds[0] < 2.0 * measure_s - 0.1 or half < 2:
            short += 1
        elif (np.abs(part[:half].mean(axis=0) - part[half:].mean(axis=0)) <= steady).all():
            rows.append((first, last))
            twists.append(part.mean(axis=0))
    bounds = np.array(rows, np.int64).reshape(-1, 2)
    return Holds(
        volts=log.volts[bounds[:, 0]],
        twists=np.array(twists, float).reshape(-1, 2),
        first=bounds[:, 0],
        last=bounds[:, 1],
        short=short,
        unsettled=len(starts) - len(rows) - short,
    )
