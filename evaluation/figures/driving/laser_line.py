"""The laser's line of the camera on servos: error against the truth by distance, and points on wrong surfaces."""

from __future__ import annotations

import math
import os
from pathlib import Path

import cv2
import numpy as np

from waychair.calibration.servo_camera_mount import SERVO_CAMERA
from waychair.geometry import in_space
from waychair.maps.grid.cells import cells_from_points, occupied
from waychair.maps.grid.distance_field import distances
from waychair.planning.seen.laser_sight import LaserSight, SightMemory, look
from waychair.simulation.plan.world import World, load_world
from waychair.simulation.sensors.renderer import Renderer
from waychair.simulation.sensors.servo_camera import ServoCamera
from waychair.types import Float32Array, FloatArray, Json, PanTiltAngles, PanTiltCommand, Picture, Pose2, Twist

WORLDS = ("small_clinic", "apartment", "corridor_t", "second_floor", "basement", "black_sofa", "glass_door", "table")
"""Light and dark buildings, posters, furniture, black leather and glass."""

LOOKS = 20
"""In each world, at random places."""

BINS = ((0.25, 1.0), (1.0, 2.0), (2.0, 3.0), (3.0, 4.0))
"""m; distances from the camera."""

TO_2_M, TO_4_M, WRONG = 0.03, 0.10, 0.01
"""m and share: bars of the issue, the first two for 95 % of the points."""

OFF = 0.15
"""m; a point that is farther off than this, and than four of its own sigmas, lies on a wrong surface."""

PERIOD_NS, STEP_NS = 100_000_000, 5_000_000

SPEED = 0.4
"""m/s; of the chair that looks while it drives."""

PICTURES = 6
"""Pictures that are written for a look by eye, in each world."""


def laser_line(out: Path) -> Json:
    """Error of the line's points by distance, at rest and in motion; `LASER_LINE_LOOKS` takes a sample.

    The truth is the depth of the same picture, rendered without the laser.
    """
    looks = int(os.environ.get("LASER_LINE_LOOKS", str(LOOKS)))
    folder = out.with_suffix("")
    folder.mkdir(parents=True, exist_ok=True)
    found: dict[str, list[FloatArray]] = {"still": [], "moving": []}
    for k, name in enumerate(WORLDS):
        world = load_world(name).without_people()
        rng = np.random.default_rng([k, 35])
        camera = ServoCamera(np.random.default_rng([k, 7]), world)
        truth = Renderer(world, SERVO_CAMERA.camera_matrix, 640, 480)
        for number in range(looks):
            place, pan = _free_place(world, rng), float(rng.uniform(0.0, math.tau))
            for motion, speed in (("still", 0.0), ("moving", SPEED)):
                shown = folder / f"{name}_{number}_{motion}.jpg" if number < PICTURES else None
                found[motion].append(_errors(camera, truth, place, pan, speed, shown))
    figures = {motion: _figures(np.concatenate(each)) for motion, each in found.items()}
    return {"passed": all(_meets(each) for each in figures.values()), "looks": looks * len(WORLDS), **_flat(figures)}


def _free_place(world: World, rng: np.random.Generator) -> Pose2:
    """Return a random pose of the chair with half a metre of room round the camera."""
    field = distances(occupied(world.grid), world.grid.resolution)
    while True:
        low = world.grid.map_from_grid
        size = np.array(world.grid.cells.shape[::-1]) * world.grid.resolution
        x, y = low.x + rng.uniform(0.6, size[0] - 0.6), low.y + rng.uniform(0.6, size[1] - 0.6)
        row, column = cells_from_points(world.grid, np.array([[x, y]]))[0]
        if field[row, column] >= 0.8:
            return Pose2(x, y, float(rng.uniform(-math.pi, math.pi)))


