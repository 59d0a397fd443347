"""Information matrices (3, 3) of relative poses: x, y [1/m^2], theta [1/rad^2]."""

from __future__ import annotations

import math

import numpy as np

from waychair.geometry import rotation
from waychair.types import FloatArray, Pose2

LOST_POSITION, LOST_HEADING = 1000.0, 10.0
"""Standard deviations [m], [rad] of an unknown motion: a chair carried through a whole building bends nothing once a loop has
joined its map."""


ODOMETRY_DISTANCE_SIGMA = 0.1  # m/m; standard deviation of the position per metre driven
ODOMETRY_ANGLE_SIGMA = 0.2  # rad/rad; standard deviation of the heading per radian turned
ODOMETRY_DRIFT_SIGMA = 0.05  # rad/m; standard deviation of the heading per metre driven
MATCH_POSITION_SIGMA = 0.01  # m; least standard deviation of a match
MATCH_ANGLE_SIGMA = 0.004  # rad; least standard deviation of a match


def odometry_information(motion: Pose2) -> FloatArray:
    """Return the information of a motion measured by the wheels, in the frame of its end."""
    distance, turn = math.hypot(motion.x, motion.y), abs(motion.theta)
    along = 0.01 + ODOMETRY_DISTANCE_SIGMA * distance
    angle = 0.005 + ODOMETRY_ANGLE_SIGMA * turn + ODOMETRY_DRIFT_SIGMA * distance
    return np.diag([along**-2, along**-2, angle**-2])


def unknown_information() -> FloatArray:
    """Return the information of an unknown motion, as of a kidnapped chair."""
    return np.diag([LOST_POSITION**-2, LOST_POSITION**-2, LOST_HEADING**-2])


def match_information(information: FloatArray) -> FloatArray:
    """Return the information of a scan match, with the least noise of a match added."""
    floor = np.diag([MATCH_POSITION_SIGMA**2, MATCH_POSITION_SIGMA**2, MATCH_ANGLE_SIGMA**2])
    return np.linalg.inv(np.linalg.inv(information + 1e-6 * np.eye(3)) + floor)


def rotated_information(information: FloatArray, theta: float) -> FloatArray:
    """Return the information in a frame that is turned by -theta relative to the given frame."""
    turn = np.eye(3)
    turn[:2, :2] = rotation(theta)
    result: FloatArray = turn @ information @ turn.T
    return result
