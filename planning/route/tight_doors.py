"""The doors on a line that are so tight that the chair passes them straight, with their axes.

Points are (N, 2) columns and rows in cell units, spaced evenly: (0.5, 0.5) is the centre of cell (0, 0).
"""

from __future__ import annotations

import math

import numpy as np

from waychair.maps.grid.cells import occupied
from waychair.planning.grid.costmap import Costmap
from waychair.planning.route.legs import DoorPassage
from waychair.types import BoolArray, FloatArray, Pose2

_LONGEST = 1.6
"""A narrow stretch longer than this [m] is a corridor; there the path is straight already."""


def tight_doors(
    costmap: Costmap, points: FloatArray, narrow: float, widest: float
) -> list[tuple[int, int, DoorPassage]]:
    """Return the doors on a line that are at most `widest` [m] wide, with the first and last index of points in each.

    A door is a place where the clearance is below `narrow` [m] and obstacles stand on both sides. It points in the line's
    direction.
    """
    rows, columns = np.floor(points[:, ::-1]).astype(np.int64).T
    clearance = costmap.clearance[rows, columns]
    cell = costmap.grid.resolution
    doors = []
    for first, last in _stretches(clearance < narrow):
        if _length(points[first : last + 1]) * cell >= _LONGEST:
            continue
        middle = first + int(np.argmin(clearance[first : last + 1]))
        if 2 * clearance[middle] - cell > widest:
            continue
        axis = _passage(costmap, points[middle], narrow / cell)
        if axis is None:
            continue
        centre, direction = axis
        if direction @ (points[last] - points[first]) < 0:
            direction = -direction
        heading = math.atan2(direction[1], direction[0])
        pose = costmap.grid.map_from_grid @ Pose2(centre[0] * cell, centre[1] * cell, heading)
        doors.append((first, last, DoorPassage(pose, 2 * float(clearance[middle]) - cell)))
    return doors


def _length(points: FloatArray) -> float:
    return float(np.hypot(*np.diff(points, axis=0).T).sum())


def _stretches(narrow: BoolArray) -> list[tuple[int, int]]:
    """Return the first and last index of every run of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], narrow.astype(np.int8), [0]])))
    return [(int(first), int(last) - 1) for first, last in edges.reshape(-1, 2)]


def _passage(costmap: Costmap, point: FloatArray, reach: float) -> tuple[FloatArray, FloatArray] | None:
    """Return centre and direction of the gap between the nearest obstacles on opposite sides; None beside one alone."""
    span = math.ceil(reach * 1.5)
    row, column = int(point[1]), int(point[0])
    top, left = max(row - span, 0), max(column - span, 0)
    window = occupied(costmap.grid)[top : row + span + 1, left : column + span + 1]
    offsets = np.argwhere(window)[:, ::-1] + np.array([left + 0.5, top + 0.5]) - point
    away = np.hypot(offsets[:, 0], offsets[:, 1])
    near = _nearest(offsets, away)
    if near is None:
        return None
    opposite = offsets @ near < -0.5 * away * np.hypot(*near)
    far = _nearest(offsets[opposite], away[opposite])
    if far is None:
        return None
    across = (far - near) / np.hypot(*(far - near))
    return point + (near + far) / 2, np.array([-across[1], across[0]])


def _nearest(offsets: FloatArray, away: FloatArray) -> FloatArray | None:
    """Return the mean of the nearest obstacles on one side (a post's face is several cells); None without any."""
    if len(away) == 0:
        return None
    one_side = offsets @ offsets[np.argmin(away)] > 0.0  # midway between two jambs both are the nearest
    mean: FloatArray = offsets[one_side & (away <= away.min() + 0.25)].mean(axis=0)
    return mean
