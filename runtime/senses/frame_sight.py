"""Door frames in the pictures of the camera on servos, as candidates for the cells: directions, followed over pictures.

A picture only proposes. The cells aim the camera at a frame, and the laser's line tells whether a doorway is there.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from waychair.control.behaviours.doorway import FrameCandidate, FramesSeen
from waychair.control.drive.doors.door_frame_tracker import DoorFrameTracker, FollowedFrame
from waychair.planning.seen.door_frames import DoorFrame, door_frames
from waychair.types import FloatArray, Picture, Pose2

_CONFIDENCE = 0.8
"""Confidence of a frame that was seen in several pictures: a proposal alone is right in about every third case."""


def frames_in(picture: Picture) -> list[DoorFrame]:
    """Return the frames proposed in a picture. It takes a tenth of a second or more: not for a control tick."""
    return door_frames(picture.image[..., ::-1].copy())


class FrameSight:
    """The frames that are followed from picture to picture."""

    def __init__(self) -> None:
        self._tracker = DoorFrameTracker()
        self._heading: float | None = None

    def seen(self, proposals: Sequence[DoorFrame], picture: Picture, pan: float, odom_from_base: Pose2) -> FramesSeen:
        """Return the steady frames after one picture more, in base.

        Args:
            proposals: `frames_in` of the picture.
            picture: taken at rest of the servos.
            pan: the servos' report of that moment [rad].
            odom_from_base: the chair's pose at that moment.
        """
        heading = odom_from_base.theta + pan
        turn = 0.0 if self._heading is None else math.remainder(heading - self._heading, math.tau)
        self._heading = heading
        self._tracker.see(proposals, picture.camera_matrix, turn)
        steady = (frame for frame in self._tracker.frames if frame.steady and not frame.missed)
        return FramesSeen(tuple(_candidate(frame, picture.camera_matrix, pan) for frame in steady))


def _candidate(frame: FollowedFrame, camera_matrix: FloatArray, pan: float) -> FrameCandidate:
    """Return the directions of a frame's edges in base [rad]; left is the greater one."""
    focal, middle = float(camera_matrix[0, 0]), float(camera_matrix[0, 2])
    ahead = math.remainder(pan, math.tau)
    left, right = (ahead + math.atan2(middle - column, focal) for column in (frame.box[0], frame.box[2]))
    return FrameCandidate(left, right, _CONFIDENCE)
