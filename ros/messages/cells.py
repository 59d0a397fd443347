"""Messages of the behaviour cells: the signal, all that a page shows, and the doorways."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

from waychair.planning.seen.doorways import Doorway
from waychair.recordings.bags.ros_messages import ODOM_FRAME, header, make
from waychair.ros.messages.json_text import json_text, read_json_text
from waychair.ros.messages.motion import pose
from waychair.runtime.pages.perception_view import PerceptionView


def signal(words: str) -> Any:
    """Return a std_msgs/String of a signal in words."""
    return make("std_msgs/msg/String", words)


def perception(view: PerceptionView) -> Any:
    """Return a std_msgs/String of the cells as a page shows them; an aim or a signal that is not a number is left out."""
    aim = view.aim if view.aim is not None and math.isfinite(view.aim.pan + view.aim.tilt) else None
    told = view.told if view.told is not None and math.isfinite(view.told.orientation) else None
    return json_text(replace(view, aim=aim, told=told))


def read_perception(message: Any) -> PerceptionView:
    """Return the cells of a std_msgs/String as `perception` makes it.

    Raises:
        MessageError: it is of another kind.
    """
    return read_json_text(message, PerceptionView, "a message of the behaviour cells")


def doorways(stamp_ns: int, found: Iterable[Doorway]) -> Any:
    """Return a geometry_msgs/PoseArray, in odom, of the doorways that range has borne out."""
    poses = [pose(door.pose) for door in found if door.validated]
    return make("geometry_msgs/msg/PoseArray", header(stamp_ns, ODOM_FRAME), poses)
