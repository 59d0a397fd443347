"""From a line over the cells to legs that flow: the band where it fits, turns on the spot where they are sooner."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from waychair.errors import NoPath
from waychair.geometry import arc_lengths, wrap_angle
from waychair.maps.grid.distance_field import DistanceField
from waychair.planning.body.clearance import HARD, PLANNED, PLANNED_TURN
from waychair.planning.body.footprint import fits, footprint, free_time, in_cells
from waychair.planning.grid.costmap import Costmap
from waychair.planning.grid.fine_distances import fine_field
from waychair.planning.grid.resumable import Resumable
from waychair.planning.route.flowing_line import COMFORT, SPACING, flowing
from waychair.planning.route.leg_planning import legs_of_manoeuvre, manoeuvre_between
from waychair.planning.route.legs import DoorPassage, DrivingManner, PathLeg
from waychair.planning.route.speed_profile import (
    curvatures,
    predicted_time,
    rooms_along,
    speeds_along,
    turn_time,
)
from waychair.planning.window.motion_limits import DwaSettings
from waychair.types import FloatArray, OccupancyGrid, Path, Pose2

_LIMITS = DwaSettings()
_BEYOND = 1.5
_TRIES = ((COMFORT, 40000.0), (0.12, 400000.0), (0.08, 400000.0))


def field_round(grid: OccupancyGrid, points: FloatArray) -> DistanceField:
    """Return the fine distances round a line (N, 2) [m]."""
    low, high = points.min(axis=0), points.max(axis=0)
    x, y = (low + high) / 2
    middle = Pose2(float(x), float(y))
    return fine_field(grid, middle, float((high - low).max()) / 2 + _BEYOND)


def can_turn(costmap: Costmap, field: DistanceField, pose: Pose2, heading: float, margin: float = PLANNED_TURN) -> bool:
    """Return whether the chair can turn on the spot to a heading [rad] in one of both directions."""
    short = wrap_angle(heading - pose.theta)
    if abs(short) < 0.05:
        return True
    shape, at = footprint(costmap.body, margin, field), in_cells(field, pose)
    return any(
        free_time(shape, at, 0.0, turn, 1.0, 1.0) >= 1.0 for turn in (short, short - math.copysign(math.tau, short))
    )


@dataclass(frozen=True, slots=True)
class _Piece:
    """A stretch between two poses: poses (N, 3), the time it takes [s], and whether the chair turns at its ends."""

    poses: FloatArray
    seconds: float
    turns_first: bool
    turns_last: bool
    backwards: bool = False


def way_legs(
    costmap: Costmap,
    line: FloatArray,
    start: Pose2,
    goal: Pose2,
    doors: Sequence[DoorPassage],
    limits: DwaSettings = _LIMITS,
) -> Resumable[list[PathLeg]]:
    """Return legs along a line (N, 2) [m] from a start to a goal in map, straight through its doors.

    The chair stops only where it turns on the spot or changes gear; it does so where that is sooner than a bend, or the
    only way.

    Raises:
        NoPath: the chair does not fit somewhere, not even with a multi-point turn.
    """
    field = field_round(costmap.grid, line)
    pieces: list[_Piece] = []
    here, rest = start, line
    for door in doors:
        yield
        found = _through(costmap, field, rest, here, goal, door, limits)
        if found is None:
            continue
        before, straight, rest = found
        pieces += [*([before] if before is not None else []), straight]
        here = Pose2(*straight.poses[-1])
    if math.dist((here.x, here.y), (goal.x, goal.y)) > 0.05 or not pieces:
        pieces += yield from _pieces(costmap, field, rest, here, goal, limits)
    return _joined(pieces, goal, doors)


def _pieces(
    costmap: Costmap, field: DistanceField, line: FloatArray, start: Pose2, goal: Pose2, limits: DwaSettings
) -> Resumable[list[_Piece]]:
    """Return the band from pose to pose, with multi-point turns where it does not fit."""
    yield
    whole = _between(costmap, field, line, start, goal, limits)
    if whole is not None:
        return [whole]
    poses = flowing(line, field, costmap.body, price=_TRIES[0][1])
    fits_there = rooms_along(costmap.body, field, poses) >= PLANNED
    bad = np.flatnonzero(~fits_there[1:-1]) + 1
    turns_in = can_turn(costmap, field, start, float(poses[0, 2]))
    turns_out = can_turn(costmap, field, Pose2(*poses[-1]), goal.theta)
    marked = [*([] if turns_in else [0]), *bad.tolist(), *([] if turns_out else [len(poses) - 1])]
    if not marked:
        marked = [0, len(poses) - 1]
    first = last = marked[0]
    for k in marked[1:]:
        if (k - last) * SPACING > _ONE_TURN:
            break
        last = k
    for around in _ROUND:
        begin, end = first, last
        while begin > 0 and ((first - begin) * SPACING < around or not fits_there[begin]):
            begin -= 1
        while end < len(poses) - 1 and ((end - last) * SPACING < around or not fits_there[end]):
            end += 1
        into = start if begin == 0 else Pose2(*poses[begin])
        out = goal if end == len(poses) - 1 else Pose2(*poses[end])
        before: list[_Piece] = []
        if begin > 0:
            piece = _between(costmap, field, poses[: begin + 1, :2], start, into, limits)
            if piece is None:
                continue
            before = [piece]
        turned = yield from manoeuvre_between(costmap, into, out)
        if turned is None:
            continue
        after: list[_Piece] = []
        if end < len(poses) - 1:
            after = yield from _pieces(costmap, field, poses[end:, :2], out, goal, limits)
        return [*before, *_gears(costmap, field, turned), *after]
    x, y, _ = poses[first]
    raise NoPath(
        f"the chair does not fit at ({x:.2f}, {y:.2f}), not even with a multi-point turn; clear the way or choose "
        "another goal",
        (float(x), float(y)),
    )


_ONE_TURN = 1.5
"""[m] Places no farther apart, at which the band does not fit, are passed by one multi-point turn."""

_ROUND = (0.8, 2.0)
"""[m] Lengths of line on both sides of such a place that a multi-point turn replaces; the longer if the shorter fails."""


def _gears(costmap: Costmap, field: DistanceField, poses: FloatArray) -> list[_Piece]:
    """Return the drives of a multi-point turn, each smoothed where the smoother one fits."""
    done = []
    for leg in legs_of_manoeuvre(poses):
        line = leg.path.poses
        keep = np.concatenate([[True], np.hypot(*np.diff(line[:, :2], axis=0).T) > 1e-6])
        line = line[keep]
        if len(line) < 2:
            continue
        line[-1, 2] = line[-1, 2] if len(line) < 3 else leg.path.poses[keep.nonzero()[0][-1], 2]
        ends = float(line[0, 2]), float(poses[np.argmin(np.hypot(*(poses[:, :2] - line[-1, :2]).T)), 2])
        smooth = flowing(
            line[:, :2], field, costmap.body, ends[0], ends[1], backwards=leg.backwards, price=_TRIES[0][1]
        )
        room = rooms_along(costmap.body, field, line)[1:-1].min(initial=1.0)
        if _sharpest(smooth) < _SHARPEST and rooms_along(costmap.body, field, smooth)[1:-1].min(initial=1.0) >= room:
            line = smooth
        done.append(_Piece(line, 0.0, True, True, leg.backwards))
    return done


def _through(
    costmap: Costmap,
    field: DistanceField,
    line: FloatArray,
    here: Pose2,
    goal: Pose2,
    door: DoorPassage,
    limits: DwaSettings,
) -> tuple[_Piece | None, _Piece, FloatArray] | None:
    """Return the soonest piece to a door's axis, the straight one through it, and the line beyond it."""
    best: tuple[float, _Piece | None, _Piece] | None = None
    for ahead in _AHEAD:
        straight = _straight(costmap, field, door, here, goal, ahead, limits)
        if straight is None:
            continue
        entry = Pose2(*straight.poses[0])
        seconds, before = straight.seconds, None
        if math.dist((entry.x, entry.y), (here.x, here.y)) > _ON_AXIS:
            k = max(1, nearest(line, entry))
            before = _between(costmap, field, np.concatenate([line[:k], [[entry.x, entry.y]]]), here, entry, limits)
            if before is None:
                continue
            seconds += before.seconds
        if best is None or seconds < best[0]:
            best = seconds, before, straight
    if best is None:
        return None
    leaving = best[2].poses[-1]
    k = nearest(line, Pose2(*leaving))
    return best[1], best[2], np.concatenate([leaving[None, :2], line[k + 1 :] if k + 1 < len(line) else line[-1:]])


