"""Registration of two depth pictures: point-to-plane ICP with projective data association.

Projective association (Blais and Levine 1995; as in KinectFusion, Newcombe et al., ISMAR 2011) needs no search tree.
The gates are RTAB-Map's (0.23.8, RegistrationIcp): the guess is kept if the correction is too large, if too few points
match, or if the surfaces leave a direction unconstrained.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from waychair.slam.camera.picture_registration import angle_between
from waychair.slam.camera.reprojection import NEAREST, move_kernel
from waychair.types import Float32Array, FloatArray, Pose3

_EDGE = 0.05  # relative step of neighbouring depths at an edge between two objects


_ITERATIONS = 20  # RTAB-Map's Icp/Iterations
_MAX_DISTANCE = 0.1  # [m] between matched points (Icp/MaxCorrespondenceDistance)
_MAX_NORMAL = 0.5  # [rad] between their normals
_MAX_TRANSLATION, _MAX_ROTATION = 0.2, 0.78  # [m], [rad] of the correction (Icp/MaxTranslation, Icp/MaxRotation)
_MIN_SHARE = 0.1  # least share of matched points (Icp/CorrespondenceRatio)
_MIN_COMPLEXITY = 0.02  # least share of the normals in any direction (Icp/PointToPlaneMinComplexity)


class IcpRefusal(enum.Enum):
    """The reason why a refinement is not used."""

    NO_DEPTH = "too few points with depth"
    FEW_MEET = "too few points meet"
    FLAT = "the surfaces leave a direction free"
    FAR = "the correction is too large"


@dataclass(frozen=True, slots=True)
class IcpFit:
    """The refined `old_from_new` (the guess if refused), mean distance to the planes [m], share of matched points, and
    the reason of a refusal."""

    old_from_new: Pose3
    error: float
    share: float
    refusal: IcpRefusal | None = None


def refine_by_depth(old: Float32Array, new: Float32Array, camera: FloatArray, guess: Pose3) -> IcpFit:
    """Return the `old_from_new` that aligns two depth pictures (H, W) [m] of one camera (4,), starting at a guess."""
    old_points, old_normals = cloud_kernel(np.ascontiguousarray(old), camera)
    new_points, new_normals = cloud_kernel(np.ascontiguousarray(new), camera)
    known = np.isfinite(new_normals[..., 0])
    points, normals = new_points[known], new_normals[known]
    if len(points) < 100:
        return IcpFit(guess, math.nan, 0.0, IcpRefusal.NO_DEPTH)
    turn, shift = guess.rotation.copy(), guess.translation.copy()
    min_cosine = math.cos(_MAX_NORMAL)
    error, met, scatter = 0.0, 0, np.eye(3)
    for _ in range(_ITERATIONS):
        normal, gradient, error, met, scatter = meet_kernel(
            old_points=old_points,
            old_normals=old_normals,
            points=points,
            normals=normals,
            camera=camera,
            turn=turn,
            shift=shift,
            max_distance=_MAX_DISTANCE,
            min_cosine=min_cosine,
        )
        if met < max(50.0, _MIN_SHARE * len(points)):
            return IcpFit(guess, error, met / len(points), IcpRefusal.FEW_MEET)
        if np.linalg.eigvalsh(scatter / met)[0] < _MIN_COMPLEXITY:
            return IcpFit(guess, error, met / len(points), IcpRefusal.FLAT)
        step = np.asarray(-np.linalg.solve(normal, gradient), np.float64)
        move_kernel(turn, shift, step)
        if np.abs(step).max() < 1e-5:
            break
    found = Pose3(turn, shift)
    moved = float(np.linalg.norm(found.translation - guess.translation))
    if moved > _MAX_TRANSLATION or angle_between(found, guess) > _MAX_ROTATION:
        return IcpFit(guess, error, met / len(points), IcpRefusal.FAR)
    return IcpFit(found, error, met / len(points))


@njit(cache=True, nogil=True)
def cloud_kernel(depth: Float32Array, camera: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return points and normals (H, W, 3) of a depth picture; nan at holes, normals also at edges and the border.

    A normal is that of the plane through the four neighbours, and points towards the camera.
    """
    height, width = depth.shape
    points, normals = np.full((height, width, 3), np.nan), np.full((height, width, 3), np.nan)
    for row in range(height):
        for column in range(width):
            z = float(depth[row, column])
            if not z > 0.0:
                continue
            u, v = (column - camera[2]) / camera[0], (row - camera[3]) / camera[1]
            points[row, column, 0], points[row, column, 1], points[row, column, 2] = u * z, v * z, z
            if not (0 < row < height - 1 and 0 < column < width - 1):
                continue
            left, right = float(depth[row, column - 1]), float(depth[row, column + 1])
            above, below = float(depth[row - 1, column]), float(depth[row + 1, column])
            rough = max(max(abs(left - z), abs(right - z)), max(abs(above - z), abs(below - z)))
            # negated so that nan counts as rough
            if not (rough < _EDGE * z and left > 0.0 and right > 0.0 and above > 0.0 and below > 0.0):
                continue
            du, dv = 0.5 * (right - left) * camera[0], 0.5 * (below - above) * camera[1]
            nx, ny, nz = du, dv, -(z + u * du + v * dv)
            length = math.sqrt(nx * nx + ny * ny + nz * nz)
            normals[row, column, 0], normals[row, column, 1], normals[row, column, 2] = (
                nx / length,
                ny / length,
                nz / length,
            )
    return points, normals


