"""The largest planes in a depth image: samples of three points, and a fit to all that agree."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from waychair.types import BoolArray, Float32Array, FloatArray

_TRIALS = 200
_MOST_POINTS = 4000
_FARTHEST = 5.0  # [m]: beyond it, the noise of depth cameras hides what is flat
_TOLERANCE = 0.015  # [m] at no distance ...
_TOLERANCE_FAR = 0.003  # [1/m] ... and per square metre of it
_LEAST_PART = 0.08


@dataclass(frozen=True, slots=True)
class Plane:
    """Unit normal (3,) with normal . X = distance > 0 [m] in the optical frame; `extent` (2, 3) [m]: corners of the box
    round its points."""

    normal: FloatArray
    distance: float
    extent: FloatArray


def points_from_depth(depth: Float32Array, camera_matrix: FloatArray) -> FloatArray:
    """(N, 3) [m] in the optical frame, of the pixels that have a depth."""
    rows, cols = np.nonzero(np.isfinite(depth) & (depth > 0.0))
    z = depth[rows, cols].astype(float)
    x = (cols - camera_matrix[0, 2]) / camera_matrix[0, 0] * z
    y = (rows - camera_matrix[1, 2]) / camera_matrix[1, 1] * z
    return np.stack([x, y, z], axis=1)


def planes_from_depth(
    depth: Float32Array, camera_matrix: FloatArray, rng: np.random.Generator, most: int = 4
) -> tuple[Plane, ...]:
    """Up to `most` planes, the largest first, each of at least 8 % of the points (Fischler and Bolles, RANSAC, 1981)."""
    points = points_from_depth(depth, camera_matrix)
    points = points[points[:, 2] < _FARTHEST]
    if len(points) > _MOST_POINTS:
        points = points[rng.choice(len(points), _MOST_POINTS, replace=False)]
    least = max(50, round(_LEAST_PART * len(points)))
    planes: list[Plane] = []
    while len(planes) < most and len(points) >= least:
        on = _best_sample(points, rng)
        for _ in range(3):  # the plane of all points that agree, and then of those that agree with that
            if on.sum() < least:
                return tuple(planes)
            normal, distance = _fit(points[on])
            on = _agree(points, normal, distance)
        kept = points[on]
        planes.append(Plane(normal, distance, np.array([kept.min(axis=0), kept.max(axis=0)])))
        points = points[~on]
    return tuple(planes)


def _best_sample(points: FloatArray, rng: np.random.Generator) -> BoolArray:
    best = np.zeros(len(points), bool)
    for _ in range(_TRIALS):
        a, b, c = points[rng.choice(len(points), 3, replace=False)]
        normal = np.cross(b - a, c - a)
        length = float(np.linalg.norm(normal))
        if length < 1e-3:
            continue
        on = _agree(points, normal / length, float(normal @ a) / length)
        if on.sum() > best.sum():
            best = on
    return best


def _agree(points: FloatArray, normal: FloatArray, distance: float) -> BoolArray:
    tolerance = _TOLERANCE + _TOLERANCE_FAR * points[:, 2] ** 2
    agree: BoolArray = np.abs(points @ normal - distance) < tolerance
    return agree


def _fit(points: FloatArray) -> tuple[FloatArray, float]:
    """Plane of least squares, each point by the inverse of its depth's variance, which grows with z^4."""
    weights = 1.0 / np.maximum(points[:, 2], 0.3) ** 4
    middle = (weights[:, None] * points).sum(axis=0) / weights.sum()
    spread = (weights[:, None] * (points - middle)).T @ (points - middle)
    normal = np.linalg.eigh(spread)[1][:, 0]
    distance = float(normal @ middle)
    return (normal, distance) if distance >= 0.0 else (-normal, -distance)
