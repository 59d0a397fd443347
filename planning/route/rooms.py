"""How much room there is beside a line of poses, and for a turn: on the map's cells where there is much, else on fine ones."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.geometry import wrap_angle
from waychair.maps.grid.distance_field import DistanceField
from waychair.planning.body.footprint import disc_tree, fits_each, footprint, free_time, in_cells
from waychair.planning.grid.costmap import Costmap
from waychair.planning.grid.fine_distances import FINEST, fine_cell, fine_field
from waychair.planning.route.speed_profile import ROOMS, rooms_along
from waychair.resumable import CountedSteps
from waychair.types import FloatArray, OccupancyGrid, Pose2

_STRETCH = 1.0
"""[m] Length of a stretch whose fine cells are made at once: about a millisecond."""

_CELLS = 400_000
"""Work of a stretch with cells of `FINEST`, in visited grid cells."""

NO_TURN = 0.05
"""[rad] A smaller change of heading happens on the way."""


def rooms_beside(costmap: Costmap, poses: FloatArray) -> CountedSteps[FloatArray]:
    """Return (N,) [m] the clearance of the outline at poses (N, 3), rounded down to `ROOMS`; -1 where it does not fit."""
    rooms = np.full(len(poses), ROOMS[-1])
    tight = np.flatnonzero(~fits_each(costmap.body, ROOMS[-1], costmap.field, poses))
    begin = 0
    while begin < len(tight):
        x, y = poses[tight[begin], :2]
        end = begin + 1
        while end < len(tight) and math.dist((x, y), poses[tight[end], :2]) < _STRETCH:
            end += 1
        yield round(_CELLS * (FINEST / fine_cell(costmap.grid)) ** 2)
        some = tight[begin:end]
        part = poses[some]
        low, high = part[:, :2].min(axis=0), part[:, :2].max(axis=0)
        middle = (low + high) / 2
        reach = float((high - low).max()) / 2 + costmap.body.circumscribed_radius + ROOMS[-1] + 0.05
        field = fine_field(costmap.grid, Pose2(float(middle[0]), float(middle[1])), reach)
        rooms[some] = rooms_along(costmap.body, field, part)
        begin = end
    return rooms


def prepare_outlines(body: ChairBody, grid: OccupancyGrid, margins: Sequence[float] = ()) -> None:
    """Make the outlines that `rooms_beside` takes on a map, and those with some more margins [m].

    On fine cells the first use of all would take 0.1 s of a tick.
    """
    for margin in (*ROOMS, *margins):
        disc_tree(body.front, body.rear, body.width / 2, margin, fine_cell(grid))


def can_turn(costmap: Costmap, pose: Pose2, heading: float, margin: float) -> bool:
    """Return whether the chair can turn on the spot to a heading [rad], in one of both directions, or need not turn."""
    return turn_to(costmap, pose, heading, margin) is not None


def turn_to(costmap: Costmap, pose: Pose2, heading: float, margin: float) -> float | None:
    """Return the smaller of the free turns [rad] on the spot to a heading [rad]; None where none is free."""
    short = wrap_angle(heading - pose.theta)
    if abs(short) < NO_TURN or _is_free(costmap.body, margin, costmap.field, pose, short):
        return short
    fine = fine_field(costmap.grid, pose, costmap.body.circumscribed_radius + 0.3)
    return free_turn(costmap.body, margin, fine, pose, short)


def free_turn(body: ChairBody, margin: float, field: DistanceField, pose: Pose2, turn: float) -> float | None:
    """Return the angle [rad] by which a body with a margin [m] can turn on the spot: the given one, or the other way round.

    None where neither is free.
    """
    other = turn - math.copysign(math.tau, turn)
    return next((each for each in (turn, other) if _is_free(body, margin, field, pose, each)), None)


def _is_free(body: ChairBody, margin: float, field: DistanceField, pose: Pose2, turn: float) -> bool:
    return free_time(footprint(body, margin, field), in_cells(field, pose), 0.0, turn, 1.0, 1.0) >= 1.0
