"""The other chairs of a building in a std_msgs/String."""

from __future__ import annotations

from typing import Any

import msgspec

from waychair.errors import MessageError
from waychair.recordings.bags.ros_messages import make
from waychair.runtime.chair_port import OthersView


def others(view: OthersView) -> Any:
    """Return a std_msgs/String of the other chairs."""
    return make("std_msgs/msg/String", msgspec.json.encode(view).decode())


def read_others(message: Any) -> OthersView:
    """Return the other chairs of a std_msgs/String as `others` makes it.

    Raises:
        MessageError: it is of another kind.
    """
    try:
        return msgspec.json.decode(message.data, type=OthersView)
    except msgspec.DecodeError as error:
        raise MessageError(
            f"a message about other chairs cannot be read: {error}; use one version everywhere"
        ) from error
