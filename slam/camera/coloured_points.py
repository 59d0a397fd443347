"""The coloured points of a picture with depth."""

from __future__ import annotations

import numpy as np

from waychair.types import Bytes, FloatArray, Pose3, RgbdFrame

_STEP = 2  # pixels; a point is taken from every second column and row, since voxels merge neighbours anyway


def coloured_points(picture: RgbdFrame, map_from_camera: Pose3, range_max: float) -> tuple[FloatArray, FloatArray]:
    """Return points (N, 3) [m] in map of a picture's depths below `range_max` [m], and their colours (N, 3) in [0, 1]."""
    depth = picture.depth[::_STEP, ::_STEP].astype(np.float64)
    rows, columns = np.nonzero(np.isfinite(depth) & (depth > 0.0) & (depth < range_max))
    pixels = np.stack([columns * _STEP, rows * _STEP, np.ones(len(rows))], axis=-1).astype(np.float64)
    rays: FloatArray = pixels @ np.linalg.inv(picture.camera_matrix).T
    seen: FloatArray = rays * depth[rows, columns][:, None]
    points: FloatArray = seen @ map_from_camera.rotation.T + map_from_camera.translation
    image: Bytes = picture.image[::_STEP, ::_STEP][rows, columns]
    colours: FloatArray = (image if image.ndim == 2 else np.repeat(image[:, None], 3, axis=1)) / 255.0
    return points, colours
