"""Range from the line that a laser draws in a picture, by triangulation.

The laser spreads its light in a plane. A pixel on the line is a ray of the camera; where the ray meets the plane is the
lit point (Hartley and Zisserman, Multiple View Geometry, 2003, section 8.1, for rays of pixels). The error follows from
that of the line's place in the picture and grows with the square of the distance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from waychair.types import FloatArray

LINE_ERROR = 0.3
"""pixels; error of the line's middle in one picture (one sigma), as a centroid over a line a few pixels thick finds it."""

PLANE_TURN_ERROR = 0.0003
"""rad; error of the laser plane's calibrated direction (one sigma): it acts like an error of every pixel."""

FLATTEST = 0.005
"""Least sine of the angle between a ray and the plane; flatter ones tell nothing. With a baseline of 0.1 m it is 20 m."""


@dataclass(frozen=True, slots=True)
class LaserPlane:
    """The laser's plane in the camera's optical frame (z forward, x right, y down): `normal` @ point = `offset` [m].

    `normal` (3,) has length 1; `offset` is the distance of the camera from the plane, at most the baseline.
    """

    normal: FloatArray
    offset: float


@dataclass(frozen=True, slots=True)
class LinePoints:
    """Lit points (N, 3) [m] in the optical frame and the error (N,) of their distance from the camera [m], one sigma.

    Both are nan where the ray does not meet the plane ahead of the camera.
    """

    points: FloatArray
    errors: FloatArray


def points_of_line(pixels: FloatArray, camera_matrix: FloatArray, plane: LaserPlane) -> LinePoints:
    """Return the lit points of pixels (N, 2) (column, row; fractions allowed) on the laser's line.

    Args:
        pixels: middles of the line in the picture, nan where it was not found.
        camera_matrix: (3, 3) [pixels] of a camera without distortion.
        plane: the laser's plane, from the servos' angles and the calibration.
    """
    ones = np.ones((len(pixels), 1))
    rays = np.concatenate([pixels, ones], axis=1) @ np.linalg.inv(camera_matrix).T
    length = np.hypot(np.hypot(rays[:, 0], rays[:, 1]), rays[:, 2])
    directions = rays / length[:, None]
    sine = directions @ plane.normal
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = plane.offset / sine
    distance[~((distance > 0.0) & (np.abs(sine) > FLATTEST))] = np.nan
    # distance = offset / sine, so that an angle d between ray and plane changes it by distance * cosine / sine * d
    cosine = np.sqrt(np.maximum(0.0, 1.0 - sine**2))
    focal = np.array([camera_matrix[0, 0], camera_matrix[1, 1]])
    across = np.hypot(plane.normal[0], plane.normal[1])
    along_normal = np.hypot(plane.normal[0] / focal[0], plane.normal[1] / focal[1]) / max(float(across), 1e-9)
    angle = np.hypot(LINE_ERROR * along_normal / length, PLANE_TURN_ERROR)
    with np.errstate(divide="ignore", invalid="ignore"):
        errors = np.abs(distance * cosine / sine) * angle
    return LinePoints(directions * distance[:, None], errors)
