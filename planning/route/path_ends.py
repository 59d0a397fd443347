"""The ends of a path: the cells of start and goal, and whether the chair has room there."""

from __future__ import annotations

import math

import cv2
import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.errors import GoalOccupied, GoalOutsideMap, StartOccupied, StartOutsideMap
from waychair.geometry import transform_points
from waychair.maps.grid.cells import cells_from_points, inside, occupied, points_from_cells
from waychair.planning.body.clearance import HARD, PLANNED_TURN
from waychair.planning.body.footprint import fits_each
from waychair.planning.grid.costmap import Costmap
from waychair.planning.grid.grid_graph import Cell
from waychair.types import Pose2

_NEAREST = 5.0
"""Largest distance [m] from an occupied goal to the place proposed instead."""

_LOOKED_AT = 4000
"""Most cells tested for it, since a driving chair waits meanwhile."""


def check_start(costmap: Costmap, body: ChairBody, start: Pose2) -> None:
    """Refuse a start at which the chair's outline contains the middle of an occupied cell.

    A chair may well stand closer beside a wall than any planned path would lead.

    Raises:
        StartOutsideMap, StartOccupied.
    """
    cell = cell_at(costmap, start)
    if cell is None:
        raise _start_outside(start)
    reach = math.ceil(body.circumscribed_radius / costmap.grid.resolution) + 1
    top, left = max(cell[0] - reach, 0), max(cell[1] - reach, 0)
    window = occupied(costmap.grid)[top : cell[0] + reach + 1, left : cell[1] + reach + 1]
    cells = np.argwhere(window) + np.array([top, left])
    x, y = transform_points(start.inverse(), points_from_cells(costmap.grid, cells)).T
    if ((x >= -body.rear) & (x <= body.front) & (np.abs(y) <= body.width / 2)).any():
        raise StartOccupied(
            f"the chair does not fit at its start ({start.x:.2f}, {start.y:.2f}) with the heading "
            f"{start.theta:.2f} rad; correct its pose"
        )


def start_cell(costmap: Costmap, start: Pose2, reach: float) -> Cell:
    """Return the start's cell or, if a wall is too close, the nearest passable one in reach and in line of sight.

    A chair that stands closer to a wall than any planned path would lead must still be able to leave.

    Raises:
        StartOutsideMap, StartOccupied.
    """
    cell = cell_at(costmap, start)
    if cell is None:
        raise _start_outside(start)
    if costmap.prices[cell] != 0:
        return cell
    if costmap.clearance[cell] > 0:
        for candidate in _passable_by_distance(costmap, start, reach):
            if _in_sight(costmap, cell, candidate):
                return candidate
    raise StartOccupied(
        f"the chair does not fit at its start ({start.x:.2f}, {start.y:.2f}): no free place within {reach:.2f} m; "
        "drive it out by hand or correct its pose"
    )


def _start_outside(start: Pose2) -> StartOutsideMap:
    return StartOutsideMap(
        f"the start ({start.x:.2f}, {start.y:.2f}) lies outside the map; localise the chair or extend the map"
    )


def goal_cell(costmap: Costmap, goal: Pose2, start: Pose2 | None = None) -> Cell:
    """Return the goal's cell. A place that is proposed instead of an occupied goal can be reached from the start.

    Raises:
        GoalOutsideMap, GoalOccupied.
    """
    cell = cell_at(costmap, goal)
    if cell is None:
        raise GoalOutsideMap(f"the goal ({goal.x:.2f}, {goal.y:.2f}) lies outside the map; choose one inside it")
    if costmap.prices[cell] == 0:
        near = _nearest_room(costmap, goal, start)
        found = "none was found near with room for its heading"
        if near is not None:
            found = f"the nearest place with room is ({near[0]:.2f}, {near[1]:.2f})"
        raise GoalOccupied(
            f"the chair does not fit at the goal ({goal.x:.2f}, {goal.y:.2f}); choose another one, {found}"
        )
    return cell


def _nearest_room(costmap: Costmap, goal: Pose2, start: Pose2 | None) -> tuple[float, float] | None:
    """Return the nearest point [m], to the centimetre, at which the chair fits with the goal's heading, if any.

    Preferred is one with room to turn on the spot, since there the chair can come from anywhere: beside a wall it fits
    at places to which no drive leads.
    """
    found = _passable_by_distance(costmap, goal, _NEAREST)
    cells = np.array(found, np.int64).reshape(-1, 2)
    if start is not None and (begin := cell_at(costmap, start)) is not None and costmap.prices[begin]:
        _, numbers = cv2.connectedComponents((costmap.prices != 0).astype(np.uint8), connectivity=4)
        cells = cells[numbers[tuple(cells.T)] == numbers[begin]]
    turns = (
        costmap.clearance[tuple(cells.T)] > costmap.body.circumscribed_radius + PLANNED_TURN + costmap.grid.resolution
    )
    for candidates in (cells[turns], cells):
        points = points_from_cells(costmap.grid, candidates[:_LOOKED_AT]).round(2)
        poses = np.column_stack([points, np.full(len(points), goal.theta)])
        with_room = poses[fits_each(costmap.body, HARD, costmap.field, poses)]
        if len(with_room):
            return float(with_room[0, 0]), float(with_room[0, 1])
    return None


def cell_at(costmap: Costmap, pose: Pose2) -> Cell | None:
    """Return row and column under a pose; None outside the map."""
    cells = cells_from_points(costmap.grid, np.array([[pose.x, pose.y]]))
    return (int(cells[0, 0]), int(cells[0, 1])) if inside(costmap.grid, cells)[0] else None


def _passable_by_distance(costmap: Costmap, pose: Pose2, reach: float) -> list[Cell]:
    """Return the passable cells whose centre lies within reach [m] of a pose, the nearest first."""
    row, column = cells_from_points(costmap.grid, np.array([[pose.x, pose.y]]))[0]
    span = int(reach / costmap.grid.resolution) + 1
    top, left = max(row - span, 0), max(column - span, 0)
    window = costmap.prices[top : row + span + 1, left : column + span + 1]
    cells = np.argwhere(window != 0) + np.array([top, left])
    away = np.hypot(*(points_from_cells(costmap.grid, cells) - (pose.x, pose.y)).T)
    near = np.argsort(away, kind="stable")[: np.count_nonzero(away <= reach)]
    return [(int(r), int(c)) for r, c in cells[near]]


def _in_sight(costmap: Costmap, first: Cell, second: Cell) -> bool:
    """Return whether the straight line between two cells' centres crosses no occupied cell."""
    steps = 4 * max(abs(first[0] - second[0]), abs(first[1] - second[1]), 1)
    rows, columns = np.rint(np.linspace(first, second, steps + 1)).astype(np.int64).T
    return bool((costmap.clearance[rows, columns] > 0).all())
