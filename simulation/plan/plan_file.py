"""Reads floor plans strictly from YAML; an error names the file, the line and the remedy."""

from __future__ import annotations

import difflib
import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import msgspec
import yaml

from waychair.errors import WorldError
from waychair.pose_text import ImpossiblePose, NoPoseText, angle_from_text, checked_turn
from waychair.simulation.plan import floor_plan
from waychair.simulation.plan.floor_plan import BuildingPlan, FloorPlan, Keys, Planar, Point
from waychair.simulation.plan.floor_plan_checks import building_problems, plan_problems
from waychair.yaml_files import compose_yaml, node_value

_Plan = TypeVar("_Plan", FloorPlan, BuildingPlan)
_NAMED: dict[str, Any] = {"places": Planar, "routes": list[Point]}
_ANGLES = ("yaw", "leaf")
"""Keys of angles."""

_POSES = ("start", "middle")
"""Keys of poses x, y, yaw; a wall's start has no yaw."""

_SECTIONS: dict[str, type[msgspec.Struct]] = {
    "levels": FloorPlan,
    "walls": floor_plan.PlanWall,
    "doors": floor_plan.PlanDoor,
    "posters": floor_plan.PlanPoster,
    "tags": floor_plan.PlanTag,
    "boxes": floor_plan.PlanBox,
    "tables": floor_plan.PlanTable,
    "ramps": floor_plan.PlanRamp,
    "thresholds": floor_plan.PlanThreshold,
    "stairs": floor_plan.PlanStairs,
    "pits": floor_plan.PlanPit,
    "lamps": floor_plan.PlanLamp,
    "light": floor_plan.PlanLight,
    "finish": floor_plan.PlanFinish,
    "people": floor_plan.PlanPerson,
    "lifts": floor_plan.PlanLift,
}


@dataclass(frozen=True, slots=True)
class PlanSource:
    """The source of a plan, which gives the line of each key; `prefix` are the keys from the file's top to the plan."""

    path: Path
    root: yaml.Node
    prefix: Keys = ()

    def error(self, keys: Keys, problem: str) -> WorldError:
        """Return the error about the value at `keys`, such as ("walls", 0, "start"), with its line."""
        keys = (*self.prefix, *keys)
        where = "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in keys).lstrip(".")
        return WorldError(f"{self.path}, line {self._line(keys)}: {where + ': ' if where else ''}{problem}")

    def _line(self, keys: Keys) -> int:
        """Return the line of the innermost node along `keys` that the file contains."""
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


@dataclass(frozen=True, slots=True)
class LevelPlan:
    """The plan of one level and its source."""

    plan: FloorPlan
    source: PlanSource


@dataclass(frozen=True, slots=True)
class PlannedBuilding:
    """The content of a file: at least one level; in a plan without `levels` it has the building's name."""

    name: str
    levels: tuple[LevelPlan, ...]


def load_building(path: Path) -> PlannedBuilding:
    """Return the plans of a file, each checked by itself and against the others; checks on the grid come later.

    Raises:
        WorldError: the file cannot be read or is not YAML; a key is unknown, missing, given twice or of the wrong type;
            a number is not finite; a wall, a door or another item is impossible. It names the line and the remedy.
    """
    source, values = _parsed(path)
    if not isinstance(values, dict):
        raise source.error((), "a world is an object; give `key: value` lines: name, size, start and walls")
    if "levels" in values:
        plan = _converted(values, BuildingPlan, source)
        levels = tuple(LevelPlan(p, PlanSource(path, source.root, ("levels", i))) for i, p in enumerate(plan.levels))
        building = PlannedBuilding(plan.name, levels)
    else:
        single = _converted(values, FloorPlan, source)
        building = PlannedBuilding(single.name, (LevelPlan(single, source),))
    _check(building, source, has_levels="levels" in values)
    return building


def checked_building(plan: BuildingPlan) -> PlannedBuilding:
    """Return the plans of a building that no file holds; raises WorldError as `load_building`, without true lines."""
    path, root = Path(plan.name), yaml.MappingNode("tag:yaml.org,2002:map", [], yaml.Mark("", 0, 0, 0, None, 0))
    levels = tuple(LevelPlan(level, PlanSource(path, root, ("levels", i))) for i, level in enumerate(plan.levels))
    building = PlannedBuilding(plan.name, levels)
    _check(building, PlanSource(path, root), has_levels=True)
    return building


