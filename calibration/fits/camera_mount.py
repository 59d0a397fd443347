"""Extrinsic calibration of camera and lidar from planes that both see.

The end of every beam must lie on the plane that the camera has measured. This is the constraint of Zhang and Pless,
Extrinsic calibration of a camera and laser range finder (IROS 2004). It is linear in the columns of the transform that
act on the laser's plane, so a first solution needs no guess; a nonlinear refinement then forbids its shear. Upright
walls alone leave the camera's height open: show a leaning board, or add the floor, above which the laser's height is
known.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from waychair.errors import CalibrationError, ThinData
from waychair.types import FloatArray, Pose3

LEAST_VIEWS = 5
"""Fewest views of planes: each gives two equations, for nine unknowns."""

_MOST_CONDITION = 1000.0
_ALIKE = "the planes are too much alike: show planes at other angles, and leaning planes or the floor"
_LEAST_OUTLIER = 0.01  # [m]: a point nearer to its plane than this is on it
_MOST_RMS = 0.1  # [m]


@dataclass(frozen=True, slots=True)
class PlaneView:
    """One plane seen by both sensors: unit normal (3,) and distance [m] with normal . X = distance in the camera's
    optical frame, and points (N, 3) [m] on it in the laser frame: the ends of beams (z = 0), or other known points."""

    normal: FloatArray
    distance: float
    points: FloatArray


@dataclass(frozen=True, slots=True)
class Extrinsics:
    """`camera_from_laser`, the rms [m] of the points' distances to their planes, and the number of inliers."""

    camera_from_laser: Pose3
    rms_m: float
    points: int


def extrinsics_from_planes(views: Sequence[PlaneView], guess: Pose3 | None = None) -> Extrinsics:
    """Return the transform from laser to camera coordinates that puts the points on their planes.

    Without a `guess` (camera_from_laser, right within some 20 degrees and decimetres) the linear solution starts the
    refinement; it needs points of beams only.

    Raises:
        ThinData: too few views, or planes so much alike that a motion of the camera along them is not observable.
        CalibrationError: no transform explains the points.
    """
    views = [view for view in views if len(view.points) >= 2]
    if len(views) < LEAST_VIEWS:
        raise ThinData(f"{len(views)} views of planes are too few: show at least {LEAST_VIEWS}, turned differently")
    normals = np.concatenate([np.repeat(view.normal[None], len(view.points), axis=0) for view in views])
    distances = np.concatenate([np.full(len(view.points), view.distance) for view in views])
    points = np.concatenate([view.points for view in views])
    # A view of many points must not outweigh a view of few.
    weights = np.concatenate([np.full(len(view.points), 1.0 / np.sqrt(len(view.points))) for view in views])
    pose = guess or _linear(normals, distances, points, weights)
    kept = np.ones(len(points), bool)
    for _ in range(3):
        pose = _refined(pose, normals[kept], distances[kept], points[kept], weights[kept])
        off = np.abs(_off(pose, normals, distances, points))
        kept = off < max(3.0 * 1.4826 * float(np.median(off)), _LEAST_OUTLIER)
    rms = float(np.sqrt(np.mean(off[kept] ** 2)))
    if rms > _MOST_RMS or kept.mean() < 0.5:
        raise CalibrationError(
            f"the points stay {rms:.3f} m off their planes: check that scans and images are of the same moments"
        )
    return Extrinsics(pose, rms, int(kept.sum()))


def _refined(
    start: Pose3, normals: FloatArray, distances: FloatArray, points: FloatArray, weights: FloatArray
) -> Pose3:
    """Return the least-squares transform, starting from one near it."""
    from scipy.optimize import least_squares  # here, since every command reads calibration files and few fit anything
    from scipy.spatial.transform import Rotation

    def residuals(p: FloatArray) -> FloatArray:
        return weights * _off(_pose(p), normals, distances, points)

    first = np.concatenate([Rotation.from_matrix(start.rotation).as_rotvec(), start.translation])
    fit = least_squares(residuals, first)
    if np.linalg.cond(fit.jac) > _MOST_CONDITION:
        raise ThinData(_ALIKE)
    return _pose(fit.x)


def _pose(p: FloatArray) -> Pose3:
    from scipy.spatial.transform import Rotation

    return Pose3(np.asarray(Rotation.from_rotvec(p[:3]).as_matrix(), np.float64), p[3:])


def _off(pose: Pose3, normals: FloatArray, distances: FloatArray, points: FloatArray) -> FloatArray:
    """Return the signed distances (N,) [m] of the points from their planes."""
    off: FloatArray = (normals * (points @ pose.rotation.T + pose.translation)).sum(axis=1) - distances
    return off


def _linear(normals: FloatArray, distances: FloatArray, points: FloatArray, weights: FloatArray) -> Pose3:
    """Return the rigid transform nearest to the solution of n . (x r1 + y r2 + t) = d, linear in r1, r2 and t."""
    if np.abs(points[:, 2]).max() > 1e-9:
        raise ThinData("points off the laser's plane need a guess of the camera's pose: measure it with a tape")
    equations = weights[:, None] * np.hstack([points[:, :1] * normals, points[:, 1:2] * normals, normals])
    scales = np.linalg.norm(equations, axis=0)
    if scales.min() < 1e-9 or np.linalg.cond(equations / scales) > _MOST_CONDITION:
        raise ThinData(_ALIKE)
    answer, *_ = np.linalg.lstsq(equations, weights * distances, rcond=None)
    r1, r2 = answer[:3], answer[3:6]
    u, _, vt = np.linalg.svd(np.stack([r1, r2, np.cross(r1, r2)], axis=1))
    return Pose3(u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt, np.asarray(answer[6:], np.float64))
