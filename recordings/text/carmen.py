"""CARMEN logs: the text format of most public two-dimensional laser recordings.

Message layouts of the Carnegie Mellon Robot Navigation Toolkit (logger, messages FLASER and ROBOTLASER1):

    FLASER n r_1 .. r_n  x y theta  odom_x odom_y odom_theta  stamp host logger_stamp
    ROBOTLASER1 type start fov step max_range accuracy remission n r_1 .. r_n  m e_1 .. e_m
                x y theta  odom_x odom_y odom_theta  v omega  forward_safety side_safety turn_axis  stamp host logger_stamp

The first pose is the laser's, the second the robot's, both by dead reckoning; metres, radians, seconds.
"""

from __future__ import annotations

import io
import math
import re
import zlib
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from waychair.errors import NoScans, RecordingDamaged, RecordingUnknown
from waychair.recordings.stamps import UNIT_NAMES, stamp_from_text, unit_of_stamps
from waychair.recordings.text.line_order import ordered_frames
from waychair.types import Float32Array, FloatArray, Odometry, Pose2, Scan, SensorFrame, Twist

NO_RETURN = 80.0
"""Ranges from here on [m] mean "no return": the maximum range of a SICK LMS 2xx, whose overflow codes decode to 81.83 m
and 81.91 m."""

GZIP_MAGIC = b"\x1f\x8b"
_GZIP_CHUNK = 1 << 16
_PROGRESS_EVERY = 256  # lines
_FLASER_TAIL = 9  # fields after the ranges: two poses, the stamp, the host, the time of logging
_SAMPLE = 1 << 20  # bytes of the text that tell the unit of its stamps
_LARGE_STAMP = re.compile(r"\d{12,}(\.\d*)?")  # since 1970 in ms, us or ns
_OTHER_WORDS = frozenset(
    b"PARAM ODOM RLASER LASER1 LASER2 LASER3 LASER4 LASER5 RAWLASER1 RAWLASER2 RAWLASER3 RAWLASER4 RAWLASER5 "
    b"ROBOTLASER2 ROBOTLASER3 ROBOTLASER4 ROBOTLASER5 TRUEPOS NEFF SYNC SONAR BUMPER IMU NMEA-GGA NMEA-RMC "
    b"VERTEX2 EDGE2 MARKER POSITION".split()
)
"""First words of the other lines of a CARMEN log."""


class _LineDamaged(ValueError):
    """A line whose fields contradict each other; the message says what it holds, without a subject."""


@dataclass(frozen=True, slots=True)
class CarmenLog:
    """The scans of a log in file order, the message kind they come from, and warnings about the log."""

    frames: tuple[SensorFrame, ...]
    kind: str
    warnings: tuple[str, ...]


def read_carmen(
    data: bytes, where: str, *, of_robot: bool = False, progress: Callable[[float], None] | None = None
) -> CarmenLog:
    """Return every scan of a log, plain or gzipped, in file order, each with the odometry on its line.

    `of_robot` takes the robot's pose as odometry, otherwise the laser's. Stamps are the log's decimal text, exact to
    the nanosecond, and may step backwards. `where` names the log in messages; `progress` gets the part done, 0..1.

    Raises:
        RecordingUnknown: no line is of a CARMEN log.
        RecordingDamaged: no scan is complete.
        NoScans: the CARMEN log has neither FLASER nor ROBOTLASER1 lines, or its ranges are in another unit.
    """
    text, warnings = decompressed_text(data, where)
    frames: dict[bytes, list[SensorFrame]] = {word: [] for word in _READERS}
    others: Counter[bytes] = Counter()
    unit = _unit_of(text)
    if unit != "s":
        warnings.append(f"the stamps of {where} are read as {UNIT_NAMES[unit]}")
    damaged: list[int] = []
    why = ""
    lines = io.BytesIO(text)
    for number, line in enumerate(lines, start=1):
        if progress is not None and number % _PROGRESS_EVERY == 0:
            progress(lines.tell() / len(text))
        word, _, _ = line.rstrip().partition(b" ")
        if word not in _READERS:
            if word in _OTHER_WORDS:
                others[word] += 1
            continue
        try:
            frames[word].append(_READERS[word](line.split(), of_robot, unit))
        except (ValueError, IndexError) as error:
            why = why or (str(error) if isinstance(error, _LineDamaged) else "")
            damaged.append(number)
    if progress is not None:
        progress(1.0)
    # Some loggers write every scan in both forms: keep the more frequent one.
    kind = max(frames, key=lambda word: len(frames[word]))
    if not frames[kind]:
        raise _no_scans_error(where, others, damaged, why)
    _refuse_another_unit(text, frames[kind], where)
    ordered, order_warnings = ordered_frames(frames[kind])
    told = (*warnings, *_warnings(len(frames[kind]), damaged), *order_warnings)
    return CarmenLog(tuple(ordered), kind.decode(), told)


