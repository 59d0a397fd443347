"""A direct leg to a near goal: one smooth curve, or a line with a turn at its ends, forwards or backwards.

A planned way begins by turning to its first direction. To a goal half a metre behind the chair that would be two half
turns; backing up needs none. In a corridor too narrow to turn in, backing is the only way.
"""

from __future__ import annotations

import math

import numpy as np

from waychair.geometry import transform_points, wrap_angle
from waychair.maps.grid.cells import cells_from_points, inside
from waychair.planning.body.clearance import PLANNED_ON_PATH, PLANNED_TURN
from waychair.planning.body.footprint import fits_each
from waychair.planning.grid.costmap import Costmap
from waychair.planning.grid.fine_distances import fine_field
from waychair.planning.route.legs import PathLeg
from waychair.planning.route.rooms import NO_TURN, turn_is_free
from waychair.planning.route.speed_profile import rooms_along
from waychair.types import FloatArray, Path, Pose2

NEAR = 1.0
"""[m] A goal no farther than this is driven to directly, where that is free."""

FAR_BACK = 6.0
"""[m] A chair that cannot turn where it stands backs so far along a free line to its goal, not farther."""

_TIGHTEST = 1.0
"""[1/m] Largest curvature of a direct curve: the chair follows it without stopping to turn."""

_SPACING = 0.025
"""[m] Distance of the poses of a curve; a line's poses are as near."""

_REVERSE_PRICE, _TURN_PRICE = 1.6, 0.4
"""[m] Prices in metres driven forwards of a metre backwards, and of a radian turned on the spot."""


def direct_leg(costmap: Costmap, start: Pose2, goal: Pose2) -> PathLeg | None:
    """Return the cheapest direct leg from a start to a goal in map; None where the goal is far or no such leg is free."""
    away = math.dist((start.x, start.y), (goal.x, goal.y))
    if not _SPACING < away <= FAR_BACK:
        return None
    reach = away / 2 + costmap.body.circumscribed_radius + 0.3
    middle = Pose2((start.x + goal.x) / 2, (start.y + goal.y) / 2, 0.0)
    near = away <= NEAR
    if not near and ((start.inverse() @ goal).x > 0.0 or abs((start.inverse() @ goal).y) > 0.3 * away):
        return None
    field = fine_field(costmap.grid, middle, reach)

    def free(poses: FloatArray) -> bool:
        return bool(fits_each(costmap.body, PLANNED_ON_PATH, field, poses).all())

    def turns(pose: Pose2, heading: float) -> bool:
        turn = wrap_angle(heading - pose.theta)
        return abs(turn) < NO_TURN or turn_is_free(costmap.body, PLANNED_TURN, field, pose, turn)

    def leg_of(poses: FloatArray, gear: float) -> PathLeg:
        rooms = rooms_along(costmap.body, field, poses)
        return PathLeg(Path(poses), rooms, backwards=gear < 0.0)

    if not near and turns(start, start.theta + math.pi):
        return None
    found: list[tuple[float, PathLeg]] = []
    for gear in (1.0, -1.0) if near else (-1.0,):
        price = 1.0 if gear > 0.0 else _REVERSE_PRICE
        curve = _curve(start, goal, gear)
        if curve is not None and free(curve):
            length = float(np.hypot(*np.diff(curve[:, :2], axis=0).T).sum())
            found.append((price * length, leg_of(curve, gear)))
        line = _line(start, goal, gear)
        heading = float(line[0, 2])
        turned = abs(wrap_angle(heading - start.theta)) + abs(wrap_angle(goal.theta - heading))
        last = Pose2(goal.x, goal.y, heading)
        if near and free(line) and turns(start, heading) and turns(last, goal.theta):
            line[-1, 2] = goal.theta
            found.append((price * away + _TURN_PRICE * turned, leg_of(line, gear)))
    allowed = [each for each in found if not _is_barred(costmap, each[1])]
    return min(allowed, key=lambda each: each[0])[1] if allowed else None


def turning_leg(costmap: Costmap, pose: Pose2, heading: float) -> PathLeg | None:
    """Return the leg that only turns on the spot to a heading [rad] in map; None where the turn is not free."""
    field = fine_field(costmap.grid, pose, costmap.body.circumscribed_radius + 0.3)
    if not turn_is_free(costmap.body, 0.0, field, pose, wrap_angle(heading - pose.theta)):
        return None
    poses = np.array([[pose.x, pose.y, pose.theta], [pose.x, pose.y, heading]])
    return PathLeg(Path(poses), np.zeros(2))


def _curve(start: Pose2, goal: Pose2, gear: float) -> FloatArray | None:
    """Return poses (N, 3) of a cubic with the chair's headings at both ends; None if it bends too tightly."""
    to = start.inverse() @ goal
    length = math.hypot(to.x, to.y)
    t = np.linspace(0.0, 1.0, math.ceil(length / _SPACING) + 1)[:, None]
    out, into = gear * length * np.array([1.0, 0.0]), gear * length * np.array([math.cos(to.theta), math.sin(to.theta)])
    end = np.array([to.x, to.y])
    points = (t**3 - 2 * t**2 + t) * out + (3 * t**2 - 2 * t**3) * end + (t**3 - t**2) * into
    speed = (3 * t**2 - 4 * t + 1) * out + (6 * t - 6 * t**2) * end + (3 * t**2 - 2 * t) * into
    rate = (6 * t - 4) * out + (6 - 12 * t) * end + (6 * t - 2) * into
    norm = np.hypot(*speed.T)
    if norm.min() < 0.2 * length:
        return None
    bend = np.abs(speed[:, 0] * rate[:, 1] - speed[:, 1] * rate[:, 0]) / norm**3
    if bend.max() > _TIGHTEST:
        return None
    headings = start.theta + np.unwrap(np.arctan2(gear * speed[:, 1], gear * speed[:, 0]))
    if np.abs(np.diff(headings)).max() > 0.5:  # the curve begins away from the goal and turns back
        return None
    poses: FloatArray = np.column_stack([transform_points(start, points), headings])
    return poses


def _line(start: Pose2, goal: Pose2, gear: float) -> FloatArray:
    """Return poses (N, 3) of the straight line, with the heading in which the chair drives it."""
    x, y = goal.x - start.x, goal.y - start.y
    heading = math.atan2(gear * y, gear * x)
    share = np.linspace(0.0, 1.0, math.ceil(math.hypot(x, y) / _SPACING) + 1)
    poses: FloatArray = np.column_stack([start.x + share * x, start.y + share * y, np.full(len(share), heading)])
    return poses


def _is_barred(costmap: Costmap, leg: PathLeg) -> bool:
    """Return whether a leg passes cells of a one-way zone; the planned way knows their directions."""
    cells = cells_from_points(costmap.grid, leg.path.poses[:, :2])
    cells = cells[inside(costmap.grid, cells)]
    return costmap.barred is not None and bool(costmap.barred[tuple(cells.T)].any())
