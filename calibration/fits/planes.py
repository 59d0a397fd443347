"""Detection of the largest planes in a depth image by RANSAC and least squares."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from waychair.types import BoolArray, Float32Array, FloatArray

_TRIALS = 200
_MOST_POINTS = 4000
_FARTHEST = 5.0  # m; depth noise hides planes beyond it
_TOLERANCE = 0.015  # m; a point's tolerance at zero depth ...
_TOLERANCE_FAR = 0.003  # 1/m; ... and its growth with the squared depth
_LEAST_PART = 0.08  # share of all points


@dataclass(frozen=True, slots=True)
class Plane:
    """A plane normal . X = distance > 0 [m] with unit normal (3,), in the optical frame; `extent` (2, 3) [m] are the
    corners of the box round its points."""

    normal: FloatArray
    distance: float
    extent: FloatArray


def points_from_depth(depth: Float32Array, camera_matrix: FloatArray) -> FloatArray:
    """Return the points (N, 3) [m] in the optical frame of all pixels with a depth."""
    rows, cols = np.nonzero(np.isfinite(depth) & (depth > 0.0))
    z = depth[rows, cols].astype(float)
    x = (cols - camera_matrix[0, 2]) / camera_matrix[0, 0] * z
    y = (rows - camera_matrix[1, 2]) / camera_matrix[1, 1] * z
    return np.stack([x, y, z], axis=1)


def planes_from_depth(
    depth: Float32Array, camera_matrix: FloatArray, rng: np.random.Generator, most: int = 4
) -> tuple[Plane, ...]:
    """Return up to `most` planes, largest first, each with 8 % of the points or more (Fischler and Bolles, RANSAC,
    1981)."""
    points = points_from_depth(depth, camera_matrix)
    points = points[points[:, 2] < _FARTHEST]
    if len(points) > _MOST_POINTS:
        points = points[rng.choice(len(points), _MOST_POINTS, replace=False)]
    least = max(50, round(_LEAST_PART * len(points)))
    planes: list[Plane] = []
    while len(planes) < most and len(points) >= least:
        on = _best_sample(points, rng)
        for _ in range(3):  # refit to all points that agree with the last plane
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
    """Fit a plane by least squares, each point weighted by the inverse variance of its depth, which grows with z^4."""
    weights = 1.0 / np.maximum(points[:, 2], 0.3) ** 4
    middle = (weights[:, None] * points).sum(axis=0) / weights.sum()
    spread = (weights[:, None] * (points - middle)).T @ (points - middle)
    normal = np.linalg.eigh(spread)[1][:, 0]
    distance = float(normal @ middle)
    return (normal, distance) if distance >= 0.0 else (-normal, -distance)