def _errors(
    camera: ServoCamera, truth: Renderer, place: Pose2, pan: float, speed: float, shown: Path | None
) -> FloatArray:
    """Return (N, 3): true distance, error and sigma [m] of the points of one look, from the second picture pair on."""
    camera.order(PanTiltCommand(0, pan, 0.0, laser=True))
    for _ in range(600):
        camera.step(STEP_NS)
    memory, rows = SightMemory(), [np.zeros((0, 3))]
    for number in range(4):
        moved = Pose2(speed * number * PERIOD_NS * 1e-9, 0.0, 0.0)
        pose = in_space(place @ moved)
        angles, picture = camera.sense(number * PERIOD_NS, pose, Twist(speed, 0.0))
        assert isinstance(angles, PanTiltAngles)
        assert isinstance(picture, Picture)
        sight, memory = look(picture, angles, moved, None, memory)
        if sight is None or not len(sight.points) or number < 1:
            continue
        depth = truth.render(pose @ SERVO_CAMERA.base_from_camera(*camera.servos.angles)).depth
        rows.append(_compared(sight, depth))
        if shown is not None:
            _write(shown, picture, sight)
            shown = None
    return np.concatenate(rows)


def _compared(sight: LaserSight, depth: Float32Array) -> FloatArray:
    """Return (N, 3) of one look: true distance, error, sigma [m]; at an edge the truth is the nearer pixel's in value."""
    column, row = np.rint(sight.columns).astype(int), np.rint(sight.rows).astype(int)
    told = np.linalg.norm(sight.points - [SERVO_CAMERA.forward, SERVO_CAMERA.left, SERVO_CAMERA.height], axis=1)
    middle = SERVO_CAMERA.camera_matrix[:2, 2]
    stretch = np.sqrt(1.0 + ((np.stack([sight.columns, sight.rows], axis=1) - middle) ** 2).sum(axis=1) / 600.0**2)
    near = [depth[row + r, np.clip(column + c, 0, 639)] * stretch for r in (-1, 0, 1) for c in (-1, 0, 1)]
    errors = np.stack(near).astype(np.float64) - told
    best = np.abs(errors).argmin(axis=0)
    at = np.arange(len(told))
    exact = errors[4]
    edge = np.abs(exact) > OFF
    error = np.where(edge, errors[best, at], exact)
    return np.column_stack([told + error, error, sight.errors])


def _figures(rows: FloatArray) -> dict[str, float]:
    away, error, sigma = np.abs(rows).T
    wrong = (error > OFF) & (error > 4.0 * sigma)
    told = {"points": float(len(rows)), "wrong": float(wrong.mean())}
    for low, high in BINS:
        here = (away > low) & (away <= high) & ~wrong
        if here.any():
            name = f"{low:g}_{high:g}_m"
            told |= {
                f"median_{name}": float(np.median(error[here])),
                f"p95_{name}": float(np.percentile(error[here], 95)),
            }
            told[f"within_3_sigma_{name}"] = float((error[here] <= 3.0 * sigma[here]).mean())
    return told


def _meets(figures: dict[str, float]) -> bool:
    bars = (TO_2_M, TO_2_M, TO_4_M, TO_4_M)
    p95 = [figures.get(f"p95_{low:g}_{high:g}_m", math.inf) for low, high in BINS]
    return all(error <= bar for error, bar in zip(p95, bars, strict=True)) and figures["wrong"] <= WRONG


def _flat(figures: dict[str, dict[str, float]]) -> dict[str, float]:
    return {f"{motion}_{key}": round(value, 4) for motion, each in figures.items() for key, value in each.items()}


def _write(path: Path, picture: Picture, sight: LaserSight) -> None:
    """Write the picture, and below it the same with the points found in green."""
    shown = picture.image.copy()
    for column, row in zip(np.rint(sight.columns).astype(int), np.rint(sight.rows).astype(int), strict=True):
        shown[row - 1 : row + 2, column] = 0, 255, 0
    cv2.imwrite(str(path), np.vstack([picture.image, shown])[..., ::-1])
