"""From a goal to steps: pivots where the chair can spin, straight legs that it clears with the driver's wander, doors.

The D* Lite route gives the way round and the doors on it, with everything that is closed. Pivots are chosen from places
beside that route; a search over them (A*, Hart et al. 1968) finds the shortest chain of legs, in which each pivot costs
as much as `PIVOT_COST` metres: drivers without sight err at slight turns and in the open, so turns are few and sharp.
"""

from __future__ import annotations

import heapq
import itertools
import math
from collections.abc import Iterator, Sequence
from typing import TypeAlias

import numpy as np

from waychair.geometry import arcs, compose, evenly_spaced, transform_points, wrap_angle
from waychair.planning.body.clearance import NARROW
from waychair.planning.grid.costmap import Costmap
from waychair.planning.route.global_planner import GlobalPlanner, PlannerSettings
from waychair.planning.route.legs import DoorPassage
from waychair.planning.route.tight_doors import tight_doors
from waychair.planning.steps.clear_ground import SPIN_ROOM, ClearGround
from waychair.planning.steps.door_steps import door_steps, doors_too_narrow, places_before
from waychair.planning.steps.step import NoSteps, Step, StepKind, StepPlan, with_pivots
from waychair.types import BoolArray, FloatArray, Goal, Pose2

PIVOT_COST = 1.5
"""m; a turn on the spot takes a driver as long as this way."""

WANDERS = (0.14, 0.10, 0.06)
"""m; room that a leg has on both sides, tried in turn: a driver wanders by about the first over a few metres. The last is
for places where the guard has to hold the chair off the wall."""

WIDEST_DOOR = 0.45
"""m; a gap wider than the chair by more than this is passed like open floor."""

BACK_COST = 3.0
"""A metre backwards costs as much as so many ahead: nobody sees behind the chair."""

_ALONG, _ASIDE = 0.4, (-0.9, -0.6, -0.3, 0.0, 0.3, 0.6, 0.9)
"""m; places for pivots: along the route, and beside it."""

_GOAL_RINGS, _GOAL_COST = (0.15, 0.3), 4.0
"""m and cost per m; an arrival so near to the goal will do where the goal itself is too tight, the nearer the better."""

_OUT_APART, _OUT_LOOKS, _OUT_ON, _OUT_TURN = 0.1, 30, 3, math.radians(10.0)
"""m between the looks, and how many, on a way straight out of a place in which the chair cannot turn; how many of the places with room
to spin are looked at, because a driver does not stop to the hand's breadth, so that the one with the most room is taken; and rad between
the directions of such ways."""

_SHUFFLE, _SHUFFLES = 0.2, 5
"""m, and how many times as far at the most, straight on or back before a turn that is not free at the start."""

_LAST_TURN = math.radians(15.0)
"""rad; the chair turns to the goal's heading at the end only if it is farther off."""


class StepPlanner:
    """Steps to one goal; the search over the grid is kept, so that replanning only repairs it."""

    def __init__(self, goal: Goal, pose: Pose2, settings: PlannerSettings | None = None) -> None:
        """`pose` is that of the goal, in map."""
        self.goal = goal
        self.pose = pose
        self._route = GlobalPlanner(pose, settings or PlannerSettings(), check_footprint=False)

    def replan(self, costmap: Costmap, start: Pose2) -> StepPlan:
        """Return the steps from wherever the chair is now.

        Raises:
            NoSteps: no chain of pivots and legs leads there; its message says why and offers autonomy.
            PlanningError: start or goal are not on free ground, as for `GlobalPlanner.replan`.
        """
        route = self._route.replan(costmap, start).poses[:, :2]
        return steps_along(costmap, route, start, self.pose)


def steps_along(costmap: Costmap, route: FloatArray, start: Pose2, goal: Pose2) -> StepPlan:
    """Return the steps from start to goal beside a route (N, 2) [m] in map.

    Raises:
        NoSteps: there are none.
    """
    ground, body = ClearGround(costmap), costmap.body
    if math.hypot(goal.x - start.x, goal.y - start.y) < _GOAL_RINGS[-1]:
        return with_pivots(start, [], _last_heading(ground, start, goal))
    doors = doors_on(costmap, route)
    narrow = doors_too_narrow(doors, body)
    if narrow is not None:
        place = narrow.map_from_door.x, narrow.map_from_door.y
        raise NoSteps(f"a door on the way is {narrow.width:.2f} m wide and the chair {body.width:.2f} m", place)
    passages = [list(door_steps(ground, door)) for door in doors]
    places = _places(ground, route, goal)
    tight = [places_before(ground, door) for door, ways in zip(doors, passages, strict=True) if not ways]
    legs = _legs(ground, start, goal, places, passages)
    if legs is None and tight:
        legs = _legs(ground, start, goal, np.concatenate([places, *tight]), passages)
    if legs is not None:
        return with_pivots(start, legs, _last_heading(ground, legs[-1].end if legs else start, goal))
    for door, ways in zip(doors, passages, strict=True):
        if not ways:
            place = door.map_from_door.x, door.map_from_door.y
            raise NoSteps(
                f"there is no room to turn before or behind the door at ({place[0]:.1f}, {place[1]:.1f})", place
            )
    raise NoSteps(f"no straight legs with turns on the spot lead to ({goal.x:.1f}, {goal.y:.1f}): it is too tight")


