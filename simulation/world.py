"""A world to drive in: the true grid, where the chair starts, named places and doors, and routes to drive.

A world comes from a floor plan (see `floor_plan.py`), from a mapped grid, or from another benchmark (`imports.py`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from waychair.errors import WorldError
from waychair.geometry import rectangle, transform_points
from waychair.maps.grid import OCCUPIED_FROM, cells_from_points, inside, points_from_cells
from waychair.simulation.floor_plan import FloorPlan, PlanWall, load_plan
from waychair.simulation.scene import Block, Finish, Lamp, Lift, PersonPlan, Pit, Poster, Slope
from waychair.types import Cells, FloatArray, OccupancyGrid, Place, Pose2

MARGIN = 0.5
"""Free ground [m] kept round a floor plan, so that walls may stand on its edge."""

WORLDS = Path(__file__).resolve().parent / "worlds"
"""Folder of the worlds that are shipped."""

MAPPING_ROUTE = "mapping"
"""Name of the route that sees all of a world and comes back over places seen before."""

_Refuse = Callable[[tuple[str | int, ...], str], WorldError]


@dataclass(frozen=True, slots=True)
class Door:
    """An open door that can be closed: `middle` is its pose in map, theta along its wall; width, thickness in [m]."""

    name: str
    middle: Pose2
    width: float
    thickness: float


@dataclass(frozen=True, slots=True)
class World:
    """One level of a building; poses and routes (N, 2) [m] are in its map.

    `grid` is the truth of where a chair cannot be, without unknown cells where it comes from a plan; `blocks` are all
    that is solid, at its height.
    """

    name: str
    grid: OccupancyGrid
    start: Pose2
    places: tuple[Place, ...] = ()
    routes: Mapping[str, FloatArray] = field(default_factory=dict)
    doors: tuple[Door, ...] = ()
    level: str = ""
    blocks: tuple[Block, ...] = ()
    slopes: tuple[Slope, ...] = ()
    pits: tuple[Pit, ...] = ()
    posters: tuple[Poster, ...] = ()
    lamps: tuple[Lamp, ...] = ()
    finish: Finish = field(default_factory=Finish)
    people: tuple[PersonPlan, ...] = ()
    lifts: tuple[Lift, ...] = ()

    def route(self, name: str = MAPPING_ROUTE) -> FloatArray:
        """Waypoints (N, 2) [m] of a route.

        Raises:
            WorldError: there is none of this name; the message gives those that exist.
        """
        if name not in self.routes:
            known = f"take one of {', '.join(self.routes)}" if self.routes else "it has no routes"
            raise WorldError(f"'{self.name}' has no route '{name}': {known}")
        return self.routes[name]

    def with_closed(self, names: Iterable[str]) -> World:
        """The same world with these doors shut: they are solid, as if their wall went through.

        Raises:
            WorldError: there is no door of such a name, or the start or a place lies in it.
        """
        doors, cells = {door.name: door for door in self.doors}, self.grid.cells.copy()
        for name in names:
            if name not in doors:
                known = f"take one of {', '.join(doors)}" if doors else "it has no doors with names"
                raise WorldError(f"'{self.name}' has no door '{name}': {known}")
            _fill(cells, self.grid, doors[name].middle, doors[name].width, doors[name].thickness)
        closed = replace(self, grid=replace(self.grid, cells=cells))
        _refuse_poses_in_walls(closed, _refusal(self.name))
        return closed


def shipped_worlds() -> tuple[str, ...]:
    """Names of the worlds that are shipped, in order."""
    return tuple(sorted(path.stem for path in WORLDS.glob("*.yaml")))


def load_world(name_or_path: str | Path) -> World:
    """World of a shipped plan's name, or of a plan's path.

    Raises:
        WorldError: there is no such world, its plan is broken (`load_plan`), or the start, a place or a route lies
            outside or in something solid; with the line.
    """
    path = Path(name_or_path)
    if path.suffix not in (".yaml", ".yml"):
        if str(name_or_path) not in shipped_worlds():
            known = ", ".join(shipped_worlds())
            raise WorldError(f"there is no world '{name_or_path}': take one of {known}, or a .yaml file")
        path = WORLDS / f"{name_or_path}.yaml"
    plan, source = load_plan(path)
    world = world_from_plan(plan)
    _refuse_poses_in_walls(world, source.error)
    _refuse_routes_in_walls(world, source.error)
    return world


def world_from_plan(plan: FloorPlan) -> World:
    """World of a plan that `load_plan` has let pass: a cell is solid when its centre lies in a wall or a box."""
    # round() first: 15.0 / 0.05 must not become 301 cells by an error in the last place
    shape = tuple(math.ceil(round((length + 2 * MARGIN) / plan.resolution, 6)) for length in reversed(plan.size))
    grid = OccupancyGrid(np.zeros(shape, np.int8), plan.resolution, Pose2(-MARGIN, -MARGIN, 0.0))
    for wall in plan.walls:
        for begin, end in _solid_pieces(wall):
            _fill(grid.cells, grid, _on_wall(wall, (begin + end) / 2), end - begin, wall.thickness)
    for box in plan.boxes:
        _fill(grid.cells, grid, Pose2(*box.centre, box.yaw), *box.size)
    return World(
        plan.name,
        grid,
        Pose2(*plan.start),
        tuple(Place(name, Pose2(*pose)) for name, pose in plan.places.items()),
        {name: np.array(route, float).reshape(-1, 2) for name, route in plan.routes.items()},
        tuple(
            Door(door.name, _on_wall(wall, door.at), door.width, wall.thickness)
            for wall in plan.walls
            for door in wall.doors
            if door.name
        ),
    )


def world_from_grid(grid: OccupancyGrid, start: Pose2, places: tuple[Place, ...] = (), name: str = "grid") -> World:
    """World raised from a mapped grid: its occupied cells are solid, its unknown ones let everything through.

    Raises:
        WorldError: the start or a place lies outside the grid or in an occupied cell.
    """
    world = World(name, grid, start, places)
    _refuse_poses_in_walls(world, _refusal(name))
    return world


def _solid_pieces(wall: PlanWall) -> list[tuple[float, float]]:
    """Where the wall stands, as stretches [m] from its start: all of it but its doors."""
    doors = sorted(wall.doors, key=lambda door: door.at)
    begins = [0.0, *(door.at + door.width / 2 for door in doors)]
    ends = [*(door.at - door.width / 2 for door in doors), wall.length]
    return [(begin, end) for begin, end in zip(begins, ends, strict=True) if end - begin > 1e-6]


def _on_wall(wall: PlanWall, at: float) -> Pose2:
    """The pose on the wall's middle line, `at` [m] from its start, looking along it."""
    (ax, ay), (bx, by) = wall.start, wall.end
    theta = math.atan2(by - ay, bx - ax)
    return Pose2(ax + at * math.cos(theta), ay + at * math.sin(theta), theta)


