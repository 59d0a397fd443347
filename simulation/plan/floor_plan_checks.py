"""Checks of a floor plan beyond its types; a problem is the keys of a value and a sentence with a remedy.

The problems of a plan come in order of importance; `world.py` makes the checks that need the grid.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise
from typing import TypeAlias

import msgspec

from waychair.simulation.plan.floor_plan import (
    LEAF_THICKNESS,
    FloorPlan,
    Keys,
    PlanDoor,
    PlanPerson,
    PlanPoster,
    PlanTag,
    PlanWall,
    Point,
)
from waychair.simulation.scene.scene import MATERIALS, PersonBehaviour

MOST_CELLS = 50_000_000
"""Largest grid that a plan may need [cells]."""

_Problems: TypeAlias = Iterator[tuple[Keys, str]]
_SLACK = 1e-9


def plan_problems(plan: FloorPlan) -> _Problems:
    """Yield the problems of one level by itself."""
    for keys, number in _numbers(msgspec.to_builtins(plan), ()):
        if not math.isfinite(number):
            yield keys, f"{number} is not finite; give a finite number"
    if plan.size[0] * plan.size[1] / plan.resolution**2 > MOST_CELLS:
        yield ("size",), f"{plan.size[0]:g} x {plan.size[1]:g} m in cells of {plan.resolution:g} m is too large; make the size smaller or the cells larger"  # fmt: skip
    for i, wall in enumerate(plan.walls):
        yield from ((("walls", i, *keys), problem) for keys, problem in _wall_problems(wall, plan))
    yield from _outside(plan)
    yield from _materials(plan)
    yield from _furniture(plan)
    yield from _ways(plan)
    yield from _repeated_names(plan)
    for i, person in enumerate(plan.people):
        yield from ((("people", i, *keys), problem) for keys, problem in _person_problems(person))
    for name, route in plan.routes.items():
        if not route:
            yield ("routes", name), "a route without points; give at least one"


def building_problems(levels: Sequence[FloorPlan]) -> _Problems:
    """Yield the problems between levels of a building; the keys begin with ("levels", index)."""
    if not levels:
        yield ("levels",), "a building without levels; give at least one"
    for i, plan in enumerate(levels):
        if plan.name in (other.name for other in levels[:i]):
            yield ("levels", i, "name"), f"there is a level '{plan.name}' already; rename one"
    for i, plan in enumerate(levels):
        for k, lift in enumerate(plan.lifts):
            keys = ("levels", i, "lifts", k)
            others = [
                other for level in levels if level is not plan for other in level.lifts if other.name == lift.name
            ]
            if not others:
                yield (*keys, "name"), f"the lift '{lift.name}' stops on one level only; add it to another level"
            for other in others:
                if math.dist(lift.middle, other.middle) > _SLACK or math.dist(lift.size, other.size) > _SLACK:
                    yield (*keys, "middle"), f"the lift '{lift.name}' has another middle or size on another level; make them equal"  # fmt: skip


def _wall_problems(wall: PlanWall, plan: FloorPlan) -> _Problems:
    if wall.length < plan.resolution:
        yield ("end",), "the wall has no length; move its end away from its start"
    if wall.thickness < 2 * plan.resolution - _SLACK:
        yield ("thickness",), f"{wall.thickness:g} m lets beams through; make it at least {2 * plan.resolution:g} m, two cells"  # fmt: skip
    for k, door in enumerate(wall.doors):
        if door.width > wall.length + _SLACK:
            yield ("doors", k, "width"), f"a door of {door.width:g} m is wider than its wall of {wall.length:g} m; make it narrower"  # fmt: skip
        if not _on_wall(door.at, door.width, wall):
            yield ("doors", k, "at"), f"a door of {door.width:g} m at {door.at:g} m lies outside its wall of {wall.length:g} m; move it inside"  # fmt: skip
        if door.closed and door.leaf:
            yield ("doors", k, "leaf"), "a closed door has no leaf that stands open; give one of closed and leaf"
        if door.leaf and plan.resolution > LEAF_THICKNESS / 2 + _SLACK:
            yield ("doors", k, "leaf"), f"a leaf {LEAF_THICKNESS:g} m thick needs cells of {LEAF_THICKNESS / 2:g} m at most; set resolution, now {plan.resolution:g}"  # fmt: skip
        for other in wall.doors[:k]:
            if _overlap(door.at, door.width, other):
                yield ("doors", k, "at"), f"the doors at {other.at:g} and {door.at:g} m overlap; move one"
    for k, poster in enumerate(wall.posters):
        yield from ((("posters", k, key), problem) for key, problem in _hung_problems("poster", poster, wall, plan))
    for k, tag in enumerate(wall.tags):
        yield from ((("tags", k, key), problem) for key, problem in _hung_problems("tag", tag, wall, plan))


def _hung_problems(what: str, hung: PlanPoster | PlanTag, wall: PlanWall, plan: FloorPlan) -> Iterator[tuple[str, str]]:
    width, high = (hung.size, hung.size) if isinstance(hung, PlanTag) else hung.size
    if not _on_wall(hung.at, width, wall):
        yield (
            "at",
            f"a {what} of {width:g} m at {hung.at:g} m lies outside its wall of {wall.length:g} m; move it inside",
        )
    for door in wall.doors:
        if _overlap(hung.at, width, door):
            yield "at", f"the {what} at {hung.at:g} m hangs in the door at {door.at:g} m; move it"
    if not high / 2 - _SLACK <= hung.height <= plan.finish.height - high / 2 + _SLACK:
        yield "height", f"a {what} {high:g} m high at {hung.height:g} m reaches beyond its wall of height {plan.finish.height:g} m; hang it elsewhere"  # fmt: skip


def _on_wall(at: float, width: float, wall: PlanWall) -> bool:
    return width / 2 - _SLACK <= at <= wall.length - width / 2 + _SLACK


def _overlap(at: float, width: float, door: PlanDoor) -> bool:
    return abs(at - door.at) < (width + door.width) / 2 - _SLACK


def _outside(plan: FloorPlan) -> _Problems:
    for keys, point in _points(plan):
        if not all(-_SLACK <= value <= length + _SLACK for value, length in zip(point, plan.size, strict=True)):
            yield keys, f"({point[0]:g}, {point[1]:g}) lies outside; move it into {plan.size[0]:g} x {plan.size[1]:g} m"


def _points(plan: FloorPlan) -> Iterator[tuple[Keys, Point]]:
    """Yield all points that must lie on the plan, except those that are checked on its grid."""
    for section in ("walls", "ramps", "stairs"):
        for i, item in enumerate(getattr(plan, section)):
            yield (section, i, "start"), item.start
            yield (section, i, "end"), item.end
    for section in ("boxes", "tables", "thresholds", "pits"):
        for i, item in enumerate(getattr(plan, section)):
            yield (section, i, "centre"), item.centre
    for i, lamp in enumerate(plan.lamps):
        yield ("lamps", i, "at"), lamp.at
    for i, lift in enumerate(plan.lifts):
        yield ("lifts", i, "middle"), lift.middle[:2]


def _materials(plan: FloorPlan) -> _Problems:
    named: list[tuple[Keys, str]] = [
        (("finish", key), getattr(plan.finish, key)) for key in ("floor", "walls", "ceiling")
    ]
    for section in ("walls", "boxes", "tables", "ramps", "thresholds", "stairs"):
        named += [((section, i, "material"), item.material) for i, item in enumerate(getattr(plan, section))]
    for i, wall in enumerate(plan.walls):
        named += [(("walls", i, "doors", k, "material"), door.material) for k, door in enumerate(wall.doors)]
    for keys, material in named:
        # A wall without a material takes the finish's.
        if material not in MATERIALS and not (material == "" and keys[0] == "walls" and len(keys) == 3):
            yield keys, f"unknown material '{material}'; did you mean '{_nearest(material, MATERIALS)}'?"


def _furniture(plan: FloorPlan) -> _Problems:
    room = plan.finish.height
    for i, box in enumerate(plan.boxes):
        if box.high <= box.low:
            yield ("boxes", i, "high"), f"{box.high:g} m is not above its lower face at {box.low:g} m; raise it"
        if box.high > room + _SLACK:
            yield ("boxes", i, "high"), f"{box.high:g} m is above the ceiling at {room:g} m; make it lower"
    for i, table in enumerate(plan.tables):
        if table.height > room + _SLACK:
            yield ("tables", i, "height"), f"{table.height:g} m is above the ceiling at {room:g} m; make it lower"
        if table.top >= table.height:
            yield ("tables", i, "top"), f"a top of {table.top:g} m leaves no space for the legs of a table {table.height:g} m high; make the top thinner"  # fmt: skip
        if 2 * table.legs > min(table.size):
            yield ("tables", i, "legs"), f"legs of {table.legs:g} m do not fit under {table.size[0]:g} x {table.size[1]:g} m; make them thinner"  # fmt: skip
    for i, lamp in enumerate(plan.lamps):
        if lamp.height is not None and lamp.height > room + _SLACK:
            yield ("lamps", i, "height"), f"{lamp.height:g} m is above the ceiling at {room:g} m; hang it lower"


def _ways(plan: FloorPlan) -> _Problems:
    """Yield the problems of ramps and stairs."""
    for section, what in (("ramps", "the ramp has"), ("stairs", "the stairs have")):
        for i, item in enumerate(getattr(plan, section)):
            if math.dist(item.start, item.end) < plan.resolution:
                yield (section, i, "end"), f"{what} no length; move its end away from its start"


def _repeated_names(plan: FloorPlan) -> _Problems:
    first: dict[str, int] = {}
    for i, wall in enumerate(plan.walls):
        for k, door in enumerate(wall.doors):
            if door.name and door.name in first:
                yield ("walls", i, "doors", k, "name"), f"walls[{first[door.name]}] has a door '{door.name}' already; rename one"  # fmt: skip
            first[door.name] = i
    for i, lift in enumerate(plan.lifts):
        if lift.name in (other.name for other in plan.lifts[:i]):
            yield ("lifts", i, "name"), f"there is a lift '{lift.name}' already; rename one"


def _person_problems(person: PlanPerson) -> _Problems:
    known = [behaviour.value for behaviour in PersonBehaviour]
    if person.behaviour not in known:
        yield ("behaviour",), f"unknown behaviour '{person.behaviour}'; did you mean '{_nearest(person.behaviour, known)}'?"  # fmt: skip
        return
    behaviour = PersonBehaviour(person.behaviour)
    needed = {PersonBehaviour.SEATED: 1, PersonBehaviour.BOUNCE: 0}.get(behaviour, 2)
    if len(person.path) < needed:
        yield ("path",), f"a person of behaviour {behaviour.value} needs at least {needed} point{'s' * (needed > 1)}, not {len(person.path)}; add points"  # fmt: skip
    for begin, end in pairwise(person.path):
        if math.dist(begin, end) < 0.05:
            yield ("path",), f"({begin[0]:g}, {begin[1]:g}) comes twice; give points at least 5 cm apart"
    if person.count > 1 and (behaviour is not PersonBehaviour.BOUNCE or person.path):
        yield ("count",), f"{person.count} people at one place; only movers that bounce and have no path may have a count, so give each person its own entry"  # fmt: skip


def _nearest(name: str, known: Iterable[str]) -> str:
    return difflib.get_close_matches(name, list(known), n=1, cutoff=0.0)[0]


def _numbers(value: object, keys: Keys) -> Iterator[tuple[Keys, float]]:
    """Yield every float in nested lists and dictionaries, with the keys that lead to it."""
    if isinstance(value, dict):
        for key, item in value.items():
            yield from _numbers(item, (*keys, key))
    elif isinstance(value, list | tuple):
        for i, item in enumerate(value):
            yield from _numbers(item, (*keys, i))
    elif isinstance(value, float):
        yield keys, value
