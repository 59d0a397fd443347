"""From a line over the cells to legs that flow: the band where it fits, turns on the spot where they are sooner.

Where the chair does not fit along the band, a multi-point turn replaces a stretch of it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from waychair.errors import NoPath
from waychair.geometry import wrap_angle
from waychair.maps.grid.cells import cells_from_points, inside
from waychair.planning.body.clearance import HARD, NOISE, PLANNED, PLANNED_TURN
from waychair.planning.body.footprint import fits
from waychair.planning.grid.costmap import Costmap
from waychair.planning.grid.fine_distances import fine_field
from waychair.planning.route.flowing_line import NO_ZONES, SPACING, flowing
from waychair.planning.route.leaving_a_wall import BY_HAND, reason_for_cramped
from waychair.planning.route.legs import DoorPassage, PathLeg
from waychair.planning.route.manoeuvres import manoeuvre_between
from waychair.planning.route.rooms import can_turn, rooms_beside
from waychair.planning.route.shortcuts import shortened
from waychair.planning.route.soonest_band import LEAST_ROOM, Stands, band_between, soonest_band
from waychair.planning.route.speed_profile import time_along
from waychair.planning.route.turns_beside import steps_aside
from waychair.planning.route.way_pieces import FIRM_PRICE, Ground, Piece
from waychair.planning.window.motion_limits import DwaSettings
from waychair.resumable import CELLS_PER_STEP, CountedSteps, counted
from waychair.types import Float32Array, FloatArray, Path, Pose2

_AHEAD = ((0.8, 0.0), (0.5, 0.0), (0.3, 0.08))
"""[m] Distances of the front end before a door's middle from which the chair is straight, and the least room beside it there: what a
bend leaves of an error is up to 4 cm over the shortest, 3 cm over the next."""

_PAST = (0.2, 0.1)
"""[m] Distances of the rear end past a door's middle up to which the chair stays straight."""

_ON_AXIS = 0.015
"""[m] A chair no farther off a door's axis goes on from where it is, after a turn on the spot if need be."""

_ONE_TURN = 1.5
"""[m] Places no farther apart, at which the band does not fit, are passed by one multi-point turn."""

_ROUND = (0.8, 2.0)
"""[m] Lengths of line on both sides of such a place that a multi-point turn replaces; the longer if the shorter fails."""

_ONWARDS = 2.5
"""[m] Length of line beyond a multi-point turn that a shortcut may replace as well."""

_SAME_HEADING = 0.02
"""[rad] Two pieces whose headings differ by no more are driven without a stop."""


def way_legs(
    costmap: Costmap,
    line: FloatArray,
    start: Pose2,
    goal: Pose2,
    doors: Sequence[DoorPassage],
    limits: DwaSettings,
    searches: Callable[[], None] | None,
) -> CountedSteps[list[PathLeg]]:
    """Return legs along a line (N, 2) [m] from a start to a goal in map, straight through its doors; resumable.

    The chair stops only where it turns on the spot or changes gear; it does so where that is sooner than a bend, or the
    only way. `searches` is called before a search for a multi-point turn, which takes long; None rules such turns out.

    Raises:
        NoPath: the chair does not fit somewhere, not even with a multi-point turn.
    """
    if math.dist((start.x, start.y), (goal.x, goal.y)) < _NOWHERE:
        return [_turn(start, goal.theta)]
    ground = Ground(costmap, limits, _zones_round(costmap, line), searches)
    direct = None if searches is None else (yield from _directly(ground, start, goal, (True, True)))
    if direct is not None:
        return _joined([direct], goal, ())
    pieces: list[Piece] = []
    passed: list[DoorPassage] = []
    here, rest = start, line
    for door in doors:
        found = yield from _through(ground, rest, here, goal, door, stands=not pieces)
        if found is not None:
            before, straight, rest = found
            pieces += [*before, straight]
            here = Pose2(*straight.poses[-1])
            passed.append(door)
    if math.dist((here.x, here.y), (goal.x, goal.y)) > _ARRIVED or not pieces:
        pieces += yield from _pieces(ground, rest, here, goal, (not pieces, True))
    return _joined(pieces, goal, passed)


def turning_leg(costmap: Costmap, pose: Pose2, heading: float) -> PathLeg | None:
    """Return the leg that only turns on the spot to a heading [rad] in map; None where the turn is not free."""
    return _turn(pose, heading) if can_turn(costmap, pose, heading, HARD) else None


