"""From a chain of points to legs: straight through doors, multi-point turns where the rectangle needs them, else free.

The chain knows the chair's half width only. Here the rectangle is asked: whether it fits in the chain's direction all
along, and whether it can be turned where the direction changes at once. Where not, a manoeuvre takes the chain's place.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np

from waychair.calibration.chair import ChairBody
from waychair.config import Settings, setting
from waychair.errors import NoPath
from waychair.geometry import arc_lengths, wrap_angle
from waychair.maps.distance_field import DistanceField
from waychair.planning.costmap import Costmap
from waychair.planning.fine_field import fine_field
from waychair.planning.footprint import fits, fits_each, footprint, free_time, in_cells
from waychair.planning.legs import Door, Leg, Manner
from waychair.planning.manoeuvre import ManoeuvreSettings, manoeuvre_in_slices
from waychair.planning.slices import Slices
from waychair.planning.way_out import BY_HAND, CRAMPED, way_out, why_cramped
from waychair.types import BoolArray, Bytes, FloatArray, Path, Pose2

_FITS = 0.045
"""Kept free round the body [m] where the simple way is judged: what the local planner keeps, on its coarser cells."""

_ROOMY = (0.05, 0.05, 72), (CRAMPED, 0.05, 72)
_TIGHT = (0.02, 0.025, 144), (0.015, 0.025, 144), (0.015, 0.02, 180)
"""Margin round the body [m], side of a bin [m] and number of headings: the first with which there is a manoeuvre.

Less than the last is less than a chair knows its place by.
"""

_KNOWN = 0.005
"""Nearer to something than this [m], which is noise, a chair does not try what was not planned."""

_AHEAD = (0.8, 0.6, 0.45, 0.3, 0.2, 0.1)
"""Before a door's middle [m]: where the front end may stand when the chair lines up, the farthest with room."""

_PAST = (0.35, 0.2, 0.1)
"""Past a door's middle [m]: where the rear end is when the chair is through."""

_STRAIGHT_M, _STRAIGHT_RAD = 0.1, 0.3
"""A chair no farther off a door's axis and direction than this [m], [rad] goes on without lining up anew."""

_BEND, _BEND_OVER = 0.3, 0.5
"""A path that turns by more than this [rad] from so far [m] before a place to so far after it bends there."""

_ROUND = (0.8, 2.0)
"""How much [m] of the chain on both sides of what does not fit a manoeuvre may replace: more when less is in vain."""


@dataclass(frozen=True, slots=True)
class RouteSettings(Settings):
    """When the chain of points is not enough."""

    door_slack: float = setting(
        0.35, "m", "a door this much wider than the chair is lined up with exactly", low=0.0, high=2.0
    )
    turn_from: float = setting(1.0, "rad", "direction off by more: the chair turns in place", low=0.2, high=math.pi)
    docking: float = setting(1.0, "m", "last part of a leg that is kept to exactly", low=0.0, high=5.0)
    bend_share: float = setting(
        0.3,
        "",
        "a band's bend with less room than this part of the body's length is kept to exactly",
        low=0.0,
        high=1.0,
    )
    manoeuvre: ManoeuvreSettings = field(default_factory=ManoeuvreSettings)


def door_leg(costmap: Costmap, door: Door, start: Pose2, goal: Pose2) -> Leg | None:
    """The leg through a door on its axis, from where the chair lines up to where it is through; None without room.

    One that stands in the door already, and straight, goes on from there; a goal in the door ends the leg.
    """
    body, middle = costmap.body, door.map_from_door
    near = fine_field(costmap.grid, middle, body.length + 1.0)

    def first(places: list[float]) -> float | None:
        return next((x for x in places if fits(body, 0.0, near, middle @ Pose2(x, 0.0, 0.0))), None)

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
    return Leg(Path(poses), Manner.DOOR, door=door)


def checked(
    costmap: Costmap, start: Pose2, legs: list[Leg], settings: RouteSettings, banded: bool = False
) -> Slices[list[Leg]]:
    """The free legs, each whole or with manoeuvres where the rectangle does not pass; `start` is the pose before them.

    Searching for a manoeuvre takes its time: it is done in slices. The bends of a rubber band (`banded`) may take all
    the room there is; a local planner that cuts them is caught there, so that tight ones become exact legs.

    Raises:
        NoPath: at some place the chair does not fit round.
    """
    done: list[Leg] = []
    for leg in legs:
        parts = [leg]
        if leg.manner is Manner.FREE:
            parts = yield from _legs_of_leg(costmap, start, leg.path.poses, settings)
        if banded:
            parts = [piece for part in parts for piece in _with_exact_bends(costmap, part, settings)]
        done += [half for part in parts for half in _docked(part, settings.docking)]
        start = Pose2(*done[-1].path.poses[-1])
    return done


