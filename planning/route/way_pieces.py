"""The pieces that a way is made of, and the ground that it is made on."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from waychair.geometry import transform_points
from waychair.planning.grid.costmap import Costmap
from waychair.planning.grid.smoothing import line_cost
from waychair.planning.window.motion_limits import DwaSettings
from waychair.types import Float32Array, FloatArray

SHARPEST = 0.45
"""[rad] Sharpest turn from one pose of a line to the next."""

FIRM_PRICE = 40000.0
"""Price of lacking room at which a band keeps clear of things."""


@dataclass(frozen=True, slots=True)
class Piece:
    """A stretch between two poses: poses (N, 3), the room (N,) [m] at them, and the time it takes [s].

    `turning` [s] is the part of that time for turns on the spot at its ends.
    """

    poses: FloatArray
    rooms: FloatArray
    seconds: float
    backwards: bool = False
    turning: float = 0.0


@dataclass(frozen=True, slots=True)
class Ground:
    """Where a way is made, and how fast the chair is there; `from_zones` as in `flowing`."""

    costmap: Costmap
    limits: DwaSettings
    from_zones: Float32Array
    searches: Callable[[], None] | None


def is_against_one_way(costmap: Costmap, points: FloatArray) -> bool:
    """Return whether a line through points (N, 2) [m] goes against a one-way zone; a band only knows walls."""
    if costmap.barred is None:
        return False
    at = transform_points(costmap.grid.map_from_grid.inverse(), points) / costmap.grid.resolution
    return any(
        line_cost(costmap.prices, a, b, c, d, costmap.barred) == math.inf
        and line_cost(costmap.prices, a, b, c, d, None) < math.inf
        for (a, b), (c, d) in pairwise(at.tolist())
        if (a, b) != (c, d)
    )


def sharpest(poses: FloatArray) -> float:
    """Return the largest turn [rad] from one of the poses (N, 3) to the next."""
    turns = np.diff(poses[:, 2])
    return float(np.abs(np.arctan2(np.sin(turns), np.cos(turns))).max()) if len(turns) else 0.0
