"""Grey pictures that are written without OpenCV, read by it."""

from __future__ import annotations

import cv2
import numpy as np

from waychair.png import grey_png


def test_a_grey_picture_is_read_as_it_was_written() -> None:
    pixels = np.random.default_rng(1).integers(0, 256, (37, 64), np.uint8)
    for shown in (pixels, np.flipud(pixels), pixels[:, 3:4]):
        read = cv2.imdecode(np.frombuffer(grey_png(shown), np.uint8), cv2.IMREAD_UNCHANGED)
        assert read is not None
        assert np.array_equal(read.reshape(shown.shape), shown)
