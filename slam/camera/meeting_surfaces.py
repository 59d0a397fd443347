"""Surfaces of one picture that meet those of another, and values between the pixels of pictures."""

from __future__ import annotations

import numpy as np

from waychair.types import FloatArray, IntArray

_GATE, _COSINE = 0.12, 0.85  # [m] and cosine of normals within which two surfaces are one


def meeting(
    points: FloatArray,
    turned: FloatArray,
    new: FloatArray,
    facing: FloatArray,
    camera: FloatArray,
    shape: tuple[int, ...],
) -> tuple[IntArray, IntArray]:
    """Return which points (N, 3) with normals `turned` meet a surface of the new picture, and the squares they meet."""
    height, width = shape
    with np.errstate(divide="ignore", invalid="ignore"):
        at = camera[:2] * points[:, :2] / points[:, 2:] + camera[2:]
        inside = (points[:, 2] > 0.0) & (at > -0.5).all(axis=1) & (at < (width - 0.5, height - 0.5)).all(axis=1)
    met = np.flatnonzero(inside)
    cells = np.rint(at[met]).astype(np.int64)
    squares = cells[:, 1] * width + cells[:, 0]
    gap = points[met] - new[squares]
    along = np.abs((gap * facing[squares]).sum(axis=1))
    with np.errstate(invalid="ignore"):
        near = (along < _GATE) & (np.linalg.norm(gap, axis=1) < 2.0 * _GATE)
        near &= (turned[met] * facing[squares]).sum(axis=1) > _COSINE
    return met[near], squares[near]


def between_pixels(pictures: FloatArray, owner: IntArray, at: FloatArray) -> FloatArray:
    """Return the values (N,) between four pixels of pictures (K, H, W), at pixels (N, 2) of pictures `owner` (N,)."""
    height, width = pictures.shape[1:]
    with np.errstate(invalid="ignore"):
        inside = np.asarray((at >= 0.0).all(axis=1) & (at <= (width - 1.001, height - 1.001)).all(axis=1))
    safe = np.where(inside[:, None], at, 0.0)
    low = safe.astype(np.int64)
    (x, y), (u, v) = (safe - low).T, low.T
    row = [pictures[owner, v + k, u] * (1.0 - x) + pictures[owner, v + k, u + 1] * x for k in range(2)]
    return np.where(inside, row[0] * (1.0 - y) + row[1] * y, np.nan)
