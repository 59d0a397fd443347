"""Points of a picture keep their place and colour."""

from __future__ import annotations

import numpy as np

from waychair.slam.camera.coloured_points import coloured_points
from waychair.types import Pose3, RgbdFrame


def test_points_keep_their_place_and_colour() -> None:
    depth = np.full((4, 6), np.nan, np.float32)
    depth[2, 4], depth[0, 0] = 2.0, 9.0
    image = np.zeros((4, 6, 3), np.uint8)
    image[2, 4] = (255, 51, 0)
    camera = np.array([[2.0, 0.0, 2.0], [0.0, 2.0, 1.0], [0.0, 0.0, 1.0]])
    turned = Pose3(np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]), np.array([1.0, 0.0, 1.0]))
    points, colours = coloured_points(RgbdFrame(0, image, depth, camera), turned, range_max=4.0)
    np.testing.assert_allclose(points, [[3.0, -2.0, 0.0]])
    np.testing.assert_allclose(colours, [[1.0, 0.2, 0.0]])
