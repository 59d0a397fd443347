"""Grey pictures as PNG files, without OpenCV: a map of a lidar is saved without it."""

from __future__ import annotations

import struct
import zlib

import numpy as np

from waychair.types import Bytes

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_DEPTH, _GREY = 8, 0  # bits a pixel, and its colour type


def grey_png(pixels: Bytes) -> bytes:
    """Return grey levels (H, W), the top row first, as a PNG file (ISO/IEC 15948)."""
    height, width = pixels.shape
    rows = np.zeros((height, 1 + width), np.uint8)  # each row begins with the number of its filter, 0 for none
    rows[:, 1:] = pixels
    header = struct.pack(">IIBBBBB", width, height, _DEPTH, _GREY, 0, 0, 0)
    chunks = ((b"IHDR", header), (b"IDAT", zlib.compress(rows.tobytes(), 6)), (b"IEND", b""))
    return _SIGNATURE + b"".join(_chunk(kind, data) for kind, data in chunks)


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
