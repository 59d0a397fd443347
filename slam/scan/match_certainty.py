"""How certain the pose of a scan match is: the direction that a scan does not see, and the covariance."""

from __future__ import annotations

import numpy as np

from waychair.types import FloatArray, Pose2

UNKNOWN_VARIANCE = 100.0
"""Variance [m^2], [rad^2] of a direction in which a scan gives no information."""

_COVARIANCE_SCALE = 2.0  # covariance of a match over the inverse of its information; see `calibrated_covariance`


def weakest_direction(information: FloatArray) -> tuple[float, FloatArray]:
    """Return the structural complexity, and the unit vector (2,) of the best known direction.

    The complexity is the smaller eigenvalue of the position's information (3, 3) over the sum of both. For point-to-line
    distances that is the weighted share of surfaces that face this direction, as in RTAB-Map's ICP; 0 without surfaces.
    """
    values, vectors = np.linalg.eigh(information[:2, :2])
    total = float(values.sum())
    return (float(max(values[0], 0.0)) / total if total > 0.0 else 0.0), vectors[:, 1]


def calibrated_covariance(information: FloatArray) -> FloatArray:
    """Return the realistic covariance (3, 3) of a match.

    Least squares assume independent errors, but the points of one wall share their errors, so the inverse of the
    information is too small by a factor (`_COVARIANCE_SCALE`). It was measured by matching disjoint halves of the beams
    against disjoint halves of the key scans: 0.2 on the Intel lab and 1.9 on Freiburg 079.
    """
    least = np.eye(3) / UNKNOWN_VARIANCE
    return np.asarray(_COVARIANCE_SCALE * np.linalg.inv(information + least), np.float64)


def without_weak_direction(
    pose: Pose2, information: FloatArray, guess: Pose2, strong: FloatArray
) -> tuple[Pose2, FloatArray]:
    """Return the pose moved from the guess along the strong direction only, and the information without the weak one.

    A few wrong normals in a corridor look like information along it (solution remapping, Zhang, Kaess and Singh 2016).
    """
    keep = np.eye(3)
    keep[:2, :2] = np.outer(strong, strong)
    x, y = (guess.x, guess.y) + keep[:2, :2] @ (pose.x - guess.x, pose.y - guess.y)
    return Pose2(float(x), float(y), pose.theta), keep @ information @ keep
