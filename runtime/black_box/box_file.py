"""The file format of the black box: requests to a chair and its ticks, readable up to the last written byte.

A file is a row of records, each `mark kind length crc payload`: after damage a reader looks for the mark `ab 57 42 01`,
the CRC-32 covers kind and payload, and the payload is MessagePack. A record with a missing end or a wrong byte is left
out and counted, and reading goes on at the next mark. The first record is a `LogHeader`, so that every file by itself names
its chair, configuration, calibration, board and software.

A ROS bag needs an index or whole chunks; this log must be readable after a power cut, and holds data for which ROS has
no messages. `black_box_bag` makes a bag of it.
"""

from __future__ import annotations

import struct
import zlib
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeAlias

import msgspec
import numpy as np

from waychair.errors import BoxError
from waychair.runtime.chair import ChairState
from waychair.runtime.drive_base import ChairMessage
from waychair.types import (
    ChairStatus,
    DriveMode,
    Goal,
    ImuSample,
    Json,
    Pose2,
    PressureSample,
    RgbdFrame,
    Scan,
    SentCommand,
    SonarReadings,
    Telemetry,
    Twist,
    WheelTicks,
)

FORMAT = 1
"""Version of the records; logs of other versions are refused."""

_MARK = b"\xabWB\x01"
_FRAME = struct.Struct("<4scII")
_LARGEST = 1 << 24  # bytes of a payload: three uncompressed pictures


@dataclass(frozen=True, slots=True)
class BoardIdentity:
    """A board's greeting: `layout_hash` is the hash of the messages on the wire."""

    firmware_version: int
    layout_hash: int
    protocol_version: int
    chair_id: str


@dataclass(frozen=True, slots=True)
class LogHeader:
    """The header of a log file. `session` names one run of the program, `configuration` is YAML with all values."""

    session: str
    wall_ns: int
    software: str
    configuration: str
    calibration: Json
    calibration_hash: str
    places: dict[str, Pose2] = field(default_factory=dict)
    board: BoardIdentity | None = None
    format: int = FORMAT


@dataclass(frozen=True, slots=True)
class LoggedHalt:
    """A halt: the id of its row in the table of stops, and its sentence with figures."""

    id: str
    text: str


@dataclass(frozen=True, slots=True)
class LoggedLocalisation:
    """The localiser's result at its last scan; see `Localisation`."""

    state: str
    health: float
    inliers: float
    map_from_odom: Pose2
    remaining: Pose2
    jumped: bool


@dataclass(frozen=True, slots=True)
class Tick:
    """One tick of a chair: its `ChairState` without the values that can be computed from the rest.

    `goal`: the end of the path, None without one. `asked` is the navigator's twist. `wall_ns` is of the wall clock.
    """

    stamp_ns: int
    wall_ns: int
    map_from_base: Pose2
    twist: Twist
    located: LoggedLocalisation | None
    mode: DriveMode
    reason: str
    share: float
    drops_goal: bool
    halt: LoggedHalt | None
    halts: tuple[LoggedHalt, ...]
    stage: str
    stage_reason: str
    asked: Twist
    plans: int
    goals: int
    goal: Pose2 | None
    command: Twist | None
    sent: SentCommand
    telemetry: Telemetry | None


@dataclass(frozen=True, slots=True)
class RiderRequest:
    """A request to the chair since the last tick: go (with its goals), confirm, cancel, stop or reset."""

    what: str
    goals: tuple[Goal, ...] = ()


@dataclass(frozen=True, slots=True)
class LostTicks:
    """A number of ticks that were not logged here, since the disk was too slow."""

    ticks: int


@dataclass(frozen=True, slots=True)
class LogEnd:
    """The end of a log that was closed in order; `problem` is the reason if it was closed early."""

    problem: str = ""


@dataclass(frozen=True, slots=True)
class StoredPicture:
    """A picture with depth: JPEG, and a 16-bit PNG in millimetres (0: none)."""

    stamp_ns: int
    image: bytes
    depth: bytes
    camera_matrix: tuple[float, ...]
    row_step: float


@dataclass(frozen=True, slots=True)
class Moment:
    """A tick, and the sensor messages since the one before."""

    tick: Tick
    heard: tuple[ChairMessage, ...] = ()


@dataclass(frozen=True, slots=True)
class CellTrace:
    """A part of the trace of the chair's behaviour cells; see `control/behaviours/trace.py`."""

    data: bytes


Record: TypeAlias = LogHeader | Moment | RiderRequest | LostTicks | LogEnd | CellTrace

_KINDS: dict[bytes, type[Any]] = {
    b"H": LogHeader,
    b"T": Moment,
    b"A": RiderRequest,
    b"L": LostTicks,
    b"E": LogEnd,
    b"C": CellTrace,
}
_LETTERS = {kind: letter for letter, kind in _KINDS.items()}
_HEARD = (WheelTicks, Scan, ImuSample, SonarReadings, PressureSample, ChairStatus, StoredPicture)


