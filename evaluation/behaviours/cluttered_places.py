"""Random cluttered rooms, a chair that came straight to its place, and the true freedom of each orientation there."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from waychair.calibration.chair_body import ChairBody
from waychair.control.behaviours.default import SECTORS, default_network
from waychair.control.behaviours.doorway import OdometryPose
from waychair.control.behaviours.runtime import Runtime
from waychair.control.behaviours.view.swept_sectors import AHEAD
from waychair.simulation.scene.boxes import bins_from_boxes
from waychair.simulation.scene.contact import SolidBoxes, clearance, in_contact
from waychair.simulation.scene.scene import Reflection, Slice
from waychair.simulation.scene.seeds import random_stream
from waychair.simulation.sensors.lidar import Lidar, LidarSettings
from waychair.simulation.sensors.rays import Scenery, scenery_from_slice
from waychair.simulation.sensors.sonar import Sonars, SonarSettings
from waychair.types import BoolArray, FloatArray, Pose2

ROOM = 7.0
"""m; side of a room."""

TICK_NS = 50_000_000
APPROACH_STEP = 0.02
"""m a tick; 0.4 m/s."""

_TURN_STEP, _DRIVE_STEP = math.radians(0.25), 0.005
"""Steps at which the true sweep is checked: no point of the outline moves by more than 5 mm."""


@dataclass(frozen=True, slots=True)
class ChairInRoom:
    """A chair in a room: the room's solid boxes and its outline for rays, and the poses of the approach."""

    solid: SolidBoxes
    scenery: Scenery
    poses: tuple[Pose2, ...]


def random_place(seed: int, body: ChairBody) -> ChairInRoom:
    """Return a room of 8 to 16 boxes and poles, and a straight approach of 2.5 to 3.5 m through it."""
    rng = np.random.default_rng(seed)
    while True:
        boxes = _boxes(rng)
        solid = SolidBoxes(boxes, bins_from_boxes(boxes))
        for _ in range(60):
            x, y = rng.uniform(1.0, ROOM - 1.0, 2).tolist()
            end = Pose2(x, y, float(rng.uniform(-math.pi, math.pi)))
            steps = int(rng.integers(125, 176))
            poses = tuple(end @ Pose2(-APPROACH_STEP * k) for k in range(steps, -1, -1))
            if clearance(solid, body, end) > 0.03 and not any(in_contact(solid, body, each) for each in poses):
                return ChairInRoom(solid, _scenery(boxes), poses)


def _boxes(rng: np.random.Generator) -> FloatArray:
    half, thick = ROOM / 2, 0.1
    rows = [
        (half, -thick, 1.0, 0.0, half + 2 * thick, thick),
        (half, ROOM + thick, 1.0, 0.0, half + 2 * thick, thick),
        (-thick, half, 1.0, 0.0, thick, half + 2 * thick),
        (ROOM + thick, half, 1.0, 0.0, thick, half + 2 * thick),
    ]
    for _ in range(int(rng.integers(8, 17))):
        angle = rng.uniform(0, math.pi)
        sides = rng.uniform(0.015, 0.03, 2) if rng.random() < 0.35 else rng.uniform(0.1, 0.5, 2)
        rows.append((*rng.uniform(0, ROOM, 2), math.cos(angle), math.sin(angle), *sides))
    return np.array(rows, np.float64)


def _scenery(boxes: FloatArray) -> Scenery:
    segments = []
    for x, y, c, s, length, width in boxes.tolist():
        corners = [
            (x + a * length * c - b * width * s, y + a * length * s + b * width * c)
            for a, b in ((1, 1), (-1, 1), (-1, -1), (1, -1))
        ]
        segments += [(*corners[k], *corners[(k + 1) % 4]) for k in range(4)]
    plain = np.full(len(segments), int(Reflection.DIFFUSE))
    return scenery_from_slice(Slice(np.array(segments), plain))


def truly_free(place: ChairInRoom, body: ChairBody) -> BoolArray:
    """Return (SECTORS,) whether the exact outline can turn to each orientation and drive `AHEAD` along it."""
    pose, solid = place.poses[-1], place.solid
    free = np.zeros(SECTORS, np.bool_)
    ways = (_turned(solid, body, pose, 1), _turned(solid, body, pose, -1))
    for k in range(SECTORS):
        turn = k * math.tau / SECTORS
        reached = turn <= ways[0] or math.tau - turn <= ways[1] or k == 0
        free[k] = reached and _drives(solid, body, pose @ Pose2(0.0, 0.0, turn), 1)
    free[SECTORS // 2] |= _drives(solid, body, pose, -1)
    return free


def _turned(solid: SolidBoxes, body: ChairBody, pose: Pose2, way: int) -> float:
    """Return how far the chair can turn on the spot [rad]."""
    steps = math.ceil(math.tau / _TURN_STEP)
    for k in range(1, steps + 1):
        if in_contact(solid, body, pose @ Pose2(0.0, 0.0, way * k * _TURN_STEP)):
            return (k - 1) * _TURN_STEP
    return math.tau


def _drives(solid: SolidBoxes, body: ChairBody, pose: Pose2, way: int) -> bool:
    steps = math.ceil(AHEAD / _DRIVE_STEP)
    return not any(in_contact(solid, body, pose @ Pose2(way * k * _DRIVE_STEP)) for k in range(steps + 1))


def offered(place: ChairInRoom, body: ChairBody, seed: int, sensors: Sequence[str], history: bool = True) -> BoolArray:
    """Return (SECTORS,) whether the default network offers each orientation at the end of the approach.

    `sensors` are those that are heard. Without `history` the chair wakes up at the end and stands for a second.
    """
    runtime = Runtime(default_network(body=body))
    lidar = Lidar(LidarSettings(), body, random_stream(seed, 1))
    sonars = Sonars(SonarSettings(rate_hz=20.0), body, random_stream(seed, 3))
    poses = place.poses if history else (place.poses[-1],) * 20
    times = np.arange(len(poses), dtype=np.int64) * TICK_NS
    rows = np.array([each.array() for each in poses])
    command: Any = None
    speed = APPROACH_STEP / (TICK_NS * 1e-9) if history else 0.0
    for k, pose in enumerate(poses):
        now_ns = int(times[k])
        heard: dict[str, Any] = {"odometry": OdometryPose(pose.x, pose.y, pose.theta, v=speed)}
        if "lidar" in sensors and k % 2 == 0 and k >= 2:
            heard["lidar"] = lidar.scan(place.scenery, times, rows, now_ns - 2 * TICK_NS)
        if "sonars" in sensors:
            heard["sonars"] = sonars.read(place.scenery, pose, (), now_ns)
        command = runtime.innervate(now_ns, heard).ports["Free-space finding"].eo.command
    free = np.zeros(SECTORS, np.bool_)
    for angle in command.orientations:
        free[round(angle / math.tau * SECTORS) % SECTORS] = True
    return free
