"""A network of ways between points of one room or corridor, as short as the chair can drive them by D* Lite."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np

from waychair.errors import NoPath
from waychair.geometry import bends
from waychair.maps.grid.cells import cells_from_points, inside, points_from_cells
from waychair.planning.grid.costmap import Costmap
from waychair.planning.grid.dstar_lite import DStarLite
from waychair.planning.grid.grid_graph import Prices
from waychair.types import BoolArray, FloatArray, IntArray, OccupancyGrid

REACH = 0.3
"""[m] How far a point may be from the nearest cell on which the chair can drive, and a region reaches into doorways."""

NEIGHBOURS = 6
"""Each point is joined to some of so many nearest ones: more takes longer and adds only ways past other points."""

DETOUR = 1.6
"""Two points get a way of their own where the ways found so far are longer than it by this factor."""

MOST_ARCS = 4
BEND = 0.35
"""[m] A way gets a node where it bends away from the straight line by more than this."""


@dataclass(frozen=True, slots=True)
class RegionLink:
    """A way between two points of a network.

    Attributes:
        start, end: indices of the points.
        bends: (K, 2) [m] points between them, such that the ways between are nearly straight.
        lengths: (K + 1,) [m] of the pieces, along D* Lite's path.
    """

    start: int
    end: int
    bends: FloatArray
    lengths: FloatArray

    @property
    def length(self) -> float:
        """Length of the whole way [m]."""
        return float(self.lengths.sum())


@dataclass(frozen=True, slots=True)
class Region:
    """The part of a costmap that one room covers; `low` is the row and column of its corner in the whole grid."""

    costmap: Costmap
    low: IntArray
    prices: Prices

    def cell(self, point: FloatArray, reach: float = REACH) -> tuple[int, int] | None:
        """Return the cell nearest to a point (2,) [m] in map on which the chair can drive; None beyond `reach` [m]."""
        at = cells_from_points(self.costmap.grid, point)[0] - self.low
        span = math.ceil(reach / self.costmap.grid.resolution)
        begin = np.maximum(at - span, 0)
        near = np.argwhere(self.prices[begin[0] : at[0] + span + 1, begin[1] : at[1] + span + 1] > 0) + begin
        if not len(near):
            return None
        row, column = near[np.argmin(((near - at) ** 2).sum(axis=1))].tolist()
        return row, column

    def widest(self) -> tuple[FloatArray, float] | None:
        """Return the drivable point (2,) [m] that is farthest from obstacles, and its clearance [m]; None without any."""
        height, width = self.prices.shape
        window = np.s_[self.low[0] : self.low[0] + height, self.low[1] : self.low[1] + width]
        clearance = np.where(self.prices > 0, self.costmap.clearance[window], -1.0)
        if clearance.max(initial=-1.0) < 0:
            return None
        # the middle of all cells that are as far: clearance is measured up to a limit only
        best = np.argwhere(clearance >= clearance.max() - 1e-6)
        cell = best[np.argmin(((best - best.mean(axis=0)) ** 2).sum(axis=1))]
        return points_from_cells(self.costmap.grid, cell + self.low)[0], float(clearance[tuple(cell)])


def region_of(costmap: Costmap, mask: BoolArray) -> Region | None:
    """Return the region of cells (H, W), reaching `REACH` into its doorways; None for an empty mask."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not len(rows):
        return None
    span = math.ceil(REACH / costmap.grid.resolution)
    low = np.maximum(np.array([rows[0], columns[0]]) - span, 0)
    high = np.array([rows[-1], columns[-1]]) + span + 1
    window = np.s_[low[0] : high[0], low[1] : high[1]]
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * span + 1, 2 * span + 1))
    reached = cv2.dilate(mask[window].astype(np.uint8), disc).astype(bool)
    return Region(costmap, low, np.where(reached, costmap.prices[window], 0).astype(np.int32))


def region_links(region: Region, points: FloatArray, most: Sequence[int]) -> list[RegionLink]:
    """Return ways that join all points (N, 2) [m] that the chair can drive between, with at most `most` (N,) each.

    The shortest ways come first until all points are joined (Kruskal); then those that save a detour.
    """
    cells = [region.cell(point) for point in points]
    found = _candidates(region, points, cells)
    found.sort(key=lambda link: link.length)
    group = list(range(len(points)))
    arcs = [0] * len(points)
    taken: list[RegionLink] = []
    for limit in (0, MOST_ARCS):  # the second time, points with too few arcs to join all may have more
        for link in found:
            ends = link.start, link.end
            if group[link.start] == group[link.end] or any(arcs[end] >= max(most[end], limit) for end in ends):
                continue
            group = [group[link.start] if each == group[link.end] else each for each in group]
            taken.append(link)
            for end in ends:
                arcs[end] += 1
    for link in found:
        ends = link.start, link.end
        if link in taken or any(arcs[end] >= most[end] for end in ends) or _passes_another(link, points):
            continue
        if _tree_distance(taken, len(points), *ends) > DETOUR * link.length:
            taken.append(link)
            for end in ends:
                arcs[end] += 1
    return taken