@njit(cache=True, nogil=True)
def meet_kernel(
    old_points: FloatArray,
    old_normals: FloatArray,
    points: FloatArray,
    normals: FloatArray,
    camera: FloatArray,
    turn: FloatArray,
    shift: FloatArray,
    max_distance: float,
    min_cosine: float,
) -> tuple[FloatArray, FloatArray, float, int, FloatArray]:
    """Return the normal equations (6, 6), (6,) of all matched points, their mean distance to the surface, their number,
    and the sum of the outer products (3, 3) of the surface normals."""
    normal, gradient, scatter = np.zeros((6, 6)), np.zeros(6), np.zeros((3, 3))
    row = np.empty(6)
    total, met = 0.0, 0
    for n in range(len(points)):
        px, py, pz = points[n, 0], points[n, 1], points[n, 2]
        x = turn[0, 0] * px + turn[0, 1] * py + turn[0, 2] * pz + shift[0]
        y = turn[1, 0] * px + turn[1, 1] * py + turn[1, 2] * pz + shift[1]
        z = turn[2, 0] * px + turn[2, 1] * py + turn[2, 2] * pz + shift[2]
        if z <= NEAREST:
            continue
        c, r = round(camera[0] * x / z + camera[2]), round(camera[1] * y / z + camera[3])
        if not (0 <= c < old_points.shape[1] and 0 <= r < old_points.shape[0]):
            continue
        facing = old_normals[r, c]
        if math.isnan(facing[0]):
            continue
        dx, dy, dz = x - old_points[r, c, 0], y - old_points[r, c, 1], z - old_points[r, c, 2]
        cosine = 0.0
        for i in range(3):
            for j in range(3):
                cosine += facing[i] * turn[i, j] * normals[n, j]
        if dx * dx + dy * dy + dz * dz > max_distance * max_distance or cosine < min_cosine:
            continue
        error = dx * facing[0] + dy * facing[1] + dz * facing[2]
        row[0], row[1], row[2] = (
            y * facing[2] - z * facing[1],
            z * facing[0] - x * facing[2],
            x * facing[1] - y * facing[0],
        )
        row[3], row[4], row[5] = facing[0], facing[1], facing[2]
        for i in range(6):
            gradient[i] += row[i] * error
            for j in range(6):
                normal[i, j] += row[i] * row[j]
        for i in range(3):
            for j in range(3):
                scatter[i, j] += facing[i] * facing[j]
        total += abs(error)
        met += 1
    for i in range(6):
        normal[i, i] += 1e-9
    return normal, gradient, total / max(met, 1), met, scatter
