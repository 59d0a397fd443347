"""Laser scans as plain rows of numbers.

A row is `stamp angle_min angle_max angle_increment time_increment scan_time range_min range_max n` and n ranges, in
seconds, radians and metres: the fields of a sensor_msgs/LaserScan in their order. There is no odometry.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from waychair.errors import RecordingDamaged
from waychair.recordings.scans import ascending
from waychair.recordings.stamps import stamp_from_text
from waychair.types import Scan, SensorFrame

_COLUMNS = 9
_PROGRESS_EVERY = 64  # lines


@dataclass(frozen=True, slots=True)
class LaserText:
    """The scans in file order, and warnings about the file."""

    frames: tuple[SensorFrame, ...]
    warnings: tuple[str, ...]


def is_laser_text(text: bytes) -> bool:
    """Return whether a first line is a complete row."""
    try:
        _scan(text.split())
    except ValueError:
        return False
    return True


def read_laser_text(text: bytes, where: str, progress: Callable[[float], None] | None = None) -> LaserText:
    """Return every scan of a file. Truncated rows are left out; lines that begin with # are comments.

    Raises:
        RecordingDamaged: no row is complete.
    """
    lines = text.split(b"\n")
    frames, damaged = [], []
    for number, line in enumerate(lines, start=1):
        fields = line.split()
        if not fields or fields[0].startswith(b"#"):
            continue
        try:
            scan = _scan(fields)
            frames.append(SensorFrame(scan.stamp_ns, scan=scan))
        except ValueError:
            damaged.append(number)
        if progress is not None and number % _PROGRESS_EVERY == 0:
            progress(number / len(lines))
    if not frames:
        raise RecordingDamaged(f"none of the {len(damaged)} rows of {where} is complete; copy the file again")
    warnings = [f"{len(damaged)} damaged rows, the first of them line {damaged[0]}, left out"] if damaged else []
    warnings.append("the file holds no odometry: the motion is estimated by scan matching alone")
    if progress is not None:
        progress(1.0)
    return LaserText(tuple(frames), tuple(warnings))


def _scan(fields: Sequence[bytes]) -> Scan:
    if len(fields) <= _COLUMNS or len(fields) != _COLUMNS + int(fields[8]):
        raise ValueError("cut short")
    angle_min, _, step, time_step, _, nearest, farthest = (float(field) for field in fields[1:8])
    ranges = np.array(fields[_COLUMNS:], np.float32)
    if len(ranges) < 2 or step == 0.0 or not math.isfinite(angle_min + step + time_step + nearest):
        raise ValueError("no angles")
    with np.errstate(invalid="ignore"):
        ranges[ranges > np.float32(farthest)] = np.inf
        ranges[ranges <= 0.0] = np.nan
    stamp_ns = stamp_from_text(fields[0].decode(errors="replace"))
    return ascending(
        Scan(
            stamp_ns=stamp_ns,
            ranges=ranges,
            angle_min=angle_min,
            angle_step=step,
            time_step=time_step,
            range_min=nearest,
            range_max=farthest,
        )
    )