def _check(building: PlannedBuilding, source: PlanSource, *, has_levels: bool) -> None:
    """Check each level by itself and against the others."""
    for level in building.levels:
        for keys, problem in plan_problems(level.plan):
            raise level.source.error(keys, problem)
    for keys, problem in building_problems([level.plan for level in building.levels]):
        raise source.error(keys if has_levels else keys[2:], problem)


def _parsed(path: Path) -> tuple[PlanSource, Any]:
    root = compose_yaml(path, WorldError)
    if root is None:
        raise WorldError(f"{path}, line 1: the file is empty; give an object of name, size, start and walls")
    source = PlanSource(path, root)
    return source, _in_radians(node_value(root, str(path), WorldError), source, ())


def _in_radians(value: Any, source: PlanSource, keys: Keys) -> Any:
    """Return a part of a plan at `keys` with its angles in radians; they may be written as `90deg`.

    Raises:
        WorldError: an angle is more than a full turn, or no angle.
    """
    if isinstance(value, list):
        return [_in_radians(each, source, (*keys, at)) for at, each in enumerate(value)]
    if not isinstance(value, dict):
        return value
    result = {}
    for key, each in value.items():
        here = (*keys, key)
        if key in _ANGLES:
            result[key] = _angle(each, source, here)
        elif isinstance(each, list) and len(each) == 3 and (key in _POSES or keys[-1:] == ("places",)):
            result[key] = [*each[:2], _angle(each[2], source, (*here, 2))]
        else:
            result[key] = _in_radians(each, source, here)
    return result


def _angle(value: Any, source: PlanSource, keys: Keys) -> Any:
    """Return an angle in radians; a value of another kind stays, since msgspec refuses it."""
    try:
        if isinstance(value, str):
            return angle_from_text(value)
        is_number = isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
        return checked_turn(value) if is_number else value
    except ImpossiblePose as error:
        raise source.error(keys, str(error)) from error
    except NoPoseText:
        return value


def _converted(values: dict[str, Any], kind: type[_Plan], source: PlanSource) -> _Plan:
    levels = values.get("levels")
    for i, level in enumerate(levels) if isinstance(levels, list) else ():
        _check_named_sections(level, ("levels", i), source, kind)
    _check_named_sections(values, (), source, kind)
    try:
        return msgspec.convert(values, kind)
    except msgspec.ValidationError as error:
        raise _validation_error(source, (), str(error), kind) from error


def _check_named_sections(plan: object, prefix: Keys, source: PlanSource, kind: type[msgspec.Struct]) -> None:
    """Check entries of named sections one by one: msgspec does not tell which entry it refuses."""
    for section, entry_kind in _NAMED.items():
        entries = plan.get(section) if isinstance(plan, dict) else None
        for name, entry in entries.items() if isinstance(entries, dict) else ():
            try:
                msgspec.convert(entry, entry_kind)
            except msgspec.ValidationError as error:
                raise _validation_error(source, (*prefix, section, str(name)), str(error), kind) from error


def _validation_error(source: PlanSource, prefix: Keys, message: str, kind: type[msgspec.Struct]) -> WorldError:
    """Return the error of a validation message, which ends in the path of the value."""
    problem, _, at = message.partition(" - at ")
    path = at.partition("$")[2].rstrip("`")
    keys = (*prefix, *(int(i) if i else name for name, i in re.findall(r"\.([^.\[]+)|\[(\d+)\]", path)))
    unknown = re.search("unknown field `(.*)`", problem)
    if unknown is None:
        return source.error(keys, f"{problem[:1].lower()}{problem[1:]}; correct the value")
    sections = [_SECTIONS[key] for key in keys if isinstance(key, str) and key in _SECTIONS]
    known = (sections[-1] if sections else kind).__struct_fields__
    near = difflib.get_close_matches(unknown[1], known, n=1, cutoff=0.0)
    return source.error((*keys, unknown[1]), f"unknown key; did you mean '{near[0]}'?")
