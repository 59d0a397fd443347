"""AprilTags as beacons: printed squares whose number a camera reads. A beacon whose id is a number is the tag of that number.

The family is 36h11 (Olson, AprilTag: A robust and flexible visual fiducial system, ICRA 2011): 587 numbers that differ in
at least 11 of 36 parts, so that shadows and textures are hardly ever taken for one.
"""

from __future__ import annotations

import cv2
import numpy as np

from waychair.errors import BuildingError
from waychair.types import BoolArray, Bytes

FAMILY = cv2.aruco.DICT_APRILTAG_36h11
"""OpenCV's number of the family."""

MOST = 587
"""Numbers of the family: 0 to 586."""

PARTS = 10
"""Parts on a side of a tag: six of the number, the black frame, and a white edge, without which no camera finds it."""

_PIXELS = 60
"""Pixels of a part in a picture to print: 0.2 m at 76 pixels a centimetre."""


def tag_parts(number: int) -> BoolArray:
    """Return which parts of a tag are black, (PARTS, PARTS), the top row first.

    Raises:
        BuildingError: the family has no such number.
    """
    if not 0 <= number < MOST:
        raise BuildingError(f"there is no AprilTag {number}: take a number from 0 to {MOST - 1}")
    inner = PARTS - 2
    picture = cv2.aruco.generateImageMarker(cv2.aruco.getPredefinedDictionary(FAMILY), number, inner)
    black = np.zeros((PARTS, PARTS), np.bool_)
    black[1:-1, 1:-1] = np.asarray(picture) < 128
    return black


def tag_picture(number: int) -> Bytes:
    """Return a tag to print, (PARTS * 60, PARTS * 60) grey levels with its white edge.

    Raises:
        BuildingError: the family has no such number.
    """
    levels = np.where(tag_parts(number), 0, 255).astype(np.uint8)
    return np.kron(levels, np.ones((_PIXELS, _PIXELS), np.uint8))
