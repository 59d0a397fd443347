"""What a building's graph is checked against: the maps and places of its storeys, the chair, the grid planner, the tables."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from waychair.calibration.chair_body import ROBOT, ChairBody
from waychair.errors import MapError, NoPath, PlanningError
from waychair.files import is_file
from waychair.maps.building.building import Building, followed
from waychair.maps.building.checks.graph_findings import GraphFinding, GraphSurroundings
from waychair.maps.building.checks.hgraph_checks import Checker
from waychair.maps.building.hgraph_files import read_hgraph
from waychair.maps.drawn.places import load_places
from waychair.maps.drawn.zones import Zone, load_zones
from waychair.maps.editing.draft import Draft, zoned
from waychair.maps.folders.map_files import MAP_YAML, load_map
from waychair.maps.grid.cells import cells_from_points
from waychair.planning.building.table_files import TABLES, StaleTables, graph_key, tables_key
from waychair.planning.grid.costmap import Costmap, costmap_from_grid
from waychair.planning.grid.dstar_lite import DStarLite
from waychair.planning.route.path_ends import cell_at, start_cell
from waychair.types import OccupancyGrid, Place, Pose2

REACH_M = 0.3
"""A node stands for the places so near to it [m]: that in a door may be a few cells beside the best way through."""

NOT_MUCH = 1.5
"""A way up to so many times the straight line is looked for in the square around it first; the checks' E5 begins there."""

SMALLEST = ROBOT
"""The body by which walls are found where no chair is named: an arc that not even this one drives crosses a wall."""


