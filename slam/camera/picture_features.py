"""Features of the pictures of the visual odometry, each found once, and corrected for a rolling shutter."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from waychair.slam.camera.feature_settings import FeatureSettings
from waychair.slam.camera.features import ImageFeatures, extract, extract_sized
from waychair.slam.camera.reprojection import back_project, unrolled
from waychair.slam.camera.tracked_picture import Picture
from waychair.types import FloatArray, RgbdFrame


class PictureFeatures:
    """The features of the latest picture asked for, by kind."""

    def __init__(self, settings: FeatureSettings) -> None:
        self.settings = settings
        self.spent_s = 0.0
        """CPU time [s] of the features of the latest picture."""
        self._picture: Picture | None = None
        self._found: dict[str, ImageFeatures] = {}

    def plain(self, picture: Picture) -> ImageFeatures:
        """Return features that locate a camera nearby."""
        return self._once(picture, "plain", extract)

    def sized(self, picture: Picture) -> ImageFeatures:
        """Return features of places, which look alike from near and far."""
        return self._once(picture, "sized", extract_sized)

    def _once(
        self, picture: Picture, kind: str, find: Callable[[RgbdFrame, FeatureSettings], ImageFeatures]
    ) -> ImageFeatures:
        if self._picture is not picture:
            self._picture, self._found, self.spent_s = picture, {}, 0.0
        if kind not in self._found:
            started = time.process_time()
            self._found[kind] = find(picture.frame, self.settings)
            self.spent_s += time.process_time() - started
        return self._found[kind]


def without_rolling_shutter(
    features: ImageFeatures, picture: Picture, velocity: FloatArray, camera: FloatArray
) -> ImageFeatures:
    """Return features, all with depth, as a camera (fx, fy, cx, cy) without a rolling shutter would see them.

    Args:
        features: those of the picture.
        picture: the picture, which knows the exposure time of each row.
        velocity: (6,) of points in the camera's frame, rotation vector [rad/s] and translation [m/s].
        camera: (4,) [px].
    """
    if picture.frame.row_step == 0.0 or len(features) == 0:
        return features
    pixels = features.pixels.astype(np.float64)
    raw = np.column_stack([pixels, 1.0 / features.points[:, 2].astype(np.float64), np.ones(len(pixels))])
    seen = unrolled(raw, velocity, picture.row_time(pixels[:, 1]), camera)
    points = back_project(seen, camera).astype(np.float32)
    return replace(features, pixels=seen[:, :2].astype(np.float32), points=points)
