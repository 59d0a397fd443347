"""Lining the path up with doorways: a chair with a long front must be straight before it enters.

No arc leads into a door around a sharp corner: the chair drives to the door's axis, stops, turns on the spot and goes
straight through.

Points are (N, 2) columns and rows in cell units, spaced evenly: (0.5, 0.5) is the centre of cell (0, 0).
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from waychair.geometry import wrap_angle
from waychair.maps.grid.cells import occupied
from waychair.planning.body.clearance import PLANNED_TURN
from waychair.planning.body.footprint import footprint, free_time
from waychair.planning.grid.costmap import Costmap
from waychair.planning.grid.smoothing import line_cost
from waychair.planning.route.legs import DoorPassage
from waychair.types import BoolArray, FloatArray, Pose2

_LONGEST = 1.6
"""A narrow stretch longer than this [m] is a corridor; there the path is straight already."""

_SLIDES = (0.0, 0.05, -0.05, 0.1, -0.1, 0.15, -0.15, 0.2, -0.2)
"""Offsets [m] along the run from its end at which a turn on the spot is tried."""


_AWAY = 1.0
"""Directions before and after a corner are taken to points this far away [m]: the bend itself is short."""

_SHORTEST = 0.2
"""A leg shorter than this [m] is not worth a stop."""


def line_up(costmap: Costmap, points: FloatArray, narrow: float, run_up: float) -> tuple[FloatArray, BoolArray]:
    """Return the points with a straight run along the axis of every narrow place, and which points begin or end a run.

    A place is narrow where the clearance is below `narrow` [m] and obstacles stand on both sides. The run begins
    `run_up` [m] before its middle and ends two thirds of that after it, shorter where there is no room. Places too near
    the path's ends for a run stay unchanged.
    """
    rows, columns = np.floor(points[:, ::-1]).astype(np.int64).T
    clearance = costmap.clearance[rows, columns]
    cell = costmap.grid.resolution
    lined, run_ends, kept = points, np.zeros(len(points), np.bool_), len(points)
    # From the last to the first, so that indices below `kept` stay valid.
    for first, last in reversed(_stretches(clearance < narrow)):
        length = math.dist(points[first], points[last]) * cell
        middle = first + int(np.argmin(clearance[first : last + 1]))
        if middle >= kept:  # the run through the next narrow place covers this one, too
            continue
        axis = _passage(costmap, points[middle], narrow / cell) if length < _LONGEST else None
        if axis is None:
            continue
        centre, direction = axis
        if direction @ (points[last] - points[first]) < 0:
            direction = -direction
        for share in (1.0, 0.75, 0.5):
            run = run_up * share / cell
            begin, end = centre - run * direction, centre + 2 / 3 * run * direction
            ends = _joined(costmap, lined, middle, begin, end)
            if ends is not None:
                before, after = ends
                lined = np.concatenate([lined[: before + 1], [begin, end], lined[after:]])
                run_ends = np.concatenate([run_ends[: before + 1], [True, True], run_ends[after:]])
                kept = before + 1
                break
    return lined, run_ends


def legs_between_turns(costmap: Costmap, points: FloatArray, run_ends: BoolArray, turn_from: float) -> list[FloatArray]:
    """Return the points cut into legs at ends of runs where the chair stops and turns on the spot.

    `turn_from` [rad] is the least change of direction for a turn; where the chair cannot turn, the corner stays.
    """
    points, legs, begin = points.copy(), [], 0
    for i in np.flatnonzero(run_ends).tolist():
        if min(_length(points[begin : i + 1]), _length(points[i:])) * costmap.grid.resolution < _SHORTEST:
            continue
        spot = _turning_spot(costmap, points, i, points[i + 1] if run_ends[i + 1] else points[i - 1], turn_from)
        if spot is not None:
            points[i] = spot
            legs.append(points[begin : i + 1].copy())
            begin = i
    return [*legs, points[begin:]]


def tight_doors(
    costmap: Costmap, points: FloatArray, narrow: float, widest: float
) -> list[tuple[int, int, DoorPassage]]:
    """Return the doors on a path that are at most `widest` [m] wide, with the first and last index of points in each.

    A door is a narrow place as in `line_up`. It points in the path's direction.
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


def _turning_spot(
    costmap: Costmap, points: FloatArray, i: int, other_end: FloatArray, turn_from: float
) -> FloatArray | None:
    """Return where to turn on the spot near point i: there, or a little along the run; None if nowhere."""
    axis = (other_end - points[i]) / np.hypot(*(other_end - points[i]))
    cell = costmap.grid.resolution
    come_from, go_to = _at_distance(points[i::-1], _AWAY / cell), _at_distance(points[i:], _AWAY / cell)
    for slide in _SLIDES:
        spot: FloatArray = points[i] + slide / cell * axis
        into, out_of = (float(math.atan2(y, x)) for x, y in (spot - come_from, go_to - spot))
        if abs(wrap_angle(out_of - into)) >= turn_from and _can_turn(costmap, spot, into, out_of):
            return spot
    return None


def _can_turn(costmap: Costmap, point: FloatArray, into: float, out_of: float) -> bool:
    """Return whether the body can turn on the spot from one direction to the other through the smaller angle."""
    shape, turn = footprint(costmap.body, PLANNED_TURN, costmap.field), wrap_angle(out_of - into)
    return bool(
        free_time(shape, np.array([*point, into]), 0.0, math.copysign(1.0, turn), abs(turn), abs(turn)) >= abs(turn)
    )


def _at_distance(points: FloatArray, distance: float) -> FloatArray:
    """Return the first point at this distance along the points, or the last."""
    along = np.hypot(*np.diff(points, axis=0).T).cumsum()
    point: FloatArray = points[min(int(np.searchsorted(along, distance)) + 1, len(points) - 1)]
    return point


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


def _joined(
    costmap: Costmap, points: FloatArray, middle: int, begin: FloatArray, end: FloatArray
) -> tuple[int, int] | None:
    """Return the indices to join `begin` from and `end` to; None where any part of the connection is blocked."""
    before = int(np.argmin(np.hypot(*(points[: middle + 1] - begin).T)))
    after = middle + int(np.argmin(np.hypot(*(points[middle:] - end).T)))
    # Join a little away from the run, so that the bend is gentle.
    before, after = max(before - 4, 0), min(after + 4, len(points) - 1)
    legs = (points[before], begin, end, points[after])
    ahead = end - begin
    if (begin - points[before]) @ ahead < 0 or (points[after] - end) @ ahead < 0:
        return None
    for start, stop in pairwise(legs):
        if line_cost(costmap.prices, start[0], start[1], stop[0], stop[1], costmap.barred) == math.inf:
            return None
    return before, after
