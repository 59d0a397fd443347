"""The laser's line in a picture: one row for each column, or none where it is not sure.

The laser shines in every other picture. The difference of two such pictures holds little but the line, as long as the
camera has not moved; one picture alone has to part the line from red marks. The middle of the line is the centroid of
the red light over a few rows (Fisher and Naidu, A comparison of algorithms for subpixel peak detection, 1996).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from waychair.types import Bytes, Float32Array, FloatArray, IntArray

LEAST_CONTRAST = 6.0
"""The line is this many times brighter than the noise of its column (one sigma, smoothed)."""

LEAST_LIGHT = 0.003
"""Least red light of the line in one pair of pictures, white is 1: below it the rounding of dark pixels looks like one."""

SECOND = 0.5
"""A second line in the same column is at most this part of the first; else nobody knows which is right."""

STEP = 1.2
"""Rows from one column to the next along one surface: 80 degrees of incidence at half a metre, more farther away."""

LEAST_RUN, LEAST_RUN_ALONE = 6, 24
"""Columns in a row that a line has: in a difference of pictures, and in one picture alone."""

_HALF_WIDTH = 3
"""Rows on both sides of the peak that hold the line."""

_APART = 7
"""Rows from the peak beyond which a second one is another line."""

_LINEAR = (np.arange(256, dtype=np.float32) / 255.0) ** 2
"""Light by pixel value: the camera's pictures are square roots of light."""

_RED = np.array([[1.0, -0.5, -0.5]], np.float32)

_SMOOTHED = 7
"""Columns over which a row is a mean, along one surface."""


@dataclass(frozen=True, slots=True)
class LineInPicture:
    """The line's row (W,) in each column, nan where it was not found."""

    rows: FloatArray

    def pixels(self) -> FloatArray:
        """Return (W, 2): column and row."""
        return np.column_stack([np.arange(len(self.rows), dtype=np.float64), self.rows])


def line_in_picture(lit: Bytes, dark: Bytes | None, rows: tuple[int, int]) -> LineInPicture:
    """Return the line in a picture with the laser on.

    Args:
        lit: picture (H, W, 3) with the laser on.
        dark: the same view with the laser off, from a camera that has not moved; None: there is none.
        rows: first row and row after the last one, in which the line can be (`rows_of_ranges`).
    """
    red = redness(lit, rows)
    if dark is None:
        return _line_in(red, rows, LEAST_RUN_ALONE, LEAST_LIGHT)
    return line_in_light(red - redness(dark, rows), 1.0, rows)


def line_in_light(red: Float32Array, pairs: float, rows: tuple[int, int]) -> LineInPicture:
    """Return the line in the red light that the laser adds, the mean of so many pairs of a lit and a dark picture.

    Noise and rounding fall with the root of the number of pairs, so that more pairs show fainter lines.

    Args:
        red: (rows, W), from `redness` of the lit pictures less that of the dark ones.
        pairs: number of pairs, at least 1.
        rows: the rows of `red` in the picture, as for `line_in_picture`.
    """
    return _line_in(red, rows, LEAST_RUN, LEAST_LIGHT / math.sqrt(pairs))


def _line_in(red: Float32Array, rows: tuple[int, int], width: int, least: float) -> LineInPicture:
    light = cv2.GaussianBlur(red, (5, 5), sigmaX=1.2, sigmaY=1.0)
    light = light - cv2.blur(light, (1, 41))
    middles = _centroids(red, _peaks(light, least))
    return LineInPicture(_in_runs(middles, width) + max(rows[0], 0))


def rows_of_ranges(
    nearest: float, farthest: float, focal: float, middle_row: float, baseline: float
) -> tuple[int, int]:
    """Return the rows [first, last) in which a level laser's line lies with its whole width, for depths between two
    limits [m]."""
    first, last = (int(middle_row + focal * baseline / away) for away in (farthest, nearest))
    return first - _HALF_WIDTH, last + _HALF_WIDTH + 1


def redness(picture: Bytes, rows: tuple[int, int]) -> Float32Array:
    """Return the red light (rows, W) above the mean of green and blue, so that a change of the room's light cancels."""
    part = picture[max(rows[0], 0) : min(rows[1], len(picture))]
    return np.asarray(cv2.transform(cv2.LUT(part, _LINEAR), _RED), np.float32)


def _peaks(light: Float32Array, least: float) -> IntArray:
    """Return the row of the line in each column; -1 where none stands out."""
    height, width = light.shape
    columns = np.arange(width)
    found = light.argmax(axis=0)
    best = light[found, columns]
    noise = 1.25 * np.abs(light).mean(axis=0)  # of normal numbers; the line itself is a few of the rows
    around = np.clip(found + np.arange(-_APART, _APART + 1)[:, None], 0, height - 1)
    others = light.copy()
    others[around, columns] = -np.inf
    second = others.max(axis=0)
    sure = (best > LEAST_CONTRAST * noise) & (best > least) & (second < SECOND * best)
    sure &= (found >= _HALF_WIDTH) & (found < height - _HALF_WIDTH)
    return np.where(sure, found, -1)


def _centroids(red: Float32Array, found: IntArray) -> FloatArray:
    """Return the middle of the line round each peak, nan where there is none, from columns smoothed along the line."""
    smooth = cv2.blur(red, (3, 1))
    columns = np.arange(len(found))
    rows = np.clip(found, _HALF_WIDTH, len(red) - 1 - _HALF_WIDTH)
    around = rows + np.arange(-_HALF_WIDTH, _HALF_WIDTH + 1)[:, None]
    far = rows + np.array([-_APART, -_APART + 1, _APART - 1, _APART])[:, None]
    ground = np.median(smooth[np.clip(far, 0, len(red) - 1), columns], axis=0)
    weights = np.maximum(smooth[around, columns] - ground, 0.0).astype(np.float64)
    total = weights.sum(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        middles = (weights * around).sum(axis=0) / total
    return np.where((found >= 0) & (total > 0.0), middles, np.nan)


def _in_runs(rows: FloatArray, least: int) -> FloatArray:
    """Return the rows of runs of at least `least` columns without a jump, smoothed along each."""
    joined = np.abs(np.diff(rows)) <= STEP  # false for nan
    begins = np.flatnonzero(np.concatenate([[True], ~joined]))
    ends = np.append(begins[1:], len(rows))
    smooth = np.full(len(rows), np.nan)
    for begin, end in zip(begins, ends, strict=True):
        if end - begin >= least:
            smooth[begin:end] = _smoothed(rows[begin:end])
    return smooth


def _smoothed(rows: FloatArray) -> FloatArray:
    """Return the means over `_SMOOTHED` columns; towards the ends over fewer, as many on both sides."""
    sums = np.concatenate([[0.0], np.cumsum(rows)])
    at = np.arange(len(rows))
    half = np.minimum(np.minimum(at, at[::-1]), _SMOOTHED // 2)
    means: FloatArray = (sums[at + half + 1] - sums[at - half]) / (2 * half + 1)
    return means