def _legs(
    ground: ClearGround, start: Pose2, goal: Pose2, places: FloatArray, passages: Sequence[Sequence[Step]]
) -> list[Step] | None:
    """Return the legs from start to goal with the most room beside them; None where no legs lead there."""
    search = _Search(ground, start, goal, places, passages)
    return next((legs for wander in WANDERS if (legs := search.legs(wander)) is not None), None)


def doors_on(costmap: Costmap, route: FloatArray) -> list[DoorPassage]:
    """Return the doors on a route (N, 2) [m] in map that a driver passes straight, in order."""
    even = evenly_spaced(route, costmap.grid.resolution)
    cells = transform_points(costmap.grid.map_from_grid.inverse(), even) / costmap.grid.resolution
    found = tight_doors(costmap, cells, NARROW, costmap.body.width + WIDEST_DOOR)
    return [_in_the_middle(costmap, door) for _, _, door in found]


def _in_the_middle(costmap: Costmap, door: DoorPassage) -> DoorPassage:
    """Return the door with its pose in the middle of the wall: half-way along its narrowest part."""
    at, cell = door.map_from_door, costmap.grid.resolution
    along = np.arange(-_DEEPEST, _DEEPEST, cell / 2)
    points = np.column_stack([at.x + math.cos(at.theta) * along, at.y + math.sin(at.theta) * along])
    clear = ClearGround(costmap).clearance(points)
    near = np.abs(along) < _DEEPEST / 2
    narrow = along[near & (clear <= clear[near].min() + cell)]
    middle = at @ Pose2(float(narrow.mean()))
    return DoorPassage(Pose2(float(middle.x), float(middle.y), middle.theta), float(door.width))


_DEEPEST = 0.4
"""m; a wall's thickness at the most."""


def _last_heading(ground: ClearGround, here: Pose2, goal: Pose2) -> float | None:
    """Return the goal's heading if the chair has to turn to it and can."""
    if abs(wrap_angle(goal.theta - here.theta)) < _LAST_TURN or not ground.turn_is_free(here, goal.theta):
        return None
    return goal.theta


def _places(ground: ClearGround, route: FloatArray, goal: Pose2) -> FloatArray:
    """Return places (N, 2) [m] in map: where the chair can spin beside a route, the goal, and a ring round it."""
    even = evenly_spaced(route, _ALONG)
    ahead = np.gradient(even, axis=0) if len(even) > 1 else np.ones_like(even)
    ahead /= np.maximum(np.hypot(*ahead.T), 1e-9)[:, None]
    left = np.column_stack([-ahead[:, 1], ahead[:, 0]])
    beside = (even[:, None] + np.array(_ASIDE)[None, :, None] * left[:, None]).reshape(-1, 2)
    angles = np.arange(8) * math.tau / 8
    round_goal = np.column_stack([np.cos(angles), np.sin(angles)])
    rings = [np.array([goal.x, goal.y]) + radius * round_goal for radius in _GOAL_RINGS]
    return np.concatenate([beside[ground.spin_room(beside) >= SPIN_ROOM], [[goal.x, goal.y]], *rings])


