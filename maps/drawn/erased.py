"""Erased parts of a map: `erased.yaml` beside `map.yaml`, a list of polygons.

    - [[1.0, 2.0], [3.0, 2.0], [3.0, 4.0]]

The corners are x, y [m] in map. People erase obstacles that are gone: all cells within count as free floor, while the
map's image stays unchanged.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import yaml

from waychair.errors import ZoneError
from waychair.files import path_exists, refuse_empty_file
from waychair.maps.drawn.anchors import load_anchors, write_anchored
from waychair.maps.drawn.places import places_path
from waychair.maps.drawn.zones import Rule, Zone, checked_polygon, zone_cells
from waychair.types import FloatArray, OccupancyGrid, Pose2
from waychair.yaml_files import load_yaml

ERASED_YAML = "erased.yaml"


def load_erased(folder: Path) -> tuple[FloatArray, ...]:
    """Return the erased polygons (N, 2) [m] of a map, given its folder or YAML file; none without such a file.

    They are moved with the map's nodes (`maps.drawn.anchors`).

    Raises:
        MapError: the anchors are damaged.
        ZoneError: the file is broken.
    """
    path = places_path(folder).with_name(ERASED_YAML)
    if not path_exists(path, ZoneError):
        return ()
    refuse_empty_file(path, ZoneError, "[]")
    values = load_yaml(path, ZoneError)
    if values is None:
        return ()
    if not isinstance(values, list):
        raise ZoneError(f"{path} must be a list of polygons [[x, y], [x, y], [x, y], ...]")
    polygons = [checked_polygon(f"{path}, polygon {number}", each) for number, each in enumerate(values, 1)]
    anchors = load_anchors(path.parent)
    now = [anchors.follow("erased", str(number), erased_points(polygon)) for number, polygon in enumerate(polygons)]
    return tuple(np.array([[pose.x, pose.y] for pose in corners]) for corners in now)


def save_erased(folder: Path, polygons: Sequence[FloatArray]) -> None:
    """Write the polygons of a map, whole or not at all.

    Raises:
        MapError: the anchors are damaged.
        OutputError: the folder cannot be made or written to.
    """
    values = [polygon.tolist() for polygon in polygons]
    text = yaml.safe_dump(values, default_flow_style=None, width=10_000)
    points = {str(number): erased_points(polygon) for number, polygon in enumerate(polygons)}
    write_anchored(places_path(folder).with_name(ERASED_YAML), text, "erased", points)


def erased_points(polygon: FloatArray) -> list[Pose2]:
    """Return the points of a polygon (N, 2) that are anchored: its corners."""
    return [Pose2(x, y) for x, y in polygon.tolist()]


def clear_erased(grid: OccupancyGrid, polygons: Sequence[FloatArray]) -> OccupancyGrid:
    """Return a copy of the grid with the polygons' cells free; the grid itself without polygons."""
    if not polygons:
        return grid
    cells = grid.cells.copy()
    for polygon in polygons:
        part, within = zone_cells(Zone("", Rule.KEEP_OUT, np.asarray(polygon)), grid)
        cells[part][within] = 0
    return OccupancyGrid(cells, grid.resolution, grid.map_from_grid)
