"""Reading the images of maps, with checks that they are complete and fit into memory."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from waychair.errors import MapError, MapNotFound
from waychair.files import is_file, read_bytes
from waychair.maps.grid.cells import check_size

Pixels: TypeAlias = NDArray[Any]

_BETWEEN = rb"(?:\s|#[^\r\n]*[\r\n])+"
_PNM = re.compile(rb"P(?P<kind>[1-6])" + _BETWEEN + rb"(?P<width>\d{1,9})" + _BETWEEN + rb"(?P<height>\d{1,9})\s")
_BRIGHTEST = re.compile(_BETWEEN + rb"(\d{1,5})\s")
_CHANNELS = {b"2": 1, b"5": 1, b"3": 3, b"6": 3}
"""Channels by kind of PGM and PPM file: 2 and 3 are text, 5 and 6 bytes."""

_SILENT = 0  # an OpenCV log level


def read_image(path: Path) -> tuple[Pixels, int]:
    """Return the image (H, W, channels) as whole numbers, top row first, and the value of white.

    Raises:
        MapNotFound: there is no such file.
        MapError: it is damaged, of a kind that OpenCV does not read, or larger than `maps.grid.MOST_CELLS`.
    """
    if not is_file(path, MapError):
        raise MapNotFound(f"the map's image {path} is not there; put it there or correct `image` in the map's YAML")
    data = read_bytes(path, MapError)
    _check_header(path, data)
    try:
        with _quiet_opencv():
            image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED) if data else None
    except cv2.error:
        image = None
    if image is None:
        raise MapError(f"the map's image {path} is cut short or no image (PGM, PNG, BMP); copy it again")
    check_size(f"the map's image {path}", image.shape[0], image.shape[1])  # for kinds whose header is not read here
    brightest = {np.dtype(np.uint8): 255, np.dtype(np.uint16): 65535}.get(image.dtype)
    if brightest is None:
        raise MapError(f"the map's image {path} holds {image.dtype} pixels; save it with 8 or 16 bits")
    return image.reshape(*image.shape[:2], -1), brightest


def _check_header(path: Path, data: bytes) -> None:
    """Refuse an image that is too large, or a PGM or PPM that is shorter or longer than its header says.

    OpenCV would fill up a short one with arbitrary values and ignore the rest of a long one.
    """
    what = f"the map's image {path}"
    pnm = _PNM.match(data)
    if data.startswith(b"\x89PNG"):
        width, height = (int.from_bytes(data[at : at + 4], "big") for at in (16, 20))
    elif data.startswith(b"BM"):
        width, height = (int.from_bytes(data[at : at + 4], "little", signed=True) for at in (18, 22))
    elif pnm:
        width, height = int(pnm["width"]), int(pnm["height"])
    else:
        return
    check_size(what, abs(height), abs(width))
    brightest = _BRIGHTEST.match(data, pnm.end() - 1) if pnm and pnm["kind"] in _CHANNELS else None
    if not pnm or not brightest:
        return
    announced = height * width * _CHANNELS[pnm["kind"]]
    if pnm["kind"] in b"23":
        there, more = _words(data[brightest.end() :]), False
    else:
        announced *= 1 if int(brightest[1]) < 256 else 2
        there = min(len(data) - brightest.end(), announced)
        more = bool(data[brightest.end() + announced :].strip())
    if there < announced:
        raise MapError(f"{what} is cut short: it holds {there} of the {announced} values it announces; copy it again")
    if there > announced or more:
        raise MapError(f"{what} goes on after the {announced} values that it announces; copy it again")


def _words(text: bytes) -> int:
    """Return how many words a text has outside its comments."""
    letters = np.frombuffer(re.sub(rb"#[^\r\n]*", b"", text), np.uint8)
    space = np.concatenate([[True], (letters == 32) | ((letters >= 9) & (letters <= 13))])
    return int(np.count_nonzero(space[:-1] & ~space[1:]))


@contextmanager
def _quiet_opencv() -> Iterator[None]:
    """Suppress OpenCV's own lines on stderr about a damaged file."""
    log: Any = getattr(cv2.utils, "logging", cv2)  # before OpenCV 5 the functions are in cv2 itself
    level = log.getLogLevel()
    log.setLogLevel(_SILENT)
    try:
        yield
    finally:
        log.setLogLevel(level)
