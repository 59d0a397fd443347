"""The step through a door: from its pivotal zone straight on to free ground behind it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.geometry import transform_points
from waychair.planning.route.legs import DoorPassage
from waychair.planning.steps.clear_ground import SPIN_ROOM, ClearGround
from waychair.planning.steps.step import Step, StepKind
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


def places_before(ground: ClearGround, door: DoorPassage) -> FloatArray:
    """Return places (N, 2) [m] in map on a door's axis, on either side, at which the chair can spin.

    From there a leg may lead through a door behind which, or before which, there is no room for a step of its own.
    """
    away = HALF_WALL + ground.costmap.body.front + _BEFORE
    along = np.concatenate([-away, away])
    places = transform_points(door.map_from_door, np.column_stack([along, np.zeros(len(along))]))
    spins: FloatArray = places[ground.spin_room(places) >= SPIN_ROOM]
    return spins


_BEFORE = np.arange(0.0, 1.35, 0.1)
"""m; distances of the chair's front end from the wall at such a place."""


def _ends(step: Step) -> FloatArray:
    return np.array([[step.start.x, step.start.y], [step.end.x, step.end.y]])


def doors_too_narrow(doors: Sequence[DoorPassage], body: ChairBody) -> DoorPassage | None:
    """Return the first door that a hand cannot pass."""
    return next((door for door in doors if room_in(door, body) < LEAST_ROOM), None)
