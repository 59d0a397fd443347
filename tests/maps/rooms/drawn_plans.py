"""Small floor plans drawn cell by cell: walls as lines, doors as gaps, furniture as rectangles; metres, 5 cm cells."""

from __future__ import annotations

import cv2
import numpy as np

from waychair.types import UNKNOWN, Cells, OccupancyGrid, Pose2

RESOLUTION = 0.05


class DrawnPlan:
    """Floor that is drawn on; points are (x, y) [m] from the lower left corner."""

    def __init__(self, width: float, height: float) -> None:
        """Begin with unknown cells."""
        self.cells: Cells = np.full((round(height / RESOLUTION), round(width / RESOLUTION)), UNKNOWN, np.int8)

    def fill(self, left: float, below: float, right: float, above: float, value: int) -> DrawnPlan:
        """Give a rectangle's cells a value."""
        rows, columns = (
            slice(round(a / RESOLUTION), round(b / RESOLUTION)) for a, b in ((below, above), (left, right))
        )
        self.cells[rows, columns] = value
        return self

    def room(self, left: float, below: float, right: float, above: float) -> DrawnPlan:
        """Draw free floor with walls of 10 cm round it, outside of it."""
        self.fill(left - 0.1, below - 0.1, right + 0.1, above + 0.1, 100)
        return self.fill(left, below, right, above, 0)

    def solid(self, x: float, y: float, width: float, depth: float) -> DrawnPlan:
        """Draw a piece of furniture by its middle and its sides."""
        return self.fill(x - width / 2, y - depth / 2, x + width / 2, y + depth / 2, 100)

    def chair(self, x: float, y: float) -> DrawnPlan:
        """Draw four legs."""
        for dx in (-0.2, 0.2):
            for dy in (-0.2, 0.2):
                self.solid(x + dx, y + dy, 0.05, 0.05)
        return self

    def grid(self, map_from_grid: Pose2 | None = None) -> OccupancyGrid:
        """Return the plan as a grid."""
        return OccupancyGrid(self.cells, RESOLUTION, map_from_grid or Pose2())

    def turned(self, degrees: float) -> OccupancyGrid:
        """Return the plan turned about its middle, cells taken from the nearest, unknown outside."""
        height, width = self.cells.shape
        side = int(np.hypot(height, width)) + 4
        turn = cv2.getRotationMatrix2D((width / 2, height / 2), degrees, 1.0)
        turn[:, 2] += (side - width) / 2, (side - height) / 2
        cells = cv2.warpAffine(self.cells, turn, (side, side), flags=cv2.INTER_NEAREST, borderValue=UNKNOWN)
        return OccupancyGrid(np.asarray(cells, np.int8), RESOLUTION, Pose2())


def ward() -> DrawnPlan:
    """Return a corridor of 14 by 2 m, with four rooms above and three below, each with one door.

    Doors above are 0.9 m wide at x = 2, 5.5, 9 and 12.5 m, below 1.2 m wide at 2.5, 7.5 and 12 m.
    """
    plan = DrawnPlan(15.0, 11.0)
    plan.room(0.5, 4.5, 14.5, 6.5)
    for left, right in ((0.5, 3.9), (4.0, 7.4), (7.5, 10.9), (11.0, 14.5)):
        plan.room(left, 6.6, right, 10.4)
    for left, right in ((0.5, 4.9), (5.0, 9.9), (10.0, 14.5)):
        plan.room(left, 0.5, right, 4.4)
    for x in (2.0, 5.5, 9.0, 12.5):
        plan.fill(x - 0.45, 6.5, x + 0.45, 6.6, 0)
    for x in (2.5, 7.5, 12.0):
        plan.fill(x - 0.6, 4.4, x + 0.6, 4.5, 0)
    return plan
