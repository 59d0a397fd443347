"""Floor plans with rooms drawn by hand, and the measure of a segmentation against them.

The plans and the measure are those of Bormann et al., "Room Segmentation: Survey, Implementation, and Analysis", ICRA
2016: 5 cm a pixel, free above 250, unknown at 205; precision and recall as means over rooms of the largest overlap.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from waychair.types import UNKNOWN, IntArray, OccupancyGrid

RESOLUTION, FREE_ABOVE, UNKNOWN_PIXEL, LEAST_PIXELS = 0.05, 250, 205, 100
TRUTH, FURNISHED = "_gt_segmentation.png", "_furnitures.png"


class RoomScores(NamedTuple):
    """Precision, recall and the number of rooms found on one plan."""

    precision: float
    recall: float
    rooms: int


def plan_names(folder: Path) -> list[str]:
    """Return the names of the plans of a folder."""
    return sorted(path.name.removesuffix(TRUTH) for path in folder.glob(f"*{TRUTH}"))


def plan_grid(path: Path) -> OccupancyGrid:
    """Return a plan's picture as a grid; its first row is the grid's."""
    pixels = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    assert pixels is not None, path
    cells = np.where(pixels > FREE_ABOVE, 0, np.where(pixels == UNKNOWN_PIXEL, UNKNOWN, 100)).astype(np.int8)
    return OccupancyGrid(cells, RESOLUTION)


def true_rooms(path: Path) -> IntArray:
    """Return (H, W) the rooms drawn by hand, numbered from 1."""
    pixels = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    assert pixels is not None, path
    count, parts, boxes, _ = cv2.connectedComponentsWithStats((pixels > FREE_ABOVE).astype(np.uint8), connectivity=8)
    large = np.flatnonzero(boxes[:, cv2.CC_STAT_AREA] > LEAST_PIXELS)
    numbers = np.zeros(count, np.int64)
    numbers[large[large > 0]] = np.arange(1, (large > 0).sum() + 1)
    result: IntArray = numbers[parts]
    return result


def agreement(found: IntArray, true: IntArray) -> RoomScores:
    """Return how well labels (H, W) agree with the true rooms (H, W), by the authors' measure."""
    overlaps = np.zeros((int(found.max()) + 1, int(true.max()) + 1), np.int64)
    np.add.at(overlaps, (found.ravel(), true.ravel()), 1)
    found_area, true_area = overlaps.sum(axis=1), overlaps.sum(axis=0)
    counted = np.flatnonzero(found_area > LEAST_PIXELS)
    counted = counted[counted > 0]
    precision = overlaps[counted, 1:].max(axis=1) / found_area[counted]
    recall = overlaps[1:, 1:].max(axis=0) / true_area[1:]
    return RoomScores(float(precision.mean()), float(recall.mean()), len(counted))
