"""The camera's pose from known points in space that it sees: robust least squares on pixels and inverse depths.

A point observed at u, v [px] and inverse depth 1/z [1/m] gives three residuals; without depth (nan), two. The fourth
number of an observation is the factor on its pixel error. The error of a structured-light or stereo camera is uniform
in inverse depth (Khoshelham and Oude Elberink, Sensors 2012), so one standard deviation serves near and far.

Kernels take the rotation (3, 3) and translation (3,) of camera_from_map, and the camera as fx, fy, cx, cy.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from waychair.types import BoolArray, FloatArray, Pose3

NEAREST = 0.05
"""Points nearer than this to the camera's plane [m] count as behind it."""


@dataclass(frozen=True, slots=True)
class NoiseModel:
    """The noise of observations in a picture: standard deviations of a pixel [px] and of inverse depth [1/m]."""

    pixel: float = 0.7
    inverse_depth: float = 0.005


HUBER_WIDTH = 1.5
"""Residuals beyond this [sigma] count linearly."""

OUTLIER_CHI_SQUARE = 9.2
"""A pixel of a greater chi-square is an outlier (99 % of 2 degrees of freedom)."""


@dataclass(frozen=True, slots=True)
class PoseFit:
    """The fitted camera_from_map, its inliers (N,), and the information (6, 6) of rotation [rad] and translation [m] of
    the camera in its own frame."""

    camera_from_map: Pose3
    inliers: BoolArray
    information: FloatArray


def fit_pose(
    points: FloatArray, observed: FloatArray, camera: FloatArray, guess: Pose3, noise: NoiseModel, iterations: int = 12
) -> PoseFit:
    """Return the pose near `guess` (camera_from_map) at which points (N, 3) [m] are seen as observed (N, 4).

    Gauss-Newton with Huber's weights, then without the outliers; camera (4,) fx, fy, cx, cy.
    """
    turn, shift = guess.rotation.copy(), guess.translation.copy()
    sigma = np.array([noise.pixel, noise.inverse_depth, HUBER_WIDTH])
    chi, information = fit_kernel(
        points=np.ascontiguousarray(points),
        observed=np.ascontiguousarray(observed),
        camera=camera,
        turn=turn,
        shift=shift,
        sigma=sigma,
        limit=OUTLIER_CHI_SQUARE,
        iterations=iterations,
    )
    return PoseFit(Pose3(turn, shift), chi <= OUTLIER_CHI_SQUARE, information)


def project(points: FloatArray, camera_from_map: Pose3, camera: FloatArray) -> FloatArray:
    """Return u, v [px] and 1/z [1/m] (N, 3) of points (N, 3) [m] in map; nan behind the camera."""
    inside = points @ camera_from_map.rotation.T + camera_from_map.translation
    z = np.where(inside[:, 2] > NEAREST, inside[:, 2], np.nan)
    return np.stack([camera[0] * inside[:, 0] / z + camera[2], camera[1] * inside[:, 1] / z + camera[3], 1 / z], axis=1)


def back_project(observed: FloatArray, camera: FloatArray) -> FloatArray:
    """Return points (N, 3) [m] in the optical frame of observations (N, 4); nan without depth."""
    z = 1.0 / observed[:, 2]
    return np.stack(
        [(observed[:, 0] - camera[2]) / camera[0] * z, (observed[:, 1] - camera[3]) / camera[1] * z, z], axis=1
    )


def unrolled(observed: FloatArray, velocity: FloatArray, row_time: FloatArray, camera: FloatArray) -> FloatArray:
    """Return observations (N, 4) corrected for the rolling shutter: as if all rows were exposed with the middle one.

    `velocity` (6,) is the motion of points in the camera's frame, rotation [rad/s] and translation [m/s]; `row_time`
    (N,) [s] is each one's exposure time. The correction is of first order, since a picture takes some hundredths of a
    second; without depth only the rotation counts. Negated times give the inverse.
    """
    x, y = (observed[:, 0] - camera[2]) / camera[0], (observed[:, 1] - camera[3]) / camera[1]
    inverse = np.nan_to_num(observed[:, 2])
    (wx, wy, wz), (tx, ty, tz) = velocity[:3], velocity[3:]
    along = wx * y - wy * x + tz * inverse  # relative change of depth
    dx = wy - wz * y + tx * inverse - x * along
    dy = wz * x - wx + ty * inverse - y * along
    moved = np.stack([camera[0] * dx, camera[1] * dy, -observed[:, 2] * along], axis=1)
    result = observed.copy()
    result[:, :3] -= moved * row_time[:, None]
    return result


def pinhole(matrix: FloatArray) -> FloatArray:
    """Return fx, fy, cx, cy (4,) of a camera matrix (3, 3)."""
    return np.array([matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]])


