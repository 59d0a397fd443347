"""Pictures of a simulated flat whose colour and depth are of two cameras: beside each other, turned, of other focal lengths."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from waychair.simulation.plan.world import World
from waychair.simulation.sensors.renderer import Renderer, camera_matrix
from waychair.types import Float32Array, FloatArray, Pose2, Pose3, RgbdFrame

WIDTH, HEIGHT, VIEW = 320, 240, math.radians(62.0)
EYE, RATE = 1.25, 15.0  # m above the floor; Hz
_TURN, _WAY, _PERIOD = (0.25, 0.6, 0.15), 0.15, 6.0  # rad, m and s of the swaying
_GREY_NOISE, _DEPTH_NOISE = 2.0, 0.002  # levels; share of the squared depth [1/m]


@dataclass(frozen=True, slots=True)
class Sensors:
    """`colour_from_depth`, and the factors of both focal lengths over the one that is told."""

    colour_from_depth: Pose3
    colour_focal: float = 1.0
    depth_focal: float = 1.0


TOLD_RIGHT = Sensors(Pose3(np.eye(3), np.zeros(3)))


def drawn_sensors(seed: int, offset: float = 0.025, angle: float = math.radians(2.0), focal: float = 0.05) -> Sensors:
    """Return sensors that lie `offset` [m] and `angle` [rad] apart in a drawn direction, with colour `focal` off."""
    rng = np.random.default_rng(seed)
    towards, about = (each / np.linalg.norm(each) for each in rng.normal(size=(2, 3)))
    return Sensors(Pose3(turned(angle * about), offset * towards), 1.0 + focal * float(rng.choice([-1.0, 1.0])))


def turned(vector: Sequence[float] | FloatArray) -> FloatArray:
    """Return the rotation (3, 3) of a rotation vector [rad]."""
    return np.asarray(cv2.Rodrigues(np.asarray(vector, np.float64))[0], np.float64)


def swaying(at: Pose2, count: int) -> list[Pose3]:
    """Return poses (map_from_camera) of a camera that is held at a place and looks round from its heading."""
    ahead = np.array([math.cos(at.theta), math.sin(at.theta), 0.0])
    level = np.column_stack([[ahead[1], -ahead[0], 0.0], [0.0, 0.0, -1.0], ahead])
    poses = []
    for k in range(count):
        a = math.tau * k / RATE / _PERIOD
        turn = turned([_TURN[0] * math.sin(2 * a), _TURN[1] * math.sin(a), _TURN[2] * math.sin(3 * a)])
        shift = _WAY * np.array([math.sin(a), 0.5 * math.sin(2 * a), 0.5 * (1.0 - math.cos(a))])
        poses.append(Pose3(level @ turn, np.array([at.x, at.y, EYE]) + level @ shift))
    return poses


def pictures(world: World, poses: Sequence[Pose3], sensors: Sensors, seed: int = 0) -> list[RgbdFrame]:
    """Return what the sensors see from poses of the depth sensor, with noise, as if they were one registered camera.

    Raises:
        MissingExtra: this machine cannot render.
    """
    told, rng = camera_matrix(WIDTH, HEIGHT, VIEW), np.random.default_rng(seed)
    depths: list[Float32Array] = []
    renderer = Renderer(world, _of_focal(told, sensors.depth_focal), WIDTH, HEIGHT)
    for pose in poses:
        seen = renderer.render(pose).depth
        noise = rng.normal(0.0, _DEPTH_NOISE, seen.shape).astype(np.float32)
        depths.append(np.where(seen < 8.0, seen + noise * seen**2, np.nan).astype(np.float32))
    renderer.release()
    frames = []
    renderer = Renderer(world, _of_focal(told, sensors.colour_focal), WIDTH, HEIGHT)
    for k, (pose, depth) in enumerate(zip(poses, depths, strict=True)):
        colour = renderer.render(pose @ sensors.colour_from_depth.inverse()).colour[..., :3]
        image = np.clip(colour + rng.normal(0.0, _GREY_NOISE, colour.shape), 0, 255).astype(np.uint8)
        frames.append(RgbdFrame(round(k / RATE * 1e9), image, depth, told))
    renderer.release()
    return frames


def _of_focal(matrix: FloatArray, factor: float) -> FloatArray:
    longer = matrix.copy()
    longer[0, 0], longer[1, 1] = matrix[0, 0] * factor, matrix[1, 1] * factor
    return longer
