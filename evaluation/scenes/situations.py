"""Driving situations of every day in small rooms: goals beside walls, doors that are shut, people in the way, zones.

A `DrivenSituation` is a world, the chair's map of it, one goal, the events meanwhile, and the cause that the chair should
name if it waits, turns back or refuses. `situation(seed)` draws one; equal seeds give equal situations.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from evaluation.scenes.tight_places import map_of
from waychair.calibration.chair_body import CHAIR_A
from waychair.control.speed.limiter import LimiterSettings
from waychair.maps.drawn.zones import Rule, Zone
from waychair.runtime.chair import ChairSettings
from waychair.simulation.plan.floor_plan import FloorPlan, PlanBox, PlanDoor, PlanWall, walls_round
from waychair.simulation.plan.world import World, world_from_plan
from waychair.simulation.scene.scene import PersonBehaviour, PersonPlan
from waychair.types import OccupancyGrid, Place, Pose2, Scan, SensorMessage, WheelTicks

Messages = tuple[SensorMessage, ...]
Point = tuple[float, float]

CELL = 0.05
"""Cell size [m] of the chair's map, as the mapper makes it; the world's cells are 1 cm."""

FEET_AT, FEET_M = (math.radians(20.0), math.radians(26.0)), (0.12, 0.23)
"""Directions on both sides of straight ahead in which a lidar without a mask sees footrests [rad], and how near [m]."""


@dataclass(frozen=True, slots=True)
class SituationEvent:
    """Something that happens `after_s` [s] the drive was confirmed: `leave`, `open`, `pause`, or `go on`."""

    after_s: float
    what: str


@dataclass(frozen=True, slots=True)
class DrivenSituation:
    """A situation; `cause` is the cause to be named, `""` where the chair should drive without one.

    `start_told` is the pose at which the chair believes to stand at first, if it is not the true one. `alter` makes the messages that the chair
    hears from the simulated ones. `stick` is the rest position of the rider's joystick, forwards. `opened` is the world after the event `open`.
    """

    kind: str
    world: World
    grid: OccupancyGrid
    goal: Place
    cause: str = ""
    zones: tuple[Zone, ...] = ()
    chair: ChairSettings = field(default_factory=ChairSettings)
    events: tuple[SituationEvent, ...] = ()
    lidar_hz: float = 0.0
    alter: Callable[[Messages], Messages] | None = None
    stick: float = 0.0
    opened: World | None = None
    limit_s: float = 75.0


def situation(seed: int) -> DrivenSituation:
    """Return the situation of a seed; consecutive seeds go through all kinds."""
    rng = np.random.default_rng([34, seed])
    return KINDS[seed % len(KINDS)](rng)


# --- rooms ----------------------------------------------------------------------------------------------------------


def _room(
    size: Point,
    start: Pose2,
    walls: Sequence[PlanWall] = (),
    boxes: Sequence[PlanBox] = (),
    people: Sequence[PersonPlan] = (),
) -> World:
    """Return a room whose inner faces lie 5 cm inside a rectangle from the origin."""
    plan = FloorPlan(
        name="situation",
        size=size,
        start=(start.x, start.y, start.theta),
        walls=[*walls_round(size), *walls],
        boxes=list(boxes),
        resolution=0.01,
    )
    return replace(world_from_plan(plan, "situation"), people=tuple(people))


def _stands(x: float, y: float) -> PersonPlan:
    return PersonPlan(PersonBehaviour.SEATED, np.array([[x, y]]))


def _two_rooms(rng: np.random.Generator, width: float, people: Sequence[PersonPlan] = ()) -> tuple[World, Place]:
    """Return two rooms with one door `leaf` at (4, 1.5), a start in the first and a goal in the second."""
    wall = PlanWall(start=(4.0, 0.0), end=(4.0, 3.4), thickness=0.12, doors=[PlanDoor(1.5, width, name="leaf")])
    start = Pose2(rng.uniform(1.0, 1.6), rng.uniform(1.2, 1.8), rng.uniform(-0.3, 0.3))
    return _room((8.0, 3.4), start, [wall], people=people), Place("goal", Pose2(6.3, 1.5, 0.0))


def _two_doors(rng: np.random.Generator, people: Sequence[PersonPlan] = ()) -> tuple[World, Place]:
    """Return two rooms with a near door at (4, 1.5) and another one far off."""
    wall = PlanWall(
        start=(4.0, 0.0), end=(4.0, 7.0), thickness=0.12, doors=[PlanDoor(1.5, 1.0, name="leaf"), PlanDoor(5.6, 1.0)]
    )
    start = Pose2(rng.uniform(1.0, 1.6), rng.uniform(1.2, 1.8), 0.0)
    return _room((8.0, 7.0), start, [wall], people=people), Place("goal", Pose2(6.3, 1.5, 0.0))


def _hall(rng: np.random.Generator, people: Sequence[PersonPlan] = ()) -> World:
    return _room((8.0, 5.0), Pose2(rng.uniform(1.0, 1.5), rng.uniform(2.0, 3.0), rng.uniform(-0.5, 0.5)), people=people)


def _made(kind: str, world: World, goal: Place, **further: object) -> DrivenSituation:
    grid = map_of(world, CELL)
    return replace(DrivenSituation(kind, world, grid, goal), **further)  # type: ignore[arg-type]


# --- walls and corridors --------------------------------------------------------------------------------------------


def _beside_a_wall(rng: np.random.Generator) -> DrivenSituation:
    gap = rng.uniform(0.05, 0.15)
    goal = Pose2(rng.uniform(3.0, 5.0), 0.05 + CHAIR_A.width / 2 + gap, float(rng.choice([0.0, math.pi])))
    return _made("goal beside a wall", _hall(rng), Place("goal", goal))


def _back_in_a_corridor(rng: np.random.Generator) -> DrivenSituation:
    width, back = rng.uniform(1.1, 1.4), rng.uniform(0.5, 4.0)
    world = _room((9.0, width + 0.1), Pose2(6.0, 0.05 + width / 2, 0.0))
    return _made("back in a corridor", world, Place("goal", Pose2(6.0 - back, 0.05 + width / 2, 0.0)))


def _nose_in(rng: np.random.Generator) -> DrivenSituation:
    start = Pose2(8.0 - 0.05 - CHAIR_A.front - rng.uniform(0.02, 0.06), rng.uniform(1.5, 3.5), 0.0)
    return _made("nose in", _room((8.0, 5.0), start), Place("goal", Pose2(3.0, 2.5, math.pi)))


# --- doors ----------------------------------------------------------------------------------------------------------


def _person_in_the_door(rng: np.random.Generator, leaves: bool) -> DrivenSituation:
    person = _stands(4.0 + rng.uniform(-0.1, 0.1), 1.5 + rng.uniform(-0.1, 0.1))
    world, goal = _two_rooms(rng, rng.uniform(0.9, 1.05), [person])
    after = rng.uniform(15.0, 45.0)
    return _made(
        "somebody in the door, leaves" if leaves else "somebody in the door",
        world,
        goal,
        cause="person",
        events=(SituationEvent(after, "leave"),) if leaves else (),
        limit_s=after + 45.0 if leaves else 60.0,
    )


def _shut_door(rng: np.random.Generator, opens: bool) -> DrivenSituation:
    world, goal = _two_rooms(rng, rng.uniform(0.9, 1.05))
    after = rng.uniform(15.0, 45.0)
    found = _made(
        "door shut, opens" if opens else "door shut",
        world,
        goal,
        cause="shut",
        events=(SituationEvent(after, "open"),) if opens else (),
        limit_s=after + 45.0 if opens else 60.0,
    )
    return replace(found, world=world.with_closed(["leaf"]), opened=world)


def _shut_on_the_map(rng: np.random.Generator) -> DrivenSituation:
    world, goal = _two_rooms(rng, rng.uniform(0.9, 1.05))
    return _made("door shut on the map", world.with_closed(["leaf"]), goal, cause="shut on the map", limit_s=30.0)


def _too_narrow(rng: np.random.Generator) -> DrivenSituation:
    world, goal = _two_rooms(rng, rng.uniform(0.40, 0.58))
    return _made("door too narrow", world, goal, cause="width", limit_s=30.0)


def _other_way(rng: np.random.Generator) -> DrivenSituation:
    world, goal = _two_doors(rng)
    return replace(_made("door shut, another way", world, goal, cause="shut"), world=world.with_closed(["leaf"]))


# --- zones ----------------------------------------------------------------------------------------------------------


def _square(x0: float, y0: float, x1: float, y1: float) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])


def _zone_across(rng: np.random.Generator) -> DrivenSituation:
    world, goal = _two_rooms(rng, 1.0)
    x = rng.uniform(2.9, 3.6)
    zone = Zone("stairwell", Rule.KEEP_OUT, _square(x, -1.0, x + rng.uniform(0.3, 0.8), 4.0))
    return _made("zone across", world, goal, cause="zone", zones=(zone,), limit_s=30.0)


def _one_way_against(rng: np.random.Generator) -> DrivenSituation:
    world, goal = _two_rooms(rng, 1.0)
    zone = Zone("oneway", Rule.ONE_WAY, _square(3.3, -1.0, 4.7, 4.0), math.pi)
    return _made("one-way zone against", world, goal, cause="one-way zone", zones=(zone,), limit_s=30.0)


def _zone_over_the_goal(rng: np.random.Generator) -> DrivenSituation:
    world = _hall(rng)
    x, y = rng.uniform(4.5, 6.5), rng.uniform(1.5, 3.5)
    zone = Zone("carpet", Rule.KEEP_OUT, _square(x - 0.9, y - 0.7, x + 0.9, y + 0.7))
    return _made(
        "zone over the goal", world, Place("goal", Pose2(x, y, 0.0)), cause="zone", zones=(zone,), limit_s=30.0
    )


def _zone_over_the_start(rng: np.random.Generator) -> DrivenSituation:
    world = _hall(rng)
    at = world.start
    zone = Zone("carpet", Rule.KEEP_OUT, _square(at.x - 0.8, at.y - 0.8, at.x + 0.9, at.y + 0.8))
    goal = Place("goal", Pose2(6.0, 2.5, 0.0))
    return _made("zone over the chair", world, goal, cause="zone", zones=(zone,), limit_s=30.0)


# --- goals ----------------------------------------------------------------------------------------------------------


def _person_on_the_goal(rng: np.random.Generator, leaves: bool) -> DrivenSituation:
    goal = Pose2(rng.uniform(5.0, 6.0), rng.uniform(1.8, 3.2), rng.uniform(-0.6, 0.6))
    after = rng.uniform(20.0, 40.0)
    return _made(
        "somebody on the goal, leaves" if leaves else "somebody on the goal",
        _hall(rng, [_stands(goal.x + rng.uniform(-0.2, 0.4), goal.y)]),
        Place("goal", goal),
        cause="person",
        events=(SituationEvent(after, "leave"),) if leaves else (),
        limit_s=after + 40.0 if leaves else 60.0,
    )


def _person_ahead_of_the_goal(rng: np.random.Generator) -> DrivenSituation:
    goal = Pose2(rng.uniform(4.5, 5.5), rng.uniform(2.2, 2.8), 0.0)
    person = _stands(goal.x + CHAIR_A.front + 0.25 + rng.uniform(0.2, 0.5), goal.y + rng.uniform(-0.1, 0.1))
    return _made("somebody ahead of the goal", _hall(rng, [person]), Place("goal", goal), limit_s=75.0)


def _person_beside_the_goal(rng: np.random.Generator) -> DrivenSituation:
    goal, side = Pose2(rng.uniform(4.5, 5.5), rng.uniform(2.2, 2.8), 0.0), float(rng.choice([-1.0, 1.0]))
    person = _stands(
        goal.x + rng.uniform(-0.2, 0.4), goal.y + side * (CHAIR_A.width / 2 + 0.25 + rng.uniform(0.15, 0.6))
    )
    return _made("somebody beside the goal", _hall(rng, [person]), Place("goal", goal), limit_s=75.0)


def _person_in_a_corridor(rng: np.random.Generator) -> DrivenSituation:
    width, free = 2.0, rng.uniform(0.75, 1.1)
    person = _stands(rng.uniform(3.5, 4.5), 0.05 + free + 0.25)
    world = _room((8.0, width + 0.1), Pose2(1.2, 1.05, 0.0), people=[person])
    return _made("somebody in a corridor", world, Place("goal", Pose2(6.5, 1.05, 0.0)), limit_s=75.0)


def _where_it_stands(rng: np.random.Generator) -> DrivenSituation:
    start = Pose2(rng.uniform(3.0, 4.5), rng.uniform(2.0, 3.0), rng.uniform(-1.0, 1.0))
    goal = start @ Pose2(rng.uniform(-0.45, 0.2), rng.uniform(-0.1, 0.1), rng.uniform(-0.4, 0.4))
    close, turned = (0.15, math.radians(5.0)) if rng.random() < 0.5 else (0.05, math.radians(2.0))
    return _made("goal where it stands", _room((8.0, 5.0), start), Place("goal", goal, close, turned), limit_s=60.0)


def _tight_tolerance(rng: np.random.Generator) -> DrivenSituation:
    goal = Pose2(rng.uniform(4.0, 6.0), rng.uniform(1.5, 3.5), rng.uniform(-math.pi, math.pi))
    close = float(rng.choice([0.03, 0.05]))
    return _made("tight tolerance", _hall(rng), Place("goal", goal, close, 0.035), limit_s=75.0)


def _paused(rng: np.random.Generator) -> DrivenSituation:
    goal = Pose2(rng.uniform(3.5, 5.0), rng.uniform(2.2, 2.8), rng.uniform(-2.0, 2.0))
    begins = rng.uniform(6.0, 16.0)
    events = (SituationEvent(begins, "pause"), SituationEvent(begins + 4.0, "go on"))
    return _made("pause and go on", _hall(rng), Place("goal", goal), events=events, limit_s=75.0)


def _wrong_heading(rng: np.random.Generator) -> DrivenSituation:
    width = rng.uniform(0.8, 0.95)
    niche = [
        PlanWall(start=(6.0, 2.5 - width / 2 - 0.05), end=(8.0, 2.5 - width / 2 - 0.05)),
        PlanWall(start=(6.0, 2.5 + width / 2 + 0.05), end=(8.0, 2.5 + width / 2 + 0.05)),
    ]
    start = Pose2(rng.uniform(1.0, 1.5), rng.uniform(2.0, 3.0), 0.0)
    world = _room((8.0, 5.0), start, niche)
    goal = Place("goal", Pose2(6.9, 2.5, float(rng.choice([-1.0, 1.0])) * math.pi / 2))
    return _made("wrong heading", world, goal, cause="heading", limit_s=30.0)


def _place_in_a_wall(rng: np.random.Generator) -> DrivenSituation:
    box = PlanBox(centre=(5.5, 2.5), size=(1.6, 1.6))
    start = Pose2(rng.uniform(1.0, 1.5), rng.uniform(2.0, 3.0), 0.0)
    world = _room((8.0, 5.0), start, boxes=[box])
    goal = Place("goal", Pose2(5.5 + rng.uniform(-0.7, 0.7), 2.5 + rng.uniform(-0.7, 0.7), 0.0))
    return _made("place in a wall", world, goal, cause="goal", limit_s=30.0)


# --- limits and sensors -----------------------------------------------------------------------------------------------


def _tiny_speed(rng: np.random.Generator) -> DrivenSituation:
    world = _hall(rng)
    goal = Place("goal", world.start @ Pose2(rng.uniform(1.0, 2.0), rng.uniform(-0.3, 0.3), 0.0))
    if rng.random() < 0.5:
        limits = LimiterSettings(max_speed=float(rng.uniform(0.05, 0.12)))
        return _made("tiny speed limit", world, goal, chair=ChairSettings(limiter=limits), limit_s=60.0)
    zone = Zone("ward", Rule.SLOW, _square(0.0, 0.0, 8.0, 5.0), float(rng.uniform(0.05, 0.1)))
    return _made("tiny speed limit", world, goal, zones=(zone,), limit_s=60.0)


def _slow_lidar(rng: np.random.Generator) -> DrivenSituation:
    goal = Place("goal", Pose2(rng.uniform(4.0, 5.0), rng.uniform(1.8, 3.2), 0.0))
    late = int(rng.integers(4, 7))
    if rng.random() < 0.5:
        return _made("slow lidar", _hall(rng), goal, cause="lidar", lidar_hz=1000.0 / 300.0, limit_s=60.0)
    return _made("slow lidar", _hall(rng), goal, cause="lidar", alter=_Late(late), limit_s=60.0)


def _footrests(rng: np.random.Generator) -> DrivenSituation:
    goal = Place("goal", Pose2(rng.uniform(4.5, 6.0), rng.uniform(1.5, 3.5), rng.uniform(-1.5, 1.5)))
    return _made("own footrests", _hall(rng), goal, cause="footrests", alter=_Feet(rng.uniform(*FEET_M)), limit_s=60.0)


def _encoders(rng: np.random.Generator) -> DrivenSituation:
    goal = Place("goal", Pose2(rng.uniform(4.5, 6.0), rng.uniform(1.5, 3.5), rng.uniform(-1.5, 1.5)))
    fault = str(rng.choice(["exchanged", "reversed", "dead"]))
    return _made("encoders wrong", _hall(rng), goal, cause="encoders", alter=_Encoders(fault), limit_s=45.0)


def _stick(rng: np.random.Generator) -> DrivenSituation:
    goal = Place("goal", Pose2(rng.uniform(4.5, 6.0), rng.uniform(1.5, 3.5), 0.0))
    return _made("stick off centre", _hall(rng), goal, cause="stick", stick=rng.uniform(0.11, 0.18), limit_s=45.0)


class _Late:
    """Scans that arrive some ticks late."""

    def __init__(self, ticks: int) -> None:
        self._queue: list[tuple[SensorMessage, ...]] = [()] * ticks

    def __call__(self, messages: Messages) -> Messages:
        self._queue.append(tuple(each for each in messages if isinstance(each, Scan)))
        return (*(each for each in messages if not isinstance(each, Scan)), *self._queue.pop(0))


@dataclass(frozen=True, slots=True)
class _Feet:
    """Scans that see the chair's own footrests at a distance [m]."""

    away: float

    def __call__(self, messages: Messages) -> Messages:
        return tuple(self._seen(each) if isinstance(each, Scan) else each for each in messages)

    def _seen(self, scan: Scan) -> Scan:
        at = np.abs(scan.angles())
        feet = (at > FEET_AT[0]) & (at < FEET_AT[1])
        return replace(scan, ranges=np.where(feet, np.float32(self.away), scan.ranges))


