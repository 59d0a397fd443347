"""From a chain of points to legs: straight through doors, multi-point turns where the footprint needs them, else free.

The chain was planned with the chair's half width only. Here the footprint is checked: whether it fits along the chain,
and whether the chair can turn where the direction changes abruptly. Where not, a multi-point turn replaces the chain.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.errors import NoPath
from waychair.geometry import arc_lengths, wrap_angle
from waychair.maps.grid.distance_field import DistanceField
from waychair.planning.body.clearance import (
    EXACT_BEND,
    HARD,
    MANOEUVRE,
    MANOEUVRE_TIGHT,
    MAP_DOUBT,
    NOISE,
    PLANNED_ON_PATH,
)
from waychair.planning.body.footprint import fits, fits_each, footprint, free_time, in_cells
from waychair.planning.grid.costmap import Costmap
from waychair.planning.grid.fine_distances import fine_field
from waychair.planning.grid.resumable import Resumable
from waychair.planning.route.leaving_a_wall import BY_HAND, leading_out_path, reason_for_cramped
from waychair.planning.route.legs import DoorPassage, DrivingManner, PathLeg
from waychair.planning.route.multi_point_turn import ManoeuvreAttempt, manoeuvre_resumably
from waychair.types import BoolArray, Bytes, FloatArray, Path, Pose2

_ROOMY = tuple(ManoeuvreAttempt(clearance, 0.05, 72) for clearance in MANOEUVRE)
_TIGHT = tuple(
    ManoeuvreAttempt(clearance, side, headings)
    for clearance, (side, headings) in zip(MANOEUVRE_TIGHT, ((0.025, 144), (0.025, 144), (0.02, 180)), strict=True)
)
"""Attempts for a multi-point turn, in turn: those with little clearance need finer bins."""

_AHEAD = (0.8, 0.6, 0.45, 0.3, 0.2, 0.1)
"""Distances [m] of the front end before a door's middle for lining up; the farthest with room is taken."""

_PAST = (0.35, 0.2, 0.1)
"""Distances [m] of the rear end past a door's middle at the end of the door leg; the farthest with room is taken."""

_STRAIGHT_M, _STRAIGHT_RAD = 0.1, 0.3
"""A chair no farther off a door's axis [m] and direction [rad] continues without lining up again."""

_BEND, _BEND_OVER = 0.3, 0.5
"""A bend: the path turns by more than this [rad] from so far [m] before a place to so far after it."""

_ROUND = (0.8, 2.0)
"""Lengths [m] of chain on both sides of a misfit that a multi-point turn replaces; the longer if the shorter fails."""


TURN_FROM = 1.0
"""[rad] Where the first direction of a leg differs by more from the heading, the chair turns on the spot."""

DOCKING = 1.0
"""[m] Last part of a leg that is followed exactly, for an exact stop."""


def door_leg(costmap: Costmap, door: DoorPassage, start: Pose2, goal: Pose2) -> PathLeg | None:
    """Return the leg through a door on its axis, from lining up until the chair is through; None without room.

    A chair that already stands straight in the door starts there; a goal in the door ends the leg.
    """
    body, middle = costmap.body, door.map_from_door
    near = fine_field(costmap.grid, middle, body.length + 1.0)

    def first(places: list[float]) -> float | None:
        return next((x for x in places if fits(body, HARD, near, middle @ Pose2(x, 0.0, 0.0))), None)

    begin = first([-(body.front + ahead) for ahead in _AHEAD])
    end = first([body.rear + past for past in _PAST])
    if begin is None or end is None:
        return None
    here, there = middle.inverse() @ start, middle.inverse() @ goal
    if here.x > begin and abs(here.y) < _STRAIGHT_M and abs(here.theta) < _STRAIGHT_RAD:
        begin = here.x
    if there.x < end:
        if abs(there.y) > _STRAIGHT_M / 3 or abs(there.theta) > _STRAIGHT_RAD / 3:
            return None
        end = there.x
    if end - begin < 0.05:
        return None
    along = np.linspace(begin, end, math.ceil((end - begin) / 0.05) + 1)
    poses = np.array([(middle @ Pose2(float(x), 0.0, 0.0)).array() for x in along])
    return PathLeg(Path(poses), DrivingManner.DOOR, door=door)


