"""The trace of a behaviour network: every port at every innervation in a compact file, readable up to its last byte.

A file is a row of records `mark letter length crc payload`, as in the black box: after a kill a reader takes all whole
records. The first is a `TraceHeader` with the wiring; then comes one record for each innervation. Most hold only the
changes from the one before; every hundredth, a key record, holds all ports, so that reading goes on after damage. A
header may come again: before a key record of the same run (in the black box each file begins so), or where the network
began anew; then the last run is read.

A value in a trace is plain: numbers, texts, lists, maps of fields. DI of a cell is the EO that its link reads.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import msgspec
import numpy as np

from waychair.control.behaviours.cell import Reading
from waychair.control.behaviours.cell_network import Wiring
from waychair.control.behaviours.runtime import Innervation, PortState
from waychair.errors import OutputError, TraceError
from waychair.files import os_error_text, read_bytes

FORMAT = 1
"""Version of the records; traces of other versions are refused."""

KEY_EVERY = 100
"""Innervations from one key record to the next: 5 s of a chair's ticks are lost by damage at most."""

_MARK = b"\xabBN\x01"
FRAME = struct.Struct("<4scII")
"""Mark, letter, length of the payload and CRC-32 of letter and payload, before each payload."""

_LARGEST = 1 << 24  # bytes of a payload


@dataclass(frozen=True, slots=True)
class TraceHeader:
    """The wiring of a traced network: its preset and the preset's settings, its identity, its lines and names.

    `after`: innervations of the run before this record.
    """

    preset: str
    settings: dict[str, Any]
    software: str
    identity: str
    wiring: tuple[str, ...]
    nodes: tuple[str, ...]
    sensors: tuple[str, ...]
    after: int = 0
    format: int = FORMAT


@dataclass(frozen=True, slots=True)
class _Record:
    """An innervation in the file. None: as in the record before.

    heard: sensor, value, own stamp or None. ran: 54 * node + code of IS, EB, IB, RS, AB. active: nodes with AB = 1.
    effects: the EO that changed and its age (None: never written), by node. rewritten: nodes that wrote the EO they had. faults: all, by node.
    """

    stamp_ns: int
    heard: list[tuple[int, Any, int | None]]
    ran: list[int] | None
    active: list[int] | None
    effects: dict[int, tuple[Any, int | None]]
    rewritten: list[int] | None
    actions: dict[str, Any]
    late: list[int]
    faults: dict[int, str] | None


@dataclass(frozen=True, slots=True)
class TracedInnervation:
    """An innervation as read: as `Innervation`, with plain values, and the sensors' values and stamps."""

    stamp_ns: int
    heard: Mapping[str, tuple[Any, int | None]]
    ran: tuple[str, ...]
    ports: Mapping[str, PortState]
    actions: Mapping[str, Any]
    late: tuple[str, ...]
    payload: bytes = b""


@dataclass(frozen=True, slots=True)
class Trace:
    """A trace as read. `damaged` bytes are not readable; `gaps`: innervations before which records are missing."""

    header: TraceHeader
    innervations: tuple[TracedInnervation, ...]
    damaged: int = 0
    gaps: tuple[int, ...] = ()


