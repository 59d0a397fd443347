"""Drives of a simulated chair on a saved map, in a given world or in one raised from the map."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from waychair.calibration.chair_body import CHAIR_A
from waychair.calibration.fits.dac import DEFAULT
from waychair.errors import StartOccupied, StartOutsideMap, WorldError
from waychair.maps.drawn.zones import Zone
from waychair.maps.grid.cells import OCCUPIED_FROM, cells_from_points, inside, points_from_cells
from waychair.maps.grid.distance_field import distance_field
from waychair.planning.grid.costmap import check_free_space, costmap_from_grid
from waychair.runtime.chair import ChairSettings
from waychair.simulation.plan.world import World, world_from_grid
from waychair.simulation.scene.contact import in_contact, solid_from_blocks
from waychair.simulation.scene.scene import PersonBehaviour, PersonPlan
from waychair.simulation.simulator import SimulationSettings, Simulator, with_all_sensors
from waychair.trials.demo.demo import randomised_settings
from waychair.trials.drive import DriveRecord, DriveSetup, drive_to_places
from waychair.types import OccupancyGrid, Place, Pose2

_SPECK = 0.1
"""A smaller unknown area [m^2] counts as free."""

_CLEAR_OF_START = 1.5
"""Least distance [m] of a person to the chair at its start."""


def navigate(
    grid: OccupancyGrid,
    start: Pose2,
    goals: Sequence[Place],
    seed: int = 0,
    people: int = 0,
    world: World | None = None,
    zones: Sequence[Zone] = (),
    sensors: bool = False,
    scanned: OccupancyGrid | None = None,
    map_from_world: Pose2 | None = None,
    box: Path | None = None,
    trace: Path | None = None,
    settings: ChairSettings | None = None,
    simulation: SimulationSettings | None = None,
    progress: Callable[[str, float], None] = lambda goal, metres: None,
) -> tuple[DriveRecord, ...]:
    """Drive chair A from a start to places in turn, in the map's frame, among `people` walking people.

    A given `world` lies at `map_from_world`, without its own start and people; by default the world is raised from the
    map. `zones` are the map's. With `sensors` the chair has sonars, a depth camera and an IMU besides its lidar.
    `scanned` is the map as the lidar sees it in `world`; in a raised world the lidar sees the whole map. `box` is the
    folder of a black box, `trace` the file for the trace of behaviour cells, which are switched on for it. `settings` are
    the chair's, `simulation` those of its simulated sensors and plant. `progress` is called after each tick with the goal's
    name and the way [m] driven to it.

    Raises:
        StartOutsideMap, StartOccupied: the chair cannot stand at the start (in map coordinates).
        NoFreeSpace: the map has no free space for the chair.
        WorldError: there is no space for so many people.
    """
    map_from_world = map_from_world or Pose2()
    if not inside(grid, cells_from_points(grid, np.array([[start.x, start.y]])))[0]:
        raise StartOutsideMap(f"the start ({start.x:g}, {start.y:g}) is outside the map: choose one inside it")
    check_free_space(costmap_from_grid(grid, CHAIR_A, zones=zones))
    if world is None:
        grid, scanned = with_closed_borders(grid), None
    world = _world_at_start(start, grid, world, map_from_world)
    chair = with_all_sensors(randomised_settings(seed)) if sensors else randomised_settings(seed)
    chair = (simulation or SimulationSettings()).over(chair)
    simulator = Simulator(with_walkers(world, people, seed), CHAIR_A, chair, seed)
    places = {place.name: place for place in goals}
    chair_settings = settings or ChairSettings()
    setup = DriveSetup(
        grid=grid,
        places=places,
        body=CHAIR_A,
        calibration=DEFAULT,
        map_from_world=map_from_world,
        zones=zones,
        scanned=scanned,
        chair=chair_settings if trace is None else replace(chair_settings, perceive=True),
    )
    return drive_to_places(setup, simulator, [place.name for place in goals], progress=progress, box=box, trace=trace)


def world_with_people(world: World, start: Pose2, people: int, seed: int) -> World:
    """Return a world with the chair's start moved to `start`, with walking people instead of its own.

    Raises:
        StartOccupied: the chair does not fit there.
        WorldError: there is no space for so many people.
    """
    return with_walkers(_world_at_start(start, world.grid, world, Pose2()), people, seed)


def _world_at_start(start: Pose2, grid: OccupancyGrid, world: World | None, map_from_world: Pose2) -> World:
    """Return the given world without people, or one raised from the grid, with the chair at `start` in map."""
    refusal = StartOccupied(
        f"the chair does not fit at its start ({start.x:g}, {start.y:g}, {start.theta:g}) on the map: "
        "choose another one"
    )
    if world is None:
        try:
            world = world_from_grid(grid, start)
        except WorldError as error:  # the start lies in a wall
            raise refusal from error
    else:
        world = replace(world.without_people(), start=map_from_world.inverse() @ start)
    if in_contact(solid_from_blocks(world.blocks, world.pits), CHAIR_A, world.start):
        raise refusal
    return world


def with_closed_borders(grid: OccupancyGrid) -> OccupancyGrid:
    """Return the map with walls where free space borders unknown space, as every beam ends somewhere in a building.

    Small unknown specks stay open.
    """
    unknown = (grid.cells < 0).astype(np.uint8)
    _, patches, facts, _ = cv2.connectedComponentsWithStats(unknown, connectivity=4)
    large = facts[:, cv2.CC_STAT_AREA] * grid.resolution**2 >= _SPECK
    large[0] = False  # label 0: known cells
    border = cv2.dilate(((grid.cells >= 0) & (grid.cells < OCCUPIED_FROM)).astype(np.uint8), np.ones((3, 3), np.uint8))
    cells = np.where(large[patches] & (border > 0), np.int8(100), grid.cells)
    return replace(grid, cells=cells)


def with_walkers(world: World, count: int, seed: int, radius: float = 0.25) -> World:
    """Return the world with `count` people in its free space who walk straight on until something blocks them.

    Raises:
        WorldError: there is no space for so many people.
    """
    rng = np.random.default_rng(seed)
    roomy = (distance_field(world.grid).metres > radius + 2 * world.grid.resolution) & (world.grid.cells >= 0)
    edge = math.ceil(radius / world.grid.resolution) + 1  # the border of a grid is solid to people
    within = np.zeros_like(roomy)
    within[edge:-edge, edge:-edge] = True
    free = points_from_cells(world.grid, np.argwhere(roomy & within))
    free = free[np.hypot(*(free - (world.start.x, world.start.y)).T) > _CLEAR_OF_START]
    walkers: list[PersonPlan] = []
    for _ in range(count):
        if not len(free):
            raise WorldError(f"'{world.name}' has room for {len(walkers)} of {count} people: take fewer")
        at = free[rng.integers(len(free))]
        walkers.append(PersonPlan(PersonBehaviour.BOUNCE, at[None], speed=float(rng.uniform(0.4, 0.9)), radius=radius))
        free = free[np.hypot(*(free - at).T) > 2 * radius]
    return replace(world, people=(*world.people, *walkers))
