"""Tight scenes of buildings: doors, a corridor with a corner, a dead end, parked chairs, with seeded random starts.

A `TightScene` is a world, a chair in it and a goal. `run_scene` drives the complete chair there: noisy lidar, localiser,
navigator, closed loop, and the shipped firmware on the lines of an uncalibrated chair.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.calibration.fits.dac import DEFAULT
from waychair.errors import WorldError
from waychair.maps.drawn.zones import Zone
from waychair.maps.grid.distance_field import distance_field
from waychair.planning.body.footprint import fits
from waychair.runtime.chair import ChairSettings
from waychair.simulation.plan.floor_plan import FloorPlan, PlanDoor, PlanWall
from waychair.simulation.plan.world import World, world_from_plan
from waychair.simulation.plant.plant import PlantSettings
from waychair.simulation.simulator import Simulator, with_all_sensors
from waychair.trials.demo.demo import randomised_settings
from waychair.trials.drive import DriveRecord, DriveSetup, drive_to_places
from waychair.types import FloatArray, OccupancyGrid, Place, Pose2

MAP_RESOLUTION = 0.01
"""Cell size [m] of the chair's map; the world's cells are half as large."""

DOORS = (0.80, 0.815, 0.90)
APPROACHES = (0.0, 30.0, 60.0, 90.0)
"""Clear widths [m], and angles [degrees] between the chair's start heading and the door's axis."""

ROOM, WALL = 4.0, 0.15
"""Side of the rooms and thickness of the wall between them [m]."""

CORRIDOR, DEAD_END = 0.915, 1.5
"""Widths [m] of the corridor with a corner (the least by the ADA) and of the dead end."""

PARKED_BY, PARKED_AT = (0.02, 0.04), ("beside", "nose in", "tail in")
"""Distances [m] of a parked chair to the wall on its right and, "nose in" or "tail in", to one ahead or behind."""

_EDGE = 0.2  # [m] free space round a plan's outer walls


def drive_variants(body: ChairBody) -> Mapping[str, ChairBody]:
    """Return the body with its drive wheels at the rear, in the middle and at the front; the sensors stay in place."""
    axles = {"rear": 0.25, "mid": body.length / 2, "front": body.length - 0.25}
    return MappingProxyType(
        {
            drive: replace(
                body,
                drive=drive,
                axle_from_rear=axle,
                laser_x=body.laser_x + body.axle_from_rear - axle,
                camera_x=body.camera_x + body.axle_from_rear - axle,
                imu_x=body.imu_x + body.axle_from_rear - axle,
            )
            for drive, axle in axles.items()
        }
    )


@dataclass(frozen=True, slots=True)
class TightScene:
    """A world with the chair's start, the goal, the chair, and the door whose axis is scored, if any.

    `zones` are the map's. With `sensors` the chair has sonars, a depth camera and an IMU besides its lidar.
    """

    name: str
    world: World
    goal: Place
    body: ChairBody
    door: Pose2 | None = None
    chair: ChairSettings = field(default_factory=ChairSettings)
    zones: Sequence[Zone] = ()
    sensors: bool = False


@dataclass(frozen=True, slots=True)
class SceneResult:
    """The result of a run. `door_error_m`: greatest offset of the body's middle line from the door's axis."""

    scene: str
    seed: int
    reached: bool
    contacts: int
    reason: str
    seconds: float
    plans: int
    min_clearance_m: float
    door_error_m: float | None
    leg: DriveRecord


def door_scene(width: float, approach: float, body: ChairBody, seed: int) -> TightScene:
    """Return two rooms with a door; the start is 1.5 to 3 m before it, at `approach` degrees to the door's axis.

    The turn is to either side, within 5 degrees of `approach`. The lateral offset is random, where the chair fits.
    """
    rng = np.random.default_rng(seed)
    left, right = _EDGE + ROOM, _EDGE + ROOM + WALL
    low, high = _EDGE, _EDGE + ROOM
    middle = Pose2((left + right) / 2, (low + high) / 2, 0.0)
    dividing = PlanWall(start=(middle.x, low), end=(middle.x, high), thickness=WALL, doors=[PlanDoor(ROOM / 2, width)])
    world = _world("door", [(_EDGE, low), (right + ROOM, low), (right + ROOM, high), (_EDGE, high)], [dividing])

    def start() -> Pose2:
        turn = rng.choice([-1.0, 1.0]) * math.radians(approach) + math.radians(rng.uniform(-5.0, 5.0))
        return Pose2(middle.x - rng.uniform(1.5, 3.0), middle.y + rng.uniform(-1.5, 1.5), turn)

    goal = Place("beyond", Pose2(middle.x + 2.2, middle.y, 0.0))
    name = f"door {width:g} m, {approach:g} degrees, {body.chair_id} {body.drive}"
    return TightScene(name, _started(world, body, start), goal, body, middle)


def corner_scene(body: ChairBody, seed: int) -> TightScene:
    """Return a corridor of 0.915 m with a right-angled corner; the start is in one arm, the goal in the other."""
    rng = np.random.default_rng(seed)
    inner, outer = _EDGE + 3.0, _EDGE + 3.0 + CORRIDOR
    outline = [
        (_EDGE, _EDGE), (outer, _EDGE), (outer, outer), (inner, outer), (inner, _EDGE + CORRIDOR), (_EDGE, _EDGE + CORRIDOR),
    ]  # fmt: skip
    world = _world("corner", outline, [])
    middle = _EDGE + CORRIDOR / 2

    def start() -> Pose2:
        turn = math.radians(rng.uniform(-5.0, 5.0))
        return Pose2(_EDGE + rng.uniform(0.9, 1.4), middle + rng.uniform(-0.08, 0.08), turn)

    goal = Place("round the corner", Pose2((inner + outer) / 2, outer - 1.2, math.pi / 2))
    name = f"corner {CORRIDOR:g} m, {body.chair_id} {body.drive}"
    return TightScene(name, _started(world, body, start), goal, body)


def dead_end_scene(body: ChairBody, seed: int) -> TightScene:
    """Return a dead end of 1.5 m width; the start faces its end, the goal faces out."""
    rng = np.random.default_rng(seed)
    end = _EDGE + 5.0
    world = _world("dead end", [(_EDGE, _EDGE), (end, _EDGE), (end, _EDGE + DEAD_END), (_EDGE, _EDGE + DEAD_END)], [])
    middle = _EDGE + DEAD_END / 2

    def start() -> Pose2:
        turn = math.radians(rng.uniform(-10.0, 10.0))
        return Pose2(end - body.front - rng.uniform(0.15, 0.6), middle + rng.uniform(-0.2, 0.2), turn)

    goal = Place("way out", Pose2(_EDGE + 1.5, middle, math.pi))
    return TightScene(
        f"dead end {DEAD_END:g} m, {body.chair_id} {body.drive}", _started(world, body, start), goal, body
    )


def parked_scene(place: str, body: ChairBody, seed: int) -> TightScene:
    """Return a room with the chair parked beside a wall or in a corner; the goal is in the middle, at any heading."""
    rng = np.random.default_rng(seed)
    far = _EDGE + ROOM
    world = _world("parked", [(_EDGE, _EDGE), (far, _EDGE), (far, far), (_EDGE, far)], [])
    beside, end = rng.uniform(*PARKED_BY, size=2)
    x = {
        "beside": rng.uniform(_EDGE + 1.5, far - 1.5),
        "nose in": far - end - body.front,
        "tail in": _EDGE + end + body.rear,
    }
    start = Pose2(x[place], _EDGE + beside + body.width / 2, 0.0)
    middle = _EDGE + ROOM / 2
    goal = Pose2(middle + rng.uniform(-0.3, 0.3), middle + rng.uniform(0.0, 0.5), rng.uniform(-math.pi, math.pi))
    name = f"parked {place}, {body.chair_id} {body.drive}"
    return TightScene(name, replace(world, start=start), Place("middle", goal), body)


def run_scene(
    scene: TightScene, seed: int, time_limit_s: float = 150.0, plant: PlantSettings | None = None
) -> SceneResult:
    """Drive a simulated chair of this seed, or with this `plant`, to the scene's goal, on the true map.

    Raises:
        BoardBuildError: the firmware cannot be built: no C compiler.
    """
    chair = randomised_settings(seed)
    chair = chair if plant is None else replace(chair, plant=plant)
    chair = with_all_sensors(chair) if scene.sensors else chair
    simulator = Simulator(scene.world, scene.body, chair, seed)
    places = {scene.goal.name: scene.goal}
    setup = DriveSetup(
        grid=map_of(scene.world),
        places=places,
        body=scene.body,
        calibration=DEFAULT,
        chair=scene.chair,
        zones=scene.zones,
    )
    leg = drive_to_places(setup, simulator, [scene.goal.name], time_limit_s)[0]
    return SceneResult(
        scene=scene.name,
        seed=seed,
        reached=leg.reached,
        contacts=leg.contacts,
        reason=leg.reason,
        seconds=leg.duration_s,
        plans=leg.plans,
        min_clearance_m=float(leg.clearance.min()),
        door_error_m=None if scene.door is None else door_error(leg.truth, scene.body, scene.door),
        leg=leg,
    )


def map_of(world: World, resolution: float = MAP_RESOLUTION) -> OccupancyGrid:
    """Return the world's grid with coarser cells, sampled at their centres."""
    fine = world.grid
    step = round(resolution / fine.resolution)
    cells = fine.cells[step // 2 :: step, step // 2 :: step].copy()
    return OccupancyGrid(cells, step * fine.resolution, fine.map_from_grid)


def door_error(truth: FloatArray, body: ChairBody, door: Pose2) -> float | None:
    """Return the greatest offset [m] of the body's middle line from the door's axis while the body was in the door.

    The offset is taken in the wall's plane. `truth` (T, 3) and the door's pose (x along its axis) are in one frame.
    None if the body never was in the door.
    """
    away = truth[:, :2] - (door.x, door.y)
    along = away @ (math.cos(door.theta), math.sin(door.theta))
    across = away @ (-math.sin(door.theta), math.cos(door.theta))
    turn = truth[:, 2] - door.theta
    inside = (along + body.front * np.cos(turn) > -WALL / 2) & (along - body.rear * np.cos(turn) < WALL / 2)
    if not inside.any():
        return None
    return float(np.abs(across - along * np.tan(turn))[inside].max())


def _world(name: str, outline: list[tuple[float, float]], inner: list[PlanWall]) -> World:
    """Return a world of outer walls, whose inner faces form the anticlockwise outline, and of inner walls."""
    thickness = 0.1
    points = np.array(outline)
    ahead = np.roll(points, -1, axis=0) - points
    ahead /= np.hypot(*ahead.T)[:, None]
    before = np.roll(ahead, 1, axis=0)
    # at a reflex corner the walls meet; at a convex one each is extended over the other's end
    over = np.where(before[:, 0] * ahead[:, 1] > before[:, 1] * ahead[:, 0], thickness, 0.0)
    walls = []
    for k, along in enumerate(ahead):
        off = np.array([along[1], -along[0]]) * thickness / 2
        start = points[k] + off - over[k] * along
        end = points[(k + 1) % len(points)] + off + over[(k + 1) % len(points)] * along
        walls.append(PlanWall(start=(start[0], start[1]), end=(end[0], end[1]), thickness=thickness))
    size = points.max(axis=0) + _EDGE
    plan = FloorPlan(
        name=name, size=(size[0], size[1]), start=(*points.mean(axis=0), 0.0), walls=[*walls, *inner], resolution=0.005
    )
    return world_from_plan(plan, name)


def _started(world: World, body: ChairBody, draw: Callable[[], Pose2]) -> World:
    """Return the world with the first drawn start at which the chair has 5 cm of clearance."""
    field = distance_field(world.grid)
    for _ in range(1000):
        start = draw()
        if fits(body, 0.05, field, start):
            return replace(world, start=start)
    raise WorldError(f"chair {body.chair_id} has no free start in '{world.name}': use a smaller chair")