class TraceEncoder:
    """Turns the innervations of one run into the bytes of a trace."""

    def __init__(
        self, wiring: Wiring, preset: str = "", settings: Mapping[str, Any] | None = None, after: int = 0
    ) -> None:
        """`after`: innervations of the run that the trace lacks."""
        self._wiring = wiring
        self._places = {name: k for k, name in enumerate(wiring.nodes)}
        self._sensors = {name: k for k, name in enumerate(wiring.sensors)}
        self._cells = [name for name in wiring.nodes if wiring.outputs[name] == name]
        self._preset, self._settings = preset, dict(settings or {})
        self.count = after
        """Innervations of the run up to the next one."""
        self._stamps: dict[str, int | None] = dict.fromkeys(self._cells)
        self._written: dict[str, bytes] = {}
        self._before: _Record | None = None

    def header(self) -> bytes:
        """Return the first record."""
        from waychair import __version__

        wiring = self._wiring
        header = TraceHeader(
            preset=self._preset,
            settings=self._settings,
            software=__version__,
            identity=wiring.identity(),
            wiring=tuple(wiring.lines()),
            nodes=tuple(wiring.nodes),
            sensors=tuple(wiring.sensors),
            after=self.count,
        )
        return _framed(b"H", ENCODER.encode(header))

    def innervation(self, done: Innervation, heard: Mapping[str, Any], key: bool | None = None) -> bytes:
        """Return the record of an innervation that heard these sensor values; a `key` record holds all ports."""
        is_key = self._before is None or self.count % KEY_EVERY == 0 if key is None else key
        self.count += 1
        places, ports = self._places, done.ports
        effects: dict[int, tuple[Any, int | None]] = {}
        rewritten: list[int] = []
        for name in self._cells:
            port = ports[name]
            if port.eo_stamp_ns == self._stamps[name] and not is_key:
                continue
            self._stamps[name] = port.eo_stamp_ns
            value = ENCODER.encode(port.eo)
            if value != self._written.get(name) or is_key:
                age_ns = None if port.eo_stamp_ns is None else done.stamp_ns - port.eo_stamp_ns
                effects[places[name]] = msgspec.Raw(value), age_ns
                self._written[name] = value
            else:
                rewritten.append(places[name])
        whole = _Record(
            stamp_ns=done.stamp_ns,
            heard=[
                (self._sensors[name], *((value.value, value.stamp_ns) if isinstance(value, Reading) else (value, None)))
                for name, value in heard.items()
            ],
            ran=[54 * places[name] + _code(ports[name]) for name in done.ran],
            active=[places[name] for name, port in ports.items() if port.ab],
            effects=effects,
            rewritten=rewritten,
            actions=dict(done.actions),
            late=[places[name] for name in done.late],
            faults={places[name]: port.fault for name, port in ports.items() if port.fault},
        )
        before, self._before = self._before, whole
        if is_key or before is None:
            return _framed(b"K", ENCODER.encode(whole))
        same: dict[str, Any] = {name: None for name in _REPEATED if getattr(whole, name) == getattr(before, name)}
        return _framed(b"D", ENCODER.encode(replace(whole, **same)))


_REPEATED = ("ran", "active", "rewritten", "faults")
"""Fields of a record that are left out where they are as before."""


class TraceWriter:
    """Writes a trace into a file, each innervation at once, so that it survives the end of the program."""

    def __init__(
        self, path: Path, wiring: Wiring, preset: str = "", settings: Mapping[str, Any] | None = None, after: int = 0
    ) -> None:
        """`after`: innervations of the run that the trace lacks.

        Raises:
            OutputError: the file cannot be written.
        """
        self._path, self._about = path, (wiring, preset, settings)
        self._encoder = TraceEncoder(*self._about, after)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = path.open("wb", buffering=0)
        except OSError as error:
            raise OutputError(f"cannot write {path}: {os_error_text(error)}") from error
        self._write(self._encoder.header())

    def write(self, done: Innervation, heard: Mapping[str, Any]) -> None:
        """Write an innervation that heard these sensor values; raises as the constructor."""
        self._write(self._encoder.innervation(done, heard))

    def begin_anew(self) -> None:
        """Note that the network begins anew, without memory; raises as the constructor."""
        self._encoder = TraceEncoder(*self._about)
        self._write(self._encoder.header())

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def _write(self, data: bytes) -> None:
        try:
            written = self._file.write(data)
        except OSError as error:
            raise OutputError(f"cannot write {self._path}: {os_error_text(error)}") from error
        if written != len(data):
            raise OutputError(f"cannot write {self._path}: the disk took a part only; free disk space")