def checked(costmap: Costmap, start: Pose2, legs: list[PathLeg], banded: bool = False) -> Resumable[list[PathLeg]]:
    """Return the legs with multi-point turns where the footprint does not fit; `start` is the pose before them.

    The search for a turn takes long; it is resumable. The bends of a rubber band (`banded`) may take all the room there
    is. The dynamic window cuts bends and would get stuck there, so tight ones become exact legs.

    Raises:
        NoPath: the chair does not fit somewhere.
    """
    done: list[PathLeg] = []
    for leg in legs:
        parts = [leg]
        if leg.manner is DrivingManner.FREE:
            parts = yield from _legs_of_leg(costmap, start, leg.path.poses)
        if banded:
            parts = [piece for part in parts for piece in _with_exact_bends(costmap, part)]
        done += [half for part in parts for half in _docked(part)]
        start = Pose2(*done[-1].path.poses[-1])
    return done


def _docked(leg: PathLeg) -> list[PathLeg]:
    """Return a free leg cut so that its last metre, up to the stop, is exact; any other leg unchanged."""
    if leg.manner is not DrivingManner.FREE or leg.flows:
        return [leg]
    poses = leg.path.poses
    left = np.append(np.hypot(*np.diff(poses[:, :2], axis=0).T)[::-1].cumsum()[::-1], 0.0)
    if left[0] <= 1.5 * DOCKING:
        return [PathLeg(leg.path, DrivingManner.EXACT)]
    k = int(np.searchsorted(-left, -DOCKING))
    return [PathLeg(Path(poses[: k + 1]), flows=True), PathLeg(Path(poses[k:].copy()), DrivingManner.EXACT)]


def _with_exact_bends(costmap: Costmap, leg: PathLeg) -> list[PathLeg]:
    """Return a free leg with its tight bends cut out as exact legs; any other leg unchanged."""
    poses, done = leg.path.poses, 0
    if leg.manner is not DrivingManner.FREE or len(poses) < 3:
        return [leg]
    legs: list[PathLeg] = []
    for first, last in _tight_bends(costmap, poses):
        if first > done:
            legs.append(PathLeg(Path(poses[done : first + 1].copy()), flows=True))
        legs.append(PathLeg(Path(poses[first : last + 1].copy()), DrivingManner.EXACT))
        done = last
    return legs if done == len(poses) - 1 else [*legs, PathLeg(Path(poses[done:]))]


def _tight_bends(costmap: Costmap, poses: FloatArray) -> list[tuple[int, int]]:
    """Return first and last index of every bend with little room, extended by half a metre at both ends."""
    body, headings, end = costmap.body, np.unwrap(poses[:-1, 2]), len(poses) - 1  # the last heading is a turn
    room = EXACT_BEND * body.length  # the part ahead of the axle cuts a bend
    along = arc_lengths(poses[:, :2])
    before = np.searchsorted(along, along[:-1] - _BEND_OVER)
    after = np.minimum(np.searchsorted(along, along[:-1] + _BEND_OVER), end - 1)
    bent = np.flatnonzero(np.abs(headings[after] - headings[before]) > _BEND)
    found: list[tuple[int, int]] = []
    for bend in np.split(bent, 1 + np.flatnonzero(np.diff(bent) > 1)) if len(bent) else []:
        part = poses[bend]
        middle = Pose2(*part[:, :2].mean(axis=0).tolist())
        reach = np.hypot(*(part[:, :2] - (middle.x, middle.y)).T).max() + body.circumscribed_radius + room
        if fits_each(body, room, fine_field(costmap.grid, middle, reach), part).all():
            continue
        first, last = int(before[bend[0]]), int(after[bend[-1]]) + 1
        first = first if along[first] > _BEND_OVER else 0
        last = last if along[-1] - along[last] > 1.5 * DOCKING else end
        if found and along[first] - along[found[-1][1]] < _BEND_OVER:
            first = found.pop()[0]
        found.append((first, last))
    return found


