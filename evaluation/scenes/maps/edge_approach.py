"""A rider drives near drop-offs while the chair maps: is each drop-off in the grid before the wheels reached near it?

The worlds are those of `hazards`, where the chair drives by itself: a pit ahead, a stairwell beside a chair that turns
round its corner, a stairwell behind a chair that backs out of a booth.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import chain, pairwise

import numpy as np

from evaluation.runs.simulated_frames import FrameGathering
from evaluation.scenes.hazards import DROP_OFFS, Protection
from evaluation.scenes.maps.depth_drive import simulator_with_pictures
from waychair.calibration.chair_body import CHAIR_A
from waychair.geometry import transform_points
from waychair.maps.depth.depth_scan import DepthSettings
from waychair.maps.grid.cells import occupied
from waychair.maps.grid.distance_field import are_within, distances
from waychair.simulation.follower import Follower, follow
from waychair.simulation.plant.plant import PlantSettings, joystick_from_volts, volts_from_twist
from waychair.simulation.scene.scene import Pit
from waychair.simulation.simulator import Simulator
from waychair.slam.mapping.depth_mapping import DepthMappingSettings
from waychair.slam.mapping.live_mapping import LiveMapping, LiveMappingSettings
from waychair.types import FloatArray, JoystickInput, OccupancyGrid, Pose2, RgbdFrame, SensorMessage, Twist

NEAR = 0.35
"""A drop-off within this distance [m] of the footprint must be in the grid: stopping from 0.6 m/s takes 0.3 m."""

_RIDER_DISTANCE = 0.2  # [m] between the footprint and the drop-off that the rider keeps
_REVERSE_SPEED = 0.25  # [m/s]
_SIZE, _CAMERA_HZ = (320, 240), 5.0
_MARKED_WITHIN = 0.15  # [m]: an occupied cell this near marks a drop-off; the chair keeps more distance anyway
_TICK_NS = 50_000_000


@dataclass(frozen=True, slots=True)
class EdgeApproach:
    """The result of a drive near drop-offs.

    `points`, 5 cm apart on the rims, came within `NEAR` of the footprint; `known` of them were in the grid by then.
    `nearest_m` [m]: least distance from the footprint to a rim.
    """

    where: str
    seed: int
    points: int
    known: int
    nearest_m: float


def approach_edge(where: str, seed: int, camera: bool = True) -> EdgeApproach:
    """Drive up to, along or back to a drop-off; `where`: ahead, beside or behind. `camera`: map its pictures, too.

    Raises:
        WorldError: the rider ran into something.
        MissingExtra: this machine cannot render pictures.
    """
    hazard = DROP_OFFS[where](Protection.CAMERA, seed)
    world = hazard.world
    simulator = simulator_with_pictures(world, CHAIR_A, _CAMERA_HZ, _SIZE, seed)
    depth = DepthMappingSettings(use="on", view=DepthSettings(step=2))  # half the size of a real picture
    live = LiveMapping(replace(LiveMappingSettings(), depth=depth), CHAIR_A.base_from_laser, CHAIR_A)
    edges = np.concatenate([_rim(pit) for pit in world.pits])
    frames, map_from_world = FrameGathering(), simulator.truth().inverse()
    reached, known, nearest = np.zeros(len(edges), np.bool_), 0, math.inf
    for message in _drive(where, simulator, hazard.goals[0].pose):
        if camera and isinstance(message, RgbdFrame):
            live.see(message)
        elif (frame := frames.add(message)) is not None:
            live.process(frame)
        gaps = _distances(simulator.truth(), edges)
        nearest = min(nearest, float(gaps.min()))
        new = (gaps < NEAR) & ~reached
        if new.any():
            reached |= new
            known += _count_marked(live.grid(), transform_points(map_from_world, edges[new]))
    return EdgeApproach(where, seed, int(reached.sum()), known, nearest)


def _drive(where: str, simulator: Simulator, goal: Pose2) -> Iterator[SensorMessage]:
    """Yield the messages of the rider's drive: forward along a route, then in reverse if the drop-off is behind."""
    start, pit = simulator.truth(), simulator.world.pits[0]
    x, y = pit.middle.x, pit.middle.y
    if where == "ahead":
        return _along(simulator, [(x - pit.length / 2 - CHAIR_A.front - _RIDER_DISTANCE, start.y)])
    if where == "beside":
        lane = y + pit.width / 2 + CHAIR_A.width / 2 + _RIDER_DISTANCE
        return _along(simulator, [(start.x, lane), (x + 0.5, lane)])
    lane = y + pit.width / 2 + 1.0
    rest = y + pit.width / 2 + CHAIR_A.rear + _RIDER_DISTANCE
    return chain(_along(simulator, [(goal.x, lane), (goal.x, goal.y)]), _back(simulator, rest))


def _along(simulator: Simulator, route: list[tuple[float, float]]) -> Iterator[SensorMessage]:
    return follow(simulator, Follower(np.array(route), CHAIR_A.track, PlantSettings()))


def _back(simulator: Simulator, until_y: float) -> Iterator[SensorMessage]:
    """Drive straight back until the axle is at `until_y` [m, world]."""
    plant = PlantSettings()
    stick = joystick_from_volts(plant, *volts_from_twist(plant, CHAIR_A.track, Twist(-_REVERSE_SPEED, 0.0)))
    while simulator.truth().y > until_y:
        simulator.rider = JoystickInput(simulator.now_ns, *stick)
        yield from simulator.advance(_TICK_NS)
    simulator.rider = JoystickInput(simulator.now_ns)


def _rim(pit: Pit, step: float = 0.05) -> FloatArray:
    """Return points (N, 2) [m, world] along the rim of a pit, one centimetre inside."""
    a, b = pit.length / 2 - 0.01, pit.width / 2 - 0.01
    corners = np.array([(a, b), (-a, b), (-a, -b), (a, -b), (a, b)])
    sides = [
        p + (q - p) * np.linspace(0.0, 1.0, math.ceil(math.dist(p, q) / step), endpoint=False)[:, None]
        for p, q in pairwise(corners)
    ]
    return transform_points(pit.middle, np.concatenate(sides))


def _distances(pose: Pose2, points: FloatArray) -> FloatArray:
    """Return (N,) distances [m] from the footprint to points (N, 2) [m, world]."""
    local = transform_points(pose.inverse(), points)
    ahead = np.maximum(local[:, 0] - CHAIR_A.front, -CHAIR_A.rear - local[:, 0])
    beside = np.abs(local[:, 1]) - CHAIR_A.width / 2
    gaps: FloatArray = np.hypot(np.maximum(ahead, 0.0), np.maximum(beside, 0.0))
    return gaps


def _count_marked(grid: OccupancyGrid, points: FloatArray) -> int:
    """Return the number of points (N, 2) [m, map] with an occupied cell within `_MARKED_WITHIN`."""
    from_things = distances(occupied(grid), grid.resolution)
    return int(are_within(from_things, grid, points, _MARKED_WITHIN).sum())
