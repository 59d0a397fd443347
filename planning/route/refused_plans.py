"""The true cause of a failed plan, found by planning again with one thing after another taken away.

Taken away in turn are slim live obstacles (people stand on two legs, so somebody is as wide as a leg or two), all live
obstacles, the one-way zones, the keep-out zones, and last the chair's width. The first of them without which there is a
way is the cause, and the place where that way meets it is told. The plans are made in parts of a tick, since a chair that
waits asks for the cause, too.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import cv2
import numpy as np
from scipy.spatial import cKDTree

from waychair.errors import GoalOccupied, NoPath, PlanningError, StartOccupied
from waychair.geometry import transform_points
from waychair.maps.drawn.zones import Rule, Zone, zone_contains
from waychair.maps.grid.cells import cells_from_points
from waychair.planning.body.clearance import HARD, PLANNED
from waychair.planning.body.footprint import fits
from waychair.planning.grid.costmap import Costmap, costmap_in_bands
from waychair.planning.grid.drawn_map import DrawnMap
from waychair.planning.route.global_planner import GlobalPlanner, PlannerSettings
from waychair.planning.route.path_ends import cell_at
from waychair.resumable import Resumable
from waychair.types import FloatArray, Pose2

SLIM, LEAF, FLAT = 0.9, 0.45, 0.03
"""[m] An obstacle no longer than the first is somebody, or something as slim, unless it is longer than the second and as
flat as the third (r.m.s. off a line): then it is the leaf of a door, the part of it that no jamb hides. People are round
and have a shadow of mixed pixels."""

_DOORWAY, _NEAR_WALL = 0.75, 0.2
"""[m] A place with walls on both sides no farther than the first is told as a doorway; a point nearer than the second to a
wall is at that wall."""

_APART = 0.4
"""[m] Points of one obstacle are no farther apart than two legs of one person."""

_CELL = 0.05
"""[m] Points this near are one in the search for an obstacle's points: a camera sees thousands."""

_ANYTHING = 0.15
"""[m] Half the width of the narrowest body that is tried: a gap too narrow for it is a crack in a wall."""

_STEPS = 7
"""Halvings of the interval in which the width of the widest way lies: to about a centimetre."""


@dataclass(frozen=True, slots=True)
class Obstruction:
    """The thing that a way meets: a sentence without advice, the advice, and where [m] in map, if at one place.

    `in_doorway`: it may be gone before long, since people leave doors and open them. `spoken`: the sentence for somebody who does
    not see the map, without coordinates; empty where it is about the map itself.
    """

    what: str
    advice: str
    at: tuple[float, float] | None = None
    in_doorway: bool = False
    spoken: str = ""

    @property
    def text(self) -> str:
        """The sentence with its advice."""
        return f"{self.what}; {self.advice}"


_NOTHING = np.empty((0, 2))


def explained(
    error: PlanningError, drawn: DrawnMap, start: Pose2, goal: Pose2, points: FloatArray = _NOTHING
) -> Resumable[PlanningError]:
    """Return the error of a plan over a map with its zones and live obstacles, saying what is truly in the way.

    It is the error itself if nothing better is known. `points` as in `cause_of`.
    """
    found = yield from cause_of(error, drawn, start, goal, points)
    return error if found is None else type(error)(found.text)


def cause_of(
    error: PlanningError, drawn: DrawnMap, start: Pose2, goal: Pose2, points: FloatArray
) -> Resumable[Obstruction | None]:
    """Return what keeps a plan over a map with its zones and live obstacles from its goal; None if unknown.

    The obstacles are points (N, 2) [m] in map, whose height is unknown or that concern a layer of the body only.
    """
    yield
    if isinstance(error, StartOccupied):
        return (yield from _at_an_end(drawn, start, points, "start"))
    if isinstance(error, GoalOccupied):
        return (yield from _at_an_end(drawn, goal, points, "goal"))
    if not isinstance(error, NoPath):
        return None
    place = getattr(error, "place", None)
    if place is not None:  # there is a way for a narrow body, but the whole chair does not fit there
        return _at_a_place(drawn, place, points)
    return (yield from _across(drawn, start, goal, points))


