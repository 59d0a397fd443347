"""Floor plans as they are written: one small YAML file for a world, read strictly, refused by file and line.

    name: flat
    size: [6.0, 4.0]            # x and y; the origin is the lower left corner
    start: [1.0, 1.0, 0.0]      # x, y, yaw
    walls:
      - {start: [0.0, 2.0], end: [6.0, 2.0], doors: [{name: kitchen, at: 4.0, width: 0.9}]}
    boxes:
      - {centre: [3.0, 1.0], size: [0.8, 0.4], yaw: 0.3}
    places:
      sink: [4.0, 3.0, 1.57]
    routes:
      mapping: [[1.0, 1.0], [4.0, 1.0], [4.0, 3.0]]

Metres and radians throughout.
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Hashable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, TypeAlias

import msgspec
import yaml

from waychair.errors import WorldError

MOST_CELLS = 50_000_000
"""Largest world that is rasterised, in cells."""

_Keys: TypeAlias = tuple[str | int, ...]
_Point: TypeAlias = tuple[float, float]
_Planar: TypeAlias = tuple[float, float, float]
_Length: TypeAlias = Annotated[float, msgspec.Meta(gt=0.0, le=500.0)]


class PlanDoor(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """An opening in a wall: its middle is `at` [m] from the wall's start. One that has a name can be closed."""

    at: float
    width: _Length
    name: str = ""


