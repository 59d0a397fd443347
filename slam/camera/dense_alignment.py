"""Dense alignment: the camera's motion between two pictures from all pixels of coarse levels, robust to blur.

The motion minimises the difference in brightness between each pixel with depth of the earlier picture and its
projection into the later one (direct alignment with depth: Kerl, Sturm, Cremers, ICRA 2013). It is solved in the
inverse compositional form (Baker and Matthews, IJCV 2004) with Huber's weights; brightness and contrast may change.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit

from waychair.slam.camera.reprojection import NEAREST, move_kernel
from waychair.types import Bytes, Float32Array, FloatArray, Pose3

_ITERATIONS = 15
_HUBER = 8.0  # [grey levels]
_LEAST = 100  # pixels


@dataclass(frozen=True, slots=True)
class DenseFit:
    """The aligned now_from_before, the mean loss [grey levels], and the share of pixels that stay in the picture."""

    now_from_before: Pose3
    loss: float
    share: float


def align_pictures(
    before: Sequence[Bytes],
    depth: Float32Array,
    now: Sequence[Bytes],
    camera: FloatArray,
    guess: Pose3,
    levels: Sequence[int],
) -> DenseFit:
    """Return the camera's motion between two pyramids, starting at `guess`.

    `depth` (H, W) [m] belongs to the earlier picture, `camera` (4,) to the finest level. `levels` are used in order,
    coarse first.
    """
    turn, shift = guess.rotation.copy(), guess.translation.copy()
    loss, share = math.inf, 0.0
    for level in levels:
        scale = 2**level
        # pixels of a pyramid's level, and their depths, lie at multiples of its scale
        coarse, shrunken = np.ascontiguousarray(depth[::scale, ::scale]), camera / scale
        points, slopes, bright = slopes_kernel(before[level], coarse, shrunken)
        loss, share = dense_kernel(
            points=points,
            slopes=slopes,
            bright=bright,
            now=now[level],
            camera=shrunken,
            turn=turn,
            shift=shift,
            iterations=_ITERATIONS,
        )
    return DenseFit(Pose3(turn, shift), loss, share)


@njit(cache=True, nogil=True)
def slopes_kernel(before: Bytes, depth: Float32Array, camera: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return for each pixel with depth its point (N, 3) [m], its Jacobian (N, 6) and its brightness (N,).

    The Jacobian is the change of brightness with a small rotation and translation of the point.
    """
    height, width = min(before.shape[0], depth.shape[0]), min(before.shape[1], depth.shape[1])
    points = np.empty((height * width, 3))
    slopes = np.empty((height * width, 6))
    bright = np.empty(height * width)
    count = 0
    for row in range(1, height - 1):
        for column in range(1, width - 1):
            z = float(depth[row, column])
            if not z > NEAREST:
                continue
            gx = 0.5 * (float(before[row, column + 1]) - float(before[row, column - 1])) * camera[0]
            gy = 0.5 * (float(before[row + 1, column]) - float(before[row - 1, column])) * camera[1]
            x, y = (column - camera[2]) / camera[0], (row - camera[3]) / camera[1]
            away = -(gx * x + gy * y)
            points[count, 0], points[count, 1], points[count, 2] = x * z, y * z, z
            bright[count] = before[row, column]
            slopes[count, 0] = away * y - gy
            slopes[count, 1] = gx - away * x
            slopes[count, 2] = gy * x - gx * y
            slopes[count, 3], slopes[count, 4], slopes[count, 5] = gx / z, gy / z, away / z
            count += 1
    return points[:count], slopes[:count], bright[:count]


@njit(cache=True, nogil=True)
def dense_kernel(
    points: FloatArray,
    slopes: FloatArray,
    bright: FloatArray,
    now: Bytes,
    camera: FloatArray,
    turn: FloatArray,
    shift: FloatArray,
    iterations: int,
) -> tuple[float, float]:
    """Refine now_from_before (turn, shift) in place; return the mean Huber loss [grey levels] and the share inside."""
    height, width = now.shape
    count = len(points)
    if count < _LEAST:
        return np.inf, 0.0
    offset, gain, loss, inside = 0.0, 1.0, np.inf, 0
    back = np.empty((3, 3))
    for _ in range(iterations):
        normal, gradient = np.zeros((8, 8)), np.zeros(8)
        total, inside = 0.0, 0
        for n in range(count):
            px, py, pz = points[n, 0], points[n, 1], points[n, 2]
            z = turn[2, 0] * px + turn[2, 1] * py + turn[2, 2] * pz + shift[2]
            if z < NEAREST:
                continue
            u = camera[0] * (turn[0, 0] * px + turn[0, 1] * py + turn[0, 2] * pz + shift[0]) / z + camera[2]
            v = camera[1] * (turn[1, 0] * px + turn[1, 1] * py + turn[1, 2] * pz + shift[1]) / z + camera[3]
            if not (0.0 <= u < width - 1.001 and 0.0 <= v < height - 1.001):
                continue
            c, r = int(u), int(v)
            a, b = u - c, v - r
            seen = (1.0 - b) * ((1.0 - a) * now[r, c] + a * now[r, c + 1]) + b * (
                (1.0 - a) * now[r + 1, c] + a * now[r + 1, c + 1]
            )
            away = seen - gain * bright[n] - offset
            size = abs(away)
            weight = 1.0 if size <= _HUBER else _HUBER / size
            total += min(size, _HUBER * 3.0)
            inside += 1
            for i in range(6):
                gradient[i] += weight * slopes[n, i] * away
                for j in range(i, 6):
                    normal[i, j] += weight * slopes[n, i] * slopes[n, j]
                normal[i, 6] += weight * slopes[n, i]
                normal[i, 7] += weight * slopes[n, i] * bright[n]
            gradient[6] += weight * away
            gradient[7] += weight * away * bright[n]
            normal[6, 6] += weight
            normal[6, 7] += weight * bright[n]
            normal[7, 7] += weight * bright[n] * bright[n]
        if inside < _LEAST:
            return np.inf, 0.0
        loss = total / inside
        for i in range(8):
            for j in range(i):
                normal[i, j] = normal[j, i]
            normal[i, i] += 1e-6 * normal[i, i] + 1e-9
        step = np.asarray(np.linalg.solve(normal, gradient), np.float64)
        offset += step[6]
        gain += step[7]
        # inverse compositional: the step moves the earlier picture, so the pose takes its inverse
        back[:] = np.eye(3)
        back_shift = np.zeros(3)
        move_kernel(back, back_shift, step[:6])
        inverse = np.ascontiguousarray(back.T)
        inverse_shift = -(inverse @ back_shift)
        moved_shift = turn @ inverse_shift + shift
        moved_turn = turn @ inverse
        for i in range(3):
            shift[i] = moved_shift[i]
            for j in range(3):
                turn[i, j] = moved_turn[i, j]
        if np.abs(step[:6]).max() < 1e-5:
            break
    return loss, inside / count