def _at_an_end(drawn: DrawnMap, pose: Pose2, points: FloatArray, end: str) -> Resumable[Obstruction | None]:
    """Return what the chair would touch at the start or the goal, other than the map's walls."""
    body = drawn.body
    free = (yield from costmap_in_bands(drawn.bare, body)) if drawn.zones else drawn.costmap()
    if not (_passable(free, pose) and fits(body, HARD, free.field, pose)) and end == "goal":
        return None
    outline = _outline(drawn, pose)
    zone = _first_zone(drawn.zones, Rule.KEEP_OUT, outline)
    if zone is not None:
        what = "covers the goal" if end == "goal" else "lies under the chair"
        advice = "choose another goal" if end == "goal" else "drive it out by hand"
        return Obstruction(
            f"the keep-out zone '{zone.name}' {what} at ({pose.x:.2f}, {pose.y:.2f})", f"{advice}, or change the zone"
        )
    group = _group_near(points, np.array([[pose.x, pose.y]]), body.circumscribed_radius + PLANNED)
    if group is None:
        return None
    at = f"({group[:, 0].mean():.1f}, {group[:, 1].mean():.1f})"
    if end == "start":
        spoken = f"{_who(group)} stands close beside the chair"
        return Obstruction(f"{spoken}, at {at}", "ask for room, or drive by hand", spoken=spoken)
    spoken = f"{_who(group)} stands where the goal is"
    return Obstruction(f"{spoken}, at {at}", "ask for room, or choose another goal", spoken=spoken)


def _at_a_place(drawn: DrawnMap, place: tuple[float, float], points: FloatArray) -> Obstruction | None:
    """Return the live obstacle or the keep-out zone that leaves the chair no room at a place."""
    room = drawn.body.circumscribed_radius + PLANNED
    group = _group_near(points, np.array([place]), room)
    if group is not None:
        return _in_the_way(group, drawn)
    around = np.array([place]) + room * np.array([(math.cos(a), math.sin(a)) for a in np.arange(0.0, math.tau, 0.2)])
    zone = _first_zone(drawn.zones, Rule.KEEP_OUT, around)
    if zone is None:
        return None
    return Obstruction(
        f"the keep-out zone '{zone.name}' leaves the chair no room at ({place[0]:.2f}, {place[1]:.2f})",
        "change the zone or choose another goal",
    )


def _across(drawn: DrawnMap, start: Pose2, goal: Pose2, points: FloatArray) -> Resumable[Obstruction | None]:
    """Return what bars every way from the start to the goal."""
    usual = drawn.costmap()
    if len(points):
        group = yield from _barring(usual, start, goal, points)
        if group is not None:
            return _in_the_way(group, drawn)
    both_ways = replace(usual, barred=None)
    if usual.barred is not None and (way := (yield from _way(both_ways, start, goal))) is not None:
        return _zone_told(drawn.zones, Rule.ONE_WAY, way, start, goal)
    bare = (yield from costmap_in_bands(drawn.bare, drawn.body)) if drawn.zones else both_ways
    if drawn.zones and (way := (yield from _way(bare, start, goal))) is not None:
        return _zone_told(drawn.zones, Rule.KEEP_OUT, way, start, goal)
    return (yield from _too_narrow(bare, start, goal))


def _barring(usual: Costmap, start: Pose2, goal: Pose2, points: FloatArray) -> Resumable[FloatArray | None]:
    """Return the first live obstacle (N, 2) [m] on the way that there would be without any; None without a way."""
    way = yield from _way(usual, start, goal)
    yield
    return None if way is None else _first_on(way, points, usual.body.width / 2 + PLANNED + usual.grid.resolution)


