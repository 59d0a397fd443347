"""The other chairs of a building in a std_msgs/String."""

from __future__ import annotations

from typing import Any

from waychair.ros.messages.json_text import json_text, read_json_text
from waychair.runtime.pages.chair_port import OthersView


def others(view: OthersView) -> Any:
    """Return a std_msgs/String of the other chairs."""
    return json_text(view)


def read_others(message: Any) -> OthersView:
    """Return the other chairs of a std_msgs/String as `others` makes it.

    Raises:
        MessageError: it is of another kind.
    """
    return read_json_text(message, OthersView, "a message about other chairs")
