"""The map of a level of an Open-RMF building: walls and floors drawn on a grid, doors left open."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from waychair.maps.grid.cells import MOST_CELLS
from waychair.types import UNKNOWN, FloatArray, OccupancyGrid, Pose2

CELL, WALL, MARGIN = 0.05, 0.10, 1.0
"""Side of a cell, thickness of a wall (that of the traffic editor's worlds), and unknown ground round the building [m]."""


def grid_of_level(points: FloatArray, level: dict[str, Any]) -> OccupancyGrid | None:
    """Return the grid of a level; None where it has no walls, or is larger than a map can be.

    Floor polygons are free; where there are none, the rectangle round the walls is.

    Args:
        points: (N, 2) [m] the level's vertices in the building's frame.
        level: its part of the file, its walls, doors and floors naming vertices by index.
    """
    walls = [row[:2] for row in level.get("walls") or []]
    if not walls:
        return None
    ends = points[np.array(walls).ravel()]
    low, high = ends.min(axis=0) - MARGIN, ends.max(axis=0) + MARGIN
    width, height = (int(side) for side in np.ceil((high - low) / CELL))
    if width * height > MOST_CELLS:
        return None
    cells = np.full((height, width), UNKNOWN, np.int16)

    def at(indices: list[int]) -> NDArray[np.int32]:
        found: NDArray[np.int32] = np.floor((points[indices] - low) / CELL).astype(np.int32)
        return found

    floors = [floor.get("vertices") for floor in level.get("floors") or [] if isinstance(floor, dict)]
    drawn = [
        f for f in floors if isinstance(f, list) and f and all(isinstance(i, int) and 0 <= i < len(points) for i in f)
    ]
    for floor in drawn:
        cv2.fillPoly(cells, [at(floor)], 0)
    if not drawn:
        cells[round(MARGIN / CELL) : -round(MARGIN / CELL), round(MARGIN / CELL) : -round(MARGIN / CELL)] = 0
    thick = round(WALL / CELL)
    for wall in walls:
        start, end = at(wall).tolist()
        cv2.line(cells, start, end, 100, thick)
    for door in level.get("doors") or []:
        start, end = at(door[:2]).tolist()
        cv2.line(cells, start, end, 0, thick + 1)
    return OccupancyGrid(cells.astype(np.int8), CELL, Pose2(float(low[0]), float(low[1]), 0.0))