def _docked(leg: Leg, docking: float) -> list[Leg]:
    """A free leg whose last metre is exact, as it ends where the chair is to stop; another one as it is."""
    if leg.manner is not Manner.FREE or leg.flows or docking == 0.0:
        return [leg]
    poses = leg.path.poses
    left = np.append(np.hypot(*np.diff(poses[:, :2], axis=0).T)[::-1].cumsum()[::-1], 0.0)
    if left[0] <= 1.5 * docking:
        return [Leg(leg.path, Manner.EXACT)]
    k = int(np.searchsorted(-left, -docking))
    return [Leg(Path(poses[: k + 1]), flows=True), Leg(Path(poses[k:].copy()), Manner.EXACT)]


def _with_exact_bends(costmap: Costmap, leg: Leg, settings: RouteSettings) -> list[Leg]:
    """A free leg, its tight bends cut out of it as exact legs; another one as it is."""
    poses, done = leg.path.poses, 0
    if leg.manner is not Manner.FREE or len(poses) < 3:
        return [leg]
    legs: list[Leg] = []
    for first, last in _tight_bends(costmap, poses, settings):
        if first > done:
            legs.append(Leg(Path(poses[done : first + 1].copy()), flows=True))
        legs.append(Leg(Path(poses[first : last + 1].copy()), Manner.EXACT))
        done = last
    return legs if done == len(poses) - 1 else [*legs, Leg(Path(poses[done:]))]


def _tight_bends(costmap: Costmap, poses: FloatArray, settings: RouteSettings) -> list[tuple[int, int]]:
    """First and last index of every bend with little room, with half a metre on both sides; what is left is longer."""
    body, headings, end = costmap.body, np.unwrap(poses[:-1, 2]), len(poses) - 1  # the last heading is a turn in place
    room = settings.bend_share * body.length  # by how much a bend is cut grows with what is ahead of the axle
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
        last = last if along[-1] - along[last] > 1.5 * settings.docking else end
        if found and along[first] - along[found[-1][1]] < _BEND_OVER:
            first = found.pop()[0]
        found.append((first, last))
    return found


def _legs_of_leg(costmap: Costmap, start: Pose2, poses: FloatArray, settings: RouteSettings) -> Slices[list[Leg]]:
    """One free leg, checked: itself, or what can be driven in its place."""
    tight = _tight_stretch(costmap, start, poses, settings.turn_from)
    if tight is None:
        return [Leg(Path(poses))]
    first, last = tight
    for around in _ROUND:
        begin, end = _ends(costmap, poses, first, last, around)
        from_pose = start if begin == 0 else Pose2(*poses[begin])
        turned = yield from _manoeuvre(costmap, from_pose, Pose2(*poses[end]), settings.manoeuvre)
        if turned is None:
            continue
        before = [Leg(Path(poses[: begin + 1]))] if begin > 0 else []
        after: list[Leg] = []
        if end < len(poses) - 1:
            after = yield from _legs_of_leg(costmap, Pose2(*poses[end]), poses[end:], settings)
        return [*before, *_legs_of_manoeuvre(turned), *after]
    x, y, _ = poses[first]
    if not _stands_free(costmap, start):  # too near to something for any plan: the local planner may still get away
        near = fine_field(costmap.grid, start, costmap.body.circumscribed_radius + 0.3)
        why = why_cramped(near, costmap.body, start, _KNOWN)
        if why is None:
            return [Leg(Path(poses))]
        raise NoPath(f"{why}; {BY_HAND}")
    raise NoPath(
        f"the chair does not fit round at ({x:.2f}, {y:.2f}), not even in several goes; clear the way or choose "
        "another goal"
    )