def read_trace(path: Path) -> Trace:
    """Read a trace.

    Raises:
        TraceError: the file cannot be read, holds no header, or is of another version of the format.
    """
    return trace_from_bytes(read_bytes(path, TraceError), str(path))


def trace_from_bytes(data: bytes, where: str = "the trace") -> Trace:
    """Read a trace from its bytes; raises as `read_trace`, naming `where`."""
    header: TraceHeader | None = None
    decoder: _Decoder | None = None
    found, damaged, gaps = list[TracedInnervation](), 0, list[int]()
    for record in _frames(data):
        if isinstance(record, int):
            damaged += record
            if decoder is not None:
                decoder.lose()
            continue
        letter, payload = record
        if letter == b"H":
            again = _header(payload, where)
            if header is None or decoder is None or again.after == 0 or again.identity != header.identity:
                header, decoder = again, _Decoder(again)
                found, gaps = [], []
            elif again.after != header.after + len(found):
                decoder.lose()
        elif letter in (b"K", b"D") and decoder is not None:
            lost = decoder.lost
            each = decoder.innervation(letter, payload)
            if each is not None:
                if lost:
                    gaps.append(len(found))
                found.append(each)
    if header is None:
        raise TraceError(f"{where} holds no trace of a behaviour network: give a file that a trace was written to")
    return Trace(header, tuple(found), damaged, tuple(gaps))


def _header(payload: bytes, where: str) -> TraceHeader:
    try:
        version = _FORMAT.decode(payload).format
        if version == FORMAT:
            return _HEADERS.decode(payload)
    except msgspec.MsgspecError as error:
        raise TraceError(f"{where} has a header that cannot be read: {error}; it was altered") from error
    raise TraceError(f"{where} has format {version}, and this version reads format {FORMAT}: use the one that wrote it")