def is_carmen(line: bytes) -> bool:
    """Return whether a line begins with a word of CARMEN logs."""
    word = line.split(None, 1)[0] if line.strip() else b""
    return word in _READERS or word in _OTHER_WORDS


def _flaser(fields: Sequence[bytes], of_robot: bool, unit: str = "s") -> SensorFrame:
    """Read a FLASER line: beams over half a turn in front; an even number of beams leaves out the one at +90 degrees."""
    count = _count(fields[1])
    tail = fields[2 + count :]
    if count < 2 or len(tail) != _FLASER_TAIL:
        raise _LineDamaged(f"tells of {count} ranges, and holds {max(len(fields) - 2 - _FLASER_TAIL, 0)}")
    stamp_ns = _stamp(tail[6], unit)
    step = math.pi / (count - count % 2)
    scan = Scan(stamp_ns, _ranges(fields[2 : 2 + count], NO_RETURN), -math.pi / 2, step, range_max=NO_RETURN)
    return _frame(scan, tail[3:6] if of_robot else tail[:3], Twist())


def _count(field: bytes) -> int:
    if not field.lstrip(b"-").isdigit():
        raise _LineDamaged(f"tells of '{field.decode(errors='replace')}' ranges, which is no whole number")
    return int(field)


def _stamp(field: bytes, unit: str) -> int:
    try:
        return stamp_from_text(field.decode(), unit)
    except ValueError as error:
        raise _LineDamaged(f"holds a stamp that cannot be read: {error}") from error


def _robotlaser(fields: Sequence[bytes], of_robot: bool, unit: str = "s") -> SensorFrame:
    start, _, step, max_range = (_finite(field) for field in fields[2:6])
    count = int(fields[8])
    remissions = int(fields[9 + count])
    tail = fields[10 + count + remissions :]
    if count < 2 or remissions < 0 or len(tail) < 14 or step <= 0.0:
        raise ValueError("cut short")
    stamp_ns = _stamp(tail[11], unit)
    reach = min(NO_RETURN, max_range) if max_range > 0.0 else NO_RETURN
    scan = Scan(stamp_ns, _ranges(fields[9 : 9 + count], reach), start, step, range_max=reach)
    return _frame(scan, tail[3:6] if of_robot else tail[:3], Twist(_finite(tail[6]), _finite(tail[7])))


_READERS: dict[bytes, Callable[[Sequence[bytes], bool, str], SensorFrame]] = {
    b"FLASER": _flaser,
    b"ROBOTLASER1": _robotlaser,
}


def _frame(scan: Scan, pose: Sequence[bytes], twist: Twist) -> SensorFrame:
    odometry = Odometry(scan.stamp_ns, Pose2(*(_finite(field) for field in pose)), twist)
    return SensorFrame(scan.stamp_ns, scan=scan, wheels=(odometry,))


def _ranges(fields: Sequence[bytes], reach: float) -> Float32Array:
    """Return ranges (N,) float32 [m] by REP-117: +inf from `reach` on, nan where the log holds no distance."""
    ranges = np.array(fields, dtype=np.float32)
    with np.errstate(invalid="ignore"):
        ranges[ranges >= np.float32(reach)] = np.inf
        ranges[ranges <= 0.0] = np.nan
    return ranges


