"""The message of step guidance: a JSON object of `runtime.chair_port.GuideView`, empty without guidance."""

from __future__ import annotations

from typing import Any

import msgspec

from waychair.errors import MessageError
from waychair.recordings.bags.ros_messages import make
from waychair.runtime.chair_port import GuideView


def guidance(view: GuideView | None) -> Any:
    """Return a std_msgs/String."""
    return make("std_msgs/msg/String", "" if view is None else msgspec.json.encode(view).decode())


def read_guidance(message: Any) -> GuideView | None:
    """Return the guidance of a std_msgs/String, None without.

    Raises:
        MessageError: the text is no guidance.
    """
    text = str(message.data)
    try:
        return msgspec.json.decode(text, type=GuideView) if text else None
    except msgspec.MsgspecError as error:
        raise MessageError(f"the guidance cannot be read ({error}): update the page's node") from error
