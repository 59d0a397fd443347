"""Reading the images of maps (PGM, PPM, PBM, PNG, BMP), with checks that they are complete and fit into memory."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from waychair.errors import MapError, MapNotFound
from waychair.files import is_file, read_bytes
from waychair.types import BoolArray

Shades: TypeAlias = NDArray[Any]

MOST_PIXELS = 400_000_000
"""The largest image that is read [pixels]: it takes two bytes a pixel before its cells are joined to larger ones."""

_BETWEEN = rb"(?:\s|#[^\r\n]*[\r\n])+"
_PNM = re.compile(rb"P(?P<kind>[1-6])" + _BETWEEN + rb"(?P<width>\d{1,9})" + _BETWEEN + rb"(?P<height>\d{1,9})\s")
_WHITE = re.compile(_BETWEEN + rb"(\d{1,9})\s")
_CHANNELS = {b"2": 1, b"5": 1, b"3": 3, b"6": 3}
"""Channels by kind of PGM and PPM file: 2 and 3 are text, 5 and 6 bytes."""

_SPACE = re.compile(rb"\s")
_TEXT_AT_ONCE = 1 << 22  # bytes of a text image that are converted at once

_LARGEST_WHITE = 65535  # of the PGM and PPM formats

_OTHER_KINDS = {b"\xff\xd8\xff": "JPEG", b"II*\0": "TIFF", b"MM\0*": "TIFF", b"RIFF": "WebP", b"GIF8": "GIF"}
"""First bytes of other images. JPEG and the like blur shades, so that the edges of unknown areas become free floor."""

_SILENT = 0  # an OpenCV log level


@dataclass(frozen=True, slots=True)
class MapImage:
    """An image's shades (H, W), whole numbers from 0 to `white` with the top row first.

    `opaque` (H, W) tells the pixels that are wholly opaque, None where the image has no transparency. The shade of a
    coloured pixel is the sum of its channels.
    """

    shades: Shades
    white: int
    opaque: BoolArray | None = None


def read_image(path: Path) -> MapImage:
    """Return the image of a map.

    Raises:
        MapNotFound: there is no such file.
        MapError: it is damaged, of another kind, or has more than `MOST_PIXELS`.
    """
    if not is_file(path, MapError):
        raise MapNotFound(f"the map's image {path} is not there; put it there or correct `image` in the map's YAML")
    data = read_bytes(path, MapError)
    for begin, kind in _OTHER_KINDS.items():
        if data.startswith(begin):
            raise MapError(
                f"the map's image {path} is a {kind} file; save it as PNG, from the original if there is one"
            )
    _check_size(path, *_announced_size(data))
    pnm = _PNM.match(data)
    if pnm and pnm["kind"] in _CHANNELS:
        return _pnm_image(path, data, pnm)
    return _decoded(path, data)


def _announced_size(data: bytes) -> tuple[int, int]:
    """Return the height and width that an image's header announces, 0 for an unknown header."""
    if data.startswith(b"\x89PNG"):
        width, height = (int.from_bytes(data[at : at + 4], "big") for at in (16, 20))
    elif data.startswith(b"BM"):
        width, height = (int.from_bytes(data[at : at + 4], "little", signed=True) for at in (18, 22))
    elif pnm := _PNM.match(data):
        width, height = int(pnm["width"]), int(pnm["height"])
    else:
        return 0, 0
    return abs(height), abs(width)


def _check_size(path: Path, height: int, width: int) -> None:
    if height * width > MOST_PIXELS:
        raise MapError(
            f"the map's image {path} has {width} by {height} pixels, more than the {MOST_PIXELS} that are read; cut it to "
            "the part that the chair drives in, or save it with larger cells"
        )


