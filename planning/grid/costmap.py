"""The costmap: the price of driving through each cell, impassable near obstacles, high beside them, low in the open.

Its layers, from below, are the map, the zones, and present sensor data at the heights at which the chair has an outline
of its own. A costmap knows the chair's half width alone, which every heading needs; the local planner checks the whole
footprint. Unknown cells are passable at a price (the source paper's section 3.3.1 takes them as free).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from waychair.calibration.chair_body import BodyLayer, ChairBody
from waychair.errors import NoFreeSpace
from waychair.maps.drawn.zones import Rule, Zone, keep_out_cells, zone_cells
from waychair.maps.grid.cells import OCCUPIED_FROM, cells_under, cells_where, occupied
from waychair.maps.grid.distance_field import DistanceField, distances, near_distances, update_near
from waychair.planning.body.clearance import COMFORTABLE, PLANNED, TOLD_APART
from waychair.planning.grid.grid_graph import FREE_PRICE, MAX_PRICE, NO_BARS, Prices, directions_against
from waychair.resumable import Resumable, ranges_of
from waychair.types import UNKNOWN, BoolArray, Bytes, Float32Array, FloatArray, IntArray, OccupancyGrid

WALL_PRICE = 5000
"""[per mille] Price added where the chair just fits: a detour in the open of up to six times the length is cheaper."""

UNKNOWN_PRICE = 9000
"""[per mille] Price added to an unknown cell: ten times as dear as a free one."""

_BAND_CELLS = 400_000
"""Cells of a band of `costmap_in_bands`: about 10 ms of a control period's 50."""

CRUISE = 0.8
"""[m/s] Speed in the open; the price of a slow zone is the ratio of this to the zone's speed."""