def surroundings(building: Building, body: ChairBody | None = None) -> GraphSurroundings:
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
        if not is_file(folder / MAP_YAML, MapError):
            missing.add(storey.id)
            continue
        grids[storey.id] = load_map(folder)
        places[storey.id], zones[storey.id] = load_places(folder), load_zones(folder)
        if followed(raw, storey.id) != raw.hgraph:
            moved.add(storey.id)
    drives = _Drives(grids, zones, SMALLEST if body is None else body)
    return GraphSurroundings(
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


class LiveSurroundings:
    """The surroundings of a draft, and its findings after each edit.

    The places and zones are the draft's; drives that were asked for once are remembered, and so are the findings of
    sub-maps that have not changed.

    Raises as `surroundings`.
    """

    def __init__(self, building: Building, body: ChairBody | None = None) -> None:
        self._body = body
        self._base = surroundings(building, body)
        self._zones: dict[str, Sequence[Zone]] = {}
        self._drives: dict[str, _Drives] = {}
        self._known: dict[tuple[str, tuple[float, float], tuple[float, float]], float | None] = {}
        self._checker = Checker()

    def findings(self, draft: Draft) -> tuple[GraphFinding, ...]:
        """Return the faults and warnings of a draft, under the rules of its zones."""
        return self._checker.check(zoned(draft), self.of_draft(draft))

    def of_draft(self, draft: Draft) -> GraphSurroundings:
        """Return the surroundings of a draft of this building."""
        for storey, zones in draft.zones.items():
            if self._zones.get(storey) is not zones:
                self._zones[storey] = zones
                self._drives.pop(storey, None)
                self._known = {key: metres for key, metres in self._known.items() if key[0] != storey}
        turns = None if self._body is None else self._turns
        return replace(self._base, places=draft.places, zones=self._zones, driven=self._length, turns=turns)

    def with_map(self, storey: str, grid: OccupancyGrid) -> None:
        """Add the map of a storey."""
        grids = {**self._base.grids, storey: grid}
        self._base = replace(self._base, grids=grids, missing=self._base.missing - {storey})
        self._drives.pop(storey, None)

    def warm_up(self, draft: Draft) -> None:
        """Ask for one drive on each storey with a map, so that the first edit does not wait for costmaps and kernels."""
        around = self.of_draft(draft)
        for storey in draft.hgraph.storeys:
            points = [
                draft.map_point(ref)
                for ref, _ in draft.hgraph.nodes()
                if draft.hgraph.storey_of(ref.submap) == storey.id
            ][:2]
            if storey.id in around.grids and len(points) == 2 and around.driven is not None:
                around.driven(storey.id, points[0], points[1])

    def look_for_maps(self, building: Building) -> bool:
        """Look which storeys' maps are missing now; return whether that has changed."""
        folders = {storey.id: building.map_folder(storey.id) for storey in building.hgraph.storeys}
        missing = frozenset(
            key for key, folder in folders.items() if folder is not None and not is_file(folder / MAP_YAML, MapError)
        )
        changed = missing != self._base.missing
        self._base = replace(self._base, missing=missing)
        return changed

    def with_saved_graph(self) -> None:
        """Say that the graph was saved with its nodes where the maps have them now."""
        self._base = replace(self._base, moved=frozenset())

    def with_tables(self, are_stale: bool) -> None:
        """Say whether the tables are older than the draft."""
        self._base = replace(self._base, stale_tables=are_stale)

    def _of_storey(self, storey: str) -> _Drives:
        if storey not in self._drives:
            body = SMALLEST if self._body is None else self._body
            self._drives[storey] = _Drives(self._base.grids, self._zones, body)
        return self._drives[storey]

    def _length(self, storey: str, one: tuple[float, float], other: tuple[float, float]) -> float | None:
        key = (storey, one, other)
        if key not in self._known:
            self._known[key] = self._of_storey(storey).length(storey, one, other)
        return self._known[key]

    def _turns(self, storey: str, point: tuple[float, float]) -> bool:
        return self._of_storey(storey).turns(storey, point)


class _Drives:
    """Asks the grid planner on the maps of a building; a storey's costmap is made when it is first needed."""

    def __init__(
        self, grids: Mapping[str, OccupancyGrid], zones: Mapping[str, Sequence[Zone]], body: ChairBody
    ) -> None:
        self._grids, self._zones, self._body = grids, zones, body
        self._costmaps: dict[str, Costmap] = {}

    def length(self, storey: str, one: tuple[float, float], other: tuple[float, float]) -> float | None:
        """Return the length [m] that the chair drives on a storey between two points of its map; None without a way.

        A way that is not much longer than the straight line stays near it, and is looked for there first.
        """
        costmap = self._costmap(storey)
        near = _part_around(costmap, one, other)
        found = None if near is None else _way(near, one, other)
        if found is not None and found <= NOT_MUCH * math.dist(one, other):
            return found
        return _way(costmap, one, other)

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


def _way(costmap: Costmap, one: tuple[float, float], other: tuple[float, float]) -> float | None:
    """Return the length [m] of the way that D* Lite finds between two points; None without a way."""
    try:
        start, goal = (start_cell(costmap, Pose2(*point), REACH_M) for point in (one, other))
        search = DStarLite(costmap.prices, goal, start, costmap.barred)
        search.replan()
    except (NoPath, PlanningError):
        return None
    steps = abs(search.path()[1:] - search.path()[:-1]).sum(axis=1)
    return float(((steps == 1).sum() + 2.0**0.5 * (steps == 2).sum()) * costmap.grid.resolution)


def _part_around(costmap: Costmap, one: tuple[float, float], other: tuple[float, float]) -> Costmap | None:
    """Return the part of a costmap that holds all ways up to `NOT_MUCH` times the straight line; None if that is most of it."""
    grid, reach = costmap.grid, NOT_MUCH * math.dist(one, other) / 2.0 + 2 * REACH_M
    middle = [(a + b) / 2.0 for a, b in zip(one, other, strict=True)]
    corners = [(middle[0] + i * reach, middle[1] + j * reach) for i in (-1, 1) for j in (-1, 1)]
    cells = cells_from_points(grid, np.array(corners))
    low, high = np.maximum(cells.min(axis=0), 0), np.minimum(cells.max(axis=0) + 1, grid.cells.shape)
    if (high - low <= 1).any() or np.prod(high - low) > grid.cells.size / 2:
        return None
    rows, columns = slice(low[0], high[0]), slice(low[1], high[1])
    corner = grid.map_from_grid @ Pose2(low[1] * grid.resolution, low[0] * grid.resolution)
    part = replace(grid, cells=np.ascontiguousarray(grid.cells[rows, columns]), map_from_grid=corner)
    prices = np.ascontiguousarray(costmap.prices[rows, columns])
    clearance = np.ascontiguousarray(costmap.clearance[rows, columns])
    barred = None if costmap.barred is None else np.ascontiguousarray(costmap.barred[rows, columns])
    return replace(costmap, grid=part, prices=prices, clearance=clearance, barred=barred, from_zones=None)


def _are_stale(building: Building) -> bool:
    """Return whether there are tables that do not belong to the present text files."""
    path = building.folder / TABLES
    try:
        return is_file(path, MapError) and tables_key(path) != graph_key(building, time.time_ns())
    except StaleTables:
        return True