def _pnm_image(path: Path, data: bytes, head: re.Match[bytes]) -> MapImage:
    """Return the image of a PGM or PPM file, whose white is any number up to 65535.

    OpenCV would take 255 for white in every file of bytes, fill up one that is cut short with arbitrary values, and
    ignore the rest of a long one.
    """
    what, channels = f"the map's image {path}", _CHANNELS[head["kind"]]
    found = _WHITE.match(data, head.end() - 1)
    white = int(found[1]) if found else 0
    if found and not 1 <= white <= _LARGEST_WHITE:
        raise MapError(f"{what} announces {white} for white, which must be 1 to {_LARGEST_WHITE}; save it again")
    count = int(head["height"]) * int(head["width"]) * channels
    if found and not count:
        raise MapError(f"{what} has no pixels; copy it again")
    if not found:
        raise MapError(f"{what} is cut short: its header ends before the value of white; copy it again")
    rest = memoryview(data)[found.end() :]
    if head["kind"] in b"23":
        values, more = _numbers(path, bytes(rest)), False
    else:
        kind = np.dtype(np.uint8 if white < 256 else ">u2")
        there = min(len(rest) // kind.itemsize, count)
        values = np.frombuffer(rest, kind, there)
        more = bool(bytes(rest[count * kind.itemsize :]).strip())
    if len(values) < count:
        raise MapError(f"{what} is cut short: it holds {len(values)} of the {count} values it announces; copy it again")
    if len(values) > count or more:
        raise MapError(f"{what} goes on after the {count} values that it announces; copy it again")
    if values.size and (int(values.max()) > white or int(values.min()) < 0):
        beyond = values.max() if int(values.max()) > white else values.min()
        raise MapError(f"{what} holds the value {beyond} beyond its white of {white}; correct that in its header")
    shades = values.reshape(int(head["height"]), int(head["width"]), channels)
    return MapImage(*_joined(shades, white))


def _numbers(path: Path, text: bytes) -> Shades:
    """Return the numbers of a text outside its comments."""
    text = re.sub(rb"#[^\r\n]*", b"", text)
    parts, at = [np.empty(0, np.int32)], 0
    while at < len(text):  # a list of all words would take ten times the memory of the image
        space = _SPACE.search(text, at + _TEXT_AT_ONCE)
        end = space.start() if space else len(text)
        try:
            if words := text[at:end].split():
                parts.append(np.array(words, dtype="S9").astype(np.int32))
        except ValueError as error:
            raise MapError(f"the map's image {path} holds text that is not a number; copy it again") from error
        at = end
    return np.concatenate(parts)


def _decoded(path: Path, data: bytes) -> MapImage:
    """Return the image of a PNG, BMP or PBM file, decoded by OpenCV."""
    import cv2  # only such images have need of it

    try:
        with _quiet_opencv():
            image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED) if data else None
    except cv2.error:
        image = None
    if image is None:
        raise MapError(f"the map's image {path} is cut short or no image (PGM, PNG, BMP); copy it again")
    _check_size(path, *image.shape[:2])  # of kinds whose header is not read here
    white = {np.dtype(np.uint8): 255, np.dtype(np.uint16): 65535}.get(image.dtype)
    if white is None:
        raise MapError(f"the map's image {path} holds {image.dtype} pixels; save it with 8 or 16 bits")
    pixels = image.reshape(*image.shape[:2], -1)
    opaque: BoolArray | None = None
    if pixels.shape[2] in (2, 4):
        opaque = pixels[..., -1] >= white
        pixels = pixels[..., :-1]
    elif pixels.shape[2] == 1 and (hidden := _transparent_shade(data, white)) is not None:
        opaque = pixels[..., 0] != hidden
    return MapImage(*_joined(pixels, white), opaque)


def _joined(pixels: Shades, white: int) -> tuple[Shades, int]:
    """Return the sum (H, W) of the channels of pixels (H, W, channels), and that of white."""
    channels = pixels.shape[2]
    if channels == 1:
        return pixels[..., 0], white
    sums = pixels[..., 0].astype(np.uint32)
    for channel in range(1, channels):
        sums += pixels[..., channel]
    return sums, white * channels


def _transparent_shade(data: bytes, white: int) -> int | None:
    """Return the shade that a grey PNG without alpha makes transparent (its chunk tRNS), which OpenCV ignores."""
    if not data.startswith(b"\x89PNG") or data[25:26] != b"\0":
        return None
    at, bits = data.find(b"tRNS", 33), data[24]
    if at < 0 or at > data.find(b"IDAT") or data[at - 4 : at] != b"\0\0\0\x02":
        return None
    shade = int.from_bytes(data[at + 4 : at + 6], "big")
    return shade * white // ((1 << bits) - 1)


@contextmanager
def _quiet_opencv() -> Iterator[None]:
    """Suppress OpenCV's own lines on stderr about a damaged file."""
    import cv2

    log: Any = getattr(cv2.utils, "logging", cv2)  # before OpenCV 5 the functions are in cv2 itself
    level = log.getLogLevel()
    log.setLogLevel(_SILENT)
    try:
        yield
    finally:
        log.setLogLevel(level)
