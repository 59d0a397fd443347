"""Angle wrapping for numba kernels. `waychair.geometry` has the functions for plain floats and for arrays."""

from __future__ import annotations

import math

from numba import njit


@njit(cache=True, inline="always")
def wrapped(angle: float) -> float:
    """Return the same angle [rad] in [-pi, pi)."""
    return angle - math.tau * math.floor(angle / math.tau + 0.5)
