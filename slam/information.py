"""Information matrices (3, 3) of relative poses: x, y [1/m^2], theta [1/rad^2]."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from waychair.config import Settings, setting
from waychair.geometry import rotation
from waychair.types import FloatArray, Pose2

LOST_POSITION, LOST_HEADING = 5.0, 1.0
"""Standard deviations [m], [rad] of an unknown motion."""


@dataclass(frozen=True, slots=True)
class NoiseSettings(Settings):
    """Noise of odometry and of scan matches."""

    odometry_distance: float = setting(0.1, "m/m", "standard deviation per metre driven", low=1e-4, high=1.0)
    odometry_angle: float = setting(0.2, "rad/rad", "standard deviation per radian turned", low=1e-4, high=1.0)
    odometry_drift: float = setting(0.05, "rad/m", "heading's standard deviation per metre", low=1e-4, high=1.0)
    match_position: float = setting(0.01, "m", "least standard deviation of a match", low=1e-4, high=1.0)
    match_angle: float = setting(0.004, "rad", "least standard deviation of a match", low=1e-5, high=1.0)


def odometry_information(motion: Pose2, noise: NoiseSettings) -> FloatArray:
    """Return the information of a motion measured by the wheels, in the frame of its end."""
    distance, turn = math.hypot(motion.x, motion.y), abs(motion.theta)
    along = 0.01 + noise.odometry_distance * distance
    angle = 0.005 + noise.odometry_angle * turn + noise.odometry_drift * distance
    return np.diag([along**-2, along**-2, angle**-2])


def unknown_information() -> FloatArray:
    """Return the information of an unknown motion, as of a kidnapped chair."""
    return np.diag([LOST_POSITION**-2, LOST_POSITION**-2, LOST_HEADING**-2])


def match_information(information: FloatArray, noise: NoiseSettings) -> FloatArray:
    """Return the information of a scan match, with the least noise of a match added."""
    floor = np.diag([noise.match_position**2, noise.match_position**2, noise.match_angle**2])
    return np.linalg.inv(np.linalg.inv(information + 1e-6 * np.eye(3)) + floor)


def rotated_information(information: FloatArray, theta: float) -> FloatArray:
    """Return the information in a frame that is turned by -theta relative to the given frame."""
    turn = np.eye(3)
    turn[:2, :2] = rotation(theta)
    result: FloatArray = turn @ information @ turn.T
    return result
