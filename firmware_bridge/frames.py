"""Frames on a serial line to a board: type, sequence number, payload and CRC-16 in COBS, between zero bytes.

A frame is `COBS(type u8, sequence u16, payload, crc u16) 00`, little endian: COBS by Cheshire and Baker (1999), CRC-16/IBM-3740
(polynomial 0x1021, start 0xFFFF, check value 0x29B1) over everything before it. `firmware/frame.c` is the same in C.
"""

from __future__ import annotations

import binascii
import struct
import zlib
from collections.abc import Mapping
from dataclasses import dataclass

_HEAD = struct.Struct("<BH")
_CRC = struct.Struct("<H")


def struct_of_layout(layout: str, formats: Mapping[str, str]) -> struct.Struct:
    """Return the struct of a payload whose layout names each field and its type, as "flags u8, stamp_us u32"."""
    return struct.Struct("<" + "".join(formats[field.split()[1]] for field in layout.split(",") if field))


def layout_hash(layouts: Mapping[int, str]) -> int:
    """Return the CRC-32 of a table of messages, their layouts by type."""
    return zlib.crc32(";".join(f"{number}:{layouts[number]}" for number in sorted(layouts)).encode())


@dataclass(frozen=True, slots=True)
class Frame:
    """A frame's type (0 to 255), sequence number (modulo 2^16) and payload."""

    type: int
    sequence: int
    payload: bytes


def encode_frame(frame: Frame) -> bytes:
    """Return a frame for the wire, up to the closing zero; its payload is shorter than 249 bytes."""
    plain = _HEAD.pack(frame.type, frame.sequence & 0xFFFF) + frame.payload
    return _stuff(plain + _CRC.pack(crc16(plain))) + b"\0"


def crc16(data: bytes) -> int:
    """Return the CRC-16/IBM-3740, also known as CCITT with start value 0xFFFF."""
    return binascii.crc_hqx(data, 0xFFFF)


class FrameDecoder:
    """Decodes frames from bytes in any pieces, with bounded memory; it resynchronises at every zero byte.

    `bad` counts the byte runs between two zero bytes that were not frames with a payload of up to `payload_max` bytes.
    """

    def __init__(self, payload_max: int) -> None:
        self.bad = 0
        self._wire_max = _HEAD.size + payload_max + _CRC.size + 1
        self._pending = bytearray()
        self._overflowed = False

    def feed(self, data: bytes) -> list[Frame]:
        """Return the frames completed by these bytes, in order."""
        frames = []
        *ended, rest = data.split(b"\0")
        for part in ended:
            self._keep(part)
            frame = self._finish()
            if frame is not None:
                frames.append(frame)
        self._keep(rest)
        return frames

    def _keep(self, part: bytes) -> None:
        self._overflowed |= len(self._pending) + len(part) > self._wire_max
        self._pending += part[: self._wire_max - len(self._pending)]

    def _finish(self) -> Frame | None:
        stuffed, overflowed = bytes(self._pending), self._overflowed
        self._pending.clear()
        self._overflowed = False
        if not stuffed:
            return None
        frame = None if overflowed else _parse(_unstuff(stuffed))
        self.bad += frame is None
        return frame


def _parse(plain: bytes | None) -> Frame | None:
    if plain is None or len(plain) < _HEAD.size + _CRC.size:
        return None
    body, (crc,) = plain[: -_CRC.size], _CRC.unpack(plain[-_CRC.size :])
    if crc != crc16(body):
        return None
    kind, sequence = _HEAD.unpack(body[: _HEAD.size])
    return Frame(kind, sequence, body[_HEAD.size :])


def _stuff(plain: bytes) -> bytes:
    """Return the COBS encoding of fewer than 254 bytes: each run between zeros after the distance to the next zero."""
    return b"".join(bytes([len(run) + 1]) + run for run in plain.split(b"\0"))


def _unstuff(stuffed: bytes) -> bytes | None:
    runs, at = [], 0
    while at < len(stuffed):
        runs.append(stuffed[at + 1 : at + stuffed[at]])
        at += stuffed[at]
    return b"\0".join(runs) if at == len(stuffed) else None