@dataclass(frozen=True, slots=True)
class Costmap:
    """Prices (H, W) int32 and clearance (H, W) float32 [m] of a grid's cells.

    Prices are per mille of a free cell's price; 0 is impassable. Clearance is measured between cell centres (see
    `maps.grid.distance_field`) to obstacles for the whole outline: map, keep-out zone or live, up to `TOLD_APART` at least.
    `grid` holds the live obstacles and keep-out zones too, and the geometry; `body` is the chair that the prices are
    for. `barred` (H, W) has one bit per direction as in `grid_graph` for the one-way zones, if there are any.
    `from_zones` (H, W) [m] are distances to slow and one-way zones, negative within, if there are any.
    """

    prices: Prices
    clearance: Float32Array
    grid: OccupancyGrid
    body: ChairBody
    barred: Bytes | None = None
    from_zones: Float32Array | None = None

    @property
    def field(self) -> DistanceField:
        """The clearance with its geometry, for the local planner."""
        return DistanceField(self.clearance, self.grid.resolution, self.grid.map_from_grid)

    def barred_on(self, field: DistanceField) -> Bytes:
        """Return `barred` on the cells of a finer field that divides this grid's; (0, 0) without a one-way zone."""
        if self.barred is None:
            return NO_BARS
        parts = round(self.grid.resolution / field.resolution)
        corner = self.grid.map_from_grid.inverse() @ field.map_from_grid
        top, left = round(corner.y / self.grid.resolution), round(corner.x / self.grid.resolution)
        height, width = field.metres.shape
        part = self.barred[top : top + height // parts, left : left + width // parts]
        return part.repeat(parts, axis=0).repeat(parts, axis=1)


def costmap_from_grid(
    grid: OccupancyGrid,
    body: ChairBody,
    live_points: FloatArray | None = None,
    zones: Sequence[Zone] = (),
    comfortable: float = COMFORTABLE,
) -> Costmap:
    """Return the costmap of a grid with its zones and present obstacles; see `LiveCostmap.costmap`."""
    return LiveCostmap(grid, body, zones, comfortable).costmap(live_points)


def costmap_in_bands(grid: OccupancyGrid, body: ChairBody, comfortable: float = COMFORTABLE) -> Resumable[Costmap]:
    """Return `costmap_from_grid` of a grid without zones and present obstacles, with a yield after each band of rows."""
    fixed, reach = occupied(grid), _reach(body, comfortable)
    clearance = np.empty(grid.cells.shape, np.float32)
    prices = np.empty(grid.cells.shape, np.int32)
    height, width = grid.cells.shape
    beside = math.ceil(reach / grid.resolution)
    yield
    for first, after in ranges_of(0, height, max(1, _BAND_CELLS // max(width, 1))):
        above = min(first, beside)
        near = near_distances(fixed[first - above : after + beside], grid.resolution, reach)
        band = slice(above, above + after - first), slice(None)
        clearance[first:after] = near[band]
        added = _added_prices(replace(grid, cells=grid.cells[first:after]), ())
        prices[first:after] = _priced(near, band, added, body, comfortable, grid.resolution)
        yield
    return Costmap(prices, clearance, grid, body)


def check_free_space(costmap: Costmap) -> None:
    """Refuse a costmap without a passable cell, or without a cell known to be free.

    Raises:
        NoFreeSpace: either is the case.
    """
    if not costmap.prices.any():
        raise NoFreeSpace(
            f"the map has no free space for a chair {costmap.body.width:.2f} m wide; map the building again, or remove "
            "its keep-out zones"
        )
    if not (costmap.grid.cells.view(np.uint8) < OCCUPIED_FROM).any():  # unknown cells are 255
        raise NoFreeSpace("no cell of the map is known to be free; map the building again, or correct its thresholds")


class LiveCostmap:
    """The costmap of a fixed map under live obstacles; only the surroundings of changed cells are computed anew."""

    def __init__(
        self, grid: OccupancyGrid, body: ChairBody, zones: Sequence[Zone] = (), comfortable: float = COMFORTABLE
    ) -> None:
        """`comfortable` [m]: the clearance from which a cell costs no more than open floor."""
        self._body, self._comfortable = body, comfortable
        self._grid = closed_off(grid, zones)
        self._reach = _reach(body, comfortable)
        self._fixed = occupied(self._grid)
        self._solid = self._fixed.copy()
        self._clearance = near_distances(self._fixed, grid.resolution, self._reach)
        self._added = _added_prices(grid, zones)
        self._barred = _barred_directions(grid, zones)
        self._from_zones = _from_zones(grid, zones)
        self._prices = self._priced(self._clearance, _EVERYWHERE)

    def costmap(
        self, live_points: FloatArray | None = None, layered: Sequence[tuple[BodyLayer, FloatArray]] = ()
    ) -> Costmap:
        """Return the costmap with `live_points` (N, 2) [m] in map as obstacles; those outside the map are ignored.

        `layered` obstacles exist only at the heights of one layer of the body; only that layer's outline has to pass
        them. A cell is impassable when a wall's face, half a cell nearer than its centre, leaves less than the half
        width and the planned clearance. From there the price falls with the square of the clearance still missing to
        the comfortable one, so that the middle of a door or corridor is cheapest.
        """
        cell = self._grid.resolution
        solid = self._fixed | _marked(self._grid, live_points)
        changed = cells_where(solid != self._solid)
        if len(changed):
            self._solid = solid
            self._clearance = self._clearance.copy()  # earlier costmaps keep theirs
            self._prices = self._prices.copy()
            for near in update_near(self._clearance, solid, changed, cell, self._reach):
                window = _beside(near)
                self._prices[window] = self._priced(self._clearance, window)
        cells = self._grid.cells
        if (solid & ~self._fixed).any():
            cells = cells.copy()
            cells[solid & ~self._fixed] = 100
        grid = OccupancyGrid(cells, cell, self._grid.map_from_grid)
        prices, clearance = self._prices, self._clearance
        for layer, points in layered:
            seen = cells_under(self._grid, points)
            if len(seen):
                if prices is self._prices:
                    prices, clearance = prices.copy(), clearance.copy()
                self._over(prices, clearance, layer, seen)
        return Costmap(prices, clearance, grid, self._body, self._barred, self._from_zones)

    def _over(self, prices: Prices, clearance: Float32Array, layer: BodyLayer, cells: IntArray) -> None:
        """Update prices and clearance for occupied cells (N, 2) that concern one layer of the body only.

        The layer is narrower than the whole outline; by that difference its obstacles count as farther away.
        """
        body, reach = self._body, math.ceil(self._reach / self._grid.resolution)
        (top, left), (bottom, right) = np.maximum(cells.min(axis=0) - reach, 0), cells.max(axis=0) + reach + 1
        near = slice(top, bottom), slice(left, right)
        mask = np.zeros(prices[near].shape, np.bool_)
        mask[cells[:, 0] - top, cells[:, 1] - left] = True
        away = near_distances(mask, self._grid.resolution, self._reach)
        beside = body.width / 2 - layer.half_width
        all_round = min(beside, body.front - layer.front, body.rear - layer.rear)
        added, cell = self._added[near], self._grid.resolution
        layer_prices = _priced(away + np.float32(beside), _EVERYWHERE, added, body, self._comfortable, cell)
        shut = (prices[near] == 0) | (layer_prices == 0)
        prices[near] = np.where(shut, 0, np.maximum(prices[near], layer_prices))
        clearance[near] = np.minimum(clearance[near], away + np.float32(all_round))

    def _priced(self, clearance: Float32Array, window: _Window) -> Prices:
        """Return the prices of a window's cells."""
        return _priced(clearance, window, self._added[window], self._body, self._comfortable, self._grid.resolution)


def _reach(body: ChairBody, comfortable: float) -> float:
    """Return the distance [m] up to which clearances are known."""
    return max(TOLD_APART, comfortable, body.circumscribed_radius)


_Window: TypeAlias = tuple[slice, slice]
"""Rows and columns of a part of a grid."""

_EVERYWHERE: _Window = slice(None), slice(None)


def _beside(window: _Window) -> _Window:
    """Return a window with the cells beside it whose gaps it may have changed."""
    rows, columns = window
    return slice(max(rows.start - 2, 0), rows.stop + 2), slice(max(columns.start - 2, 0), columns.stop + 2)


def _priced(
    clearance: Float32Array, window: _Window, added: Float32Array, body: ChairBody, comfortable: float, cell: float
) -> Prices:
    """Return the prices (H, W) of a window's cells with these prices without obstacles, by the clearances [m] of the whole grid."""
    needed = body.width / 2 + PLANNED + cell / 2 - 1e-5  # clearances are float32: a cell at just this distance passes
    within = clearance[window]
    missing = (comfortable - within) / max(comfortable - needed, 1e-6)
    prices = added + WALL_PRICE * np.clip(missing, 0.0, 1.0) ** 2
    narrow = within < needed
    if narrow.any():
        narrow &= ~_on_middle_line(clearance, window, needed, cell)
    prices[narrow] = 0
    rounded: Prices = np.minimum(np.rint(prices), MAX_PRICE).astype(np.int32)
    return rounded


def _on_middle_line(clearance: Float32Array, window: _Window, needed: float, cell: float) -> BoolArray:
    """Return which cells of a window have the middle line of a gap on their border, if it has the needed clearance [m] there.

    Across a gap of an even number of cells the middle lies between two cells. The distances on both sides rise towards it, and go on
    to rise for the half cell that is left.
    """
    near = clearance[window]
    found = np.zeros(near.shape, np.bool_)
    cells = np.argwhere((near >= needed - cell / 2) & (near < needed))
    corner = window[0].start or 0, window[1].start or 0
    for onwards in ((0, 1), (0, -1), (1, 0), (-1, 0)):
        # (4, N, 2): two cells on each side of the border
        across = cells + corner + np.multiply.outer((-1, 0, 1, 2), onwards)[:, None]
        inner = ((across >= 0) & (across < clearance.shape)).all(axis=(0, 2))
        outer, here, there, beyond = clearance[tuple(np.moveaxis(across[:, inner], 2, 0))]
        rises = np.minimum(here - outer, there - beyond) > cell / 2
        middle = np.minimum(here + (here - outer) / 2, there + (there - beyond) / 2)
        found[tuple(cells[inner].T)] |= rises & (middle >= needed)
    return found


def closed_off(grid: OccupancyGrid, zones: Sequence[Zone]) -> OccupancyGrid:
    """Return the grid with its keep-out zones occupied; the grid itself where there are none."""
    closed = keep_out_cells(zones, grid)
    if not closed.any():
        return grid
    return OccupancyGrid(np.where(closed, np.int8(100), grid.cells), grid.resolution, grid.map_from_grid)


def _added_prices(grid: OccupancyGrid, zones: Sequence[Zone]) -> Float32Array:
    """Return (H, W) each cell's price without obstacles: unknown cells cost more, slow zones in proportion to time."""
    prices = np.full(grid.cells.shape, FREE_PRICE, np.float32)
    for zone in zones:
        if zone.rule is Rule.SLOW:
            part, within = zone_cells(zone, grid)
            price = np.float32(FREE_PRICE * max(CRUISE / zone.value, 1.0))
            prices[part] = np.where(within, np.maximum(prices[part], price), prices[part])
    prices[grid.cells == UNKNOWN] += UNKNOWN_PRICE
    return prices


def _barred_directions(grid: OccupancyGrid, zones: Sequence[Zone]) -> Bytes | None:
    """Return (H, W) forbidden directions of travel as bits; None where there is no one-way zone."""
    if not any(zone.rule is Rule.ONE_WAY for zone in zones):
        return None
    barred = np.zeros(grid.cells.shape, np.uint8)
    for zone in zones:
        if zone.rule is Rule.ONE_WAY:
            part, within = zone_cells(zone, grid)
            barred[part] |= within * np.uint8(directions_against(zone.value - grid.map_from_grid.theta))
    return barred


def _from_zones(grid: OccupancyGrid, zones: Sequence[Zone]) -> Float32Array | None:
    """Return (H, W) [m] distances to slow and one-way zones, negative within; None where there is no such zone."""
    within = np.zeros(grid.cells.shape, np.bool_)
    for zone in zones:
        if zone.rule in (Rule.SLOW, Rule.ONE_WAY):
            part, inside = zone_cells(zone, grid)
            within[part] |= inside
    if not within.any():
        return None
    return distances(within, grid.resolution) - distances(~within, grid.resolution)


def _marked(grid: OccupancyGrid, points: FloatArray | None) -> BoolArray:
    """Return (H, W) the cells under points (N, 2) [m] in map; points outside are ignored."""
    mask = np.zeros(grid.cells.shape, np.bool_)
    if points is not None and len(points):
        mask[tuple(cells_under(grid, points).T)] = True
    return mask