def obstruction_on(way: FloatArray, points: FloatArray, drawn: DrawnMap, half: float) -> Obstruction | None:
    """Return the first of live obstacles (N, 2) [m] nearer than `half` [m] to a way (M, 2) [m]; None without one."""
    group = _first_on(way, points, half)
    return None if group is None else _in_the_way(group, drawn)


def _first_on(way: FloatArray, points: FloatArray, half: float) -> FloatArray | None:
    if not len(points):
        return None
    for k, point in enumerate(way):
        if (np.hypot(*(points - point).T) < half).any():
            return _group_near(points, way[k : k + 1], half)
    return None


def _in_the_way(group: FloatArray, drawn: DrawnMap) -> Obstruction:
    """Return a live obstacle in the way, in a doorway where the map's walls are near."""
    x, y = group.mean(axis=0).tolist()
    at = f"({x:.1f}, {y:.1f})"
    in_doorway = _is_doorway(drawn, x, y)
    where = "in the doorway" if in_doorway else "in the way"
    if _is_slim(group):
        spoken = f"{_who(group)} stands {where}"
        return Obstruction(f"{spoken} at {at}", "wait, or ask for room", (x, y), in_doorway, spoken)
    what = f"the door is shut at {at}, or something stands in it" if in_doorway else f"the way is shut at {at}"
    spoken = "the door is shut, or something stands in it" if in_doorway else "the way is shut"
    return Obstruction(what, "wait, or have it opened", (x, y), in_doorway, spoken)


def _is_doorway(drawn: DrawnMap, x: float, y: float) -> bool:
    """Return whether walls of the map are near on two opposite sides of a point [m] in map, and free ground across."""
    away = np.linspace(0.3, _DOORWAY, 4)
    angles = np.arange(0.0, math.tau, math.pi / 4)
    rays = np.array([x, y]) + away[:, None, None] * np.column_stack([np.cos(angles), np.sin(angles)])
    at_walls = drawn.is_mapped(rays.reshape(-1, 2), _NEAR_WALL).reshape(len(away), 8)
    walls = np.logical_or.reduce(at_walls, axis=0).tolist()
    return any(walls[k] and walls[k + 4] and not walls[k + 2] and not walls[(k + 6) % 8] for k in range(4))


def _zone_told(zones: Sequence[Zone], rule: Rule, way: FloatArray, start: Pose2, goal: Pose2) -> Obstruction:
    zone = _first_zone(zones, rule, way)
    kind = "keep-out" if rule is Rule.KEEP_OUT else "one-way"
    name = f"the {kind} zone '{zone.name}'" if zone is not None else f"a {kind} zone"
    return Obstruction(
        f"{name} bars every way from ({start.x:.2f}, {start.y:.2f}) to ({goal.x:.2f}, {goal.y:.2f})",
        "change the zone or choose another goal",
    )


def _too_narrow(bare: Costmap, start: Pose2, goal: Pose2) -> Resumable[Obstruction]:
    """Return the widest way there is, if a narrow body could pass at all; else the walls between start and goal."""
    ends = f"from ({start.x:.2f}, {start.y:.2f}) to ({goal.x:.2f}, {goal.y:.2f})"
    cells = cell_at(bare, start), cell_at(bare, goal)
    if cells[0] is None or cells[1] is None or not _joined(bare, cells[0], cells[1], _ANYTHING):
        return Obstruction(
            f"no path leads {ends}: walls on the map close every way",
            "map again with the doors open if one was shut, or choose another goal",
        )
    needed = bare.body.width / 2 + PLANNED
    low, high = _ANYTHING, needed + bare.grid.resolution
    for _ in range(_STEPS):
        middle = (low + high) / 2
        yield
        low, high = (middle, high) if _joined(bare, cells[0], cells[1], middle) else (low, middle)
    place = ""
    yield
    prices = np.maximum(bare.prices, 1000)
    yield
    prices[bare.clearance < low] = 0
    yield
    if (way := (yield from _way(replace(bare, prices=prices), start, goal))) is not None:
        at = cells_from_points(bare.grid, way)
        x, y = way[int(np.argmin(bare.clearance[tuple(at.T)]))].tolist()
        place = f" at ({x:.1f}, {y:.1f})"
    return Obstruction(
        f"no path wide enough for the chair leads {ends}: the widest is about {2 * low - bare.grid.resolution:.2f} m "
        f"wide{place}, and the chair needs {2 * needed:.2f} m",
        "clear the way or choose another goal",
    )