def _finite(field: bytes) -> float:
    try:
        value = float(field)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise _LineDamaged(f"holds '{field.decode(errors='replace')}' where a number belongs")
    return value


def decompressed_text(data: bytes, where: str) -> tuple[bytes, list[str]]:
    """Return the text of a file that may be gzipped, and a warning where only its beginning can be decompressed.

    Raises:
        RecordingDamaged: nothing can be decompressed.
    """
    if not data.startswith(GZIP_MAGIC):
        return data, []
    parts: list[bytes] = []
    at = 0
    try:
        while data.startswith(GZIP_MAGIC, at):  # a gzip file may hold several members
            member = zlib.decompressobj(wbits=31)
            while not member.eof and at < len(data):
                chunk = data[at : at + _GZIP_CHUNK]
                parts.append(member.decompress(chunk))
                at += len(chunk) - len(member.unused_data)
            if not member.eof:
                raise zlib.error("the file ends early")
    except zlib.error as error:
        text = b"".join(parts)
        if not text:
            message = f"{where} is a damaged gzip file ({error}): nothing can be read; copy it again from its source"
            raise RecordingDamaged(message) from error
        return text, [f"the gzip file is cut short or damaged ({error}): only the data before that was read"]
    return b"".join(parts), []


def _unit_of(text: bytes) -> str:
    """Return the unit of the stamps: seconds, unless they count from 1970 in a smaller one."""
    lines = [line for line in text[:_SAMPLE].splitlines() if line.split(b" ", 1)[0] in _READERS]
    stamps = [parts[0].decode(errors="replace") for line in lines if len(parts := line.rsplit(None, 3)[1:]) == 3]
    large = [stamp for stamp in stamps if _LARGE_STAMP.fullmatch(stamp)]
    return unit_of_stamps(large) if 2 * len(large) > len(stamps) else "s"


def _refuse_another_unit(text: bytes, frames: Sequence[SensorFrame], where: str) -> None:
    """Refuse a log whose ranges all lie beyond those that a CARMEN log can hold.

    Raises:
        NoScans: with the usual range.
    """
    if any(frame.scan is not None and not np.isinf(frame.scan.ranges).all() for frame in frames):
        return
    lines = [line.split() for line in text[:_SAMPLE].splitlines()]
    told = [_flaser_ranges(fields) for fields in lines if fields and fields[0] == b"FLASER"]
    usual = float(np.median(np.concatenate(told))) if told else math.inf
    if math.isfinite(usual):
        raise NoScans(
            f"the ranges of {where} are {usual:.0f} m in the median, and a CARMEN log holds metres up to {NO_RETURN:g} m: are they "
            "in millimetres or centimetres? Divide them by 1000 or 100"
        )


def _flaser_ranges(fields: Sequence[bytes]) -> FloatArray:
    try:
        return np.array(fields[2 : 2 + int(fields[1])], np.float64)
    except (ValueError, IndexError):
        return np.full(1, math.inf)


def _warnings(count: int, damaged: Sequence[int]) -> list[str]:
    warnings = []
    if damaged:
        lines = "line" if len(damaged) == 1 else "lines, the first of them line"
        warnings.append(f"{len(damaged)} damaged scan {lines} {damaged[0]}, left out; {count} scans were read")
    return warnings


def _no_scans_error(
    where: str, others: Counter[bytes], damaged: Sequence[int], why: str
) -> RecordingDamaged | NoScans:  # fmt: skip
    """Return the error for a log without a single readable scan."""
    if damaged:
        message = f"none of the {len(damaged)} scan lines of {where} is complete (the first, line {damaged[0]}, {why or 'is cut short'})"
        return RecordingDamaged(f"{message}; copy the file again from its source")
    if others:
        kinds = ", ".join(f"{word.decode()} ({count})" for word, count in sorted(others.items()))
        return NoScans(f"{where} holds no FLASER or ROBOTLASER1 lines but {kinds}; give a log with laser scans")
    return RecordingUnknown(
        f"{where} is neither a CARMEN or CoreSLAM log nor a ROS 1 or ROS 2 bag; give a .clf, .log, .dat, .bag, .mcap or "
        ".db3 file or the folder of a ROS 2 bag"
    )
