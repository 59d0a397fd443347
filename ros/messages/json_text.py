"""JSON objects of plain dataclasses in a std_msgs/String, for what only this project's own nodes and pages read."""

from __future__ import annotations

from typing import Any, TypeVar

import msgspec

from waychair.errors import MessageError
from waychair.recordings.bags.ros_messages import make

View = TypeVar("View")


def json_text(view: object) -> Any:
    """Return a std_msgs/String of a dataclass."""
    return make("std_msgs/msg/String", msgspec.json.encode(view).decode())


def read_json_text(message: Any, kind: type[View], what: str) -> View:
    """Return the dataclass of a std_msgs/String as `json_text` makes it; `what` begins the error.

    Raises:
        MessageError: it is of another kind.
    """
    try:
        return msgspec.json.decode(message.data, type=kind)
    except msgspec.DecodeError as error:
        raise MessageError(f"{what} cannot be read: {error}; use one version everywhere") from error
