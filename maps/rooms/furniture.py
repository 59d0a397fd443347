"""Furniture of a grid: islands of cells that are not free and are too small or too compact to be walls."""

from __future__ import annotations

import cv2
import numpy as np

from waychair.types import BoolArray

SHORT = 1.0
"""An island below this length [m] is furniture: chairs, table legs, pillars, clutter. A piece of wall between two doors
is longer."""

BROAD, FILLED, LARGEST = 0.45, 0.65, 6.0
"""An island at least this broad [m], that fills this share of its rectangle and takes at most this area [m²], is a
table, a bed or a cabinet. Walls are thinner, and walls round a corner leave most of their rectangle empty."""


def furniture_islands(free: BoolArray, resolution: float) -> BoolArray:
    """Return the cells (H, W) of furniture that stands free.

    An island is an 8-connected part of the cells that are not free: occupied, or unknown inside or behind furniture.
    Furniture against a wall is one part with the wall and stays.

    Args:
        free: (H, W) cells that are known to be free.
        resolution: side of a cell [m].
    """
    _, parts, boxes, _ = cv2.connectedComponentsWithStats((~free).astype(np.uint8), connectivity=8)
    across = np.hypot(boxes[:, cv2.CC_STAT_WIDTH], boxes[:, cv2.CC_STAT_HEIGHT]) * resolution
    furniture = across < SHORT
    longest = LARGEST / BROAD
    for part in np.flatnonzero((across >= SHORT) & (across <= longest)):
        furniture[part] = _is_furniture(parts, boxes[part], int(part), resolution)
    for rim in (parts[0], parts[-1], parts[:, 0], parts[:, -1]):
        furniture[rim] = False  # nobody knows how it goes on beyond the map
    furniture[0] = False
    result: BoolArray = furniture[parts]
    return result


def _is_furniture(parts: np.ndarray, box: np.ndarray, part: int, resolution: float) -> bool:
    """Return whether one part is short, or broad and compact, by the smallest rectangle round it."""
    left, top, width, height, cells = (int(value) for value in box)
    rows, columns = np.nonzero(parts[top : top + height, left : left + width] == part)
    sides = cv2.minAreaRect(np.column_stack([columns, rows]).astype(np.float32))[1]
    long, broad = ((side + 1) * resolution for side in (max(sides), min(sides)))
    if long < SHORT:
        return True
    area = long * broad
    return broad >= BROAD and area <= LARGEST and cells * resolution**2 >= FILLED * area
