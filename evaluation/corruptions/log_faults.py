"""CARMEN logs of the sound drive, and their faults: numbers, lines, units, stamps, ends."""

from __future__ import annotations

import gzip
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np

from evaluation.corruptions.fault import faults_of, file_fault
from evaluation.corruptions.sound_drive import MOUNT, SECOND, START_NS, sound_drive
from waychair.geometry import compose

Rng = np.random.Generator
_LINE = "lines?|damage|cut|neither|complete"
_DAMAGE = _LINE + "|zero|end|incomplete|gz|empty|encod|text|UTF"
_COUNT, _POSE, _STAMP = 1, -9, -3  # places of the number of beams, of the laser's pose, of the stamp on a line

_SWEEP_S = 0.013  # of a lidar whose mirror turns 75 times a second
Row = list[str]


def write_log(path: Path) -> None:
    """Write the drive as FLASER lines of a lidar of half a turn, with the pose of the laser by dead reckoning."""
    drive = sound_drive(180, math.pi, _SWEEP_S)
    poses = np.stack([np.interp(drive.scan_times, drive.wheel_times, column) for column in drive.wheel_poses.T], axis=1)
    lines = [
        "# message_name [message contents] ipc_timestamp ipc_hostname logger_timestamp",
        "PARAM robot_frontlaser_offset 0.0 0 host 0",
    ]
    for seconds, base, ranges in zip(drive.scan_times, poses, drive.scans, strict=True):
        laser = compose(base, np.array([*MOUNT, 0.0]))
        pose = " ".join(f"{value:.6f}" for value in laser.tolist())
        beams = " ".join(f"{min(value, 81.83):.2f}" for value in ranges.tolist())
        stamp = f"{START_NS / SECOND + float(seconds):.6f}"
        lines.append(f"FLASER {len(ranges)} {beams} {pose} {pose} {stamp} host {float(seconds):.6f}")
    path.write_text("\n".join(lines) + "\n")


def _rows(path: Path, rng: Rng, share: float | None, by: Callable[[Row], Row]) -> Path:
    """Change a share of the scan lines (all of them: 1), or one."""
    share = float(rng.choice([0.0, 0.2, 1.0])) if share is None else share
    lines = path.read_text().splitlines()
    one = int(rng.integers(2, len(lines)))
    changed = [
        " ".join(by(line.split())) if line.startswith("FLASER") and (k == one or rng.random() < share) else line
        for k, line in enumerate(lines)
    ]
    path.write_text("\n".join(changed) + "\n")
    return path


def _ranges(row: Row, by: Callable[[float], float]) -> Row:
    count = int(row[_COUNT])
    return [*row[:2], *(f"{by(float(value)):.3f}" for value in row[2 : 2 + count]), *row[2 + count :]]


def _poses(row: Row, by: Callable[[float, float, float], tuple[float, float, float]]) -> Row:
    pose = [f"{value:.6f}" for value in by(*(float(value) for value in row[_POSE : _POSE + 3]))]
    return [*row[:_POSE], *pose, *pose, *row[_STAMP:]]


@file_fault(4, ("log", "lidar"), _LINE, "log")
def log_lines_are_cut(path: Path, rng: Rng) -> Path:
    return _rows(path, rng, None, lambda row: row[: int(rng.integers(1, len(row)))])


@file_fault(4, ("log", "lidar"), _LINE + "|beams|number", "log")
def log_counts_are_wrong(path: Path, rng: Rng) -> Path:
    count = str(rng.choice(["179", "90", "181", "0", "-1", "1000000000", "abc", "18.0"]))
    return _rows(path, rng, None, lambda row: [row[0], count, *row[2:]])


@file_fault(4, ("log", "lidar", "odometry"), _LINE + "|finite|nan|number", "log")
def log_numbers_are_none(path: Path, rng: Rng) -> Path:
    value = str(rng.choice(["nan", "inf", "-", "1,25", "1e400", "0x1F"]))

    def broken(row: Row) -> Row:
        at = int(rng.integers(2, len(row) - 3)) if rng.random() < 0.5 else len(row) + _POSE + int(rng.integers(3))
        return [*row[:at], value, *row[at + 1 :]]

    return _rows(path, rng, None, broken)


@file_fault(2, "lidar", "units?|millimet|mm|cm|centimet|scale|no distance", "log")
def log_ranges_are_in_other_units(path: Path, rng: Rng) -> Path:
    unit = float(rng.choice([1000.0, 100.0]))
    return _rows(path, rng, float(rng.choice([0.0, 0.2, 1.0])), lambda row: _ranges(row, lambda value: unit * value))