def _turn(pose: Pose2, heading: float) -> PathLeg:
    return PathLeg(Path(np.array([pose.array(), [pose.x, pose.y, heading]])), np.zeros(2))


def _directly(ground: Ground, start: Pose2, goal: Pose2, stands: Stands) -> CountedSteps[Piece | None]:
    """Return the soonest band straight to a goal that is near, in both gears; to one behind a chair without room to turn, in reverse.

    To a goal half a metre behind the chair, a way over the cells would begin and end with half a turn.
    """
    at, costmap = start.inverse() @ goal, ground.costmap
    away = math.hypot(at.x, at.y)
    gears: tuple[bool, ...] = (False, True)
    if away > _NEAR:
        if away > _FAR_BACK or at.x > 0.0 or abs(at.y) > 0.3 * away:
            return None
        if can_turn(costmap, start, start.theta + math.pi, PLANNED_TURN):
            return None
        gears = (True,)
    line = np.array([[start.x, start.y], [goal.x, goal.y]])
    found: list[Piece] = []
    for backwards in gears:
        if backwards and ground.limits.max_reverse == 0.0:
            continue
        turns = away <= _NEAR
        piece = yield from soonest_band(ground, line, start, goal, stands, first=turns, last=turns, backwards=backwards)
        found += [] if piece is None else [piece]
    return min(found, key=lambda piece: piece.seconds) if found else None


_NEAR, _FAR_BACK = 1.0, 6.0
"""[m] A goal no farther than the first is driven to directly. A chair that cannot turn where it stands backs no farther than
the second."""

_NOWHERE = 0.005
"""[m] At a goal so near the chair only turns."""

_CELLS_OF_A_DOOR = 600_000
"""Work of the fine cells round a door, in visited grid cells."""

_ARRIVED = 0.05
"""[m] A door's passage that ends so near to the goal ends the drive."""


def _zones_round(costmap: Costmap, line: FloatArray) -> Float32Array:
    """Return the distances to zones if the line goes round all of them; through one the band keeps near its line."""
    if costmap.from_zones is None:
        return NO_ZONES
    cells = cells_from_points(costmap.grid, line)
    rows, columns = cells[inside(costmap.grid, cells)].T
    crosses = (costmap.from_zones[rows, columns] < 0.0).any()
    return NO_ZONES if crosses else costmap.from_zones


def _pieces(ground: Ground, line: FloatArray, start: Pose2, goal: Pose2, stands: Stands) -> CountedSteps[list[Piece]]:
    """Return the band from pose to pose, with multi-point turns where it does not fit."""
    whole = yield from _bands(ground, line, start, goal, stands)
    if whole is not None:
        return whole
    costmap = ground.costmap
    poses = yield from flowing(line, costmap.field, costmap.body, price=FIRM_PRICE, from_zones=ground.from_zones)
    rooms = yield from rooms_beside(costmap, poses)
    fits_there = rooms >= PLANNED
    bad = (np.flatnonzero(~fits_there[1:-1]) + 1).tolist()
    here = yield from rooms_beside(costmap, start.array()[None])
    turns_in = here[0] >= LEAST_ROOM and can_turn(costmap, start, float(poses[0, 2]), PLANNED_TURN)
    turns_out = can_turn(costmap, Pose2(*poses[-1]), goal.theta, PLANNED_TURN)
    marked = [*([] if turns_in else [0]), *bad, *([] if turns_out else [len(poses) - 1])]
    marked = marked or list(range(len(poses)))  # only the ends' headings do not fit
    first = last = marked[0]
    for k in marked[1:]:
        if (k - last) * SPACING > _ONE_TURN:
            break
        last = k
    if ground.searches is None:
        raise _no_room(costmap, start, poses[first])
    for around in _ROUND:
        begin, end = first, last
        while begin > 0 and ((first - begin) * SPACING < around or not fits_there[begin]):
            begin -= 1
        while end < len(poses) - 1 and ((end - last) * SPACING < around or not fits_there[end]):
            end += 1
        into = start if begin == 0 else Pose2(*poses[begin])
        out = goal if end == len(poses) - 1 else Pose2(*poses[end])
        before: list[Piece] = []
        if begin > 0:
            piece = yield from band_between(ground, poses[: begin + 1, :2], start, into, (stands[0], False))
            if piece is None:
                continue
            before = [piece]
        ground.searches()
        turned = yield from counted(manoeuvre_between(costmap, into, out), CELLS_PER_STEP)
        if turned is None:
            continue
        after: list[Piece] = []
        if end < len(poses) - 1:
            after = yield from _pieces(ground, poses[end:, :2], out, goal, (False, stands[1]))
            onwards, after = _beginning(after)
            turned = np.concatenate([turned, onwards])
        gears = yield from shortened(ground, turned)
        return [*before, *gears, *after]
    raise _no_room(costmap, start, poses[first])


