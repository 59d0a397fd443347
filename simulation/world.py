"""A world to drive in: the true grid, where the chair starts, named places, and a route that sees everything.

A world comes from a floor plan (a small YAML file, see `worlds/small_clinic.yaml`) or is raised from a mapped grid.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import msgspec
import numpy as np
import yaml

from waychair.errors import WorldError
from waychair.geometry import transform_points
from waychair.maps.grid import cells_from_points, inside, occupied, points_from_cells
from waychair.types import BoolArray, Cells, FloatArray, OccupancyGrid, Place, Pose2

RESOLUTION = 0.05
"""Side of a cell [m] of a world made from a floor plan."""

MARGIN = 0.5
"""Free ground [m] kept round a floor plan, so that walls may stand on its edge."""

WORLDS = Path(__file__).resolve().parent / "worlds"
"""Folder of the worlds that are shipped."""


def _no_route() -> FloatArray:
    return np.empty((0, 2))


@dataclass(frozen=True, slots=True)
class World:
    """`grid` is the truth, without unknown cells where it comes from a plan; poses and `route` (N, 2) [m] are in map."""

    name: str
    grid: OccupancyGrid
    start: Pose2
    places: tuple[Place, ...] = ()
    route: FloatArray = field(default_factory=_no_route)


_Point = tuple[float, float]
_Planar = tuple[float, float, float]
_Length = Annotated[float, msgspec.Meta(gt=0.0, le=500.0)]


class _Wall(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A straight wall between two points; at least two cells thick, so that no beam slips through a slanted one."""

    start: _Point
    end: _Point
    thickness: Annotated[float, msgspec.Meta(ge=2 * RESOLUTION, le=5.0)] = 2 * RESOLUTION


class _Box(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A piece of furniture: its size along its own x and y, turned by `yaw` [rad]."""

    centre: _Point
    size: tuple[_Length, _Length]
    yaw: float = 0.0


class _Plan(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The floor plan as it is written: lengths in metres, angles in radians, origin in the lower left corner."""

    name: str
    size: tuple[_Length, _Length]
    start: _Planar
    walls: list[_Wall]
    boxes: list[_Box] = []
    places: dict[str, _Planar] = {}
    route: list[_Point] = []


def load_world(name_or_path: str | Path) -> World:
    """World of a shipped plan's name, or of a plan's path.

    Raises:
        WorldError: there is no such world, its YAML is broken (with the line), a key is unknown, missing or of the
            wrong type (with the key), or the start, a place or the route lies outside or in something solid.
    """
    path = Path(name_or_path)
    if path.suffix not in (".yaml", ".yml"):
        path = WORLDS / f"{name_or_path}.yaml"
        if not path.is_file():
            known = ", ".join(sorted(entry.stem for entry in WORLDS.glob("*.yaml")))
            raise WorldError(f"there is no world '{name_or_path}': take one of {known}, or a .yaml file")
    try:
        values = yaml.safe_load(path.read_text(encoding="utf-8"))
        plan = msgspec.convert(values, _Plan)
    except (OSError, UnicodeDecodeError) as error:
        raise WorldError(f"cannot read the world {path}: {error}") from error
    except yaml.YAMLError as error:
        raise WorldError(f"{path} is not YAML: {' '.join(str(error).split())}") from error
    except msgspec.ValidationError as error:
        raise WorldError(f"{path}: {error}") from error
    return _world_from_plan(plan, path)


def world_from_grid(grid: OccupancyGrid, start: Pose2, places: tuple[Place, ...] = (), name: str = "grid") -> World:
    """World raised from a mapped grid: its occupied cells are solid, its unknown ones let everything through.

    Raises:
        WorldError: the start or a place lies outside the grid or in an occupied cell.
    """
    world = World(name, grid, start, places)
    _refuse_points_in_walls(world, name)
    return world


def _world_from_plan(plan: _Plan, path: Path) -> World:
    _refuse_not_finite(plan, path)
    shape = tuple(math.ceil((length + 2 * MARGIN) / RESOLUTION) for length in reversed(plan.size))
    empty = OccupancyGrid(np.zeros(shape, np.int8), RESOLUTION, Pose2(-MARGIN, -MARGIN, 0.0))
    world = World(
        plan.name,
        OccupancyGrid(_rasterised(plan, empty), RESOLUTION, empty.map_from_grid),
        Pose2(*plan.start),
        tuple(Place(name, Pose2(*pose)) for name, pose in plan.places.items()),
        np.array(plan.route, float).reshape(-1, 2),
    )
    _refuse_points_in_walls(world, str(path))
    return world


def _rasterised(plan: _Plan, empty: OccupancyGrid) -> Cells:
    """(H, W) cells: 100 where a cell's centre lies in a wall or a box, 0 elsewhere."""
    centres = points_from_cells(empty, np.argwhere(empty.cells == 0))
    solid = np.zeros(len(centres), np.bool_)
    for wall in plan.walls:
        (ax, ay), (bx, by) = wall.start, wall.end
        middle = Pose2((ax + bx) / 2, (ay + by) / 2, math.atan2(by - ay, bx - ax))
        solid |= _within(centres, middle, math.hypot(bx - ax, by - ay), wall.thickness)
    for box in plan.boxes:
        solid |= _within(centres, Pose2(*box.centre, box.yaw), *box.size)
    return np.where(solid, 100, 0).astype(np.int8).reshape(empty.cells.shape)


def _within(points: FloatArray, middle: Pose2, length: float, width: float) -> BoolArray:
    """(N,) whether points (N, 2) lie in a rectangle about `middle`."""
    local = np.abs(transform_points(middle.inverse(), points))
    result: BoolArray = np.all(local <= np.array([length / 2, width / 2]) + 1e-9, axis=1)
    return result


def _refuse_not_finite(plan: _Plan, path: Path) -> None:
    for key, value in msgspec.to_builtins(plan).items():
        numbers = [number for number in _numbers(value) if not math.isfinite(number)]
        if numbers:
            raise WorldError(f"{path}: {key} holds {numbers[0]}: give finite numbers")


def _numbers(value: object) -> list[float]:
    if isinstance(value, dict):
        value = list(value.values())
    if isinstance(value, list | tuple):
        return [number for item in value for number in _numbers(item)]
    return [value] if isinstance(value, float) else []


def _refuse_points_in_walls(world: World, where: str) -> None:
    named = [("start", world.start.x, world.start.y)]
    named += [(f"places: {place.name}", place.pose.x, place.pose.y) for place in world.places]
    named += [(f"route[{i}]", x, y) for i, (x, y) in enumerate(world.route.tolist())]
    cells = cells_from_points(world.grid, np.array([(x, y) for _, x, y in named]))
    solid = occupied(world.grid)
    for (key, x, y), cell, within in zip(named, cells, inside(world.grid, cells), strict=True):
        if not within:
            raise WorldError(f"{where}: {key} at ({x:g}, {y:g}) lies outside the world: move it in")
        if solid[tuple(cell)]:
            raise WorldError(f"{where}: {key} at ({x:g}, {y:g}) lies in something solid: move it to free ground")
