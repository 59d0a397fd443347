"""AprilTags in a picture, and where they are by the camera's depth: no size of a tag needs to be known.

A tag is flat. Over a plane the reciprocal of the depth is linear in the pixels, so that the depths of all of a tag's pixels
give its plane by least squares; the plane gives the tag's middle and the direction in which it faces.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from waychair.geometry import wrap_angle
from waychair.maps.building.april_tags import FAMILY
from waychair.types import Bytes, Float32Array, FloatArray, Pose2, Pose3, RgbdFrame

LEAST_DEPTHS = 60
"""Fewest pixels of a tag with a depth: their plane's direction is then known to about a degree."""

FLATTEST = math.cos(math.radians(35.0))
"""A tag whose normal is not level within 35 degrees hangs on no wall, so that its direction tells no heading."""


@dataclass(frozen=True, slots=True)
class SeenTag:
    """A tag: its number, and the pose of its middle in base, theta the direction in which it faces; None without depth."""

    number: int
    base_from_tag: Pose2 | None = None


def seen_tags(frame: RgbdFrame, base_from_camera: Pose3) -> tuple[SeenTag, ...]:
    """Return the tags in a frame, each number once; a number that is there twice tells nothing."""
    corners, numbers = tags_in_picture(frame.image)
    once = [k for k, number in enumerate(numbers) if numbers.count(number) == 1]
    return tuple(SeenTag(numbers[k], _placed(frame, base_from_camera, corners[k])) for k in once)


def tags_in_picture(image: Bytes) -> tuple[list[FloatArray], list[int]]:
    """Return the corners (4, 2) [pixels] of the tags in a picture, grey (H, W) or rgb (H, W, 3), and their numbers."""
    grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(FAMILY))
    found, numbers, _ = detector.detectMarkers(grey)
    corners = [np.asarray(each, np.float64).reshape(4, 2) for each in found]
    return corners, [] if numbers is None else [int(each) for each in np.asarray(numbers).ravel()]


def _placed(frame: RgbdFrame, base_from_camera: Pose3, corners: FloatArray) -> Pose2 | None:
    """Return the pose in base of a tag with these corners (4, 2) [pixels]; None where its depth tells none."""
    plane = _plane(frame.depth, corners) if frame.depth.shape == frame.image.shape[:2] else None
    if plane is None:
        return None
    inverse = np.linalg.inv(frame.camera_matrix)
    middle = np.array([*corners.mean(axis=0), 1.0])
    per_metre = float(plane @ middle)
    if not per_metre > 0.0:
        return None
    # n . X = 1 on the plane, with X = Z K^-1 (u, v, 1): 1 / Z = (K^-T n) . (u, v, 1)
    normal = frame.camera_matrix.T @ plane
    towards = base_from_camera.rotation @ (-normal / np.linalg.norm(normal))
    if np.hypot(*towards[:2]) < FLATTEST:
        return None
    at = base_from_camera.rotation @ (inverse @ middle / per_metre) + base_from_camera.translation
    return Pose2(float(at[0]), float(at[1]), wrap_angle(math.atan2(towards[1], towards[0])))


def _plane(depth: Float32Array, corners: FloatArray) -> FloatArray | None:
    """Return (3,) of which the product with (u, v, 1) is 1 / depth within a tag's corners; None with too few depths."""
    inside = np.zeros(depth.shape, np.uint8)
    cv2.fillConvexPoly(inside, np.rint(corners).astype(np.int32), 1)
    rows, columns = np.nonzero(inside & (np.isfinite(depth) & (depth > 0.0)))
    if len(rows) < LEAST_DEPTHS:
        return None
    pixels = np.column_stack([columns, rows, np.ones(len(rows))]).astype(np.float64)
    reciprocal = 1.0 / depth[rows, columns].astype(np.float64)
    found, *_ = np.linalg.lstsq(pixels, reciprocal, rcond=None)
    # depths of things before the tag, or of its edge, are left out of a second fit
    away = np.abs(pixels @ found - reciprocal)
    near = away <= 3.0 * np.median(away) + 1e-9
    plane: FloatArray = np.linalg.lstsq(pixels[near], reciprocal[near], rcond=None)[0]
    return plane
