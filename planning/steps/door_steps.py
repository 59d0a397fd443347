"""The step through a door: from its pivotal zone straight on to free ground behind it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.planning.route.legs import DoorPassage
from waychair.planning.steps.clear_ground import SPIN_ROOM, ClearGround
from waychair.planning.steps.step import NoSteps, Step, StepKind, StepPlan, with_pivots
from waychair.types import FloatArray, Pose2

PIVOT_AHEAD = (0.75, 0.9, 0.6, 1.1, 0.45, 1.3, 0.3)
"""m; distances of the chair's front end from the wall at the pivot, the best first: nearer there is less room to
straighten, farther the driver wanders for longer."""

HALF_WALL = 0.08
"""m; half of a usual inner wall: a door's pose is in its middle."""

BEHIND = (0.05, 0.2, 0.4, 0.7, 1.0, 1.5)
"""m; tried beyond the swept disc for the end of a door's step: there the chair is clear of the wall and may turn."""

LEAST_ROOM = 0.02
"""m; room on either side below which a driver cannot pass a door by hand."""


def door_step(door: DoorPassage, body: ChairBody, ahead: float, behind: float) -> Step:
    """Return the step that begins with the chair's front `ahead` [m] before the wall, and ends `behind` [m] beyond it."""
    at = door.map_from_door
    start = at @ Pose2(-(HALF_WALL + ahead + body.front))
    end = at @ Pose2(HALF_WALL + body.circumscribed_radius + behind)
    return Step(StepKind.DOOR, start, end, room=room_in(door, body), door=door)


def room_in(door: DoorPassage, body: ChairBody) -> float:
    """Return what is free [m] on either side of the chair in a door."""
    return 0.5 * (door.width - body.width)


def door_steps(ground: ClearGround, door: DoorPassage) -> Iterator[Step]:
    """Yield the ways through a door whose pivotal point and end are free for a spin, the best first; maybe none."""
    body = ground.costmap.body
    if room_in(door, body) < LEAST_ROOM:
        return
    for ahead in PIVOT_AHEAD:
        for behind in BEHIND:
            step = door_step(door, body, ahead, behind)
            if (ground.spin_room(_ends(step)) < SPIN_ROOM).any():
                continue
            if ground.straight_is_free(step.start, step.length, -0.5 * ground.costmap.grid.resolution):
                yield step
                break


def steps_through(door: DoorPassage, start: Pose2, body: ChairBody, last_heading: float | None = None) -> StepPlan:
    """Return the steps from a pose through a door that was just found, without a map: all in the frame of the door.

    A chair that stands near the axis, nearer than the pivotal point and about straight, drives on from where it is.

    Raises:
        NoSteps: the door is too narrow for this chair by hand, or the chair stands in it or behind it.
    """
    room = room_in(door, body)
    if room < LEAST_ROOM:
        raise NoSteps(f"the door is {door.width:.2f} m wide and the chair {body.width:.2f} m, too little for a hand")
    at = door.map_from_door.inverse() @ start
    if at.x > -body.front:
        raise NoSteps("the chair stands in the door or behind it")
    step = door_step(door, body, PIVOT_AHEAD[0], BEHIND[0])
    pivot = at.x + HALF_WALL + PIVOT_AHEAD[0] + body.front
    if pivot > 0.0 and abs(at.y) < _NEAR_AXIS:
        ahead = Pose2(start.x, start.y, math.atan2(door.map_from_door.y - start.y, door.map_from_door.x - start.x))
        return with_pivots(start, [Step(StepKind.DOOR, ahead, step.end, room=room, door=door)], last_heading)
    legs: list[Step] = []
    away = step.start.x - start.x, step.start.y - start.y
    if math.hypot(*away) > _AT_PIVOT:
        heading = math.atan2(away[1], away[0])
        begin, end = Pose2(start.x, start.y, heading), Pose2(step.start.x, step.start.y, heading)
        legs.append(Step(StepKind.STRAIGHT, begin, end, room=_UNKNOWN_ROOM))
    return with_pivots(start, [*legs, step], last_heading)


_NEAR_AXIS = 0.25
"""m off the axis, up to which the chair need not go back to the pivotal point."""

_AT_PIVOT = 0.2
"""m from the pivotal point, within which the chair is there."""

_UNKNOWN_ROOM = 0.14
"""m; assumed beside a leg over ground that no map knows: the guard keeps the chair off things."""


def _ends(step: Step) -> FloatArray:
    return np.array([[step.start.x, step.start.y], [step.end.x, step.end.y]])


def doors_too_narrow(doors: Sequence[DoorPassage], body: ChairBody) -> DoorPassage | None:
    """Return the first door that a hand cannot pass."""
    return next((door for door in doors if room_in(door, body) < LEAST_ROOM), None)