def _tight_stretch(costmap: Costmap, start: Pose2, poses: FloatArray, turn_from: float) -> tuple[int, int] | None:
    """First and last index of the first poses that do not fit, or at which the chair cannot turn; None if all is well."""
    bad = (1 + np.flatnonzero(~_stand_free(costmap, poses[1:-1]))).tolist()
    into = _turn_at(costmap, Pose2(poses[0, 0], poses[0, 1], start.theta), float(poses[0, 2]), turn_from)
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
    """Whether the chair can turn in place to a heading, one way round or the other, if it has to at all."""
    short = wrap_angle(heading - pose.theta)
    if abs(short) < turn_from:
        return True
    field = costmap.field
    for fine in (False, True):  # the map's own cells are enough where there is room
        if fine:
            field = fine_field(costmap.grid, pose, costmap.body.circumscribed_radius + 0.3)
        shape = footprint(costmap.body, _FITS, field)
        at = in_cells(field, pose)
        for turn in (short, short - math.copysign(math.tau, short)):
            if free_time(shape, at, 0.0, turn, 1.0, 1.0) >= 1.0:
                return True
    return False


def _stands_free(costmap: Costmap, pose: Pose2) -> bool:
    """Whether the rectangle fits at a pose."""
    return bool(_stand_free(costmap, pose.array()[None])[0])


def _stand_free(costmap: Costmap, poses: FloatArray) -> BoolArray:
    """(N,) whether the rectangle fits at poses (N, 3); the map's own cells say so where there is room."""
    free = fits_each(costmap.body, _FITS, costmap.field, poses)
    for k in np.flatnonzero(~free):
        pose = Pose2(*poses[k])
        field = fine_field(costmap.grid, pose, costmap.body.circumscribed_radius + 0.1)
        free[k] = fits(costmap.body, _FITS, field, pose)
    return free


def _ends(costmap: Costmap, poses: FloatArray, first: int, last: int, around: float) -> tuple[int, int]:
    """Indices of the poses between which a manoeuvre is to lead: `around` [m] off, or farther, where the chair fits."""
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


def _manoeuvre(costmap: Costmap, begin: Pose2, end: Pose2, settings: ManoeuvreSettings) -> Slices[FloatArray | None]:
    """A multi-point turn with as much margin as there is room for; None where there is none at all.

    From a cramped place it leads out first, rather than keep as little all the way.
    """
    body, middle = costmap.body, Pose2((begin.x + end.x) / 2, (begin.y + end.y) / 2, 0.0)
    field = fine_field(costmap.grid, middle, math.hypot(end.x - begin.x, end.y - begin.y) / 2 + 2 * body.length)
    barred = costmap.barred_on(field)
    turned = yield from _turned(field, body, begin, end, settings, _ROOMY, barred)
    if turned is not None:
        return turned
    out = yield from way_out(field, body, begin)
    if out is not None:
        turned = yield from _turned(field, body, Pose2(*out[-1]), end, settings, _ROOMY, barred)
        if turned is not None:
            return np.concatenate([out[:-1], turned])
    return (yield from _turned(field, body, begin, end, settings, _TIGHT, barred))


def _turned(
    field: DistanceField,
    body: ChairBody,
    begin: Pose2,
    end: Pose2,
    settings: ManoeuvreSettings,
    attempts: Sequence[tuple[float, float, int]],
    barred: Bytes,
) -> Slices[FloatArray | None]:
    for margin, side, headings in attempts:
        yield
        with suppress(NoPath):
            attempt = replace(settings, margin=margin, bin=side, headings=headings)
            return (yield from manoeuvre_in_slices(field, body, begin, end, attempt, barred))
    return None


def _legs_of_manoeuvre(poses: FloatArray) -> list[Leg]:
    """Cut at turns in place and where the direction of travel changes; each leg ends in the heading of the next."""
    steps = np.diff(poses[:, :2], axis=0)
    along = steps[:, 0] * np.cos(poses[:-1, 2]) + steps[:, 1] * np.sin(poses[:-1, 2])
    gears = np.where((steps == 0.0).all(axis=1), 0, np.where(along < 0.0, -1, 1))
    legs: list[Leg] = []
    begin = 0
    for k in range(1, len(gears) + 1):
        if k < len(gears) and gears[k] == gears[begin]:
            continue
        part = poses[begin : k + 1].copy()
        if gears[begin] == 0 and legs:  # the leg before it ends with this turn
            legs[-1].path.poses[-1, 2] = part[-1, 2]
        else:
            legs.append(Leg(Path(part), Manner.EXACT, backwards=bool(gears[begin] < 0)))
        begin = k
    return legs
