"""Solution of three equations inside kernels, without LAPACK: its library takes a command longer to load than 100 scans to map."""

from __future__ import annotations

import math

from numba import njit

from waychair.types import FloatArray


@njit(cache=True)
def solved(matrix: FloatArray, right: FloatArray) -> tuple[float, float, float]:
    """Return x of `matrix` x = `right` for a symmetric positive definite matrix (3, 3), by Cholesky's method.

    Not a number where the matrix is not positive definite.
    """
    a = math.sqrt(matrix[0, 0]) if matrix[0, 0] > 0.0 else math.nan
    b, c = matrix[1, 0] / a, matrix[2, 0] / a
    left = matrix[1, 1] - b * b
    d = math.sqrt(left) if left > 0.0 else math.nan
    e = (matrix[2, 1] - c * b) / d
    left = matrix[2, 2] - c * c - e * e
    f = math.sqrt(left) if left > 0.0 else math.nan
    u = right[0] / a
    v = (right[1] - b * u) / d
    w = (right[2] - c * u - e * v) / f
    z = w / f
    y = (v - e * z) / d
    return (u - b * y - c * z) / a, y, z
