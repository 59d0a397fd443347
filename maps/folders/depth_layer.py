"""The depth layer of a map: `depth.yaml` and `depth.pgm` beside `map.yaml`, readable by any map_server.

In the map itself all obstacles and drop-offs are occupied cells; planners, here and in Nav2, need no more. The layer
marks the occupied cells that only the depth camera sees, and the drop-offs. Scan matching and displays need it.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from waychair.errors import MapError
from waychair.files import is_file
from waychair.maps.folders.map_files import load_info, load_map, save_map, yaml_path
from waychair.maps.grid.cells import occupied
from waychair.types import UNKNOWN, BoolArray, Cells, OccupancyGrid

DEPTH = "depth"
"""Name of the layer's files without suffix."""

SEEN_BY_DEPTH, DROP_OFF = 50, 100
"""Values of the layer's cells [%] (raw mode): an obstacle that only the depth camera sees; a drop-off."""


def depth_layer(scanned: OccupancyGrid, grid: OccupancyGrid, drops: BoolArray) -> OccupancyGrid:
    """Return the depth layer of a `grid` of all sensors, from its drop-offs (H, W) and the lidar's grid `scanned`."""
    cells = np.zeros(grid.cells.shape, np.int8)
    row, col = (
        round((low - high) / grid.resolution)
        for low, high in (
            (scanned.map_from_grid.y, grid.map_from_grid.y),
            (scanned.map_from_grid.x, grid.map_from_grid.x),
        )
    )
    walls = np.zeros(grid.cells.shape, np.bool_)
    height, width = scanned.cells.shape
    walls[row : row + height, col : col + width] = occupied(scanned)
    cells[occupied(grid) & ~walls] = SEEN_BY_DEPTH
    cells[drops] = DROP_OFF
    return OccupancyGrid(cells, grid.resolution, grid.map_from_grid)


def save_depth_layer(folder: Path, layer: OccupancyGrid | None) -> None:
    """Write the layer of a map; without a layer, remove the files of an earlier one.

    Raises:
        OutputError: the folder cannot be made or written to.
    """
    if layer is None:
        for suffix in (".yaml", ".pgm"):
            (folder / f"{DEPTH}{suffix}").unlink(missing_ok=True)
        return
    save_map(folder, layer, mode="raw", name=DEPTH)


def load_depth_layer(path: Path, grid: OccupancyGrid) -> OccupancyGrid | None:
    """Return the layer of the map at a folder or YAML file, whose grid is `grid`; None where the map has none.

    Raises:
        MapError: the layer is broken, or belongs to another map.
    """
    file = yaml_path(path).with_name(f"{DEPTH}.yaml")
    if not is_file(file, MapError):
        return None
    times = grid.resolution / load_info(file).resolution  # more than 1 where the map's cells were joined
    whole = times >= 1.0 and abs(times - round(times)) < 1e-6
    layer = load_map(file, lambda _: None, resolution=grid.resolution if whole else None)
    if (layer.cells.shape, layer.resolution, layer.map_from_grid) != (
        grid.cells.shape,
        grid.resolution,
        grid.map_from_grid,
    ):
        raise MapError(f"{file} belongs to another map than {yaml_path(path).name}: make the map again, or remove it")
    return layer


def drop_offs(layer: OccupancyGrid) -> BoolArray:
    """Return which cells (H, W) are drop-offs."""
    result: BoolArray = layer.cells == DROP_OFF
    return result


def scanned_part(grid: OccupancyGrid, layer: OccupancyGrid | None) -> OccupancyGrid:
    """Return the grid for scan matching: cells that only the depth camera sees are unknown."""
    if layer is None:
        return grid
    cells: Cells = np.where(layer.cells > 0, np.int8(UNKNOWN), grid.cells)
    return OccupancyGrid(cells, grid.resolution, grid.map_from_grid)
