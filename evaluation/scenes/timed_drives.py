"""Drives between random places of a building, on a map of the chair's own making, beside the least time for each.

The chair drives alone. Its time to the report of its arrival is divided by the time of the best drive between the same
two poses in the true world (`evaluation/best_time`). The time begins with the request, or where the chair is asked when
`armed`, with the start of a drive that stood at a pause while its board armed: planning counts, the board's two seconds
at rest do not.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from evaluation.best_time.comfort import comfort_of
from evaluation.best_time.kept import kept_best_drive
from evaluation.best_time.motion import BestDrive
from evaluation.scenes.way_manners import WayManners, manners_of
from waychair.calibration.chair_body import CHAIR_A, ChairBody
from waychair.calibration.fits.dac import DEFAULT
from waychair.errors import NoPath, PlanningError, WorldError
from waychair.geometry import transform_points
from waychair.maps.folders.map_files import load_map
from waychair.maps.grid.cells import points_from_cells
from waychair.maps.grid.distance_field import distance_field, near_distances
from waychair.planning.body.footprint import fits
from waychair.simulation.plan.world import World, load_world, world_from_grid
from waychair.simulation.scene.contact import solid_from_blocks
from waychair.trials.demo.demo import randomised_settings
from waychair.trials.drive import DriveRecord, DriveSetup, drive_to_place, simulated_chair
from waychair.trials.navigate import with_closed_borders
from waychair.trials.ride import RecordingSimulator, TrueMotion
from waychair.types import FloatArray, OccupancyGrid, Place, Pose2

NEAREST_M, FARTHEST_M = 3.0, 25.0
"""[m] Straight distance between start and goal; the second bounds the time of a measurement."""

_SEEN_M = 0.6
"""[m] Distance of the axle, at start and goal, from anything solid or unknown in the chair's map."""

_FITS_M = 0.05
"""[m] Clearance of the footprint at start and goal, in the world and on the map."""

_TRIES = 300


@dataclass(frozen=True, slots=True)
class MappedWorld:
    """A true world and the chair's map of it, with the pose of the world in the map's frame."""

    name: str
    world: World
    grid: OccupancyGrid
    map_from_world: Pose2


@dataclass(frozen=True, slots=True)
class TimedDrive:
    """One drive and the best between the same poses.

    `best_s` and `best_turned` [rad] are NaN if there is none; `no_best` says why. `way_m` is driven, `best_way_m` is the
    best drive's.
    """

    ground: str
    name: str
    reached: bool
    contacts: int
    reason: str
    driven_s: float
    way_m: float
    best_s: float
    best_way_m: float
    best_turned: float
    no_best: str
    manners: WayManners

    @property
    def ratio(self) -> float:
        """The time driven over the best."""
        return self.driven_s / self.best_s


def ground_of_world(name: str, folder: Path) -> MappedWorld:
    """Return a shipped world without people, with the map that was made from its start."""
    world = load_world(name).without_people()
    return MappedWorld(name, world, load_map(folder), world.start.inverse())


def ground_of_map(name: str, folder: Path) -> MappedWorld:
    """Return a real map, and the world raised from it."""
    grid = with_closed_borders(load_map(folder))
    free = points_from_cells(grid, np.argwhere(distance_field(grid).metres > _SEEN_M)[:1])[0]
    return MappedWorld(name, world_from_grid(grid, Pose2(*free.tolist())), grid, Pose2())


def ground_of_plan(name: str) -> MappedWorld:
    """Return a shipped world without people, with its plan as the map."""
    world = load_world(name).without_people()
    return MappedWorld(name, world, world.grid, Pose2())


def random_poses(ground: MappedWorld, seed: int) -> tuple[Pose2, Pose2]:
    """Return a random start and goal in the world, at least 3 m apart, with a way for the exact outline between them.

    Raises:
        WorldError: no such pair was found.
    """
    rng = np.random.default_rng(seed)
    places = _roomy(ground)
    fields = (distance_field(ground.world.grid), Pose2()), (distance_field(ground.grid), ground.map_from_world)
    for _ in range(_TRIES):
        start, goal = (
            Pose2(x, y, rng.uniform(-math.pi, math.pi)) for x, y in places[rng.integers(len(places), size=2)].tolist()
        )
        if not NEAREST_M <= math.dist((start.x, start.y), (goal.x, goal.y)) <= FARTHEST_M:
            continue
        if not all(fits(CHAIR_A, _FITS_M, field, to @ pose) for field, to in fields for pose in (start, goal)):
            continue
        if not isinstance(best_of(ground, start, goal), NoPath):
            return start, goal
    raise WorldError(f"'{ground.name}' has no two places {NEAREST_M:g} m apart with a way: take another world")


def _roomy(ground: MappedWorld) -> FloatArray:
    """Return the points (N, 2) [m] in the world at cells of the map that are free and far from anything."""
    grid = ground.grid
    unknown = near_distances(grid.cells < 0, grid.resolution, 2 * _SEEN_M)
    clear = np.minimum(distance_field(grid).metres, unknown)
    points = points_from_cells(grid, np.argwhere((clear > _SEEN_M) & (grid.cells >= 0)))
    return transform_points(ground.map_from_world.inverse(), points)


def best_of(ground: MappedWorld, start: Pose2, goal: Pose2, body: ChairBody = CHAIR_A) -> BestDrive | PlanningError:
    """Return the best drive between two poses in the world, or the error that says why there is none."""
    solid = solid_from_blocks(ground.world.blocks, ground.world.pits)
    return kept_best_drive(solid, body, start, goal, comfort_of())


def drives(
    ground: MappedWorld, start: Pose2, goals: Sequence[Place], seed: int, armed: bool = False
) -> list[TimedDrive]:
    """Drive chair A from a start to places in turn, all in the world's frame; return each drive beside its best.

    The best drive to a place begins where the chair stood. With `armed`, the time begins once the board is armed.

    Raises:
        BoardBuildError: the firmware cannot be built: no C compiler.
    """
    world = replace(ground.world, start=start)
    simulator = RecordingSimulator(world, CHAIR_A, randomised_settings(seed), seed)
    places = {goal.name: replace(goal, pose=ground.map_from_world @ goal.pose) for goal in goals}
    setup = DriveSetup(ground.grid, places, CHAIR_A, DEFAULT, ground.map_from_world)
    found = []
    with simulated_chair(setup, simulator) as chair:
        for goal in goals:
            began = simulator.truth()
            leg = drive_to_place(setup, simulator, chair, goal.name, armed=armed)
            motion = simulator.motion().since(round(leg.times_s[0] * 1e9))
            found.append(_timed(ground, goal, leg, began, motion))
    return found


def _timed(ground: MappedWorld, goal: Place, leg: DriveRecord, began: Pose2, motion: TrueMotion) -> TimedDrive:
    best = best_of(ground, began, goal.pose)
    seconds, way, turned, problem = math.nan, math.nan, math.nan, ""
    if isinstance(best, BestDrive):
        seconds, way, turned = best.seconds, best.way_m, best.turned
    else:
        problem = str(best)
    return TimedDrive(
        ground=ground.name,
        name=goal.name,
        reached=leg.reached,
        contacts=leg.contacts,
        reason=leg.reason,
        driven_s=leg.duration_s,
        way_m=leg.distance_m,
        best_s=seconds,
        best_way_m=way,
        best_turned=turned,
        no_best=problem,
        manners=manners_of(motion, began, goal.pose),
    )