_AHEAD = (0.8, 0.5, 0.3)
"""[m] Distances of the front end before a door's middle from which the chair is straight."""

_PAST = (0.2, 0.1)
"""[m] Distances of the rear end past a door's middle up to which the chair stays straight."""


_ON_AXIS = 0.015
"""[m] A chair no farther off a door's axis goes on from where it is, after a turn on the spot if need be."""


def _straight(
    costmap: Costmap,
    field: DistanceField,
    door: DoorPassage,
    here: Pose2,
    goal: Pose2,
    ahead: float,
    limits: DwaSettings,
) -> _Piece | None:
    body, middle = costmap.body, door.map_from_door
    begin = -(body.front + ahead)
    end = next((body.rear + past for past in _PAST if fits(body, HARD, field, middle @ Pose2(body.rear + past))), None)
    at, there = middle.inverse() @ here, middle.inverse() @ goal
    if at.x > begin - 0.1 and abs(at.y) < _ON_AXIS and can_turn(costmap, field, here, middle.theta, PLANNED):
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
    return _Piece(poses, _time_of(costmap, field, poses, limits), False, False)


def _between(
    costmap: Costmap, field: DistanceField, line: FloatArray, start: Pose2, goal: Pose2, limits: DwaSettings
) -> _Piece | None:
    """Return the soonest band from pose to pose, with or without turns on the spot at its ends; None if none fits."""
    best: _Piece | None = None
    for leaves in (None, start.theta):
        for arrives in (None, goal.theta):
            found = _fitting(costmap, field, line, leaves, arrives)
            if found is None:
                continue
            poses, _ = found
            into, out = Pose2(*poses[0]), Pose2(*poses[-1])
            if leaves is None and not can_turn(costmap, field, start, into.theta):
                continue
            if arrives is None and not can_turn(costmap, field, out, goal.theta):
                continue
            seconds = _time_of(costmap, field, poses, limits)
            seconds += turn_time(wrap_angle(into.theta - start.theta), limits) if leaves is None else 0.0
            seconds += turn_time(wrap_angle(goal.theta - out.theta), limits) if arrives is None else 0.0
            if best is None or seconds < best.seconds:
                best = _Piece(poses, seconds, leaves is None, arrives is None)
    return best


