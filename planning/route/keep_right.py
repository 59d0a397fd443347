"""Keeping to one side of a corridor, as people do, so that oncoming people can pass on the other.

A wheelchair in the middle of a corridor of 2 m leaves 0.7 m on either side. Hardly anybody squeezes past there: people
stop in front of the chair, and the chair in front of them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from waychair.config import Settings, setting
from waychair.geometry import arc_lengths, limit_slope
from waychair.maps.grid.cells import cells_from_points, inside
from waychair.planning.body.personal_space import PASSING, PASSING_OPEN
from waychair.planning.grid.costmap import Costmap
from waychair.types import UNKNOWN, BoolArray, FloatArray, Path


@dataclass(frozen=True, slots=True)
class KeepRightSettings(Settings):
    """The side of a corridor on which people pass each other."""

    aside: float = setting(
        0.4,
        "m",
        "shift of a corridor path to the right when people are about, negative to the left; larger: farther right",
        low=-2.0,
        high=2.0,
    )


SLOPE = 0.3
"""[m/m] Slope of the path to the side and back: a gentle swerve at walking speed."""


_STEP = 0.05
"""Distance [m] between two tested places from the path to the side."""


def kept_right(path: Path, costmap: Costmap, aside: float = KeepRightSettings().aside) -> Path:
    """Return the path moved by `aside` [m] to the right as far as there is room, except in the open.

    Ends and last heading stay.
    """
    poses = path.poses
    if len(poses) < 3 or aside == 0.0:
        return path
    side = math.copysign(1.0, aside) * np.column_stack([np.sin(poses[:, 2]), -np.cos(poses[:, 2])])
    steps = np.arange(1, round(abs(aside) / _STEP) + 1) * _STEP
    roomy = _has_room(poses[:, None, :2] + steps[:, None] * side[:, None], costmap, PASSING)
    shifts = _STEP * np.logical_and.accumulate(roomy, axis=1).sum(axis=1)
    shifts[_has_room(poses[:, None, :2], costmap, PASSING_OPEN - costmap.body.width / 2)[:, 0]] = 0.0
    shifts[[0, -1]] = 0.0
    moved = poses.copy()
    along = arc_lengths(poses[:, :2])
    eased = _smoothed(limit_slope(shifts, SLOPE * along), along)
    moved[:, :2] += eased[:, None] * side
    ahead = np.diff(moved[:, :2], axis=0)
    goes_on = np.hypot(ahead[:, 0], ahead[:, 1]) > 0.0
    latest = np.maximum.accumulate(
        np.where(goes_on, np.arange(len(ahead)), 0)
    )  # where the chair only turns, as it came
    moved[:-1, 2] = np.where(goes_on[latest], np.arctan2(ahead[latest, 1], ahead[latest, 0]), moved[:-1, 2])
    return Path(moved)


def _smoothed(aside: FloatArray, along: FloatArray) -> FloatArray:
    """Return shifts (N,) [m] without corners, and none larger than it was where the way is narrow."""
    sums = np.concatenate([[0.0], np.cumsum((aside[1:] + aside[:-1]) / 2 * np.diff(along))])
    reach = np.minimum(_SWERVE / 2, np.minimum(along, along[-1] - along))
    before, after = np.interp(along - reach, along, sums), np.interp(along + reach, along, sums)
    return np.minimum(aside, np.where(reach > 0.0, (after - before) / np.maximum(2 * reach, 1e-9), 0.0))


_SWERVE = 1.2
"""[m] Length over which a shift begins or ends."""


def _has_room(points: FloatArray, costmap: Costmap, room: float) -> BoolArray:
    """Return (N, S) whether points (N, S, 2) [m] in map are on known floor with `room` [m] beside the chair."""
    cells = cells_from_points(costmap.grid, points.reshape(-1, 2))
    within = inside(costmap.grid, cells)
    at = tuple(np.where(within[:, None], cells, 0).T)
    needed = costmap.body.width / 2 + room + costmap.grid.resolution / 2  # to the face of a wall, not to its middle
    roomy = within & (costmap.clearance[at] >= needed) & (costmap.grid.cells[at] != UNKNOWN)
    if costmap.barred is not None:  # never into a one-way zone, in any direction
        roomy &= costmap.barred[at] == 0
    by_pose: BoolArray = roomy.reshape(points.shape[:2])
    return by_pose