class _Search:
    """A* over pivots: beside the route, at the goal, before and behind doors, straight out of the start, and the start.

    The rooms beside legs are kept for the next, less demanding search.
    """

    def __init__(
        self, ground: ClearGround, start: Pose2, goal: Pose2, places: FloatArray, passages: Sequence[Sequence[Step]]
    ) -> None:
        self._ground, self._start, self._goal = ground, start, goal
        doors = [(rank, step) for ways in passages for rank, step in enumerate(ways)]
        outs = _ways_out(ground, start)
        at_doors = [(pose.x, pose.y) for _, step in doors for pose in (step.start, step.end)]
        more = np.array([*at_doors, *((legs[-1].end.x, legs[-1].end.y) for _, legs in outs), (start.x, start.y)])
        self._points = np.concatenate([places, more])
        self._spins = ground.spin_room(self._points) >= SPIN_ROOM
        self._spins[-1] = False
        away = np.hypot(*(self._points - (goal.x, goal.y)).T)
        self._last = np.where(away <= _GOAL_RINGS[-1] + 1e-6, _GOAL_COST * away, math.inf)
        first = len(places)
        self._doors = {first + 2 * k: (_RANK_COST * rank, step) for k, (rank, step) in enumerate(doors)}
        first += len(at_doors)
        self._outs = [(first + k, cost, legs) for k, (cost, legs) in enumerate(outs)]
        self._rooms: dict[int, FloatArray] = {}

    def legs(self, wander: float) -> list[Step] | None:
        """Return the cheapest legs whose rooms are at least `wander` [m]; None without any."""
        here = len(self._points) - 1
        best = {here: 0.0}
        came: dict[int, tuple[int, tuple[Step, ...]]] = {}
        order = itertools.count()
        queue: list[tuple[float, int, int, bool]] = [(0.0, next(order), here, False)]
        settled: set[int] = set()
        while queue:
            _, _, at, arrived = heapq.heappop(queue)
            if arrived:
                return self._chain(came, at)
            if at in settled:
                continue
            settled.add(at)
            if math.isfinite(self._last[at]) and at != here:
                heapq.heappush(queue, (best[at] + float(self._last[at]), next(order), at, True))
            for onto, more, steps in self._onward(at, wander):
                reached = best[at] + more
                if onto not in settled and reached < best.get(onto, math.inf) - 1e-9:
                    best[onto], came[onto] = reached, (at, steps)
                    away = math.hypot(self._points[onto][0] - self._goal.x, self._points[onto][1] - self._goal.y)
                    heapq.heappush(queue, (reached + max(away - _GOAL_RINGS[-1], 0.0), next(order), onto, False))
        return None

    def _chain(self, came: dict[int, tuple[int, tuple[Step, ...]]], at: int) -> list[Step]:
        legs: list[Step] = []
        while at in came:
            at, steps = came[at]
            legs[:0] = steps
        return legs

    def _onward(self, at: int, wander: float) -> list[tuple[int, float, tuple[Step, ...]]]:
        """Return the ways on from a node: the node at their end, their cost, and the legs."""
        onward: list[tuple[int, float, tuple[Step, ...]]] = []
        is_start = at == len(self._points) - 1
        if at in self._doors:
            rank, through = self._doors[at]
            onward.append((at + 1, through.length + rank, (through,)))
        if not (is_start or self._spins[at]):
            return onward
        here = self._points[at]
        rooms = self._rooms_from(at)
        for onto in np.flatnonzero(rooms >= wander).tolist():
            x, y = (self._points[onto] - here).tolist()
            length = math.hypot(x, y)
            if length < _SHORTEST or onto == len(self._points) - 1:
                continue
            heading = math.atan2(y, x)
            begin = Pose2(float(here[0]), float(here[1]), heading)
            end = Pose2(begin.x + x, begin.y + y, heading)
            if is_start and not self._ground.turn_is_free(self._start, heading):
                continue
            if not self._spins[onto] and not self._ground.straight_is_free(_near_end(begin, end), _LAST_PART, 0.0):
                continue
            tight = _TIGHT_COST * max(WANDERS[0] - float(rooms[onto]), 0.0) * length
            leg = Step(StepKind.STRAIGHT, begin, end, room=float(rooms[onto]))
            onward.append((onto, length + PIVOT_COST + tight, (leg,)))
        if is_start:
            onward += self._outs
            onward += self._short_ways()
        return onward

    def _short_ways(self) -> Iterator[tuple[int, float, tuple[Step, ...]]]:
        """Yield ways too short for a turn, to places with room to spin that lie straight ahead of the start or behind it."""
        along, aside = transform_points(self._start.inverse(), self._points).T
        near = self._spins & (np.abs(aside) <= _ON_AXIS) & (np.abs(along) < _SHORTEST) & (np.abs(along) > _ON_AXIS)
        for onto in np.flatnonzero(near).tolist():
            way = float(along[onto])
            if self._ground.straight_is_free(self._start, way, _OUT_ROOM):
                yield (onto, *_straight_way(self._start, way, _OUT_ROOM))

    def _rooms_from(self, at: int) -> FloatArray:
        if at not in self._rooms:
            rooms = self._ground.side_rooms(self._points[at], self._points)
            for _, door in self._doors.values():
                rooms[_crosses(door, self._points[at], self._points)] = -1.0  # it is passed by its own step only
            self._rooms[at] = rooms
        return self._rooms[at]