def _legs_of_leg(costmap: Costmap, start: Pose2, poses: FloatArray) -> Resumable[list[PathLeg]]:
    """Return one free leg if it fits, else the legs that replace it."""
    tight = _tight_stretch(costmap, start, poses)
    if tight is None:
        return [PathLeg(Path(poses))]
    first, last = tight
    for around in _ROUND:
        begin, end = _ends(costmap, poses, first, last, around)
        from_pose = start if begin == 0 else Pose2(*poses[begin])
        turned = yield from manoeuvre_between(costmap, from_pose, Pose2(*poses[end]))
        if turned is None:
            continue
        before = [PathLeg(Path(poses[: begin + 1]))] if begin > 0 else []
        after: list[PathLeg] = []
        if end < len(poses) - 1:
            after = yield from _legs_of_leg(costmap, Pose2(*poses[end]), poses[end:])
        return [*before, *legs_of_manoeuvre(turned), *after]
    x, y, _ = poses[first]
    if not _stands_free(costmap, start):  # too near to an obstacle for any plan; the local planner may still get away
        near = fine_field(costmap.grid, start, costmap.body.circumscribed_radius + 0.3)
        why = reason_for_cramped(near, costmap.body, start, NOISE)
        if why is None:
            return [PathLeg(Path(poses))]
        raise NoPath(f"{why}; {BY_HAND}", (float(x), float(y)))
    raise NoPath(
        f"the chair does not fit at ({x:.2f}, {y:.2f}), not even with a multi-point turn; clear the way or choose "
        "another goal",
        (float(x), float(y)),
    )


def _tight_stretch(costmap: Costmap, start: Pose2, poses: FloatArray) -> tuple[int, int] | None:
    """Return first and last index of the first poses that do not fit or allow no turn; None if all are fine."""
    bad = (1 + np.flatnonzero(~_stand_free(costmap, poses[1:-1]))).tolist()
    into = _turn_at(costmap, Pose2(poses[0, 0], poses[0, 1], start.theta), float(poses[0, 2]), TURN_FROM)
    heading = float(poses[-2, 2]) if len(poses) > 1 else start.theta
    out = _turn_at(costmap, Pose2(poses[-1, 0], poses[-1, 1], heading), float(poses[-1, 2]), 0.1)
    bad = [*([] if into else [0]), *bad, *([] if out else [len(poses) - 1])]
    if not bad:
        return None
    last = bad[0]
    for k in bad[1:]:
        if k - last > 15:
            break
        last = k
    return bad[0], last


def _turn_at(costmap: Costmap, pose: Pose2, heading: float, turn_from: float) -> bool:
    """Return whether the chair can turn on the spot to a heading in either direction, or need not turn."""
    short = wrap_angle(heading - pose.theta)
    if abs(short) < turn_from:
        return True
    field = costmap.field
    for fine in (False, True):  # the map's cells are fine enough where there is room
        if fine:
            field = fine_field(costmap.grid, pose, costmap.body.circumscribed_radius + 0.3)
        shape = footprint(costmap.body, PLANNED_ON_PATH, field)
        at = in_cells(field, pose)
        for turn in (short, short - math.copysign(math.tau, short)):
            if free_time(shape, at, 0.0, turn, 1.0, 1.0) >= 1.0:
                return True
    return False


def _stands_free(costmap: Costmap, pose: Pose2) -> bool:
    """Return whether the footprint fits at a pose."""
    return bool(_stand_free(costmap, pose.array()[None])[0])