def _bands(
    ground: Ground, line: FloatArray, start: Pose2, goal: Pose2, stands: Stands
) -> CountedSteps[list[Piece] | None]:
    """Return the soonest of the bands from pose to pose: along the line, straight in either gear where they are near, and those
    with turns on the spot beside the ends. None if none fits.
    """
    whole = yield from band_between(ground, line, start, goal, stands)
    best = [] if whole is None else [whole]
    if ground.searches is None or len(line) < 2:
        return best or None
    # the whole way, at both of whose ends the chair stands, was tried directly before
    if not all(stands) and _ARRIVED < math.dist((start.x, start.y), (goal.x, goal.y)) <= _NEAR:
        direct = yield from _directly(ground, start, goal, stands)
        best = best if direct is None else _sooner(best, [direct])
    begin, rest = start, line
    for step in (yield from steps_aside(ground, start, _bearing(start, line[:_HEADED]))):
        ground.searches()
        place = Pose2(*step.poses[-1])
        onwards = np.concatenate([[[place.x, place.y]], line[min(_nearest(line, place) + 1, len(line) - 1) :]])
        band = yield from band_between(ground, onwards, place, goal, (True, stands[1]))
        if band is not None and _sooner(best, [step, band]) is not best:
            best, begin, rest = [step, band], place, onwards
    before = best[:-1]
    for step in (yield from steps_aside(ground, goal, _bearing(goal, line[::-1][:_HEADED]) + math.pi, arrives=True)):
        place = Pose2(*step.poses[0])
        onto = np.concatenate([rest[: max(1, _nearest(rest, place))], [[place.x, place.y]]])
        band = yield from band_between(ground, onto, begin, place, (stands[0] or begin is not start, True))
        best = best if band is None else _sooner(best, [*before, band, step])
    return best or None


_HEADED = 11
"""Points of a line, with its end, by which it is told where it leads: a metre."""


def _bearing(pose: Pose2, line: FloatArray) -> float:
    """Return the direction [rad] from a pose to the last point of a line (N, 2)."""
    return math.atan2(line[-1, 1] - pose.y, line[-1, 0] - pose.x)


def _sooner(best: list[Piece], other: list[Piece]) -> list[Piece]:
    """Return the sooner of two chains of pieces; an empty one is none."""
    return other if not best or _seconds(other) < _seconds(best) else best


def _seconds(pieces: list[Piece]) -> float:
    """Return how long [s] a chain of pieces takes."""
    return sum(piece.seconds + _BETWEEN_PIECES_S for piece in pieces)


_BETWEEN_PIECES_S = 0.5
"""[s] About what the chair stands between two pieces."""


def _beginning(pieces: list[Piece]) -> tuple[FloatArray, list[Piece]]:
    """Return the poses (N, 3) of the first piece up to `_ONWARDS`, and the rest of the pieces."""
    first, *others = pieces
    cut = math.ceil(_ONWARDS / SPACING)
    if len(first.poses) < cut + 4:
        return first.poses, others
    return first.poses[: cut + 1], [replace(first, poses=first.poses[cut:], rooms=first.rooms[cut:]), *others]


def _no_room(costmap: Costmap, start: Pose2, pose: FloatArray) -> NoPath:
    """Return the error of a chair that fits neither along its line nor with a multi-point turn."""
    x, y = float(pose[0]), float(pose[1])
    near = fine_field(costmap.grid, start, costmap.body.circumscribed_radius + 0.3)
    if not fits(costmap.body, PLANNED, near, start):
        why = reason_for_cramped(near, costmap.body, start, NOISE)
        if why is not None:
            return NoPath(f"{why}; {BY_HAND}", (x, y))
    return NoPath(
        f"the chair does not fit at ({x:.2f}, {y:.2f}), not even with a multi-point turn; clear the way or choose "
        "another goal",
        (x, y),
    )


