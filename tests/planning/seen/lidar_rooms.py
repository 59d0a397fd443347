"""Plans of a few straight walls, and the views that an ideal lidar takes of them."""

from __future__ import annotations

import math

import numpy as np

from waychair.planning.seen.range_views import RangeView
from waychair.types import FloatArray, Pose2


def wall_with_door(width: float, *, thick: float = 0.12, recess: float | None = None) -> FloatArray:
    """Return the faces (N, 4) [m] of a wall along y at x = 0 to `thick`, with an opening of `width` about y = 0, in a
    hall of 8 by 8 m. With `recess` a closed leaf stands that far behind the near face."""
    half = width / 2
    faces = []
    for side in (1.0, -1.0):
        jamb, end = side * half, side * 4.0
        faces += [(0.0, jamb, 0.0, end), (thick, jamb, thick, end), (0.0, jamb, thick, jamb)]
    faces += [(-4.0, -4.0, -4.0, 4.0), (4.0, -4.0, 4.0, 4.0), (-4.0, 4.0, 4.0, 4.0), (-4.0, -4.0, 4.0, -4.0)]
    if recess is not None:
        faces.append((recess, -half, recess, half))
    return np.array(faces)


def leaf(width: float, angle: float, side: float = 1.0, thick: float = 0.12) -> FloatArray:
    """Return the face (1, 4) of a leaf hung behind the wall at the jamb at y = side * width / 2, open by `angle` [rad]."""
    hinge = np.array([thick, side * width / 2])
    tip = hinge + width * np.array([math.sin(angle), -side * math.cos(angle)])
    return np.array([[*hinge, *tip]])


def view_of(
    faces: FloatArray, sensor: Pose2, noise: float = 0.0, step: float = 0.5, rng: np.random.Generator | None = None
) -> RangeView:
    """Return the view from a sensor with beams every `step` [deg] over 270 degrees and ranges with `noise` [m]."""
    angles = np.radians(np.arange(-135.0, 135.0 + step / 2, step)) + sensor.theta
    away = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    start, along = faces[:, :2] - (sensor.x, sensor.y), faces[:, 2:] - faces[:, :2]
    cross = away[:, :1] * along[:, 1] - away[:, 1:] * along[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        range_m = (start[:, 0] * along[:, 1] - start[:, 1] * along[:, 0]) / cross
        share = (start[:, 0] * away[:, 1:] - start[:, 1] * away[:, :1]) / cross
    hit = (range_m > 1e-6) & (share >= 0.0) & (share <= 1.0)
    ranges = np.where(hit, range_m, np.inf).min(axis=1)
    if rng is not None:
        ranges = ranges + noise * rng.standard_normal(len(ranges))
    met = np.isfinite(ranges)
    origin = np.array([sensor.x, sensor.y])
    return RangeView(origin, origin + np.where(met, ranges, np.nan)[:, None] * away, met)


def drive_past(faces: FloatArray, count: int = 10, noise: float = 0.01, seed: int = 0) -> list[tuple[RangeView, Pose2]]:
    """Return views and poses of a drive towards the wall at a slant, from 3.4 m before it to 1 m before it."""
    rng = np.random.default_rng(seed)
    poses = [Pose2(x, 0.5 * x + 0.6, -0.2) for x in np.linspace(-3.4, -1.0, count)]
    return [(view_of(faces, pose, noise, rng=rng), pose) for pose in poses]
