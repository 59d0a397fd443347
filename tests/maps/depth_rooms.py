"""Depth images of plain rooms, ray by ray: a floor with pits in it, and boxes that stand or hang."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from waychair.calibration.chair_body import CHAIR_A
from waychair.maps.depth.depth_scan import DepthScan, DepthSettings, depth_scan
from waychair.slam.odometry.tilt import Tilt
from waychair.types import FloatArray, Pose3, RgbdFrame

CAMERA = np.array([[116.0, 0.0, 79.5], [0.0, 116.0, 59.5], [0.0, 0.0, 1.0]])
EVERY = DepthSettings(step=1)
Box = tuple[float, float, float, float, float, float]
"""x, y and z from and to [m], in level axes under the chair."""

Hole = tuple[float, float, float, float, float]
"""x and y from and to, and depth [m]."""


def picture(boxes: Sequence[Box] = (), holes: Sequence[Hole] = (), tilt: Tilt | None = None) -> RgbdFrame:
    """Return the picture of chair A's camera; depth up to 8 m."""
    lean = Pose3(np.eye(3) if tilt is None else tilt.level_from_base(), np.zeros(3))
    mount = lean @ CHAIR_A.base_from_camera
    columns, rows = np.meshgrid(np.arange(160.0), np.arange(120.0))
    pixels = np.stack([columns, rows, np.ones(columns.shape)], axis=-1)
    rays = pixels @ (mount.rotation @ np.linalg.inv(CAMERA)).T
    depth = _floor(rays, mount.translation, holes)
    for box in boxes:
        depth = np.minimum(depth, _box(rays, mount.translation, box))
    image = np.zeros((120, 160, 3), np.uint8)
    return RgbdFrame(1, image, np.where(depth < 8.0, depth, np.nan).astype(np.float32), CAMERA)


def scan_of_picture(frame: RgbdFrame, tilt: Tilt | None = None, settings: DepthSettings = EVERY) -> DepthScan:
    lean = np.eye(3) if tilt is None else tilt.level_from_base()
    return depth_scan(frame, CHAIR_A.base_from_camera, lean, CHAIR_A.front, settings)


def _floor(rays: FloatArray, lens: FloatArray, holes: Sequence[Hole]) -> FloatArray:
    """Return the depth of the floor, or within a hole that of its bottom or walls."""
    with np.errstate(divide="ignore"):
        depth = np.where(rays[..., 2] < 0.0, -lens[2] / rays[..., 2], np.inf)
    with np.errstate(invalid="ignore"):
        x, y = (lens[axis] + depth * rays[..., axis] for axis in (0, 1))
    for x0, x1, y0, y1, deep in holes:
        within = (x > x0) & (x < x1) & (y > y0) & (y < y1)
        with np.errstate(divide="ignore", invalid="ignore"):
            ends = [np.where(rays[..., 2] < 0.0, -(lens[2] + deep) / rays[..., 2], np.inf)]
            for axis, low, high in ((0, x0, x1), (1, y0, y1)):
                wall = np.where(rays[..., axis] > 0.0, high, low)
                ends.append(np.where(rays[..., axis] != 0.0, (wall - lens[axis]) / rays[..., axis], np.inf))
        depth = np.where(within, np.minimum.reduce(ends), depth)
    return depth


def _box(rays: FloatArray, lens: FloatArray, box: Box) -> FloatArray:
    """Return the depth at which rays enter a box."""
    low, high = np.array(box[::2]), np.array(box[1::2])
    with np.errstate(divide="ignore", invalid="ignore"):
        first, second = (low - lens) / rays, (high - lens) / rays
    enter, leave = np.fmin(first, second).max(axis=-1), np.fmax(first, second).min(axis=-1)
    return np.where((enter <= leave) & (enter > 0.0), enter, np.inf)
