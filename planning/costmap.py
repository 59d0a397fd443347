"""What driving through each cell costs: impassable near obstacles, dear beside them, cheap in the open.

The chair is judged here by its half width alone, which any heading needs; whether the whole rectangle fits is the local
planner's question. Unknown cells are free at a price (the source paper's section 3.3.1 takes them as free).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from waychair.calibration.chair import ChairBody
from waychair.config import Settings, setting
from waychair.maps.distance_field import DistanceField, distances
from waychair.maps.grid import cells_from_points, inside, occupied
from waychair.planning.grid_graph import FREE_PRICE, Prices
from waychair.types import UNKNOWN, Float32Array, FloatArray, OccupancyGrid


@dataclass(frozen=True, slots=True)
class CostmapSettings(Settings):
    """How far to keep away from things, and what it is worth."""

    margin: float = setting(0.03, "m", "kept free beside the chair's half width", low=0.0, high=0.5)
    inflation_radius: float = setting(1.0, "m", "clearance from which on a cell is no dearer", low=0.0, high=5.0)
    wall_price: int = setting(5000, "per mille", "price added where the chair just fits", low=0, high=100_000)
    unknown_price: int = setting(9000, "per mille", "price added to an unknown cell", low=0, high=100_000)


@dataclass(frozen=True, slots=True)
class Costmap:
    """Prices (H, W) int32 and clearance (H, W) float32 [m] of a grid's cells.

    Prices are per mille of a free cell's, 0 is impassable. Clearance is measured between cell centres (see
    `maps.distance_field`) to occupied cells, static or live. `grid` holds the live obstacles too, and the geometry;
    `body` is the chair that the prices are for.
    """

    prices: Prices
    clearance: Float32Array
    grid: OccupancyGrid
    body: ChairBody

    @property
    def field(self) -> DistanceField:
        """The clearance with its geometry, as the local planner takes it."""
        return DistanceField(self.clearance, self.grid.resolution, self.grid.map_from_grid)


def costmap_from_grid(
    grid: OccupancyGrid,
    body: ChairBody,
    settings: CostmapSettings = CostmapSettings(),
    live_points: FloatArray | None = None,
) -> Costmap:
    """Costmap of a grid and of obstacles seen just now, `live_points` (N, 2) [m] in map; those outside it are ignored.

    A cell is impassable when a wall's face, half a cell nearer than its centre, leaves less than the half width and the
    margin. From there the price falls with the square of the clearance still missing to the inflation radius, so that
    the middle of a door or corridor is the cheapest way through.
    """
    grid = _with_obstacles(grid, live_points)
    clearance = distances(occupied(grid), grid.resolution)
    needed = body.width / 2 + settings.margin + grid.resolution / 2
    missing = (settings.inflation_radius - clearance) / max(settings.inflation_radius - needed, 1e-6)
    prices = FREE_PRICE + settings.wall_price * np.clip(missing, 0.0, 1.0) ** 2
    prices[grid.cells == UNKNOWN] += settings.unknown_price
    # Clearances are float32: a hair of slack lets a cell at exactly the needed distance pass.
    prices[clearance < needed - 1e-5] = 0
    return Costmap(np.rint(prices).astype(np.int32), clearance, grid, body)


def _with_obstacles(grid: OccupancyGrid, points: FloatArray | None) -> OccupancyGrid:
    """The grid with the cells under the points occupied."""
    if points is None or len(points) == 0:
        return grid
    cells = cells_from_points(grid, points)
    rows, columns = cells[inside(grid, cells)].T
    marked = grid.cells.copy()
    marked[rows, columns] = 100
    return OccupancyGrid(marked, grid.resolution, grid.map_from_grid)
