"""The folder of a black box: a ring of segments, whose oldest are dropped, and permanent parts.

    BOX/lock                      held by the writing program
    BOX/ring/00000042.log         one segment: see `black_box_file`
    BOX/parts/0007-obstacle/      part.json, configuration.yaml, calibration.json and the segments around an event

Segments are appended to, not mapped into memory: on a full disk a mapped file raises SIGBUS, which would kill the
chair's program, while appending returns an error. Written data survive the program's death at once, and a power cut
from the next `fdatasync` on. A part holds hard links to its segments, so that it costs no time, and no disk space until
the ring drops them; on file systems without hard links it holds copies.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import math
import os
import shutil
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Self

import msgspec

from waychair.calibration.calibration_file import SCHEMA
from waychair.errors import BoxError
from waychair.files import sync_folder, write_json, write_text
from waychair.runtime.black_box.box_events import OTHER_EVENTS, BlackBoxEvent, Gravity
from waychair.runtime.black_box.box_file import Log, LogEnd, LogHeader, Tick, encoded, read_end, read_head, read_log

RING, PARTS, LOCK = "ring", "parts", "lock"
_ABOUT, _READ = "part.json", "read"
LEAST_FREE = 64 << 20
"""Logging ends when fewer bytes are free, so that the rest of the computer can go on."""


@dataclass(frozen=True, slots=True)
class BoxLimits:
    """Limits of a box: segments in the ring, their bytes in total, and parts."""

    segments: int
    ring_bytes: int
    parts: int


@dataclass(slots=True)
class Segment:
    """A file of the ring and the span of the chair's clock that it holds, None while it holds no tick."""

    path: Path
    begin_ns: int | None = None
    end_ns: int | None = None
    size: int = 0

    def overlaps(self, begin_ns: int, end_ns: int) -> bool:
        """Whether the segment holds a tick of this span."""
        return (
            self.begin_ns is not None
            and self.end_ns is not None
            and self.begin_ns <= end_ns
            and self.end_ns >= begin_ns
        )


class Ring:
    """The segments of a box, written by one run of the program. Every method raises OSError when the disk fails."""

    def __init__(self, folder: Path, bounds: BoxLimits) -> None:
        """`folder` is the folder of the box."""
        self._folder, self._bounds = folder / RING, bounds
        self._folder.mkdir(parents=True, exist_ok=True)
        self._old = [Segment(path, size=path.stat().st_size) for path in segment_files(folder)]
        self.segments: list[Segment] = []  # of this run
        self._file: int | None = None
        self._waiting = bytearray()

    @property
    def full_segment(self) -> bool:
        """Whether the present segment has reached its share of the ring's bytes."""
        share = max(self._bounds.ring_bytes // self._bounds.segments, 1 << 16)
        return bool(self.segments) and self.segments[-1].size + len(self._waiting) >= share

    def begin(self, head: LogHeader) -> None:
        """Begin a new segment, and drop the oldest ones beyond the bounds.

        Raises:
            OSError: the disk is full.
        """
        if shutil.disk_usage(self._folder).free < LEAST_FREE:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        self.close()
        every = [*self._old, *self.segments]
        number = 1 + max((int(segment.path.stem) for segment in every), default=0)
        path = self._folder / f"{number:08d}.log"
        self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND | os.O_CLOEXEC, 0o644)
        self.segments.append(Segment(path))
        self._drop_oldest()
        self._waiting += encoded(head)
        self.sync()
        sync_folder(self._folder)

    def append(self, data: bytes, stamp_ns: int | None = None) -> None:
        """Append a record, with its tick's stamp if it has one; the next `write` writes it."""
        self._waiting += data
        segment = self.segments[-1]
        if stamp_ns is not None:
            segment.begin_ns = stamp_ns if segment.begin_ns is None else min(segment.begin_ns, stamp_ns)
            segment.end_ns = stamp_ns if segment.end_ns is None else max(segment.end_ns, stamp_ns)

    def write(self) -> None:
        """Pass the waiting bytes to the system: from then on they survive the program's death."""
        if self._file is None:
            return
        while self._waiting:
            written = os.write(self._file, self._waiting)
            self.segments[-1].size += written
            del self._waiting[:written]

    def sync(self) -> None:
        """Sync to the disk: from then on the log survives a power cut, if the disk honours it."""
        self.write()
        if self._file is not None:
            os.fdatasync(self._file)

    def close(self) -> None:
        """Close the present segment, if there is one."""
        if self._file is not None:
            self.sync()
            os.close(self._file)
            self._file = None

    def give_up(self, problem: str) -> None:
        """After a disk error, drop the oldest segment to make room, then write the waiting bytes and the reason."""
        if self._file is None:
            return
        with contextlib.suppress(OSError):
            every = [*self._old, *self.segments[:-1]]
            if every:
                every[0].path.unlink()
            self._waiting += encoded(LogEnd(problem))  # after the half-written record
            self.sync()
        with contextlib.suppress(OSError):
            os.close(self._file)
        self._file = None

    def _drop_oldest(self) -> None:
        while True:
            every = [*self._old, *self.segments]
            size = sum(segment.size for segment in every)
            if len(every) <= self._bounds.segments and size <= self._bounds.ring_bytes * (
                1 - 1 / self._bounds.segments
            ):
                return
            if len(every) == 1:
                return
            every[0].path.unlink(missing_ok=True)
            (self._old or self.segments).pop(0)