def whole_storey(costmap: Costmap) -> Region:
    """Return the region of all cells."""
    return Region(costmap, np.zeros(2, np.int64), costmap.prices)


def link_between(region: Region, points: FloatArray, start: int, end: int) -> RegionLink | None:
    """Return the way between two of the points (N, 2) [m]; None where the chair cannot drive from one to the other."""
    cells = region.cell(points[start]), region.cell(points[end])
    if cells[0] is None or cells[1] is None:
        return None
    search = DStarLite(region.prices, cells[1], cells[0])
    try:
        search.replan()
    except NoPath:
        return None
    return _link(region, start, end, search.path(), points)


def _candidates(region: Region, points: FloatArray, cells: list[tuple[int, int] | None]) -> list[RegionLink]:
    """Return the ways from each point to its nearest ones, each once."""
    found = []
    for one, cell in enumerate(cells):
        if cell is None:
            continue
        away = np.hypot(*(points - points[one]).T)
        near = [int(k) for k in np.argsort(away, kind="stable") if k != one and cells[k] is not None][:NEIGHBOURS]
        search: DStarLite | None = None
        for other in near:
            back = [int(k) for k in np.argsort(np.hypot(*(points - points[other]).T), kind="stable")[: NEIGHBOURS + 1]]
            if other < one and one in back:
                continue  # it was found from the other side
            start = cells[other]
            assert start is not None
            if search is None:
                search = DStarLite(region.prices, cell, start)
            search.move_start(start)
            try:
                search.replan()
            except NoPath:
                continue
            found.append(_link(region, other, one, search.path(), points))
    return found


def _link(region: Region, start: int, end: int, cells: IntArray, points: FloatArray) -> RegionLink:
    path = points_from_cells(region.costmap.grid, cells + region.low)
    path[0], path[-1] = points[start], points[end]
    keep = bends(path, BEND)
    steps = np.hypot(*np.diff(path, axis=0).T)
    lengths = np.array([steps[a:b].sum() for a, b in pairwise([0, *keep, len(path) - 1])])
    return RegionLink(start, end, path[keep].reshape(-1, 2), lengths)


def _passes_another(link: RegionLink, points: FloatArray) -> bool:
    """Return whether a way leads past a third point, over which there are ways already."""
    line = np.vstack([points[link.start], link.bends, points[link.end]])
    others = np.delete(points, [link.start, link.end], axis=0)
    return len(others) > 0 and any(_from_segment(others, a, b).min() < 2 * BEND for a, b in pairwise(line))


def _from_segment(points: FloatArray, a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the distances (N,) of points from a segment."""
    along = b - a
    share = np.clip((points - a) @ along / max(float(along @ along), 1e-12), 0.0, 1.0)
    result: FloatArray = np.hypot(*(points - (a + share[:, None] * along)).T)
    return result


def _tree_distance(links: list[RegionLink], count: int, start: int, end: int) -> float:
    """Return the length of the shortest way over links [m] (Bellman and Ford: there are few)."""
    away = [math.inf] * count
    away[start] = 0.0
    for _ in range(count):
        changed = False
        for link in links:
            for a, b in ((link.start, link.end), (link.end, link.start)):
                if away[a] + link.length < away[b]:
                    away[b], changed = away[a] + link.length, True
        if not changed:
            break
    return away[end]


def ahead_of_opening(
    grid: OccupancyGrid, clearance: FloatArray, middle: FloatArray, jambs: FloatArray, side: FloatArray
) -> FloatArray:
    """Return the point (2,) [m] in front of an opening where the clearance is greatest along the way straight in.

    Args:
        grid: gives the geometry.
        clearance: (H, W) [m].
        middle: (2,) [m] of the opening.
        jambs: (2, 2) [m].
        side: (2,) [m] a point on the side that is meant.
    """
    across = jambs[1] - jambs[0]
    normal = np.array([-across[1], across[0]]) / max(float(np.hypot(*across)), 1e-9)
    if normal @ (side - middle) < 0:
        normal = -normal
    steps = np.arange(0.3, AHEAD, grid.resolution)
    points = middle + steps[:, None] * normal
    cells = cells_from_points(grid, points)
    on_grid = inside(grid, cells)
    values = np.where(on_grid, clearance[tuple(np.where(on_grid[:, None], cells, 0).T)], -1.0)
    falls = np.flatnonzero(np.diff(values) < -1e-4)
    stop = int(falls[0]) if len(falls) else len(values) - 1
    best: FloatArray = points[stop]
    return best


AHEAD = 1.6
"""[m] How far in front of a door the middle of the corridor is looked for."""
