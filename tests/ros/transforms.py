"""Decoding /tf messages for tests; no node of the chair reads /tf."""

from __future__ import annotations

from typing import Any

from waychair.recordings.bags.ros_transforms import pose_matrix
from waychair.ros.messages.wire import stamp_of
from waychair.types import Pose3


def read_transforms(message: Any) -> dict[tuple[str, str], tuple[int, Pose3]]:
    """Return stamps [ns] and `parent_from_child` of a tf2_msgs/TFMessage, by (parent, child)."""
    found = {}
    for stamped in message.transforms:
        matrix = pose_matrix(stamped.transform.translation, stamped.transform.rotation)
        pose = Pose3(matrix[:3, :3], matrix[:3, 3])
        found[stamped.header.frame_id, stamped.child_frame_id] = stamp_of(stamped), pose
    return found