def encoded(record: Record) -> bytes:
    """Return a record's bytes in the file."""
    values: Any = record
    if isinstance(record, Moment):
        values = record.tick, [(type(message).__name__, message) for message in map(_stored, record.heard)]
    payload = _ENCODER.encode(values)
    letter = _LETTERS[type(record)]
    return _FRAME.pack(_MARK, letter, len(payload), zlib.crc32(payload, zlib.crc32(letter))) + payload


def tick_from_state(state: ChairState, wall_ns: int) -> Tick:
    """Return the logged form of a chair's state."""
    verdict, navigation, found = state.verdict, state.navigation, state.localisation
    path = navigation.path
    return Tick(
        stamp_ns=state.stamp_ns,
        wall_ns=wall_ns,
        map_from_base=state.map_from_base,
        twist=state.twist,
        located=None
        if found is None
        else LoggedLocalisation(
            state=found.state.value,
            health=found.health,
            inliers=found.inliers,
            map_from_odom=found.map_from_odom,
            remaining=found.remaining,
            jumped=found.jumped,
        ),
        mode=verdict.mode,
        reason=verdict.reason,
        share=verdict.share,
        drops_goal=verdict.drops_goal,
        halt=None if verdict.halt is None else LoggedHalt(verdict.halt.stop.id, verdict.halt.text),
        halts=tuple(LoggedHalt(halted.stop.id, halted.text) for halted in state.halts),
        stage=navigation.stage.value,
        stage_reason=navigation.reason,
        asked=navigation.twist,
        plans=navigation.plans,
        goals=navigation.goals,
        goal=None if path is None or not len(path.poses) else Pose2(*path.poses[-1].tolist()),
        command=state.command,
        sent=state.sent,
        telemetry=state.telemetry,
    )


@dataclass(frozen=True, slots=True)
class Log:
    """The readable records of one run: latest header, moments in order, and requests with the index of the next moment.

    `lost` ticks were not logged, `damaged` bytes are not readable; `end` None: the log was cut off.
    """

    head: LogHeader
    moments: tuple[Moment, ...]
    requests: tuple[tuple[int, RiderRequest], ...]
    lost: int
    damaged: int
    end: LogEnd | None

    @property
    def ticks(self) -> tuple[Tick, ...]:
        """The ticks without their messages."""
        return tuple(moment.tick for moment in self.moments)

    def messages(self) -> Iterator[ChairMessage]:
        """Yield the sensor messages in order."""
        for moment in self.moments:
            yield from moment.heard

    def between(self, begin_ns: int, end_ns: int) -> Log:
        """Return the part of the log in a span of the chair's clock."""
        kept = [k for k, moment in enumerate(self.moments) if begin_ns <= moment.tick.stamp_ns <= end_ns]
        if not kept:
            return replace(self, moments=(), requests=())
        first, last = kept[0], kept[-1]
        requests = tuple((k - first, each) for k, each in self.requests if first <= k <= last + 1)
        return replace(self, moments=self.moments[first : last + 1], requests=requests)


def read_log(files: Sequence[Path]) -> Log:
    """Read the files of one run, given in the order of writing.

    Raises:
        BoxError: they hold no readable header, or are of another version of the format.
    """
    heads, moments, requests, lost, damaged = list[LogHeader](), list[Moment](), list[tuple[int, RiderRequest]](), 0, 0
    end: LogEnd | None = None
    for file in files:
        for record in _records(file):
            end = None
            if isinstance(record, Moment):
                moments.append(record)
            elif isinstance(record, LogHeader):
                heads.append(record)
            elif isinstance(record, RiderRequest):
                requests.append((len(moments), record))
            elif isinstance(record, LostTicks):
                lost += record.ticks
            elif isinstance(record, LogEnd):
                end = record
            elif not isinstance(record, CellTrace):
                damaged += record
    if not heads:
        names = ", ".join(str(file) for file in files) or "no file"
        raise BoxError(f"{names} holds no readable record of a black box: it is not such a log, or it is damaged")
    return Log(head=heads[-1], moments=tuple(moments), requests=tuple(requests), lost=lost, damaged=damaged, end=end)


def read_cell_traces(files: Sequence[Path]) -> bytes:
    """Return the trace of behaviour cells in files of a black box, given in the order of writing; empty without one.

    Raises:
        BoxError: a file cannot be read, or is of another version of the format.
    """
    return b"".join(record.data for file in files for record in _records(file) if isinstance(record, CellTrace))


def read_head(file: Path) -> LogHeader | None:
    """Return the header of a file; None if it is not readable.

    Raises:
        BoxError: the file is of another version of the format.
    """
    return next((record for record in _records(file, 1 << 20) if isinstance(record, LogHeader)), None)


def read_end(file: Path) -> LogEnd | None:
    """Return the end record of a file; None if it was cut off."""
    last = deque(_records(file), maxlen=1)
    return last[0] if last and isinstance(last[0], LogEnd) else None