@dataclass(frozen=True, slots=True)
class _Encoders:
    """Wheel encoders that are exchanged, reversed or dead (the left one)."""

    fault: str

    def __call__(self, messages: Messages) -> Messages:
        return tuple(self._read(each) if isinstance(each, WheelTicks) else each for each in messages)

    def _read(self, ticks: WheelTicks) -> WheelTicks:
        if self.fault == "exchanged":
            return replace(ticks, left=ticks.right, right=ticks.left)
        if self.fault == "reversed":
            return replace(ticks, left=-ticks.left, right=-ticks.right)
        return replace(ticks, left=0)


KINDS: tuple[Callable[[np.random.Generator], DrivenSituation], ...] = (
    _beside_a_wall,
    _back_in_a_corridor,
    lambda rng: _person_in_the_door(rng, leaves=True),
    lambda rng: _person_in_the_door(rng, leaves=False),
    lambda rng: _shut_door(rng, opens=True),
    lambda rng: _shut_door(rng, opens=False),
    _shut_on_the_map,
    _too_narrow,
    _other_way,
    _zone_across,
    _one_way_against,
    _zone_over_the_goal,
    _zone_over_the_start,
    lambda rng: _person_on_the_goal(rng, leaves=True),
    lambda rng: _person_on_the_goal(rng, leaves=False),
    _person_ahead_of_the_goal,
    _person_beside_the_goal,
    _person_in_a_corridor,
    _where_it_stands,
    _tight_tolerance,
    _paused,
    _wrong_heading,
    _place_in_a_wall,
    _nose_in,
    _tiny_speed,
    _slow_lidar,
    _footrests,
    _encoders,
    _stick,
)