def _joined(costmap: Costmap, start: tuple[int, int], goal: tuple[int, int], half: float) -> bool:
    """Return whether a round body of this half width [m] can pass from cell to cell."""
    free = costmap.clearance >= half
    free[start] = free[goal] = True
    _, numbers = cv2.connectedComponents(free.astype(np.uint8), connectivity=4)
    return bool(numbers[start] == numbers[goal])


def _way(costmap: Costmap, start: Pose2, goal: Pose2) -> Resumable[FloatArray | None]:
    """Return points (N, 2) [m] of a path for the half width alone; None where there is none."""
    planner = GlobalPlanner(goal, PlannerSettings(), check_footprint=False)
    with suppress(PlanningError):
        path = yield from planner.replan_resumably(costmap, lambda: start)
        return path.poses[:, :2]
    return None


def _passable(costmap: Costmap, pose: Pose2) -> bool:
    cell = cell_at(costmap, pose)
    return cell is not None and bool(costmap.prices[cell])


def _outline(drawn: DrawnMap, pose: Pose2) -> FloatArray:
    """Return points (N, 2) [m] in map on and in the chair's outline at a pose, a cell apart."""
    body, step = drawn.body, drawn.grid.resolution
    x, y = np.arange(-body.rear, body.front + step, step), np.arange(-body.width / 2, body.width / 2 + step, step)
    return transform_points(pose, np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2))


def _first_zone(zones: Sequence[Zone], rule: Rule, points: FloatArray) -> Zone | None:
    """Return the first zone of a kind on points (N, 2) [m] in map, in their order; None if there is none."""
    hits = [
        (int(np.argmax(on)), k)
        for k, zone in enumerate(zones)
        if zone.rule is rule and (on := zone_contains(zone, points)).any()
    ]
    return zones[min(hits)[1]] if hits else None


def _group_near(points: FloatArray, places: FloatArray, within: float) -> FloatArray | None:
    """Return the points (N, 2) [m] of the obstacle nearest to places (M, 2), if nearer than `within` [m]."""
    if not len(points):
        return None
    gaps, _ = cKDTree(places).query(points)
    first = int(np.argmin(gaps))
    if gaps[first] > within:
        return None
    cells, cell_of = np.unique(np.floor(points / _CELL).astype(np.int64), axis=0, return_inverse=True)
    tree, cell_of = cKDTree(cells * _CELL), cell_of.ravel()
    group = np.zeros(len(cells), np.bool_)
    border = [int(cell_of[first])]
    while border:
        group[border] = True
        near = np.concatenate(tree.query_ball_point(cells[border] * _CELL, _APART)).astype(np.int64)
        border = np.unique(near[~group[near]]).tolist()
    found: FloatArray = points[group[cell_of]]
    return found


def _is_slim(group: FloatArray) -> bool:
    """Return whether an obstacle of points (N, 2) [m] is as slim as somebody, and no leaf of a door."""
    off = group - group.mean(axis=0)
    if len(group) > 2:
        off = off @ np.linalg.svd(off, full_matrices=False)[2].T
    length, thickness = float(np.ptp(off[:, 0])), float(np.sqrt((off[:, 1] ** 2).mean()))
    return length <= SLIM and not (length > LEAF and thickness < FLAT)


def _who(group: FloatArray) -> str:
    return "somebody (or something as slim)" if _is_slim(group) else "something"
