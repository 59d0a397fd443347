"""Places beside a pose where the chair can turn on the spot though it cannot at the pose, and the straight drive from there to here.

A chair whose front would swing against a wall needs only a step back to turn, where a bend would lead it round in a loop.
"""

from __future__ import annotations

import math

import numpy as np

from waychair.geometry import arcs, compose
from waychair.planning.body.clearance import PLANNED, PLANNED_TURN
from waychair.planning.route.flowing_line import SPACING
from waychair.planning.route.rooms import can_turn, rooms_beside
from waychair.planning.route.speed_profile import time_along
from waychair.planning.route.way_pieces import Ground, Piece, is_against_one_way
from waychair.resumable import CountedSteps
from waychair.types import Pose2

_STEPS = ((-0.2, -0.4, -0.7, -1.0), (0.2, 0.4, 0.7, 1.0))
"""[m] Ahead of the pose; the first of each row where the chair can turn is taken."""

_LEAST_TURN = 0.8
"""[rad] A smaller turn is as quick in a bend."""

_CELLS_OF_A_TURN = 100_000
"""Work of looking whether a turn is free, in visited grid cells."""


def steps_aside(ground: Ground, pose: Pose2, heading: float, arrives: bool = False) -> CountedSteps[list[Piece]]:
    """Return the straight drives from a pose to places where the chair can turn to a heading [rad], at most one in each gear.

    With `arrives` they are drives from such places, where the chair comes in the heading, to the pose. There is none if the
    chair can turn at the pose itself, or hardly needs to.
    """
    found: list[Piece] = []
    costmap, limits = ground.costmap, ground.limits
    yield _CELLS_OF_A_TURN
    if math.cos(heading - pose.theta) > math.cos(_LEAST_TURN) or can_turn(costmap, pose, heading, PLANNED_TURN):
        return found
    for row in _STEPS:
        for ahead in row:
            backwards = (ahead < 0.0) != arrives
            place = pose @ Pose2(ahead)
            if backwards and limits.max_reverse == 0.0:
                break
            along = np.linspace(0.0, ahead, max(4, math.ceil(abs(ahead) / SPACING)) + 1)
            poses = compose(pose.array(), arcs(along, np.zeros_like(along)))
            poses = poses[::-1] if arrives else poses
            rooms = yield from rooms_beside(costmap, poses)
            if rooms.min() < PLANNED or is_against_one_way(costmap, poses[:, :2]):
                break
            yield _CELLS_OF_A_TURN
            if can_turn(costmap, place, heading, PLANNED_TURN):
                seconds = time_along(poses, rooms, costmap.body, limits, -1.0 if backwards else 1.0)
                found.append(Piece(poses, rooms, seconds, backwards))
                break
    return found