@dataclass(frozen=True, slots=True)
class LogPart:
    """A kept part of the log: its events in order, and its time span."""

    folder: Path
    session: str
    events: tuple[BlackBoxEvent, ...]
    begin_ns: int
    end_ns: int
    software: str = ""
    calibration_hash: str = ""
    board: dict[str, Any] = field(default_factory=dict)
    closed: bool = False

    @property
    def number(self) -> int:
        """The part's number, from 1."""
        return int(self.folder.name.split("-")[0])

    @property
    def read(self) -> bool:
        """Whether the part has been explained to somebody."""
        return (self.folder / _READ).exists()

    @property
    def gravity(self) -> Gravity:
        """The gravity of the gravest event."""
        return max((event.gravity for event in self.events), key=list(Gravity).index)

    def mark_read(self) -> None:
        """Mark the part as read; ignored if the box cannot be written to."""
        with contextlib.suppress(OSError):
            (self.folder / _READ).touch()

    def log(self) -> Log:
        """Return the part's log.

        Raises:
            BoxError: no record of it is readable.
        """
        return read_log(sorted(self.folder.glob("*.log"))).between(self.begin_ns, self.end_ns)


class PartStore:
    """The kept parts of a box, written by one run of the program. Every method raises OSError when the disk fails."""

    def __init__(self, folder: Path, bounds: BoxLimits) -> None:
        self._box, self._folder, self._bounds = folder, folder / PARTS, bounds
        self._folder.mkdir(parents=True, exist_ok=True)
        self._written: set[Path] = set()  # folders of this run's open parts

    def open(
        self, event: BlackBoxEvent, head: LogHeader, segments: Sequence[Segment], span_ns: tuple[int, int]
    ) -> LogPart:
        """Open a part with the segments of a span around an event, and drop parts beyond the bounds."""
        part = LogPart(
            folder=self._folder / f"{self._next_number():04d}-{event.id}",
            session=head.session,
            events=(event,),
            begin_ns=span_ns[0],
            end_ns=span_ns[1],
            software=head.software,
            calibration_hash=head.calibration_hash,
            board={} if head.board is None else msgspec.to_builtins(head.board),
        )
        part.folder.mkdir()
        self._written.add(part.folder)
        write_text(part.folder / "configuration.yaml", head.configuration)
        known = {"schema": SCHEMA, **head.calibration, "hash": head.calibration_hash}
        write_json(part.folder / "calibration.json", known)
        self.keep(part, segments)
        self.save(part)
        self._drop_least()
        return part

    def keep(self, part: LogPart, segments: Sequence[Segment]) -> None:
        """Link, or copy, the part's segments that it does not hold yet."""
        for segment in segments:
            kept = part.folder / segment.path.name
            if not segment.overlaps(part.begin_ns, part.end_ns) or not segment.path.exists():
                continue
            if kept.exists() and (kept.samefile(segment.path) or kept.stat().st_size == segment.path.stat().st_size):
                continue
            try:
                os.link(segment.path, kept)
            except OSError:
                shutil.copyfile(segment.path, kept)

    def save(self, part: LogPart) -> None:
        """Write part.json."""
        write_json(part.folder / _ABOUT, msgspec.to_builtins(part, enc_hook=lambda folder: folder.name))
        with (part.folder / _ABOUT).open("rb") as file:
            os.fsync(file.fileno())
        sync_folder(part.folder)
        sync_folder(self._folder)

    def close(self, part: LogPart) -> None:
        """Mark a part as complete."""
        self.save(replace(part, closed=True))
        self._written.discard(part.folder)
        self._drop_least()

    def _next_number(self) -> int:
        """Return the next free number over all folders, also unreadable ones that a killed program has left."""
        begun = (path.name.split("-")[0] for path in self._folder.iterdir())
        return max((int(number) for number in begun if number.isdecimal()), default=0) + 1

    def _drop_least(self) -> None:
        """Drop parts beyond the bounds: pauses before others, among these unread before read, then the oldest.

        The newest part always stays. Open parts are dropped when they are closed.
        """
        kept = parts_of(self._box)
        order = sorted(kept[:-1], key=lambda part: (part.gravity is not Gravity.PAUSE, part.read, part.number))
        for part in order[: max(0, len(kept) - self._bounds.parts)]:
            if part.folder not in self._written:
                shutil.rmtree(part.folder, ignore_errors=True)


