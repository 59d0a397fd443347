"""An angle within one turn, for kernels; on arrays and single angles it is `waychair.geometry`'s business."""

from __future__ import annotations

import math

from numba import njit


@njit(cache=True, inline="always")
def wrapped(angle: float) -> float:
    """The same angle [rad] in [-pi, pi)."""
    return angle - math.tau * math.floor(angle / math.tau + 0.5)
