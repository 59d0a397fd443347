"""Decoding pictures with depth from separate colour, depth and camera_info messages of one stamp."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass
from typing import Any

import cv2

from waychair.errors import MessageError, RecordingError
from waychair.recordings.bags.ros_decoding import camera_matrix_from_message, depth_from_message, picture_from_message
from waychair.ros.messages.wire import require_finite, stamp_of
from waychair.types import FloatArray, RgbdFrame

_WAITING = 8  # stamps for which only colour or depth has arrived
_SHORTEST = 1.0  # px; a smaller focal length means that the camera is not calibrated


def read_rgbd(colour: Any, depth: Any, info: Any) -> RgbdFrame:
    """Return the frame of a colour and a depth sensor_msgs/Image (16UC1 in mm or 32FC1 in m, REP-118) and a CameraInfo.

    Raises:
        MessageError: an unknown encoding, too few bytes, different sizes or stamps, or an uncalibrated camera.
    """
    stamp_ns = stamp_of(colour)
    if stamp_of(depth) != stamp_ns:
        late_ms = (stamp_of(depth) - stamp_ns) * 1e-6
        raise MessageError(f"depth is {late_ms:.1f} ms later than its picture: let the camera's driver align them")
    matrix = read_intrinsics(info)
    try:
        pixels, metres = picture_from_message(colour), depth_from_message(depth)
    except (RecordingError, cv2.error) as error:
        raise MessageError(f"a picture cannot be read: {error}") from error
    if not pixels.shape[:2] == metres.shape == (info.height, info.width):
        sizes = ", ".join(f"{width} x {height}" for height, width in (pixels.shape[:2], metres.shape))
        raise MessageError(
            f"picture and depth ({sizes}) differ from the camera's {info.width} x {info.height}: align depth to colour"
        )
    return RgbdFrame(stamp_ns, pixels, metres, matrix)


def read_intrinsics(info: Any) -> FloatArray:
    """Return the matrix (3, 3) [pixels] of a sensor_msgs/CameraInfo.

    Raises:
        MessageError: the camera is not calibrated.
    """
    require_finite("the camera's matrix", *map(float, info.k))
    matrix = camera_matrix_from_message(info)
    if matrix is None or min(matrix[0, 0], matrix[1, 1]) < _SHORTEST or tuple(matrix[2]) != (0.0, 0.0, 1.0):
        raise MessageError("the camera is not calibrated (its camera_info has no focal lengths): calibrate it")
    return matrix


@dataclass(slots=True)
class _Half:
    colour: Any = None
    depth: Any = None


class CameraPairing:
    """Pairs a camera's colour and depth messages by stamp, in any order of arrival, and drops unpaired ones."""

    def __init__(self) -> None:
        self._info: Any = None
        self._waiting: OrderedDict[int, _Half] = OrderedDict()

    def calibrated(self, info: Any) -> None:
        """Take a sensor_msgs/CameraInfo."""
        self._info = info

    def colour(self, message: Any) -> RgbdFrame | None:
        """Take a colour picture; return the frame if its depth has arrived. Raises as `read_rgbd`."""
        half = self._half(message)
        half.colour = message
        return self._completed(stamp_of(message), half)

    def depth(self, message: Any) -> RgbdFrame | None:
        """Take a depth picture; return the frame if its colour has arrived. Raises as `read_rgbd`."""
        half = self._half(message)
        half.depth = message
        return self._completed(stamp_of(message), half)

    def _half(self, message: Any) -> _Half:
        half = self._waiting.setdefault(stamp_of(message), _Half())
        while len(self._waiting) > _WAITING:
            self._waiting.popitem(last=False)
        return half

    def _completed(self, stamp_ns: int, half: _Half) -> RgbdFrame | None:
        if half.colour is None or half.depth is None or self._info is None:
            return None
        del self._waiting[stamp_ns]
        return read_rgbd(half.colour, half.depth, self._info)