class _Decoder:
    """Puts the records of a trace together again."""

    def __init__(self, header: TraceHeader) -> None:
        self._nodes, self._sensors = header.nodes, header.sensors
        self._effects: dict[str, tuple[Any, int | None]] = dict.fromkeys(header.nodes, (None, None))
        self._before: _Record | None = None
        self.lost = header.after > 0
        """Whether records are missing since the last whole one."""
        self._shown = _outputs_from_lines(header.wiring)

    def lose(self) -> None:
        """Note that records are missing: changes cannot be read before the next key record."""
        self.lost, self._before = True, None

    def innervation(self, letter: bytes, payload: bytes) -> TracedInnervation | None:
        """Return the next innervation; None if it needs a record that is missing."""
        record = _RECORDS.decode(payload)
        before = self._before
        if letter == b"D":
            if before is None:
                return None
            kept: dict[str, Any] = {name: getattr(before, name) for name in _REPEATED if getattr(record, name) is None}
            record = replace(record, **kept)
        self._before, self.lost = record, False
        stamp_ns, nodes = record.stamp_ns, self._nodes
        for place, (value, age_ns) in record.effects.items():
            self._effects[nodes[place]] = value, None if age_ns is None else stamp_ns - age_ns
        for place in record.rewritten or ():
            self._effects[nodes[place]] = self._effects[nodes[place]][0], stamp_ns
        codes = {nodes[each // 54]: each % 54 for each in record.ran or ()}
        active, faults = {nodes[place] for place in record.active or ()}, record.faults or {}
        said = {nodes[place]: text for place, text in faults.items()}
        ports = {name: _port(codes.get(name), name in active, self._effect(name), said.get(name, "")) for name in nodes}
        return TracedInnervation(
            stamp_ns=stamp_ns,
            heard={self._sensors[place]: (value, own_ns) for place, value, own_ns in record.heard},
            ran=tuple(codes),
            ports=ports,
            actions=record.actions,
            late=tuple(nodes[place] for place in record.late),
            payload=letter + payload,
        )

    def _effect(self, name: str) -> tuple[Any, int | None]:
        shown = self._shown.get(name, name)
        return (None, None) if shown is None else self._effects[shown]


def _outputs_from_lines(lines: tuple[str, ...]) -> dict[str, str | None]:
    """Return the cell whose EO each network shows."""
    shown: dict[str, str | None] = {}
    network = ""
    for line in lines:
        if line.startswith("network "):
            network = line.removeprefix("network ")
            shown[network] = None
        elif line.startswith("cell "):
            network = ""
        elif network and line.startswith("  EO: that of "):
            shown[network] = line.removeprefix("  EO: that of ")
    resolved = {}
    for name, output in shown.items():
        while output in shown:
            output = shown[output]
        resolved[name] = output
    return resolved


def _code(port: PortState) -> int:
    """Return EB, IB, RS (each None, 0 or 1) and AB as a number below 54."""
    eb, ib, rs = (0 if value is None else 1 + value for value in (port.eb, port.ib, port.rs))
    return ((eb * 3 + ib) * 3 + rs) * 2 + port.ab


def _port(code: int | None, ab: bool, effect: tuple[Any, int | None], fault: str) -> PortState:
    if code is None:
        return PortState(False, None, None, None, ab, *effect, fault)
    eb, ib, rs = (None if part == 0 else part == 2 for part in (code // 18, code // 6 % 3, code // 2 % 3))
    return PortState(True, eb, ib, rs, ab, *effect, fault)


def _framed(letter: bytes, payload: bytes) -> bytes:
    return FRAME.pack(_MARK, letter, len(payload), zlib.crc32(payload, zlib.crc32(letter))) + payload


def _frames(data: bytes) -> Iterator[tuple[bytes, bytes] | int]:
    """Yield letter and payload of each whole record, and the number of bytes of each stretch without one."""
    at = 0
    while at < len(data):
        whole = _frame_at(data, at)
        if whole is not None:
            yield whole
            at += FRAME.size + len(whole[1])
            continue
        found = data.find(_MARK, at + 1)
        end = len(data) if found < 0 else found
        yield end - at
        at = end


def _frame_at(data: bytes, at: int) -> tuple[bytes, bytes] | None:
    if len(data) - at < FRAME.size:
        return None
    mark, letter, length, crc = FRAME.unpack_from(data, at)
    payload = data[at + FRAME.size : at + FRAME.size + length]
    if mark != _MARK or length > _LARGEST or len(payload) < length:
        return None
    return (letter, payload) if zlib.crc32(payload, zlib.crc32(letter)) == crc else None


def value_text(value: Any, most: int = 60) -> str:
    """Return a plain value in a few words, cut after `most` characters."""
    text = _words(value)
    return text if len(text) <= most else text[: most - 1] + "…"


def _words(value: Any) -> str:
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "1" if value else "0"
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, bytes):
        return f"{len(value)} bytes"
    if isinstance(value, Mapping):
        return ", ".join(f"{key} {_words(each)}" for key, each in value.items())
    if isinstance(value, list | tuple):
        return "[" + " ".join(_words(each) for each in value) + "]"
    return str(value)


def _plain(value: Any) -> Any:
    """Encode arrays as dtype, shape and bytes, and numbers of numpy as Python's."""
    if isinstance(value, np.ndarray):
        return value.dtype.str, value.shape, np.ascontiguousarray(value).tobytes()
    if isinstance(value, np.generic):
        return value.item()
    raise NotImplementedError(f"a {type(value).__name__} cannot be traced: give a dataclass of plain values")


@dataclass(frozen=True, slots=True)
class _Version:
    format: int = 0


ENCODER = msgspec.msgpack.Encoder(enc_hook=_plain)
_FORMAT, _HEADERS = msgspec.msgpack.Decoder(_Version), msgspec.msgpack.Decoder(TraceHeader)
_RECORDS = msgspec.msgpack.Decoder(_Record)