class PlanWall(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A straight wall between two points; at least two cells thick, so that no beam slips through a slanted one."""

    start: _Point
    end: _Point
    thickness: Annotated[float, msgspec.Meta(gt=0.0, le=5.0)] = 0.1
    doors: list[PlanDoor] = []

    @property
    def length(self) -> float:
        """From start to end [m]."""
        return math.dist(self.start, self.end)


class PlanBox(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A piece of furniture: its size along its own x and y, turned by `yaw` [rad]."""

    centre: _Point
    size: tuple[_Length, _Length]
    yaw: float = 0.0


class FloorPlan(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A whole plan; `resolution` [m] is the side of a cell of the world that is made of it."""

    name: str
    size: tuple[_Length, _Length]
    start: _Planar
    walls: list[PlanWall]
    resolution: Annotated[float, msgspec.Meta(ge=0.005, le=0.1)] = 0.05
    boxes: list[PlanBox] = []
    places: dict[str, _Planar] = {}
    routes: dict[str, list[_Point]] = {}


_NAMED: dict[str, Any] = {"places": _Planar, "routes": list[_Point]}


@dataclass(frozen=True, slots=True)
class PlanSource:
    """Where a plan was read: says of each key on which line it stands."""

    path: Path
    root: yaml.Node

    def error(self, keys: _Keys, problem: str) -> WorldError:
        """The error about the value at `keys`, such as ("walls", 0, "start"), with its line."""
        where = "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in keys).lstrip(".")
        return WorldError(f"{self.path}, line {self._line(keys)}: {where + ': ' if where else ''}{problem}")

    def _line(self, keys: _Keys) -> int:
        """Line of the innermost node on the way along `keys` that is written out."""
        node, line = self.root, self.root.start_mark.line
        for key in keys:
            if isinstance(node, yaml.MappingNode):
                found = [(name.start_mark.line, value) for name, value in node.value if name.value == key]
            elif isinstance(node, yaml.SequenceNode) and isinstance(key, int) and key < len(node.value):
                found = [(node.value[key].start_mark.line, node.value[key])]
            else:
                found = []
            if not found:
                break
            line, node = found[0]
        return line + 1


def load_plan(path: Path) -> tuple[FloorPlan, PlanSource]:
    """The plan in a file, checked in itself: types, numbers, walls and doors; and where it stands, for later checks.

    Raises:
        WorldError: the file cannot be read or is not YAML; a key is unknown, missing, given twice or of the wrong type;
            a number is not finite; a wall, a box or a door is impossible. With the line, and what would be right.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise WorldError(f"cannot read the world {path}: {error}") from error
    loader = _Loader(text)
    try:
        root = loader.get_single_node()
        values = None if root is None else loader.construct_document(root)
    except yaml.MarkedYAMLError as error:
        line = f", line {error.problem_mark.line + 1}" if error.problem_mark else ""
        raise WorldError(f"{path}{line}: {error.problem}; mend the YAML there") from error
    except (yaml.YAMLError, ValueError) as error:
        raise WorldError(f"{path} is not YAML: {' '.join(str(error).split())}") from error
    finally:
        loader.dispose()
    if root is None:
        raise WorldError(f"{path}, line 1: the file is empty; give an object of name, size, start and walls")
    source = PlanSource(path, root)
    plan = _converted(values, source)
    for keys, problem in _problems(plan):
        raise source.error(keys, problem)
    return plan, source


class _Loader(yaml.SafeLoader):
    """Refuses a key that is given twice, where YAML's own would silently keep the last."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, Any]:
        seen: set[str] = set()
        for key, _ in node.value:
            if str(key.value) in seen:
                raise yaml.MarkedYAMLError(problem=f"'{key.value}' is given twice", problem_mark=key.start_mark)
            seen.add(str(key.value))
        return super().construct_mapping(node, deep)


def _converted(values: Any, source: PlanSource) -> FloorPlan:
    if not isinstance(values, dict):
        raise source.error((), "a world is an object; give `key: value` lines: name, size, start and walls")
    # Entries with names of their own come first, one by one: msgspec does not say which of them it refuses.
    for section, kind in _NAMED.items():
        entries = values.get(section)
        for name, entry in entries.items() if isinstance(entries, dict) else ():
            try:
                msgspec.convert(entry, kind)
            except msgspec.ValidationError as error:
                raise _refusal(source, (section, str(name)), str(error)) from error
    try:
        return msgspec.convert(values, FloorPlan)
    except msgspec.ValidationError as error:
        raise _refusal(source, (), str(error)) from error


def _refusal(source: PlanSource, prefix: _Keys, message: str) -> WorldError:
    """The error of a validation message, which ends in the path of the value."""
    problem, _, at = message.partition(" - at ")
    path = at.partition("$")[2].rstrip("`")
    keys = (*prefix, *(int(i) if i else name for name, i in re.findall(r"\.([^.\[]+)|\[(\d+)\]", path)))
    unknown = re.search("unknown field `(.*)`", problem)
    if unknown is None:
        return source.error(keys, f"{problem[:1].lower()}{problem[1:]}; write it so")
    kind = FloorPlan if not keys else {"walls": PlanWall, "boxes": PlanBox}[str(keys[0])]
    known = (PlanDoor if "doors" in keys else kind).__struct_fields__
    near = difflib.get_close_matches(unknown[1], known, n=1, cutoff=0.0)
    return source.error((*keys, unknown[1]), f"unknown key; did you mean '{near[0]}'?")


def _problems(plan: FloorPlan) -> Iterator[tuple[_Keys, str]]:
    """What types cannot say, in the order of importance: the keys and the sentence."""
    for keys, number in _numbers(msgspec.to_builtins(plan), ()):
        if not math.isfinite(number):
            yield keys, f"{number} is not finite; give a finite number"
    if plan.size[0] * plan.size[1] / plan.resolution**2 > MOST_CELLS:
        yield ("size",), f"{plan.size[0]:g} x {plan.size[1]:g} m in cells of {plan.resolution:g} m is too large; make the size smaller or the cells larger"  # fmt: skip
    for i, wall in enumerate(plan.walls):
        yield from ((("walls", i, *keys), problem) for keys, problem in _wall_problems(wall, plan))
    for i, box in enumerate(plan.boxes):
        if not _on_plan(box.centre, plan):
            yield ("boxes", i, "centre"), f"({box.centre[0]:g}, {box.centre[1]:g}) lies outside; move it in"
    first: dict[str, int] = {}
    for i, wall in enumerate(plan.walls):
        for k, door in enumerate(wall.doors):
            if door.name and door.name in first:
                yield ("walls", i, "doors", k, "name"), f"walls[{first[door.name]}] has a door '{door.name}' already; rename one"  # fmt: skip
            first[door.name] = i
    for name, route in plan.routes.items():
        if not route:
            yield ("routes", name), "a route without points; give at least one"


def _wall_problems(wall: PlanWall, plan: FloorPlan) -> Iterator[tuple[_Keys, str]]:
    for key, point in (("start", wall.start), ("end", wall.end)):
        if not _on_plan(point, plan):
            yield (key,), f"({point[0]:g}, {point[1]:g}) lies outside; move it into {plan.size[0]:g} x {plan.size[1]:g} m"  # fmt: skip
    if wall.length < plan.resolution:
        yield ("end",), "the wall has no length; move its end away from its start"
    if wall.thickness < 2 * plan.resolution - 1e-9:
        yield ("thickness",), f"{wall.thickness:g} m lets beams through; make it at least {2 * plan.resolution:g} m, two cells"  # fmt: skip
    for k, door in enumerate(wall.doors):
        if door.width > wall.length + 1e-9:
            yield ("doors", k, "width"), f"a door of {door.width:g} m is wider than its wall of {wall.length:g} m; make it narrower"  # fmt: skip
        if door.at - door.width / 2 < -1e-9 or door.at + door.width / 2 > wall.length + 1e-9:
            yield ("doors", k, "at"), f"a door of {door.width:g} m at {door.at:g} m lies outside its wall of {wall.length:g} m; move it in"  # fmt: skip
        for other in wall.doors[:k]:
            if abs(door.at - other.at) < (door.width + other.width) / 2 - 1e-9:
                yield ("doors", k, "at"), f"the doors at {other.at:g} and {door.at:g} m overlap; move one"


def _on_plan(point: _Point, plan: FloorPlan) -> bool:
    return all(-1e-9 <= value <= length + 1e-9 for value, length in zip(point, plan.size, strict=True))


def _numbers(value: object, keys: _Keys) -> Iterator[tuple[_Keys, float]]:
    """Every float in nested lists and dictionaries, with the keys that lead to it."""
    if isinstance(value, dict):
        for key, item in value.items():
            yield from _numbers(item, (*keys, key))
    elif isinstance(value, list | tuple):
        for i, item in enumerate(value):
            yield from _numbers(item, (*keys, i))
    elif isinstance(value, float):
        yield keys, value