def _time_of(costmap: Costmap, field: DistanceField, poses: FloatArray, limits: DwaSettings) -> float:
    along = arc_lengths(poses[:, :2])
    rooms = rooms_along(costmap.body, field, poses)
    return predicted_time(speeds_along(curvatures(poses), rooms, along, costmap.body, limits), along, limits)


def nearest(line: FloatArray, pose: Pose2) -> int:
    """Return the index of the point of a line (N, 2) that is nearest to a pose."""
    return int(np.argmin(np.hypot(*(line - (pose.x, pose.y)).T)))


def _joined(pieces: list[_Piece], goal: Pose2, doors: Sequence[DoorPassage]) -> list[PathLeg]:
    """Return the pieces as legs, cut where the chair turns on the spot or changes gear."""
    joined: list[_Piece] = []
    for piece in pieces:
        before = joined[-1] if joined else None
        if (
            before is None
            or before.backwards != piece.backwards
            or abs(wrap_angle(before.poses[-1, 2] - piece.poses[0, 2])) > _SAME_HEADING
        ):
            joined.append(piece)
        else:
            joined[-1] = replace(before, poses=np.concatenate([before.poses, piece.poses[1:]]))
    legs = []
    for k, piece in enumerate(joined):
        poses = piece.poses
        heading = joined[k + 1].poses[0, 2] if k + 1 < len(joined) else goal.theta
        if abs(wrap_angle(poses[-1, 2] - heading)) > 1e-6:
            poses = np.concatenate([poses, [[poses[-1, 0], poses[-1, 1], heading]]])
        legs.append(PathLeg(Path(poses), DrivingManner.LINE, backwards=piece.backwards, doors=tuple(doors)))
    return legs


_SAME_HEADING = 0.02
"""[rad] Two pieces whose headings differ by no more are driven without a stop."""


def _fitting(
    costmap: Costmap, field: DistanceField, line: FloatArray, leaves: float | None, arrives: float | None
) -> tuple[FloatArray, FloatArray] | None:
    line = flowing(line, field, costmap.body, leaves, arrives, COMFORT, price=2000.0)[:, :2]
    for comfort, price in _TRIES:
        poses = flowing(line, field, costmap.body, leaves, arrives, comfort, price=price)
        line = poses[:, :2]
        if _sharpest(poses) > _SHARPEST:
            return None
        rooms = rooms_along(costmap.body, field, poses)
        if (rooms[1:-1] >= LEAST_ROOM).all():
            return poses, rooms
    return None


LEAST_ROOM = 0.02
"""[m] Room that a line needs: what a chair at a crawl errs, twice."""

_SHARPEST = 0.45
"""[rad] Sharpest turn from one pose to the next."""


def _sharpest(poses: FloatArray) -> float:
    turns = np.diff(poses[:, 2])
    return float(np.abs(np.arctan2(np.sin(turns), np.cos(turns))).max()) if len(turns) else 0.0