@file_fault(2, "lidar", "code|nothing|share|same value", "log")
def log_tells_nothing_as_a_code(path: Path, rng: Rng) -> Path:
    reach = float(rng.choice([3.0, 4.5]))
    code = float(rng.choice([reach, 0.0, 8.191, 81.91, 5.6]))
    return _rows(path, rng, 1.0, lambda row: _ranges(row, lambda value: code if value > reach else value))


@file_fault(1, "odometry", "jump|restart|begin|anew|no chair|step|wild|bridged", "log")
def log_odometry_jumps(path: Path, rng: Rng) -> Path:
    far, seen, first, once = float(10.0 ** rng.uniform(0.5, 6.0)), [0], int(rng.integers(40, 150)), rng.random() < 0.5

    def moved(row: Row) -> Row:
        seen[0] += 1
        off = far if (seen[0] == first if once else seen[0] >= first) else 0.0
        return _poses(row, lambda x, y, yaw: (x + off, y - off, yaw))

    return _rows(path, rng, 1.0, moved)


@file_fault(
    1,
    "odometry",
    "units?|scale|millimet|degrees|headings?|exchanged|other way|mirror|[\\d.]+ times (too|the true)",
    "log",
)
def log_odometry_is_in_other_units(path: Path, rng: Rng) -> Path:
    which = int(rng.integers(4))
    return _rows(
        path, rng, 1.0,
        lambda row: _poses(
            row,
            lambda x, y, yaw: [(1000 * x, 1000 * y, yaw), (x, y, math.degrees(yaw)), (x, y, -yaw), (y, x, yaw)][which],
        ),
    )  # fmt: skip


@file_fault(1, "odometry", "nothing|stand|stick|zero|same", "log")
def log_odometry_is_zero(path: Path, rng: Rng) -> Path:
    return _rows(path, rng, 1.0, lambda row: _poses(row, lambda x, y, yaw: (0.0, 0.0, 0.0)))


@file_fault(2, ("clock", "log"), "stamp|clock|order|line|same|back", "log")
def log_stamps_are_wrong(path: Path, rng: Rng) -> Path:
    stamp = str(rng.choice(["0", "nan", "-1.5", "1e30", "abc", "1715000000.000000"]))
    return _rows(path, rng, None, lambda row: [*row[:_STAMP], stamp, *row[_STAMP + 1 :]])


@file_fault(2, ("clock", "log"), "stamp|clock|unit|second", "log")
def log_stamps_are_in_other_units(path: Path, rng: Rng) -> Path:
    digits = int(rng.choice([3, 6, 9]))
    return _rows(
        path, rng, 1.0, lambda row: [*row[:_STAMP], f"{float(row[_STAMP]) * 10**digits:.0f}", *row[_STAMP + 1 :]]
    )  # fmt: skip


@file_fault(4, "log", _LINE + "|twice|order|repeat|stamps?", "log")
def log_lines_are_moved(path: Path, rng: Rng) -> Path:
    lines = path.read_text().splitlines()
    head, rest = lines[:2], lines[2:]
    which = int(rng.integers(3))
    if which == 0:
        first = int(rng.integers(len(rest) - 20))
        rest[first : first + 10] = rest[first : first + 10] * 2
    elif which == 1:
        a, b = sorted(int(k) for k in rng.integers(0, len(rest), 2))
        rest[a], rest[b] = rest[b], rest[a]
    else:
        rest = rest[::-1]
    path.write_text("\n".join(head + rest) + "\n")
    return path


@file_fault(4, ("log", "file"), _DAMAGE, "log")
def log_bytes_are_wrong(path: Path, rng: Rng) -> Path:
    data = bytearray(path.read_bytes())
    first, size = int(rng.uniform(0.1, 0.8) * len(data)), int(rng.choice([10, 3000, 50_000]))
    data[first : first + size] = bytes(size) if rng.random() < 0.5 else rng.bytes(size)
    path.write_bytes(data)
    return path


@file_fault(4, ("log", "file"), _DAMAGE, "log")
def log_is_cut(path: Path, rng: Rng) -> Path:
    data = path.read_bytes()
    if rng.random() < 0.5:
        data = gzip.compress(data, 1)
    path.write_bytes(data[: int(float(rng.choice([0.0, 0.0005, 0.3, 0.7, 0.999])) * len(data))])
    return path


@file_fault(4, ("log", "file"), _DAMAGE, "log")
def log_has_another_encoding(path: Path, rng: Rng) -> Path:
    text = path.read_text()
    data = [
        text.encode("utf-16"),
        b"\xef\xbb\xbf" + text.encode(),
        text.replace("\n", "\r\n").encode(),
        text.replace("\n", "\r").encode(),
        text.replace(" ", "\t").encode(),
        text.replace("FLASER", "FLASR").encode(),
    ][int(rng.integers(6))]
    path.write_bytes(data)
    return path


LOG_FAULTS = faults_of(globals())
