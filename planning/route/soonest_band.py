"""The soonest band from pose to pose: with a turn on the spot at either end, without one, or with a part of the last one.

A chair that slows down turns on the way for nothing. So it begins the turn at its goal in a bend where that is sooner.
"""

from __future__ import annotations

import math
from functools import partial

import numpy as np

from waychair.geometry import wrap_angle
from waychair.planning.body.clearance import PLANNED, PLANNED_TURN
from waychair.planning.route.flowing_line import COMFORT, SPACING, flowing
from waychair.planning.route.rooms import NO_TURN, rooms_beside, turn_to
from waychair.planning.route.speed_profile import time_along, turn_time
from waychair.planning.route.way_pieces import FIRM_PRICE, SHARPEST, Ground, Piece, is_against_one_way, sharpest
from waychair.resumable import CountedSteps
from waychair.types import FloatArray, Pose2

LEAST_ROOM = PLANNED
"""[m] Room that a line needs."""

_SETTLING_PRICE = 2000.0
"""Price of lacking room at which a band first settles."""

_TRIES = ((COMFORT, FIRM_PRICE), (0.12, 400000.0), (0.08, 400000.0))
"""Comfort [m] and price of lacking room of the bands that are tried in turn."""

_END_PART = 3.0
"""[m] Length of a line's ends that are made with and without a turn on the spot."""

_IN_BENDS, _LEAST_TURN = (0.5, 1.0, 1.5), 0.3
"""[rad] Parts of the turn at a goal that are tried as bends, and what must be left of it: a smaller turn is not worth its stop."""

_WORTH_S = 0.5
"""[s] Such a bend must be sooner by so much: the chair hardly turns while it comes to rest between the two."""

_STOP_S = 1.5
"""[s] About what it takes to stop for a turn where the chair would drive on, and to speed up again."""

Stands = tuple[bool, bool]
"""Whether the chair stands at a band's start and at its goal; elsewhere it may come and go on the move."""


def band_between(
    ground: Ground, line: FloatArray, start: Pose2, goal: Pose2, stands: Stands = (False, False)
) -> CountedSteps[Piece | None]:
    """Return the soonest band near a line (N, 2) [m] from pose to pose in map, with turns on the spot at its ends or not.

    None if none fits. The ends of a long line do not depend on each other.
    """
    found = yield from _fitting(ground, line, None, None)
    if found is not None:
        poses, rooms = found
        cut = math.ceil(_END_PART / SPACING)
        if len(poses) > 3 * cut:
            into, out = Pose2(*poses[cut]), Pose2(*poses[-cut - 1])
            first = yield from soonest_band(ground, poses[: cut + 1, :2], start, into, (stands[0], False), last=False)
            last = yield from soonest_band(ground, poses[-cut - 1 :, :2], out, goal, (False, stands[1]), first=False)
            if first is not None and last is not None:
                poses = np.concatenate([first.poses[:-1], poses[cut : len(poses) - cut], last.poses[1:]])
                rooms = np.concatenate([first.rooms[:-1], rooms[cut : len(rooms) - cut], last.rooms[1:]])
                middle = time_along(poses, rooms, ground.costmap.body, ground.limits)
                return Piece(poses, rooms, middle + first.turning + last.turning, turning=first.turning + last.turning)
    return (yield from soonest_band(ground, line, start, goal, stands, found))


def soonest_band(
    ground: Ground,
    line: FloatArray,
    start: Pose2,
    goal: Pose2,
    stands: Stands = (False, False),
    free: tuple[FloatArray, FloatArray] | None = None,
    first: bool = True,
    last: bool = True,
    backwards: bool = False,
) -> CountedSteps[Piece | None]:
    """Return the soonest of the bands along a line with fixed and with free ends; None if none fits.

    `free` is the band with free ends, if it is known. The chair may turn on the spot at the `first` and the `last` end;
    at the others it drives on, in the pose's heading.
    """
    band = partial(_band, ground, line, (start, goal), stands, backwards)
    best: Piece | None = None
    ends: tuple[float | None, float | None] = start.theta, goal.theta
    for leaves in (None, start.theta) if first else (start.theta,):
        for arrives in (None, goal.theta) if last else (goal.theta,):
            piece = yield from band(leaves, arrives, free if leaves is None and arrives is None else None)
            if piece is not None and (best is None or piece.seconds < best.seconds):
                best, ends = piece, (leaves, arrives)
    if best is None:
        return None
    leaves, arrives = ends
    if arrives is None:
        turn, most = wrap_angle(goal.theta - float(best.poses[-1, 2])), best.seconds - _WORTH_S
        for part in _IN_BENDS:
            if abs(turn) > part + _LEAST_TURN:
                piece = yield from band(leaves, goal.theta - turn + math.copysign(part, turn))
                if piece is not None and piece.seconds < min(most, best.seconds):
                    best = piece
    return best


def _band(
    ground: Ground,
    line: FloatArray,
    ends: tuple[Pose2, Pose2],
    stands: Stands,
    backwards: bool,
    leaves: float | None,
    arrives: float | None,
    found: tuple[FloatArray, FloatArray] | None = None,
) -> CountedSteps[Piece | None]:
    """Return the band that leaves and arrives in these headings [rad], None being free, with the turns to and from them.

    `ends` are the poses between which it leads; `found` is that band, if it is known. None if it does not fit, or a turn is not free.
    """
    if found is None:
        found = yield from _fitting(ground, line, leaves, arrives, backwards, stands)
    if found is None and any(stands):  # with a straight beginning and end it may fit still
        found = yield from _fitting(ground, line, leaves, arrives, backwards)
    if found is None:
        return None
    poses, rooms = found
    (start, goal), body, turning = ends, ground.costmap.body, 0.0
    for needed, rests, at, heading in (
        (leaves != start.theta, stands[0], start, float(poses[0, 2])),
        (arrives != goal.theta, stands[1], Pose2(*poses[-1]), goal.theta),
    ):
        turn = turn_to(ground.costmap, at, heading, PLANNED_TURN) if needed else 0.0
        if turn is None:
            return None
        stop = 0.0 if rests or abs(turn) < NO_TURN else _STOP_S
        turning += turn_time(turn, body, ground.limits) + stop
    seconds = time_along(poses, rooms, body, ground.limits, -1.0 if backwards else 1.0) + turning
    return Piece(poses, rooms, seconds, backwards, turning)


def _fitting(
    ground: Ground,
    line: FloatArray,
    leaves: float | None,
    arrives: float | None,
    backwards: bool = False,
    stands: Stands = (False, False),
) -> CountedSteps[tuple[FloatArray, FloatArray] | None]:
    """Return the first band along a line that fits, and the room (N,) [m] at its poses; None if none does."""
    costmap = ground.costmap
    for comfort, price in ((COMFORT, _SETTLING_PRICE), *_TRIES):
        poses = yield from flowing(
            line, costmap.field, costmap.body, leaves, arrives, comfort, backwards, price, ground.from_zones, stands
        )
        line = poses[:, :2]
        if price == _SETTLING_PRICE:
            continue
        if sharpest(poses) > SHARPEST:
            return None
        rooms = yield from rooms_beside(costmap, poses)
        if (rooms[:-1] >= LEAST_ROOM).all() and not is_against_one_way(costmap, line):
            return poses, rooms
    return None