@njit(cache=True)
def residual_kernel(
    point: FloatArray,
    seen: FloatArray,
    camera: FloatArray,
    turn: FloatArray,
    shift: FloatArray,
    sigma: FloatArray,
    error: FloatArray,
    by_pose: FloatArray,
    by_point: FloatArray,
) -> tuple[float, float]:
    """Compute the residual of one observation; return the chi-squares of pixel (-1 behind the camera) and depth.

    Filled in: the whitened error (3,), and its derivatives by a left perturbation (rotation, translation) of
    camera_from_map (3, 6) and by the point in the camera's frame (3, 3), all scaled by the root of Huber's weight.
    Pixel and depth are weighted separately: a corner on an object's edge has a good pixel and a bad depth. sigma (3,)
    holds the standard deviations of pixel and inverse depth, and Huber's width.
    """
    x = turn[0, 0] * point[0] + turn[0, 1] * point[1] + turn[0, 2] * point[2] + shift[0]
    y = turn[1, 0] * point[0] + turn[1, 1] * point[1] + turn[1, 2] * point[2] + shift[1]
    z = turn[2, 0] * point[0] + turn[2, 1] * point[1] + turn[2, 2] * point[2] + shift[2]
    if z < NEAREST:
        return -1.0, 0.0
    inverse, wide = 1.0 / z, sigma[2]
    error[0] = (camera[0] * x * inverse + camera[2] - seen[0]) / (sigma[0] * seen[3])
    error[1] = (camera[1] * y * inverse + camera[3] - seen[1]) / (sigma[0] * seen[3])
    pixel = error[0] * error[0] + error[1] * error[1]
    wp = math.sqrt(min(1.0, wide / math.sqrt(pixel))) if pixel > 0.0 else 1.0
    error[0] *= wp
    error[1] *= wp
    wp /= sigma[0] * seen[3]
    error[2] = depth = wd = 0.0
    if not math.isnan(seen[2]):
        error[2] = (inverse - seen[2]) / sigma[1]
        depth = error[2] * error[2]
        wd = math.sqrt(min(1.0, wide / abs(error[2]))) if depth > 0.0 else 1.0
        error[2] *= wd
        wd /= sigma[1]
    by_point[0, 0], by_point[0, 1] = wp * camera[0] * inverse, 0.0
    by_point[0, 2] = -wp * camera[0] * x * inverse * inverse
    by_point[1, 0], by_point[1, 1] = 0.0, wp * camera[1] * inverse
    by_point[1, 2] = -wp * camera[1] * y * inverse * inverse
    by_point[2, 0], by_point[2, 1], by_point[2, 2] = 0.0, 0.0, -wd * inverse * inverse
    for r in range(3):
        a, b, c = by_point[r, 0], by_point[r, 1], by_point[r, 2]
        by_pose[r, 0], by_pose[r, 1], by_pose[r, 2] = c * y - b * z, a * z - c * x, b * x - a * y
        by_pose[r, 3], by_pose[r, 4], by_pose[r, 5] = a, b, c
    return pixel, depth


@njit(cache=True)
def huber_loss(chi: float, wide: float) -> float:
    """Return Huber's loss of a chi-square: unchanged up to the width [sigma], then linear in its root."""
    return chi if chi <= wide * wide else wide * (2.0 * math.sqrt(chi) - wide)


@njit(cache=True)
def move_kernel(turn: FloatArray, shift: FloatArray, step: FloatArray) -> None:
    """Apply a small motion (rotation vector, translation) on the left of camera_from_map, in place."""
    angle = math.sqrt(step[0] ** 2 + step[1] ** 2 + step[2] ** 2)
    a = math.sin(angle) / angle if angle > 1e-9 else 1.0
    b = (1.0 - math.cos(angle)) / (angle * angle) if angle > 1e-4 else 0.5
    x, y, z = step[0], step[1], step[2]
    small = np.empty((3, 3))
    small[0, 0] = 1.0 - b * (y * y + z * z)
    small[0, 1] = b * x * y - a * z
    small[0, 2] = b * x * z + a * y
    small[1, 0] = b * x * y + a * z
    small[1, 1] = 1.0 - b * (x * x + z * z)
    small[1, 2] = b * y * z - a * x
    small[2, 0] = b * x * z - a * y
    small[2, 1] = b * y * z + a * x
    small[2, 2] = 1.0 - b * (x * x + y * y)
    turned = small @ turn
    shifted = small @ shift
    for r in range(3):
        shift[r] = shifted[r] + step[3 + r]
        for c in range(3):
            turn[r, c] = turned[r, c]


@njit(cache=True)
def fit_kernel(
    points: FloatArray,
    observed: FloatArray,
    camera: FloatArray,
    turn: FloatArray,
    shift: FloatArray,
    sigma: FloatArray,
    limit: float,
    iterations: int,
) -> tuple[FloatArray, FloatArray]:
    """Optimise turn and shift in place; return the pixels' chi-squares (N,) and the information (6, 6).

    sigma (3,) holds the standard deviations of pixel and inverse depth, and Huber's width. Iteration stops at
    negligible steps.
    """
    error, by_pose, by_point = np.empty(3), np.empty((3, 6)), np.empty((3, 3))
    chi, normal = np.empty(len(points)), np.zeros((6, 6))
    for iteration in range(iterations + 1):
        strict = iteration >= iterations // 2  # outliers are excluded from now on
        normal[:] = 0.0
        gradient = np.zeros(6)
        for n in range(len(points)):
            value, _ = residual_kernel(points[n], observed[n], camera, turn, shift, sigma, error, by_pose, by_point)
            chi[n] = value if value >= 0.0 else np.inf
            if value < 0.0 or (strict and value > limit):
                continue
            for i in range(6):
                for r in range(3):
                    gradient[i] += by_pose[r, i] * error[r]
                    for j in range(6):
                        normal[i, j] += by_pose[r, i] * by_pose[r, j]
        if iteration == iterations:
            break
        for i in range(6):
            normal[i, i] += 1e-6 * normal[i, i] + 1e-9
        step = np.asarray(-np.linalg.solve(normal, gradient), np.float64)
        move_kernel(turn, shift, step)
        if strict and np.abs(step).max() < 1e-6:
            iterations = iteration + 1
    return chi, normal
