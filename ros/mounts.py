"""The mounts of a chair's sensors as static transforms."""

from __future__ import annotations

from waychair.calibration.chair_body import ChairBody
from waychair.recordings.bags.ros_messages import BASE_FRAME, CAMERA_FRAME, CAMERA_FROM_OPTICAL, OPTICAL_FRAME
from waychair.trials.record import mounts_of
from waychair.types import Pose3


def static_transforms(body: ChairBody, sonar_height: float = 0.4) -> dict[tuple[str, str], Pose3]:
    """Return `parent_from_child` of all sensors on a chair, by (parent, child); `sonar_height` [m]."""
    mounts = mounts_of(body, sonar_height)
    fixed = {(BASE_FRAME, frame): base_from_frame for frame, base_from_frame in mounts.items()}
    return fixed | {(CAMERA_FRAME, OPTICAL_FRAME): CAMERA_FROM_OPTICAL}
