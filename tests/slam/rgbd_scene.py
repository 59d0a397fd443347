"""A synthetic room seen by a colour and depth camera: textured walls, rendered exactly by intersecting rays."""

from __future__ import annotations

import math

import numpy as np
from scipy.ndimage import map_coordinates, zoom
from scipy.spatial.transform import Rotation

from waychair.types import Float32Array, FloatArray, Pose3, RgbdFrame

WIDTH, HEIGHT = 320, 240
MATRIX = np.array([[260.0, 0.0, 159.5], [0.0, 260.0, 119.5], [0.0, 0.0, 1.0]])
CAMERA = np.array([260.0, 260.0, 159.5, 119.5])

# a room of 4 x 3 x 4 m round the origin, optical axes: x right, y down, z forward; a box stands before the far wall
_PLANES = [(axis, side * half) for axis, half in ((0, 2.0), (1, 1.5), (2, 2.0)) for side in (-1.0, 1.0)]
_RANDOM = np.random.default_rng(5)
# coarse and fine together, as real surfaces are: a fine texture alone repeats a few squares further
_TEXTURE = sum(
    zoom(_RANDOM.uniform(0.0, share, (len(_PLANES) + 1, 240 // size, 240 // size)), (1, size, size), order=1)
    for size, share in ((1, 120.0), (3, 60.0), (10, 70.0))
)
_PATCHES = 24.0  # squares of the texture to a metre


def pose(turn: tuple[float, float, float] = (0, 0, 0), at: tuple[float, float, float] = (0, 0, 0)) -> Pose3:
    """map_from_camera of a rotation vector [rad] and a place [m]."""
    return Pose3(Rotation.from_rotvec(turn).as_matrix(), np.array(at, float))


def render(map_from_camera: Pose3, stamp_ns: int = 0, row_motion: FloatArray | None = None) -> RgbdFrame:
    """Return the picture from a pose. `row_motion` (6,): rotation [rad/s] and translation [m/s] of things before the
    camera; each row is exposed 0.05 ms later than the one above."""
    rows, columns = np.mgrid[0:HEIGHT, 0:WIDTH].astype(float)
    rays = np.stack([(columns - CAMERA[2]) / CAMERA[0], (rows - CAMERA[3]) / CAMERA[1], np.ones_like(rows)], axis=-1)
    row_step = 0.0 if row_motion is None else 5e-5
    turns, places = _poses_of_rows(map_from_camera, row_motion, row_step)
    directions = np.einsum("rij,rcj->rci", turns, rays)
    origins = np.broadcast_to(places[:, None], directions.shape)
    depth, shade = np.full(rows.shape, np.inf), np.zeros(rows.shape)
    for number, (axis, offset) in enumerate(_PLANES):
        _hit(axis, offset, number, None, origins, directions, depth, shade)
    _hit(2, 1.2, len(_PLANES), 0.4, origins, directions, depth, shade)
    image = np.clip(np.rint(shade), 0, 255).astype(np.uint8)
    return RgbdFrame(stamp_ns, image, depth.astype(np.float32), MATRIX, row_step)


def _poses_of_rows(map_from_camera: Pose3, motion: FloatArray | None, row_step: float) -> tuple[FloatArray, FloatArray]:
    turns, places = [], []
    for row in range(HEIGHT):
        step = np.zeros(6) if motion is None else motion * (row - 0.5 * HEIGHT) * row_step
        moved = map_from_camera @ Pose3(Rotation.from_rotvec(step[:3]).as_matrix(), step[3:]).inverse()
        turns.append(moved.rotation)
        places.append(moved.translation)
    return np.array(turns), np.array(places)


def _hit(
    axis: int,
    offset: float,
    texture: int,
    half: float | None,
    origins: FloatArray,
    directions: FloatArray,
    depth: FloatArray,
    shade: FloatArray,
) -> None:
    """Draw a plane, or a square of it, into depth and shade where it is nearest."""
    with np.errstate(divide="ignore", invalid="ignore"):
        along = (offset - origins[..., axis]) / directions[..., axis]
    points = origins + along[..., None] * directions
    u, v = (points[..., k] for k in range(3) if k != axis)
    nearer = (along > 0.05) & (along < depth)
    if half is not None:
        nearer &= (np.abs(u) < half) & (np.abs(v) < half)
    at = [(v[nearer] * _PATCHES) % 239, (u[nearer] * _PATCHES) % 239]
    depth[nearer], shade[nearer] = along[nearer], map_coordinates(_TEXTURE[texture], at, order=1)


def sway(count: int, turn: float = 0.25, way: float = 0.25) -> list[Pose3]:
    """Poses of a camera that looks round and moves in a closed curve, map_from_camera of the first at the origin."""
    poses = []
    for k in range(count):
        a = 2 * math.pi * k / count
        poses.append(
            pose((0.4 * turn * math.sin(2 * a), turn * math.sin(a), 0.3 * turn * (1 - math.cos(a))),
                 (way * math.sin(a), 0.3 * way * math.sin(2 * a), way * (1 - math.cos(a)) * 0.5))
        )  # fmt: skip
    return poses


def noisy(frame: RgbdFrame, seed: int, share: float = 0.004) -> RgbdFrame:
    """Return the frame with noise on grey levels and depth, the latter by this share of its square."""
    rng = np.random.default_rng(seed)
    image = np.clip(frame.image + rng.normal(0.0, 2.0, frame.image.shape), 0, 255).astype(np.uint8)
    error: Float32Array = rng.normal(0.0, share, frame.depth.shape).astype(np.float32) * frame.depth**2
    return RgbdFrame(frame.stamp_ns, image, frame.depth + error, frame.camera_matrix, frame.row_step)
