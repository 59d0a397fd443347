"""CoreSLAM logs (tinySLAM, Steux and El Hamzaoui 2010): encoder counts and laser ranges of a small robot, as text.

A line holds the time in microseconds, a number, the counts of the left and right encoders, other robot state up to
column 24, and then the ranges in millimetres, counter-clockwise, 0 for no return. 2000 counts are a whole wheel turn.
The published example takes 2000 counts as half a turn, but adds the distances of both wheels instead of averaging
them. Scan matching on both logs confirms a whole turn (0.96 to 0.97 of the distance).

The time belongs to the encoders; the scan on the same line is older. The turns from scan matching follow those of the
wheels best when the middle of the sweep is 0.156 s before the line's time (correlation 0.96 in both logs, 0.70 and
0.72 without). The first beam is thus 0.19 s before it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from waychair.errors import NoScans, RecordingDamaged
from waychair.geometry import interpolate
from waychair.types import FloatArray, IntArray, Odometry, Pose2, Scan, SensorFrame, Twist

FIRST_RANGE = 24
"""Column of the first range."""

# The robot of the published logs, with a Hokuyo URG-04LX laser.
WHEEL_RADIUS = 0.077  # m
HALF_AXLE = 0.165  # m; half the distance between the wheels
COUNTS_PER_TURN = 2000.0  # encoder counts of a whole turn of a wheel
LASER_OFFSET = 0.145  # m; laser ahead of the axle
FIELD_OF_VIEW = math.radians(240.0)  # between the first and the last beam
BLIND_BEAMS = 70  # beams at either end that hit the robot itself
RANGE_MIN = 0.06  # m; shorter ranges are error codes
RANGE_MAX = 5.6  # m; longer ranges mean that nothing was seen
MIRROR_PERIOD = 0.1  # s; a whole turn of the laser's mirror
SCAN_AGE = 0.19  # s; from a scan's first beam to the time of its line (see above)

_LEFT, _RIGHT = 2, 3  # columns of the encoder counts
_LEAST_BEAMS = 100
_PROGRESS_EVERY = 64  # lines


@dataclass(frozen=True, slots=True)
class CoreslamLog:
    """The scans of a log in file order with odometry, the laser's mount, and warnings about the log."""

    frames: tuple[SensorFrame, ...]
    base_from_laser: Pose2
    warnings: tuple[str, ...]


def is_coreslam(text: bytes) -> bool:
    """Return whether a first line is of a CoreSLAM log: only numbers, the first an integer, enough of them for a scan."""
    fields = text.split()
    return len(fields) >= FIRST_RANGE + _LEAST_BEAMS and fields[0].isdigit() and _numbers(fields) is not None


def read_coreslam(text: bytes, where: str, progress: Callable[[float], None] | None = None) -> CoreslamLog:
    """Return every scan of a log, with odometry from its encoder counts. Truncated lines are left out.

    Raises:
        RecordingDamaged: no line is complete.
        NoScans: the log has fewer than two scans.
    """
    lines = [line for line in text.split(b"\n") if line.strip()]
    width = len(lines[0].split()) if lines else 0
    rows, damaged = [], []
    for number, line in enumerate(lines, start=1):
        row = _numbers(line.split())
        if row is not None and len(row) == width:
            rows.append(row)
        else:
            damaged.append(number)
        if progress is not None and number % _PROGRESS_EVERY == 0:
            progress(number / len(lines))
    if not rows:
        raise RecordingDamaged(f"none of the {len(damaged)} lines of {where} is complete; copy the file again")
    if len(rows) < 2:
        raise NoScans(f"{where} holds only one scan; give a log of a drive")
    table = np.array(rows)
    warnings = [f"{len(damaged)} damaged lines, the first of them line {damaged[0]}, left out"] if damaged else []
    stamps = (table[:, 0] * 1000.0).astype(np.int64)
    if backwards := int((np.diff(stamps) < 0).sum()):
        warnings.append(f"stamps step backwards {backwards} times: the scans are kept in the order of the file")
    taken = stamps - round(SCAN_AGE * 1e9)
    odometry = _at(_odometry(table, stamps), taken)
    scans = [_scan(int(stamp), row[FIRST_RANGE:]) for stamp, row in zip(taken, table, strict=True)]
    frames = [SensorFrame(scan.stamp_ns, scan=scan, wheels=(at,)) for scan, at in zip(scans, odometry, strict=True)]
    if progress is not None:
        progress(1.0)
    return CoreslamLog(tuple(frames), Pose2(LASER_OFFSET, 0.0, 0.0), tuple(warnings))


def _numbers(fields: Sequence[bytes]) -> FloatArray | None:
    """Return the fields as finite numbers; None when one is not."""
    try:
        row = np.array(fields, np.float64)
    except ValueError:
        return None
    return row if np.isfinite(row).all() else None


def _odometry(table: FloatArray, stamps: IntArray) -> list[Odometry]:
    """Return the axle's pose at each line, integrated as arcs, with the mean twist since the line before."""
    metres = table[:, [_LEFT, _RIGHT]] * (WHEEL_RADIUS * math.tau / COUNTS_PER_TURN)
    steps = np.diff(metres, axis=0)
    seconds = np.diff(stamps) * 1e-9
    pose, readings = Pose2(), [Odometry(int(stamps[0]), Pose2())]
    for stamp, (left, right), elapsed in zip(stamps[1:].tolist(), steps.tolist(), seconds.tolist(), strict=True):
        distance, turn = 0.5 * (left + right), 0.5 * (right - left) / HALF_AXLE
        chord = distance * math.sin(0.5 * turn) / (0.5 * turn) if turn else distance
        pose = pose @ Pose2(chord * math.cos(0.5 * turn), chord * math.sin(0.5 * turn), turn)
        twist = Twist(distance / elapsed, turn / elapsed) if elapsed > 0.0 else Twist()
        readings.append(Odometry(stamp, pose, twist))
    return readings


def _at(readings: Sequence[Odometry], stamps: IntArray) -> list[Odometry]:
    """Return the odometry interpolated to other stamps, with the twist of the later reading."""
    known = np.maximum.accumulate(np.array([reading.stamp_ns for reading in readings]))
    found = []
    for stamp, after in zip(stamps.tolist(), np.searchsorted(known, stamps), strict=True):
        a, b = readings[max(after - 1, 0)], readings[min(after, len(readings) - 1)]
        elapsed = b.stamp_ns - a.stamp_ns
        share = (stamp - a.stamp_ns) / elapsed if elapsed > 0 else 1.0
        pose = interpolate(a.odom_from_base, b.odom_from_base, min(max(share, 0.0), 1.0))
        found.append(Odometry(stamp, pose, b.twist))
    return found


def _scan(stamp_ns: int, millimetres: FloatArray) -> Scan:
    ranges = (millimetres * 1e-3).astype(np.float32)
    with np.errstate(invalid="ignore"):
        ranges[ranges > RANGE_MAX] = np.inf
        ranges[ranges < RANGE_MIN] = np.nan
    ranges[:BLIND_BEAMS] = ranges[-BLIND_BEAMS:] = np.nan
    step = FIELD_OF_VIEW / (len(ranges) - 1)
    return Scan(
        stamp_ns=stamp_ns,
        ranges=ranges,
        angle_min=-0.5 * FIELD_OF_VIEW,
        angle_step=step,
        time_step=MIRROR_PERIOD * step / math.tau,
        range_min=RANGE_MIN,
        range_max=RANGE_MAX,
    )