def _crosses(through: Step, start: FloatArray, ends: FloatArray) -> BoolArray:
    """Return (N,) whether straight legs from one point (2,) to each of `ends` (N, 2) lead through a door."""
    assert through.door is not None
    door_from_map = through.door.map_from_door.inverse()
    (x, y), (xs, ys) = transform_points(door_from_map, start[None])[0], transform_points(door_from_map, ends).T
    with np.errstate(divide="ignore", invalid="ignore"):
        across = y + (ys - y) * -x / (xs - x)
    within: BoolArray = (x * xs < 0.0) & (np.abs(across) < through.door.width)
    return within


_Way: TypeAlias = tuple[float, tuple[Step, ...]]
"""Cost of legs, and the legs, in order."""


def _ways_out(ground: ClearGround, start: Pose2) -> list[_Way]:
    """Return ways out of a start to places with room to spin: straight ahead or back, where the chair cannot spin after a turn as far
    as is free, and if that does not lead out either, after a shuffle and a turn.

    A chair that stands nearer to something than `_OUT_ROOM` keeps as much room as it has.
    """
    room = ground.room_at(start, _OUT_ROOM)
    if room is None:
        return []
    ways = list(_straight_out(ground, start, room))
    if ground.spin_room(np.array([[start.x, start.y]]))[0] >= SPIN_ROOM:
        return ways
    ways += _turned_out(ground, start, room)
    return ways or list(_shuffled_out(ground, start, room))


def _straight_way(start: Pose2, along: float, room: float) -> _Way:
    """Return the way straight ahead, or back if `along` [m] is negative."""
    kind, price = (StepKind.STRAIGHT, 1.0) if along > 0.0 else (StepKind.BACK, BACK_COST)
    return price * abs(along), (Step(kind, start, start @ Pose2(along), room=room),)


def _shuffled_out(ground: ClearGround, start: Pose2, room: float) -> Iterator[_Way]:
    for ahead in (1.0, -1.0):
        for along in (ahead * _SHUFFLE * np.arange(1, _SHUFFLES + 1)).tolist():
            if not ground.straight_is_free(start, along, room):
                break
            before, (step,) = _straight_way(start, along, room)
            for cost, legs in _turned_out(ground, step.end, room):
                yield before + cost, (step, *legs)


def _turned_out(ground: ClearGround, start: Pose2, room: float) -> Iterator[_Way]:
    for side in (1.0, -1.0):
        turned = (start @ Pose2(theta=side * turn) for turn in np.arange(_OUT_TURN, math.pi, _OUT_TURN).tolist())
        for pose in itertools.takewhile(lambda pose: ground.turn_is_free(start, pose.theta), turned):
            yield from ((PIVOT_COST + cost, legs) for cost, legs in _straight_out(ground, pose, room))


def _straight_out(ground: ClearGround, start: Pose2, room: float) -> Iterator[_Way]:
    """Yield the ways straight ahead and back to the first place with room to spin."""
    for ahead in (1.0, -1.0):
        along = ahead * _OUT_APART * np.arange(1.0, _OUT_LOOKS + 1.0)
        ends = compose(start.array(), arcs(along, np.zeros_like(along)))
        rooms = ground.spin_room(ends[:, :2])
        rooms[~ground.free_until(ends, room)] = -math.inf
        spins = np.flatnonzero(rooms >= SPIN_ROOM)
        if len(spins):
            first = int(spins[0])
            best = first + int(np.argmax(rooms[first : first + _OUT_ON]))
            yield _straight_way(start, float(along[best]), room)


_RANK_COST = 0.8
"""Cost of each pivotal point of a door that is worse than the one before: it outweighs the way between them."""

_SHORTEST = 0.25
"""m; shorter legs are not worth a turn."""

_ON_AXIS = 0.03
"""m; a place so little beside the chair's axis lies straight ahead or behind."""

_TIGHT_COST = 8.0
"""Cost per m of missing room and m of way: wide ways are preferred to short ones."""

_LAST_PART = 0.6
"""m; before a goal without room to spin, the whole outline is looked at over so much of the last leg."""

_OUT_ROOM = 0.01
"""m; kept beside the outline on the way straight out of a tight place."""


def _near_end(begin: Pose2, end: Pose2) -> Pose2:
    return end @ Pose2(-min(_LAST_PART, math.hypot(end.x - begin.x, end.y - begin.y)))
