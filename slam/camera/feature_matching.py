"""Descriptor matching between two images, and the epipolar check of the matches.

For images without depth the check is RTAB-Map's VhEp: matches that agree with a fundamental matrix found by RANSAC
(Hartley and Zisserman 2004, chapter 11).
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit

from waychair.slam.camera.features import Descriptors, ImageFeatures
from waychair.slam.camera.hamming_index import hamming_table, packed
from waychair.types import Float32Array, IntArray

LEAST_MATCHES = 8
"""Any seven matches agree with some fundamental matrix, so fewer than eight are no evidence."""


_RATIO = 0.8  # largest ratio of the nearest over the second nearest distance, both ways
_TOLERANCE = 3.0  # px; distance of an inlier to its epipolar line
_CONFIDENCE = 0.999  # of RANSAC, of finding the best motion
_MIN_INLIERS = 12  # matches that one motion must explain
_MIN_SHARE = 0.6  # of the matches that must be inliers


@dataclass(frozen=True, slots=True)
class Support:
    """How well two images fit: the matches, the inliers of one camera motion, and whether these are enough."""

    matches: int
    inliers: int
    enough: bool


def epipolar_support(a: ImageFeatures, b: ImageFeatures) -> Support:
    """Check whether one camera motion explains the matches of two images; no depth is needed."""
    pairs = mutual_matches(distances_between(a.descriptors, b.descriptors), _RATIO)
    if len(pairs) < LEAST_MATCHES:
        return Support(len(pairs), 0, False)
    _, mask = cv2.findFundamentalMat(
        a.pixels[pairs[:, 0]], b.pixels[pairs[:, 1]], cv2.FM_RANSAC, _TOLERANCE, _CONFIDENCE
    )
    inliers = 0 if mask is None else int(np.count_nonzero(mask))
    enough = inliers >= _MIN_INLIERS and inliers >= _MIN_SHARE * len(pairs)
    return Support(len(pairs), inliers, enough)


def distances_between(a: Descriptors, b: Descriptors) -> Float32Array:
    """Return distances (N, M) of descriptors (N, W) and (M, W): Hamming for bytes, squared Euclidean for floats."""
    if a.dtype == np.uint8:
        bits: Float32Array = hamming_table(packed(a), packed(b))
        return bits
    norms = np.einsum("ij,ij->i", a, a)[:, None] + np.einsum("ij,ij->i", b, b)
    squared: Float32Array = np.maximum(norms - np.float32(2.0) * (a @ b.T), np.float32(0.0))
    return squared


@njit(cache=True)
def mutual_matches(distances: Float32Array, ratio: float) -> IntArray:
    """Return (K, 2) rows and columns of a table (N, M) that are mutual nearest neighbours and pass the ratio test both ways."""
    rows, columns = distances.shape
    row_best, row_first, row_second = _two_smallest(distances)
    column_best, column_first, column_second = _two_smallest(distances.T)
    pairs = np.empty((min(rows, columns), 2), np.int64)
    count = 0
    for i in range(rows):
        j = row_best[i]
        if j < 0 or column_best[j] != i or row_first[i] > ratio * row_second[i]:
            continue
        if column_first[j] <= ratio * column_second[j]:
            pairs[count, 0], pairs[count, 1] = i, j
            count += 1
    return pairs[:count]


@njit(cache=True)
def _two_smallest(table: Float32Array) -> tuple[IntArray, Float32Array, Float32Array]:
    """Return the column of each row's smallest value (the first of equal values), that value, and the second smallest."""
    best = np.full(table.shape[0], -1, np.int64)
    first = np.full(table.shape[0], np.inf, np.float32)
    second = np.full(table.shape[0], np.inf, np.float32)
    for i in range(table.shape[0]):
        for j in range(table.shape[1]):
            value = table[i, j]
            if value < first[i]:
                best[i], second[i], first[i] = j, first[i], value
            elif value < second[i]:
                second[i] = value
    return best, first, second
