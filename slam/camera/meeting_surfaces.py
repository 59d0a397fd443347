"""Surfaces of a depth picture, those that meet another picture's, and values between the pixels of pictures."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from waychair.types import FloatArray, IntArray, RgbdFrame

_GATE, _COSINE = 0.12, 0.85  # [m] and cosine of normals within which two surfaces are one
_BLOCK = 4  # px; side of the squares over which depth is averaged
_FLAT = 0.06  # largest relative step of depth within a square
_CREASE = 3.0  # largest spread about a surface's plane over the middle one
_REACH = 2  # squares; half the side of a surface


@dataclass(frozen=True, slots=True)
class Surfaces:
    """The planes seen in a depth picture, by squares (h, w): middle inverse depth [1/m] and its slopes across and down
    [1/m a square]; nan where there is a step or a hole. On a plane, inverse depth is linear across the picture.
    """

    inverse: FloatArray
    across: FloatArray
    down: FloatArray
    lag: FloatArray
    """Turn [rad] of things (3,) while one row of squares is exposed, of a rolling shutter."""

    @classmethod
    def of(cls, frame: RgbdFrame, rate: FloatArray) -> Surfaces:
        """Return the surfaces of a picture that was taken while things turned by `rate` (3,) [rad/s]."""
        depth = frame.depth
        height, width = (side // _BLOCK * _BLOCK for side in depth.shape)
        with np.errstate(divide="ignore", invalid="ignore"):
            inverse = 1.0 / depth[:height, :width].astype(np.float64)
            blocks = inverse.reshape(height // _BLOCK, _BLOCK, width // _BLOCK, _BLOCK)
            low, high, middle = blocks.min(axis=(1, 3)), blocks.max(axis=(1, 3)), blocks.mean(axis=(1, 3))
            middle[~(np.isfinite(middle) & (low > 0.0) & (high - low < _FLAT * middle))] = np.nan
        along = np.arange(-_REACH, _REACH + 1.0)
        even, slope = np.ones_like(along) / len(along), along / (along**2).sum()
        found = [cv2.sepFilter2D(middle, -1, *filters) for filters in ((even, even), (slope, even), (even, slope))]
        mean, across, down = (np.asarray(each, np.float64) for each in found)
        square = np.asarray(cv2.sepFilter2D(middle**2, -1, even, even), np.float64)
        # spread about the plane: where it is large, two surfaces meet, and the plane is neither's
        spread = square - mean**2 - (across**2 + down**2) * float((along**2).mean())
        if np.isfinite(spread).any():
            mean[~(spread <= _CREASE * np.nanmedian(spread) + 1e-9)] = np.nan
        return cls(mean, across, down, rate * frame.row_step * _BLOCK)

    def planes(self, camera: FloatArray, stride: int = 1) -> tuple[FloatArray, FloatArray]:
        """Return points (N, 3) [m] on the surfaces, row by row, and their normals, by the camera (4,) of squares."""
        rows, columns = (
            each.ravel() for each in np.mgrid[: self.inverse.shape[0] : stride, : self.inverse.shape[1] : stride]
        )
        inverse, across, down = (each[rows, columns] for each in (self.inverse, self.across, self.down))
        x, y = (columns - camera[2]) / camera[0], (rows - camera[3]) / camera[1]
        points = np.column_stack([x, y, np.ones(len(x))]) / inverse[:, None]
        # n with n . point = 1: the plane's inverse depth at any pixel is n . ray
        rest = inverse - across * (columns - camera[2]) - down * (rows - camera[3])
        normals = np.column_stack([across * camera[0], down * camera[1], rest])
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        if self.lag.any():
            late = (rows - 0.5 * len(self.inverse))[:, None] * self.lag
            points, normals = points - np.cross(late, points), normals - np.cross(late, normals)
        return points, normals


def of_squares(camera: FloatArray) -> FloatArray:
    """Return the camera (4,) for pictures of squares."""
    middle = 0.5 * (_BLOCK - 1)
    return np.array([*(camera[:2] / _BLOCK), *((camera[2:] - middle) / _BLOCK)])


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