def _fill(cells: Cells, grid: OccupancyGrid, middle: Pose2, length: float, width: float) -> None:
    """Makes solid every one of `cells` whose centre lies in the rectangle; touches only the window about it."""
    corners = cells_from_points(grid, transform_points(middle, rectangle(length / 2, length / 2, width / 2)))
    low = np.maximum(corners.min(axis=0) - 1, 0)
    high = np.maximum(np.minimum(corners.max(axis=0) + 2, cells.shape), low)
    window = low + np.argwhere(np.ones(high - low, np.bool_))
    local = np.abs(transform_points(middle.inverse(), points_from_cells(grid, window)))
    solid = np.all(local <= np.array([length / 2, width / 2]) + 1e-9, axis=1)
    cells[tuple(window[solid].T)] = 100


def _refusal(name: str) -> _Refuse:
    """The error of a world that has no file, and so no lines."""
    return lambda keys, problem: WorldError(f"{name}: {' '.join(map(str, keys))}: {problem}")


def _refuse_poses_in_walls(world: World, refuse: _Refuse) -> None:
    named: list[tuple[tuple[str | int, ...], Pose2]] = [(("start",), world.start)]
    named += [(("places", place.name), place.pose) for place in world.places]
    for keys, pose in named:
        _refuse_points_in_walls(world, np.array([[pose.x, pose.y]]), keys, refuse)


def _refuse_routes_in_walls(world: World, refuse: _Refuse) -> None:
    for name, route in world.routes.items():
        _refuse_points_in_walls(world, route[:1], ("routes", name, 0), refuse)
        for i, (begin, end) in enumerate(pairwise(route)):
            count = math.ceil(math.dist(begin, end) / (world.grid.resolution / 2)) + 2
            _refuse_points_in_walls(world, np.linspace(begin, end, count), ("routes", name, i + 1), refuse)


def _refuse_points_in_walls(world: World, points: FloatArray, keys: tuple[str | int, ...], refuse: _Refuse) -> None:
    cells = cells_from_points(world.grid, points)
    within = inside(world.grid, cells)
    if not within.all():
        x, y = points[~within][0]
        raise refuse(keys, f"({x:g}, {y:g}) lies outside the world; move it in")
    solid = world.grid.cells[tuple(cells.T)] >= OCCUPIED_FROM
    if solid.any():
        x, y = points[solid][0]
        raise refuse(keys, f"({x:g}, {y:g}) lies in something solid; move it to free ground")