def _through(
    ground: Ground, line: FloatArray, here: Pose2, goal: Pose2, door: DoorPassage, stands: bool
) -> CountedSteps[tuple[list[Piece], Piece, FloatArray] | None]:
    """Return the soonest piece to a door's axis, the straight one through it, and the line beyond it."""
    best: tuple[float, list[Piece], Piece] | None = None
    for ahead, least_room in _AHEAD:
        straight = yield from _straight(ground, door, here, goal, ahead)
        if straight is None or straight.rooms.min() < least_room:
            continue
        entry = Pose2(*straight.poses[0])
        before: list[Piece] = []
        if math.dist((entry.x, entry.y), (here.x, here.y)) > _ON_AXIS:
            onto = np.concatenate([line[: max(1, _nearest(line, entry))], [[entry.x, entry.y]]])
            found = yield from _bands(ground, onto, here, entry, (stands, False))
            if found is None:
                continue
            before = found
        seconds = straight.seconds + _seconds(before)
        if best is None or seconds < best[0]:
            best = seconds, before, straight
    if best is None:
        return None
    leaving = best[2].poses[-1]
    k = _nearest(line, Pose2(*leaving))
    return best[1], best[2], np.concatenate([leaving[None, :2], line[k + 1 :] if k + 1 < len(line) else line[-1:]])


def _straight(ground: Ground, door: DoorPassage, here: Pose2, goal: Pose2, ahead: float) -> CountedSteps[Piece | None]:
    costmap, middle = ground.costmap, door.map_from_door
    body = costmap.body
    yield _CELLS_OF_A_DOOR
    field = fine_field(costmap.grid, middle, body.length + 1.0)
    begin = -(body.front + ahead)
    end = next((body.rear + past for past in _PAST if fits(body, HARD, field, middle @ Pose2(body.rear + past))), None)
    at, there = middle.inverse() @ here, middle.inverse() @ goal
    if at.x > begin - 0.1 and abs(at.y) < _ON_AXIS and can_turn(costmap, here, middle.theta, PLANNED):
        begin = at.x
    if end is None or not fits(body, HARD, field, middle @ Pose2(begin)):
        return None
    if there.x < end:
        if abs(there.y) > 0.03 or abs(there.theta) > 0.1:
            return None
        end = there.x
    if end - begin < 0.05:
        return None
    along = np.linspace(begin, end, math.ceil((end - begin) / SPACING) + 1)
    poses = np.array([(middle @ Pose2(float(x), 0.0, 0.0)).array() for x in along])
    rooms = yield from rooms_beside(costmap, poses)
    return Piece(poses, rooms, time_along(poses, rooms, body, ground.limits))


def _nearest(line: FloatArray, pose: Pose2) -> int:
    """Return the index of the point of a line (N, 2) that is nearest to a pose."""
    return int(np.argmin(np.hypot(*(line - (pose.x, pose.y)).T)))


def _joined(pieces: list[Piece], goal: Pose2, doors: Sequence[DoorPassage]) -> list[PathLeg]:
    """Return the pieces as legs, cut where the chair turns on the spot or changes gear."""
    joined: list[Piece] = []
    for piece in pieces:
        before = joined[-1] if joined else None
        if (
            before is None
            or before.backwards != piece.backwards
            or abs(wrap_angle(before.poses[-1, 2] - piece.poses[0, 2])) > _SAME_HEADING
        ):
            joined.append(piece)
        else:
            joined[-1] = replace(
                before,
                poses=np.concatenate([before.poses, piece.poses[1:]]),
                rooms=np.concatenate([before.rooms, piece.rooms[1:]]),
            )
    legs = []
    for k, piece in enumerate(joined):
        poses, rooms = piece.poses, piece.rooms
        heading = joined[k + 1].poses[0, 2] if k + 1 < len(joined) else goal.theta
        if abs(wrap_angle(poses[-1, 2] - heading)) > 1e-6:
            poses = np.concatenate([poses, [[poses[-1, 0], poses[-1, 1], heading]]])
            rooms = np.append(rooms, rooms[-1])
        legs.append(PathLeg(Path(poses), rooms, piece.backwards, tuple(doors)))
    return legs
