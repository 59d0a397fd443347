"""Subpixel alignment of small image patches: where a patch of an earlier image is in the present image.

The patch is first warped by the two poses, then aligned by inverse compositional Lucas-Kanade (Baker and Matthews, IJCV
2004) with free brightness and contrast, from coarse to fine. Each patch is always compared with the image in which its
point was first seen, so errors do not accumulate along a track (as in SVO, Forster et al., TRO 2017, section IV).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numba import njit

from waychair.types import Bytes, FloatArray, IntArray

HALF = 5
"""Half side [px] of a patch, on every level."""

_TEXTURE = 4.0  # [grey level^2]; least eigenvalue of the mean squared gradient of a usable patch
_ITERATIONS = 10
_CONVERGED = 0.02  # [px]


def align(
    reference: Sequence[Bytes],
    picture: Sequence[Bytes],
    at: FloatArray,
    affine: FloatArray,
    guess: FloatArray,
    levels: Sequence[int],
    reach: float,
    least: float,
) -> tuple[FloatArray, IntArray]:
    """Return the pixels (N, 2) of patches in a picture, and the finest level (N,) of success, -1 for none.

    Both pictures are pyramids, each level half of the one before. `at` (N, 2) are patch centres in the reference,
    `affine` (N, 2, 2) maps offsets there to offsets here, `guess` (N, 2) are the expected pixels. `levels` are processed
    in their order, coarse first. On each level a patch may move by at most `reach` [px] and must correlate by `least`,
    or it keeps the result of the level before: a blurred picture has no fine level.
    """
    found, finest = np.ascontiguousarray(guess, np.float64).copy(), np.full(len(guess), -1)
    for level in levels:
        scale = 0.5**level
        trial, alike = found * scale, np.zeros(len(guess))
        align_kernel(reference[level], picture[level], at * scale, affine, trial, alike, reach)
        good = alike >= least
        found[good], finest[good] = trial[good] / scale, level
    return found, finest


@njit(cache=True)
def _sample(image: Bytes, x: float, y: float) -> float:
    column, row = int(x), int(y)
    a, b = x - column, y - row
    top = (1.0 - a) * image[row, column] + a * image[row, column + 1]
    bottom = (1.0 - a) * image[row + 1, column] + a * image[row + 1, column + 1]
    value: float = (1.0 - b) * top + b * bottom
    return value


@njit(cache=True)
def template_kernel(image: Bytes, x: float, y: float, affine: FloatArray, patch: FloatArray) -> bool:
    """Sample the patch (2h + 3, 2h + 3) round a pixel, warped by the inverse of `affine`; return False at the border."""
    height, width = image.shape
    determinant = affine[0, 0] * affine[1, 1] - affine[0, 1] * affine[1, 0]
    if not 0.1 < determinant < 10.0:
        return False
    i00, i01 = affine[1, 1] / determinant, -affine[0, 1] / determinant
    i10, i11 = -affine[1, 0] / determinant, affine[0, 0] / determinant
    half = HALF + 1
    wide = half * (abs(i00) + abs(i01))
    high = half * (abs(i10) + abs(i11))
    if not (wide < x < width - 1 - wide and high < y < height - 1 - high):
        return False
    for r in range(2 * half + 1):
        for c in range(2 * half + 1):
            dx, dy = c - half, r - half
            patch[r, c] = _sample(image, x + i00 * dx + i01 * dy, y + i10 * dx + i11 * dy)
    return True


@njit(cache=True, nogil=True)
def align_kernel(
    reference: Bytes,
    picture: Bytes,
    at: FloatArray,
    affine: FloatArray,
    found: FloatArray,
    alike: FloatArray,
    reach: float,
) -> None:
    """Run `align` on one level: update found (N, 2) in place, and write the correlation to alike (N,), -1 on failure."""
    height, width = picture.shape
    side = 2 * HALF + 1
    patch = np.empty((side + 2, side + 2))
    now, gx, gy = np.empty((side, side)), np.empty((side, side)), np.empty((side, side))
    for n in range(len(at)):
        if not template_kernel(reference, at[n, 0], at[n, 1], affine[n], patch):
            alike[n] = -1.0
            continue
        xx = xy = yy = sx = sy = 0.0
        for r in range(side):
            for c in range(side):
                gx[r, c] = 0.5 * (patch[r + 1, c + 2] - patch[r + 1, c])
                gy[r, c] = 0.5 * (patch[r + 2, c + 1] - patch[r, c + 1])
                xx += gx[r, c] * gx[r, c]
                xy += gx[r, c] * gy[r, c]
                yy += gy[r, c] * gy[r, c]
                sx += gx[r, c]
                sy += gy[r, c]
        count = float(side * side)
        # the brightness is an unknown, so the gradients lose their means
        xx, xy, yy = xx - sx * sx / count, xy - sx * sy / count, yy - sy * sy / count
        determinant = xx * yy - xy * xy
        weakest = 0.5 * (xx + yy - math.sqrt((xx - yy) ** 2 + 4.0 * xy * xy))
        if weakest < _TEXTURE * count:
            alike[n] = -1.0
            continue
        level, contrast = moments(patch[1:-1, 1:-1])
        x, y, inside = found[n, 0], found[n, 1], True
        for _ in range(_ITERATIONS):
            if not (HALF < x < width - 1 - HALF - 1e-6 and HALF < y < height - 1 - HALF - 1e-6):
                inside = False
                break
            for r in range(side):
                for c in range(side):
                    now[r, c] = _sample(picture, x + c - HALF, y + r - HALF)
            # automatic exposure changes brightness and contrast of the same patch
            bright, spread = moments(now)
            gain = contrast / max(spread, 1e-9)
            bx = by = 0.0
            for r in range(side):
                for c in range(side):
                    away = gain * (now[r, c] - bright) - (patch[r + 1, c + 1] - level)
                    bx += gx[r, c] * away
                    by += gy[r, c] * away
            dx = (yy * bx - xy * by) / determinant
            dy = (xx * by - xy * bx) / determinant
            x, y = x - dx, y - dy
            if dx * dx + dy * dy < _CONVERGED * _CONVERGED:
                break
        inside = inside and HALF < x < width - 1 - HALF - 1e-6 and HALF < y < height - 1 - HALF - 1e-6
        if not inside or (x - found[n, 0]) ** 2 + (y - found[n, 1]) ** 2 > reach * reach:
            alike[n] = -1.0
            continue
        found[n, 0], found[n, 1] = x, y
        for r in range(side):
            for c in range(side):
                now[r, c] = _sample(picture, x + c - HALF, y + r - HALF)
        alike[n] = correlation(patch, now)


@njit(cache=True)
def moments(patch: FloatArray) -> tuple[float, float]:
    """Return the mean and the standard deviation of a patch."""
    total = square = 0.0
    for r in range(patch.shape[0]):
        for c in range(patch.shape[1]):
            total += patch[r, c]
            square += patch[r, c] * patch[r, c]
    mean = total / patch.size
    return mean, math.sqrt(max(square / patch.size - mean * mean, 0.0))


@njit(cache=True)
def correlation(patch: FloatArray, now: FloatArray) -> float:
    """Return the zero-mean normalised correlation of a patch without its rim and the present patch."""
    side = now.shape[0]
    a = b = aa = bb = ab = 0.0
    for r in range(side):
        for c in range(side):
            p, q = patch[r + 1, c + 1], now[r, c]
            a += p
            b += q
            aa += p * p
            bb += q * q
            ab += p * q
    count = float(side * side)
    spread = (aa - a * a / count) * (bb - b * b / count)
    return (ab - a * b / count) / math.sqrt(spread) if spread > 1e-9 else -1.0


@njit(cache=True)
def affine_kernel(
    points: FloatArray,
    reference_turn: FloatArray,
    reference_shift: FloatArray,
    turn: FloatArray,
    shift: FloatArray,
    camera: FloatArray,
) -> FloatArray:
    """Return affine maps (N, 2, 2) of offsets in the reference picture to offsets here, round map points (N, 3).

    Each point is taken to lie on a small plane parallel to the reference image; poses are camera_from_map.
    """
    found = np.empty((len(points), 2, 2))
    here_from_there = turn @ reference_turn.T
    for n in range(len(points)):
        depth = shift[2] * 0.0
        for k in range(3):
            depth += reference_turn[2, k] * points[n, k]
        depth += reference_shift[2]
        x, y, z = shift[0], shift[1], shift[2]
        for k in range(3):
            x += turn[0, k] * points[n, k]
            y += turn[1, k] * points[n, k]
            z += turn[2, k] * points[n, k]
        for c in range(2):
            focal = camera[c]
            dx = here_from_there[0, c] * depth / focal
            dy = here_from_there[1, c] * depth / focal
            dz = here_from_there[2, c] * depth / focal
            found[n, 0, c] = camera[0] * (dx * z - x * dz) / (z * z)
            found[n, 1, c] = camera[1] * (dy * z - y * dz) / (z * z)
    return found
