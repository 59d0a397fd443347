"""Conversion of ROS messages between bytes, plain objects and rclpy's classes, and common checks of incoming ones.

Nodes publish bytes, made from a plain message (`waychair.recordings.bags.ros_messages`, as in a bag), and subscribe to bytes likewise.
Compared with rclpy's own classes, that takes half of the CPU time for scans and IMU samples, a third for an outgoing
picture, and a seventieth for an incoming picture. Only actions and services need rclpy's classes: `native`, `plain`.
"""

from __future__ import annotations

import math
import struct
from typing import Any

from rosbags.serde import SerdeError
from rosbags.typesys import get_types_from_msg

from waychair.errors import MessageError
from waychair.recordings.bags.ros_messages import TYPES
from waychair.recordings.bags.ros_transforms import frame_name
from waychair.ros.interface_builder import TEXTS
from waychair.ros.interface_types import interface_type

_NANOSECONDS = 1_000_000_000
_BROKEN = (SerdeError, struct.error, ValueError, IndexError, AssertionError)  # a decoder's errors on damaged bytes

for _path in sorted(TEXTS.glob("*/msg/*.msg")):  # types that rosbags does not know
    _name = f"{_path.parts[-3]}/msg/{_path.stem}"
    if _name not in TYPES.types:
        TYPES.register(get_types_from_msg(_path.read_text(encoding="utf-8"), _name))


def serialised(message: Any) -> bytes:
    """Return the CDR bytes of a plain message."""
    return bytes(TYPES.serialize_cdr(message, message.__msgtype__))


def deserialised(data: bytes, name: str) -> Any:
    """Return a plain message of the type `name` from its CDR bytes.

    Raises:
        MessageError: the bytes do not decode to this type.
    """
    try:
        return TYPES.deserialize_cdr(data, name)
    except _BROKEN as error:
        raise MessageError(f"{len(data)} bytes are not a {name} ({error}): restart their sender") from error


def native(message: Any) -> Any:
    """Return rclpy's object of a plain message."""
    from rclpy.serialization import deserialize_message

    return deserialize_message(serialised(message), interface_type(message.__msgtype__))


def plain(message: Any) -> Any:
    """Return the plain message of an object of rclpy."""
    from rclpy.serialization import serialize_message

    package, kind, _ = type(message).__module__.split(".", 2)
    return deserialised(serialize_message(message), f"{package}/{kind}/{type(message).__name__}")


def stamp_of(message: Any) -> int:
    """Return the stamp [ns] of the header.

    Raises:
        MessageError: the stamp is before 1970, or its nanoseconds exceed a second.
    """
    stamp = message.header.stamp
    if stamp.sec < 0 or not 0 <= stamp.nanosec < _NANOSECONDS:
        raise MessageError(f"the stamp {stamp.sec} s {stamp.nanosec} ns is impossible: set its sender's clock")
    return int(stamp.sec) * _NANOSECONDS + int(stamp.nanosec)


def require_frame(message: Any, *frames: str) -> str:
    """Return the header's frame, which must be one of `frames`.

    Raises:
        MessageError: another frame.
    """
    frame = frame_name(message.header.frame_id)
    if frame not in frames:
        raise MessageError(f"the frame '{frame}' is not accepted: send it in {' or '.join(frames)}")
    return frame


def require_finite(what: str, *values: float) -> None:
    """Require that all values are finite; `what` names them in the error.

    Raises:
        MessageError: a value is nan or infinite.
    """
    if not all(map(math.isfinite, values)):
        shown = ", ".join(f"{value:g}" for value in values)
        raise MessageError(f"{what} is not finite ({shown}): restart its sender")
