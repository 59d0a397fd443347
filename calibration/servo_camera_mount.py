"""The camera on pan/tilt servos with its laser line: where it sits on the chair, and how far the servos turn.

The laser is on the same servos, a baseline below the camera. Its plane is parallel to the optical axis and to the
picture's rows, so that the line lies below the middle row, the lower the nearer. The paper gives the servos' ranges
(tilt 135 degrees, pan 360 degrees) and nothing else; all other figures are plausible, not measured.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from waychair.types import FloatArray, Pose3

PAN_LIMITS = (0.0, math.tau)
"""rad, to the left from straight ahead: the servo stops at both ends, so that from 350 to 10 degrees is the long way."""

TILT_LIMITS = (math.radians(-45.0), math.radians(90.0))
"""rad, up from level: the 135 degrees of the paper."""

PICTURE = (640, 480)
"""Columns and rows."""


@dataclass(frozen=True, slots=True)
class ServoCameraMount:
    """The mount in base: the pan axis [m], the height of the camera above the floor, and the camera's optics."""

    forward: float = 0.40
    left: float = 0.0
    height: float = 0.75
    baseline: float = 0.10
    focal: float = 600.0

    @property
    def camera_matrix(self) -> FloatArray:
        """The camera's matrix (3, 3) [pixels], for pixel centres."""
        columns, rows = PICTURE
        middle = [(columns - 1) / 2, (rows - 1) / 2]
        return np.array([[self.focal, 0.0, middle[0]], [0.0, self.focal, middle[1]], [0.0, 0.0, 1.0]])

    def base_from_camera(self, pan: float, tilt: float) -> Pose3:
        """Return the pose of the camera's optical frame (REP-103) at true angles [rad]."""
        (sp, cp), (st, ct) = ((math.sin(angle), math.cos(angle)) for angle in (pan, tilt))
        ahead = np.array([ct * cp, ct * sp, st])
        right = np.array([sp, -cp, 0.0])
        down = np.cross(ahead, right)
        return Pose3(np.stack([right, down, ahead], axis=1), np.array([self.forward, self.left, self.height]))

    @property
    def camera_from_laser(self) -> Pose3:
        """The pose of the laser, whose fan lies in its x and z axes, in the optical frame."""
        return Pose3(np.eye(3), np.array([0.0, self.baseline, 0.0]))


SERVO_CAMERA = ServoCameraMount()
"""The servo camera of all chairs: there is only one kind yet."""
