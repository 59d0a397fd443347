"""A world to drive in: the true grid, the chair's start, named places and doors, and routes to drive.

A world comes from a floor plan (see `floor_plan.py`), from a mapped grid, or from another benchmark (`imports.py`).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from waychair.errors import WorldError
from waychair.maps.grid.cells import OCCUPIED_FROM, cells_from_points
from waychair.maps.grid.distance_field import distance_field
from waychair.simulation.plan.floor_plan import FloorPlan, Keys
from waychair.simulation.plan.free_ground import ErrorMaker, check_free_path, check_free_point, points_between
from waychair.simulation.plan.hospital_plan import hospital_plan
from waychair.simulation.plan.plan_blocks import (
    blocks_from_plan,
    cells_in_rectangle,
    door_block,
    fill_block,
    fill_rectangle,
    grid_from_plan,
    leaf_block,
    pits_from_plan,
    pose_on_wall,
    slopes_from_plan,
)
from waychair.simulation.plan.plan_file import PlannedBuilding, checked_building, load_building
from waychair.simulation.plan.plan_fittings import (
    CLEAR_OF_START,
    finish_from_plan,
    lamps_from_plan,
    people_from_plan,
    posters_from_plan,
    tags_from_plan,
)
from waychair.simulation.scene.rectangles import blocks_from_grid
from waychair.simulation.scene.scene import Block, Finish, Lamp, LiftCabin, PersonPlan, Pit, Poster, Slope, WallTag
from waychair.simulation.scene.seeds import seed_from_names
from waychair.types import Cells, FloatArray, OccupancyGrid, Place, Pose2

MARGIN = 0.5
"""Free margin [m] round a floor plan, so that walls may stand on its edge."""

WORLDS = Path(__file__).resolve().parents[1] / "worlds"
"""Folder of the shipped worlds."""

HOSPITAL = "hospital"
"""Name of the world that is drawn from a seed, as in `hospital:7`."""

MAPPING_ROUTE = "mapping"
"""Name of the route that sees all of a world and revisits places."""


@dataclass(frozen=True, slots=True)
class ClosableDoor:
    """An open door that can be closed: `middle` is its pose in map, theta along its wall; width and thickness [m].

    `leaf` is the leaf that stands open, without its seed; None: there is none.
    """

    name: str
    middle: Pose2
    width: float
    thickness: float
    leaf: Block | None = None


@dataclass(frozen=True, slots=True)
class World:
    """One level of a building; poses and routes (N, 2) [m] are in its map.

    `grid` marks the cells that a chair cannot enter; from a plan it has no unknown cells. `blocks` are all solids with
    their heights.
    """

    name: str
    grid: OccupancyGrid
    start: Pose2
    places: tuple[Place, ...] = ()
    routes: Mapping[str, FloatArray] = field(default_factory=dict)
    doors: tuple[ClosableDoor, ...] = ()
    level: str = ""
    blocks: tuple[Block, ...] = ()
    slopes: tuple[Slope, ...] = ()
    pits: tuple[Pit, ...] = ()
    posters: tuple[Poster, ...] = ()
    tags: tuple[WallTag, ...] = ()
    lamps: tuple[Lamp, ...] = ()
    finish: Finish = field(default_factory=Finish)
    people: tuple[PersonPlan, ...] = ()
    lifts: tuple[LiftCabin, ...] = ()

    @property
    def gaps(self) -> tuple[Pit, ...]:
        """The slits at the sills of lifts, which wheels cross: seen and felt, but no obstacles."""
        return tuple(lift.sill for lift in self.lifts if lift.gap > 0.0)

    def route(self, name: str = MAPPING_ROUTE) -> FloatArray:
        """Return the waypoints (N, 2) [m] of a route.

        Raises:
            WorldError: there is no route of this name; the message lists the routes.
        """
        if name not in self.routes:
            known = f"take one of {', '.join(self.routes)}" if self.routes else "it has no routes"
            raise WorldError(f"'{self.name}' has no route '{name}': {known}")
        return self.routes[name]

    def without_people(self) -> World:
        """Return the same world without people."""
        return replace(self, people=())

    def with_closed(self, names: Iterable[str]) -> World:
        """Return the same world with these doors closed, solid like their wall.

        Raises:
            WorldError: there is no door of this name, or the start or a place lies in it.
        """
        doors, cells = {door.name: door for door in self.doors}, self.grid.cells.copy()
        leaves, standing = [], list(self.blocks)
        for name in dict.fromkeys(names):
            if name not in doors:
                known = f"take one of {', '.join(doors)}" if doors else "it has no doors with names"
                raise WorldError(f"'{self.name}' has no door '{name}': {known}")
            door, seed = doors[name], seed_from_names(self.name, self.level, "doors", name)
            if door.leaf is not None:
                standing = [block for block in standing if replace(block, seed=0) != door.leaf]
                self._clear(cells, door.leaf, standing)
            fill_rectangle(cells, self.grid, door.middle, door.width, door.thickness)
            leaves.append(
                door_block(
                    middle=door.middle,
                    width=door.width,
                    thickness=door.thickness,
                    ceiling=self.finish.height,
                    material="wood",
                    seed=seed,
                )
            )
        closed = replace(self, grid=replace(self.grid, cells=cells), blocks=(*standing, *leaves))
        _check_poses(closed, _error_without_lines(self.name))
        return closed

    def _clear(self, cells: Cells, leaf: Block, others: Iterable[Block]) -> None:
        """Free the cells of a leaf but for those that something else takes."""
        freed = np.zeros_like(cells)
        fill_block(freed, self.grid, leaf)
        taken = np.zeros_like(cells)
        for block in others:
            if math.hypot(block.middle.x - leaf.middle.x, block.middle.y - leaf.middle.y) < block.length + leaf.length:
                fill_block(taken, self.grid, block)
        cells[(freed > 0) & (taken == 0)] = 0


def shipped_worlds() -> tuple[str, ...]:
    """Return the sorted names of the shipped worlds."""
    return tuple(sorted(path.stem for path in WORLDS.glob("*.yaml")))


def levels_of(name_or_path: str | Path) -> tuple[str, ...]:
    """Return the names of a world's levels, the start level first; a single level has the world's name.

    Raises:
        WorldError: as `load_world`, except for the checks that need the grid.
    """
    return tuple(level.plan.name for level in _building(name_or_path).levels)


def load_world(name_or_path: str | Path, level: str | None = None) -> World:
    """Return the world of a shipped plan's name or of a plan's path: its first level, or the level of this name.

    Raises:
        WorldError: there is no such world or level, its plan is invalid (`load_building`), or the start, a place, a
            route, a lift or a person's path lies outside or in something solid; it names the line.
    """
    building = _building(name_or_path)
    levels = {each.plan.name: each for each in building.levels}
    if level is not None and level not in levels:
        raise WorldError(f"'{building.name}' has no level '{level}': take one of {', '.join(levels)}")
    chosen = building.levels[0] if level is None else levels[level]
    lifts = tuple(
        LiftCabin(
            lift.name,
            Pose2(*lift.middle),
            *lift.size,
            tuple(name for name, each in levels.items() if lift.name in (other.name for other in each.plan.lifts)),
            lift.gap,
        )
        for lift in chosen.plan.lifts
    )
    world = world_from_plan(chosen.plan, building.name, lifts)
    _check_poses(world, chosen.source.error)
    for name, route in world.routes.items():
        check_free_path(world.grid, world.pits, route, ("routes", name), chosen.source.error)
    _check_lifts(world, chosen.source.error)
    _check_people(world, chosen.plan, chosen.source.error)
    return world


def load_levels(name_or_path: str | Path) -> tuple[World, ...]:
    """Return all levels of a world from bottom to top, in the order of its plan; raises as `load_world`."""
    return tuple(load_world(name_or_path, level) for level in levels_of(name_or_path))


def _building(name_or_path: str | Path) -> PlannedBuilding:
    """Return the plans of a world: drawn from a seed, or of a file."""
    name, colon, seed = str(name_or_path).partition(":")
    if name != HOSPITAL or (colon and not seed.isdigit()):
        return load_building(_path(name_or_path))
    return checked_building(hospital_plan(int(seed or 0)))


def _path(name_or_path: str | Path) -> Path:
    path = Path(name_or_path)
    if path.suffix in (".yaml", ".yml"):
        return path
    if str(name_or_path) not in shipped_worlds():
        known = ", ".join((*shipped_worlds(), HOSPITAL, f"{HOSPITAL}:SEED"))
        raise WorldError(f"there is no world '{name_or_path}': take one of {known}, or a .yaml file")
    return WORLDS / f"{name_or_path}.yaml"


def world_from_plan(plan: FloorPlan, building: str, lifts: tuple[LiftCabin, ...] = ()) -> World:
    """Return the world of one level of a building; `load_building` must have checked its plan and `lifts`."""
    blocks, slopes, pits = blocks_from_plan(plan, building), slopes_from_plan(plan, building), pits_from_plan(plan)
    grid = grid_from_plan(plan, MARGIN, blocks, slopes, pits)
    return World(
        name=building,
        level=plan.name,
        grid=grid,
        start=Pose2(*plan.start),
        places=tuple(Place(name, Pose2(*pose)) for name, pose in plan.places.items()),
        routes={name: np.array(route, float).reshape(-1, 2) for name, route in plan.routes.items()},
        doors=tuple(
            ClosableDoor(
                name=door.name,
                middle=pose_on_wall(wall, door.at),
                width=door.width,
                thickness=wall.thickness,
                leaf=leaf_block(wall, door, plan.finish.height) if door.leaf else None,
            )
            for wall in plan.walls
            for door in wall.doors
            if door.name and not door.closed
        ),
        blocks=blocks,
        slopes=slopes,
        pits=pits,
        posters=posters_from_plan(plan, building, blocks),
        tags=tags_from_plan(plan),
        lamps=lamps_from_plan(plan, blocks),
        finish=finish_from_plan(plan),
        people=people_from_plan(plan, building, grid),
        lifts=lifts,
    )


def world_from_grid(grid: OccupancyGrid, start: Pose2, places: tuple[Place, ...] = (), name: str = "grid") -> World:
    """Return the world of a mapped grid: occupied cells are solid, unknown cells are not.

    Raises:
        WorldError: the start or a place lies outside the grid or in an occupied cell.
    """
    world = World(name, grid, start, places, blocks=blocks_from_grid(grid, name, Finish()))
    _check_poses(world, _error_without_lines(name))
    return world


def _error_without_lines(name: str) -> ErrorMaker:
    """Return the maker of errors for a world without a file, and so without lines."""
    return lambda keys, problem: WorldError(f"{name}: {' '.join(map(str, keys))}: {problem}")


def _check_poses(world: World, refuse: ErrorMaker) -> None:
    named: list[tuple[Keys, Pose2]] = [(("start",), world.start)]
    named += [(("places", place.name), place.pose) for place in world.places]
    for keys, pose in named:
        check_free_point(world.grid, world.pits, pose.array()[:2], keys, refuse)


def _check_lifts(world: World, refuse: ErrorMaker) -> None:
    for i, lift in enumerate(world.lifts):
        # One cell less on either side: the cabin may touch the walls of its shaft.
        length, width = (max(side - 2 * world.grid.resolution, 0.0) for side in (lift.length, lift.width))
        cells, _ = cells_in_rectangle(world.grid, lift.middle, length, width)
        if (world.grid.cells[tuple(cells.T)] >= OCCUPIED_FROM).any():
            raise refuse(("lifts", i), f"the lift '{lift.name}' is blocked by something solid; clear its cabin")


def _check_people(world: World, plan: FloorPlan, refuse: ErrorMaker) -> None:
    """Refuse people without a free path of their radius, and people at the start."""
    room = distance_field(world.grid).metres
    for i, person in enumerate(plan.people):
        keys, path = ("people", i, "path"), np.array(person.path, float).reshape(-1, 2)
        if not len(path):
            continue
        check_free_path(world.grid, world.pits, path, keys, refuse)
        if math.dist(path[0], plan.start[:2]) < CLEAR_OF_START + person.radius:
            raise refuse((*keys, 0), f"({path[0, 0]:g}, {path[0, 1]:g}) is too near to the chair's start; move it away")
        for k, point in enumerate(path):
            way = points_between(world.grid, path[max(k - 1, 0)], point)
            tight = way[room[tuple(cells_from_points(world.grid, way).T)] < person.radius]
            if len(tight):
                x, y = tight[0]
                raise refuse(
                    (*keys, k), f"({x:g}, {y:g}) is nearer to something solid than {person.radius:g} m; move it away"
                )
    wanted = sum(person.count for person in plan.people)
    if len(world.people) < wanted:
        raise refuse(
            ("people",),
            f"only {len(world.people)} of {wanted} people fit on the free floor; make them fewer or smaller",
        )
