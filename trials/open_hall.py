"""Empty halls for the calibration of simulated chairs."""

from __future__ import annotations

import numpy as np

from waychair.simulation.plan.world import World, world_from_grid
from waychair.types import OccupancyGrid, Pose2


def open_hall(side: float = 40.0, resolution: float = 0.1) -> World:
    """Return an empty square hall of `side` [m] with walls; the chair starts in its middle."""
    cells = np.zeros((round(side / resolution), round(side / resolution)), np.int8)
    cells[[0, -1]] = cells[:, [0, -1]] = 100
    return world_from_grid(OccupancyGrid(cells, resolution), Pose2(side / 2, side / 2, 0.0), name="hall")
