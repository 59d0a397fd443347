"""The message of step guidance: a JSON object of `runtime.pages.guide_view.GuideView`, empty without guidance."""

from __future__ import annotations

from typing import Any

from waychair.recordings.bags.ros_messages import make
from waychair.ros.messages.json_text import json_text, read_json_text
from waychair.runtime.pages.guide_view import GuideView


def guidance(view: GuideView | None) -> Any:
    """Return a std_msgs/String."""
    return make("std_msgs/msg/String", "") if view is None else json_text(view)


def read_guidance(message: Any) -> GuideView | None:
    """Return the guidance of a std_msgs/String, None without.

    Raises:
        MessageError: the text is no guidance.
    """
    return read_json_text(message, GuideView, "a message of guidance") if message.data else None
