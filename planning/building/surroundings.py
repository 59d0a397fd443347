"""What a building's graph is checked against: the maps and places of its storeys, the chair, the grid planner, the tables."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace

from waychair.calibration.chair_body import ROBOT, ChairBody
from waychair.errors import MapError, NoPath, PlanningError
from waychair.files import is_file
from waychair.maps.building.building import Building, followed
from waychair.maps.building.graph_findings import Surroundings
from waychair.maps.building.hgraph_files import read_hgraph
from waychair.maps.drawn.places import load_places
from waychair.maps.drawn.zones import Zone, load_zones
from waychair.maps.folders.map_files import load_map
from waychair.planning.building.table_files import TABLES, StaleTables, graph_key, tables_key
from waychair.planning.grid.costmap import Costmap, costmap_from_grid
from waychair.planning.grid.dstar_lite import DStarLite
from waychair.planning.route.path_ends import cell_at, start_cell
from waychair.types import OccupancyGrid, Place, Pose2

REACH_M = 0.3
"""A node stands for the places so near to it [m]: that in a door may be a few cells beside the best way through."""

SMALLEST = ROBOT
"""The body by which walls are found where no chair is named: an arc that not even this one drives crosses a wall."""


def surroundings(building: Building, body: ChairBody | None = None) -> Surroundings:
    """Return the surroundings of a building as its folder has them; `body` is the chair that is to drive there.

    Without a body, arcs through walls are found by the smallest one, and doors are not measured.

    Raises:
        MapError, PlaceError, ZoneError: the files of a storey's map are damaged.
    """
    grids: dict[str, OccupancyGrid] = {}
    places: dict[str, dict[str, Place]] = {}
    zones: dict[str, tuple[Zone, ...]] = {}
    missing, moved = set(), set()
    raw = replace(building, hgraph=read_hgraph(building.folder))
    for storey in building.hgraph.storeys:
        folder = building.map_folder(storey.id)
        if folder is None:
            continue
        if not is_file(folder / "map.yaml", MapError):
            missing.add(storey.id)
            continue
        grids[storey.id] = load_map(folder)
        places[storey.id], zones[storey.id] = load_places(folder), load_zones(folder)
        if followed(raw, storey.id) != raw.hgraph:
            moved.add(storey.id)
    drives = _Drives(grids, zones, SMALLEST if body is None else body)
    return Surroundings(
        width=None if body is None else body.width,
        length=None if body is None else body.front + body.rear,
        grids=grids,
        places=places,
        zones=zones,
        driven=drives.length,
        turns=None if body is None else drives.turns,
        missing=frozenset(missing),
        moved=frozenset(moved),
        stale_tables=_are_stale(building),
    )


class _Drives:
    """Asks the grid planner on the maps of a building; a storey's costmap is made when it is first needed."""

    def __init__(
        self, grids: Mapping[str, OccupancyGrid], zones: Mapping[str, Sequence[Zone]], body: ChairBody
    ) -> None:
        self._grids, self._zones, self._body = grids, zones, body
        self._costmaps: dict[str, Costmap] = {}

    def length(self, storey: str, one: tuple[float, float], other: tuple[float, float]) -> float | None:
        """Return the length [m] that the chair drives on a storey between two points of its map; None without a way."""
        costmap = self._costmap(storey)
        try:
            start, goal = (start_cell(costmap, Pose2(*point), REACH_M) for point in (one, other))
            search = DStarLite(costmap.prices, goal, start, costmap.barred)
            search.replan()
        except (NoPath, PlanningError):
            return None
        steps = abs(search.path()[1:] - search.path()[:-1]).sum(axis=1)
        return float(((steps == 1).sum() + 2.0**0.5 * (steps == 2).sum()) * costmap.grid.resolution)

    def turns(self, storey: str, point: tuple[float, float]) -> bool:
        """Return whether the chair has room to turn round at a point of a storey's map."""
        costmap = self._costmap(storey)
        cell = cell_at(costmap, Pose2(*point))
        return cell is not None and bool(costmap.clearance[cell] >= self._body.circumscribed_radius)

    def _costmap(self, storey: str) -> Costmap:
        if storey not in self._costmaps:
            self._costmaps[storey] = costmap_from_grid(
                self._grids[storey], self._body, zones=tuple(self._zones.get(storey, ()))
            )
        return self._costmaps[storey]


def _are_stale(building: Building) -> bool:
    """Return whether there are tables that do not belong to the present text files."""
    path = building.folder / TABLES
    try:
        return is_file(path, MapError) and tables_key(path) != graph_key(building, time.time_ns())
    except StaleTables:
        return True
