"""ROS messages between bytes, plain objects and rclpy's classes, and what is wrong with those that come in.

On the way to the wire a noun becomes a plain message (`waychair.ros_messages`, the same as in a bag) and then bytes,
which rclpy publishes as they are; subscriptions take bytes likewise. Measured against filling in rclpy's own classes,
that takes half the CPU time for scans and IMU samples, a third for a picture on its way out, and a seventieth for one
that comes in. Only actions and services need rclpy's classes: `native`, `plain`.
"""

from __future__ import annotations

import math
import struct
from typing import Any

from rosbags.serde import SerdeError
from rosbags.typesys import get_types_from_msg

from waychair.errors import MessageError
from waychair.ros.interface_builder import TEXTS
from waychair.ros.interface_types import interface_type
from waychair.ros_messages import TYPES
from waychair.ros_transforms import frame_name

_NANOSECONDS = 1_000_000_000
_BROKEN = (SerdeError, struct.error, ValueError, IndexError, AssertionError)  # what a decoder raises on damaged bytes

for _path in sorted(TEXTS.glob("*/msg/*.msg")):  # those that rosbags does not know
    _name = f"{_path.parts[-3]}/msg/{_path.stem}"
    if _name not in TYPES.types:
        TYPES.register(get_types_from_msg(_path.read_text(encoding="utf-8"), _name))


def serialised(message: Any) -> bytes:
    """CDR bytes of a plain message."""
    return bytes(TYPES.serialize_cdr(message, message.__msgtype__))


def deserialised(data: bytes, name: str) -> Any:
    """A plain message of the type `name` from its CDR bytes.

    Raises:
        MessageError: the bytes are no such message.
    """
    try:
        return TYPES.deserialize_cdr(data, name)
    except _BROKEN as error:
        raise MessageError(f"{len(data)} bytes are no {name} ({error}): restart what sends them") from error


def native(message: Any) -> Any:
    """rclpy's object of a plain message."""
    from rclpy.serialization import deserialize_message

    return deserialize_message(serialised(message), interface_type(message.__msgtype__))


def plain(message: Any) -> Any:
    """The plain message of an object of rclpy."""
    from rclpy.serialization import serialize_message

    package, kind, _ = type(message).__module__.split(".", 2)
    return deserialised(serialize_message(message), f"{package}/{kind}/{type(message).__name__}")


def stamp_of(message: Any) -> int:
    """Nanoseconds of the header.

    Raises:
        MessageError: it is before 1970, or has a second's worth of nanoseconds or more.
    """
    stamp = message.header.stamp
    if stamp.sec < 0 or not 0 <= stamp.nanosec < _NANOSECONDS:
        raise MessageError(f"the stamp {stamp.sec} s {stamp.nanosec} ns is impossible: set the clock of what sends it")
    return int(stamp.sec) * _NANOSECONDS + int(stamp.nanosec)


def require_frame(message: Any, *frames: str) -> str:
    """The header's frame, which must be one of these.

    Raises:
        MessageError: it is another.
    """
    frame = frame_name(message.header.frame_id)
    if frame not in frames:
        raise MessageError(f"the frame '{frame}' is unknown here: send it in {' or '.join(frames)}")
    return frame


def require_finite(what: str, *values: float) -> None:
    """
    Raises:
        MessageError: one of them is no number, or infinite.
    """
    if not all(map(math.isfinite, values)):
        shown = ", ".join(f"{value:g}" for value in values)
        raise MessageError(f"{what} is no number ({shown}): restart what sends it")