def _stand_free(costmap: Costmap, poses: FloatArray) -> BoolArray:
    """Return (N,) whether the footprint fits at poses (N, 3); the map's cells are fine enough where there is room."""
    free = fits_each(costmap.body, PLANNED_ON_PATH, costmap.field, poses)
    for k in np.flatnonzero(~free):
        pose = Pose2(*poses[k])
        field = fine_field(costmap.grid, pose, costmap.body.circumscribed_radius + 0.1)
        free[k] = fits(costmap.body, PLANNED_ON_PATH, field, pose)
    return free


def _ends(costmap: Costmap, poses: FloatArray, first: int, last: int, around: float) -> tuple[int, int]:
    """Return the indices of a multi-point turn's ends, at least `around` [m] from the misfit, where the chair fits."""
    begin, end = first, last
    while begin > 0 and (
        math.dist(poses[begin, :2], poses[first, :2]) < around or not _stands_free(costmap, Pose2(*poses[begin]))
    ):
        begin -= 1
    while end < len(poses) - 1 and (
        math.dist(poses[end, :2], poses[last, :2]) < around or not _stands_free(costmap, Pose2(*poses[end]))
    ):
        end += 1
    return begin, end


def manoeuvre_between(costmap: Costmap, begin: Pose2, end: Pose2) -> Resumable[FloatArray | None]:
    """Return a multi-point turn with as much margin as there is room for; None if there is none.

    From a cramped place the chair is led out first, rather than keeping that little clearance all along.
    """
    body, middle = costmap.body, Pose2((begin.x + end.x) / 2, (begin.y + end.y) / 2, 0.0)
    field = fine_field(costmap.grid, middle, math.hypot(end.x - begin.x, end.y - begin.y) / 2 + 2 * body.length)
    barred = costmap.barred_on(field)
    turned = yield from _turned(field=field, body=body, begin=begin, end=end, attempts=_ROOMY, barred=barred)
    if turned is not None:
        return turned
    out = yield from leading_out_path(field, body, begin, MAP_DOUBT * costmap.grid.resolution)
    if out is not None:
        turned = yield from _turned(
            field=field, body=body, begin=Pose2(*out[-1]), end=end, attempts=_ROOMY, barred=barred
        )
        if turned is not None:
            return np.concatenate([out[:-1], turned])
    return (yield from _turned(field=field, body=body, begin=begin, end=end, attempts=_TIGHT, barred=barred))


def _turned(
    field: DistanceField,
    body: ChairBody,
    begin: Pose2,
    end: Pose2,
    attempts: Sequence[ManoeuvreAttempt],
    barred: Bytes,
) -> Resumable[FloatArray | None]:
    for attempt in attempts:
        yield
        with suppress(NoPath):
            return (
                yield from manoeuvre_resumably(
                    field=field, body=body, start=begin, goal=end, attempt=attempt, barred=barred
                )
            )
    return None


def legs_of_manoeuvre(poses: FloatArray) -> list[PathLeg]:
    """Return legs cut at turns on the spot and changes of direction; each leg ends in the heading of the next."""
    steps = np.diff(poses[:, :2], axis=0)
    along = steps[:, 0] * np.cos(poses[:-1, 2]) + steps[:, 1] * np.sin(poses[:-1, 2])
    gears = np.where((steps == 0.0).all(axis=1), 0, np.where(along < 0.0, -1, 1))
    legs: list[PathLeg] = []
    begin = 0
    for k in range(1, len(gears) + 1):
        if k < len(gears) and gears[k] == gears[begin]:
            continue
        part = poses[begin : k + 1].copy()
        if gears[begin] == 0 and legs:  # the leg before ends with this turn
            legs[-1].path.poses[-1, 2] = part[-1, 2]
        else:
            legs.append(PathLeg(Path(part), DrivingManner.EXACT, backwards=bool(gears[begin] < 0)))
        begin = k
    return legs