def _records(file: Path, most: int = -1) -> Iterator[Record | int]:
    """Yield the records of a file, or of its first `most` bytes."""
    try:
        with file.open("rb") as opened:
            data = opened.read(most)
    except OSError as error:
        raise BoxError(f"cannot read {file}: {error.strerror}; check the path and its permissions") from error
    return records(data)


def records(data: bytes) -> Iterator[Record | int]:
    """Yield readable records, and the number of bytes of each unreadable stretch between them.

    Raises:
        BoxError: the records are of another version of the format.
    """
    at = 0
    while at < len(data):
        record, end = _record_at(data, at)
        if record is not None:
            yield record
        if end == at:
            found = data.find(_MARK, at + 1)
            end = len(data) if found < 0 else found
            yield end - at
        at = end


def _record_at(data: bytes, at: int) -> tuple[Record | None, int]:
    """Return the record at an offset and its end; None for an unknown kind; the end is `at` if there is no record."""
    if len(data) - at < _FRAME.size:
        return None, at
    mark, letter, length, crc = _FRAME.unpack_from(data, at)
    end = at + _FRAME.size + length
    if mark != _MARK or length > _LARGEST or end > len(data):
        return None, at
    payload = memoryview(data)[at + _FRAME.size : end]
    if zlib.crc32(payload, zlib.crc32(letter)) != crc:
        return None, at
    if letter not in _KINDS:
        return None, end
    if letter == b"H" and _FORMAT.decode(payload).format != FORMAT:
        raise BoxError(
            f"the log has format {_FORMAT.decode(payload).format}, and this version reads format {FORMAT}: "
            "read it with the version of waychair that wrote it"
        )
    try:
        return _decoded(letter, payload), end
    except (msgspec.MsgspecError, ValueError, TypeError, KeyError, IndexError):
        return None, at


def _decoded(letter: bytes, payload: memoryview) -> Record:
    record: Record
    if _KINDS[letter] is not Moment:
        record = _DECODERS[letter].decode(payload)
        return record
    tick, heard = _MOMENTS.decode(payload)
    decoded = (_HEARD_DECODERS[kind].decode(values) for kind, values in heard if kind in _HEARD_DECODERS)
    return Moment(tick, tuple(_restored(message) for message in decoded))


def _stored(message: ChairMessage | StoredPicture) -> ChairMessage | StoredPicture:
    if not isinstance(message, RgbdFrame):
        return message
    import cv2

    colour = message.image[..., ::-1] if message.image.ndim == 3 else message.image
    millimetres = np.clip(np.rint(1000.0 * np.nan_to_num(message.depth, posinf=0.0, neginf=0.0)), 0, 65535)
    _, image = cv2.imencode(".jpg", np.ascontiguousarray(colour))
    _, depth = cv2.imencode(".png", millimetres.astype(np.uint16), [cv2.IMWRITE_PNG_COMPRESSION, 1])
    matrix = tuple(float(value) for value in message.camera_matrix.ravel())
    return StoredPicture(message.stamp_ns, image.tobytes(), depth.tobytes(), matrix, message.row_step)


def _restored(message: Any) -> ChairMessage:
    if not isinstance(message, StoredPicture):
        heard: ChairMessage = message
        return heard
    import cv2

    image = cv2.imdecode(np.frombuffer(message.image, np.uint8), cv2.IMREAD_UNCHANGED)
    depth = cv2.imdecode(np.frombuffer(message.depth, np.uint8), cv2.IMREAD_UNCHANGED)
    if image is None or depth is None:
        raise ValueError("a picture is damaged")
    colour = np.ascontiguousarray(image[..., ::-1] if image.ndim == 3 else image, np.uint8)
    metres = np.where(depth > 0, depth.astype(np.float32) / np.float32(1000.0), np.float32(np.nan))
    return RgbdFrame(message.stamp_ns, colour, metres, np.array(message.camera_matrix).reshape(3, 3), message.row_step)


def _plain(value: Any) -> Any:
    """Encode arrays as dtype, shape and bytes, and numbers of numpy as Python's."""
    if isinstance(value, np.ndarray):
        return value.dtype.str, value.shape, value.tobytes()
    if isinstance(value, np.generic):
        return value.item()
    raise NotImplementedError(f"a {type(value).__name__} cannot be logged")


def _array(_: type, value: Any) -> Any:
    dtype, shape, data = value
    return np.frombuffer(data, dtype).reshape(shape)


@dataclass(frozen=True, slots=True)
class _AnyHeader:
    format: int = 0


_ENCODER = msgspec.msgpack.Encoder(enc_hook=_plain)
_DECODERS = {letter: msgspec.msgpack.Decoder(kind) for letter, kind in _KINDS.items() if kind is not Moment}
_FORMAT = msgspec.msgpack.Decoder(_AnyHeader)
_HEARD_DECODERS = {kind.__name__: msgspec.msgpack.Decoder(kind, dec_hook=_array) for kind in _HEARD}
_MOMENTS = msgspec.msgpack.Decoder(tuple[Tick, list[tuple[str, msgspec.Raw]]])