class BoxLock:
    """The exclusive lock of a box, held until the block or the program ends."""

    def __init__(self, folder: Path) -> None:
        """
        Raises:
            BoxError: another program holds the lock, or the folder cannot be written to.
        """
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._file = os.open(folder / LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        except OSError as error:
            raise BoxError(f"cannot write the black box {folder}: {error.strerror}; choose another folder") from error
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            os.close(self._file)
            raise BoxError(f"another program writes the black box {folder}: give each chair its own folder") from error

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        os.close(self._file)


def is_written(folder: Path) -> bool:
    """Whether a program is writing to this box."""
    try:
        with (folder / LOCK).open("rb") as file:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return False
    return False


def last_written_s(folder: Path) -> float:
    """Return the time of the last write to a box, by the wall clock [s]; 0 if there is no box."""
    with contextlib.suppress(OSError):
        return max((file.stat().st_mtime for file in segment_files(folder)), default=0.0)
    return 0.0


def segment_files(folder: Path) -> list[Path]:
    """Return the ring's segment files, oldest first."""
    return sorted(path for path in (folder / RING).glob("*.log") if path.stem.isdecimal())


def parts_of(folder: Path) -> list[LogPart]:
    """Return the readable parts of a box, oldest first."""
    found = []
    for path in sorted((folder / PARTS).glob("*/" + _ABOUT)):
        with contextlib.suppress(OSError, msgspec.MsgspecError, ValueError):
            values = msgspec.json.decode(path.read_bytes())
            found.append(msgspec.convert({**values, "folder": str(path.parent)}, LogPart, dec_hook=_path))
    return sorted((part for part in found if part.events), key=lambda part: part.number)


def unfinished_log(folder: Path, before_s: float) -> tuple[BlackBoxEvent, Log, list[Segment]] | None:
    """Return the end of a killed run as an event, its last log and segments; None if the last run ended in order."""
    files = [file for file in segment_files(folder) if _is_readable(file)]
    if not files or read_end(files[-1]) is not None:
        return None
    session, segments = "", list[Segment]()
    ended: Tick | None = None
    for file in reversed(files):
        log = read_log([file])
        session = session or log.head.session
        if log.head.session != session:
            break
        if log.moments:
            stamps = [tick.stamp_ns for tick in log.ticks]
            segments.insert(0, Segment(file, min(stamps), max(stamps), file.stat().st_size))
            ended = ended or log.ticks[-1]
            if ended.stamp_ns - min(stamps) > before_s * 1e9:
                break
    if ended is None:
        return None
    sentence, remedy = OTHER_EVENTS["program_ended"]
    event = BlackBoxEvent("program_ended", f"{sentence}: {remedy}", Gravity.FAULT, ended.stamp_ns, ended.wall_ns)
    return event, read_log([segment.path for segment in segments]), segments


def _is_readable(file: Path) -> bool:
    try:
        return read_head(file) is not None
    except BoxError:
        return False


def append_end(folder: Path, problem: str) -> None:
    """Append an end record to the ring, since its last run has been kept as a part."""
    with segment_files(folder)[-1].open("ab") as file:
        file.write(encoded(LogEnd(problem)))


def with_event(part: LogPart, event: BlackBoxEvent, after_ns: int) -> LogPart:
    """Return the part with a further event, its span extended to `after_ns` after it."""
    return replace(part, events=(*part.events, event), end_ns=max(part.end_ns, event.stamp_ns + after_ns))


def segments_needed(seconds: float, segment_s: float) -> int:
    """Return the number of segments that always hold the last `seconds`."""
    return math.ceil(seconds / segment_s) + 1


def _path(kind: type, value: Any) -> Any:
    if kind is Path:
        return Path(value)
    raise NotImplementedError(kind)
