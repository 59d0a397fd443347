"""A simulated drive for the mapper: frames with scans, and the camera's pictures between them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np

from evaluation.runs.simulated_frames import FrameGathering
from waychair.calibration.chair_body import CHAIR_A, ChairBody
from waychair.errors import MissingExtra
from waychair.simulation.follower import Follower, follow
from waychair.simulation.plan.plan_blocks import cells_in_rectangle, fill_rectangle
from waychair.simulation.plan.world import World
from waychair.simulation.plant.plant import PlantSettings
from waychair.simulation.scene.scene import Block, Pit
from waychair.simulation.simulator import Simulator, SimulatorSettings, with_all_sensors
from waychair.types import FloatArray, Pose2, RgbdFrame, SensorFrame, Trajectory


def drive_with_pictures(
    world: World,
    route: FloatArray,
    take: Callable[[SensorFrame | RgbdFrame], None],
    *,
    camera_hz: float = 3.0,
    size: tuple[int, int] = (640, 480),
    seed: int = 0,
    body: ChairBody = CHAIR_A,
    until_ns: int | None = None,
) -> Trajectory:
    """Drive along `route` (N, 2) [m, map], at most until `until_ns`, and return the true pose in map at each scan.

    `take` receives each frame and each picture in time order. `size` is (columns, rows) of a picture.

    Raises:
        WorldError: the chair touched something.
        MissingExtra: this machine cannot render pictures.
    """
    simulator, frames = simulator_with_pictures(world, body, camera_hz, size, seed), FrameGathering()
    stamps, poses = [], []
    for message in follow(simulator, Follower(route, body.track, PlantSettings())):
        if isinstance(message, RgbdFrame):
            take(message)
        elif (frame := frames.add(message)) is not None:
            take(frame)
            stamps.append(frame.stamp_ns)
            poses.append(simulator.truth().array())
        if until_ns is not None and message.stamp_ns >= until_ns:
            break
    return Trajectory(np.array(stamps, np.int64), np.array(poses))


def simulator_with_pictures(
    world: World, body: ChairBody, camera_hz: float, size: tuple[int, int], seed: int
) -> Simulator:
    """Return a simulator of a chair with lidar, wheels, IMU and a camera; `size` is (columns, rows) of a picture.

    Raises:
        MissingExtra: this machine cannot render pictures.
    """
    settings = with_all_sensors(SimulatorSettings())
    camera = replace(settings.camera, rate_hz=camera_hz, width=size[0], height=size[1])
    simulator = Simulator(
        world, body, replace(settings, camera=camera, sonar=replace(settings.sonar, rate_hz=0.0)), seed
    )
    if simulator.camera_problem is not None:
        raise MissingExtra(f"pictures cannot be rendered: {simulator.camera_problem}")
    return simulator


def with_hazards(world: World, seed: int, spacing: float = 4.0) -> World:
    """Return the world with low boxes, shelves and pits, in turn, beside its mapping route; lidars do not see them.

    One stands about every `spacing` [m] where there is free space, clear of the chair's path and of its turns.
    """
    rng, route = np.random.default_rng(seed), np.concatenate([[[world.start.x, world.start.y]], world.route()])
    blocks, pits, cells = list(world.blocks), list(world.pits), world.grid.cells.copy()
    grid = replace(world.grid, cells=cells)
    placed: list[FloatArray] = []
    for start, end in pairwise(route):
        length = math.dist(start, end)
        heading = math.atan2(*(end - start)[::-1])
        for along in np.arange(2.0, length - 2.0, spacing).tolist():
            side = float(rng.choice([-1.0, 1.0])) * float(rng.uniform(0.82, 0.86))
            at = Pose2(float(start[0]), float(start[1]), heading) @ Pose2(along, side)
            middle, size = np.array([at.x, at.y]), (float(rng.uniform(0.3, 0.6)), 0.24)
            covered, _ = cells_in_rectangle(grid, at, size[0] + 0.1, size[1] + 0.1)
            beside = (
                min(math.dist(middle, corner) for corner in route) > 1.5
                and min(_to_leg(middle, *leg) for leg in pairwise(route)) > 0.78
            )
            alone = all(math.dist(middle, other) > 1.5 for other in placed)
            if not (beside and alone and len(covered) and (cells[tuple(covered.T)] == 0).all()):
                continue
            kind = len(placed) % 3
            if kind == 2:
                pits.append(Pit(at, *size, 0.6))
            else:
                low, high = ((0.0, float(rng.uniform(0.1, 0.22))), (0.66, 0.72))[kind]
                blocks.append(Block(at, *size, low, high, "wood", int(rng.integers(1 << 30))))
            fill_rectangle(cells, grid, at, *size)
            placed.append(middle)
    return replace(world, blocks=tuple(blocks), pits=tuple(pits), grid=grid)


def _to_leg(point: FloatArray, start: FloatArray, end: FloatArray) -> float:
    """Return the distance [m] of a point (2,) from a segment."""
    along = end - start
    part = np.clip((point - start) @ along / max(float(along @ along), 1e-12), 0.0, 1.0)
    return math.dist(point, start + part * along)
