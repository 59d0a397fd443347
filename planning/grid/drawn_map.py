"""A map with the zones drawn on it, prepared for planning."""

from __future__ import annotations

from collections.abc import Sequence

from waychair.calibration.chair_body import BodyLayer, ChairBody
from waychair.maps.drawn.zones import Zone
from waychair.maps.grid.cells import occupied
from waychair.maps.grid.distance_field import DistanceField, are_within, distances
from waychair.planning.body.clearance import COMFORTABLE
from waychair.planning.body.footprint import fits_each
from waychair.planning.grid.costmap import Costmap, LiveCostmap, closed_off
from waychair.types import BoolArray, FloatArray, OccupancyGrid


class DrawnMap:
    """The grid with its keep-out zones occupied, and its costmap; `bare` is the grid without them.

    Construction takes many control periods: do it outside the control loop.
    """

    def __init__(
        self, grid: OccupancyGrid, body: ChairBody, zones: Sequence[Zone] = (), comfortable: float = COMFORTABLE
    ) -> None:
        self.bare, self.zones, self.body = grid, tuple(zones), body
        self.grid = closed_off(grid, zones)
        self._from_things = self._from_known = distances(occupied(grid), grid.resolution)
        if self.grid is not grid:
            thin = _thin(occupied(self.grid) & ~occupied(grid), grid.resolution)
            self._from_known = distances(occupied(grid) | thin, grid.resolution)
        self._costmaps = LiveCostmap(grid, body, zones, comfortable)

    def costmap(
        self, live_points: FloatArray | None = None, layered: Sequence[tuple[BodyLayer, FloatArray]] = ()
    ) -> Costmap:
        """Return the costmap with live obstacles; see `LiveCostmap.costmap`."""
        return self._costmaps.costmap(live_points, layered)

    def fits_each(self, poses: FloatArray, margin: float) -> BoolArray:
        """Return (N,) whether the chair's outline with a margin [m] fits at poses (N, 3) in map, without live obstacles."""
        field = DistanceField(self._from_known, self.grid.resolution, self.grid.map_from_grid)
        return fits_each(self.body, margin, field, poses)

    def is_mapped(self, points: FloatArray, within: float) -> BoolArray:
        """Return (N,) which points (N, 2) [m] in map are within a distance [m] of a mapped obstacle; zones are none."""
        return are_within(self._from_things, self.grid, points, within)

    def is_explained(self, points: FloatArray, within: float | FloatArray) -> BoolArray:
        """Return as `is_mapped`, but with keep-out zones too narrow for a person counting as obstacles, too.

        Such a zone is drawn around an obstacle such as glass. Glass is seen only where a beam meets it squarely, and
        that place moves with the chair like a person. within [m]: for all points, or (N,) for each.
        """
        return are_within(self._from_known, self.grid, points, within)


_ANYBODY = 0.25
"""A person may be where a disc of this radius [m] has room."""


def _thin(closed: BoolArray, resolution: float) -> BoolArray:
    """Return (H, W) the cells of a mask that no person's disc within it covers."""
    deep = distances(~closed, resolution) >= _ANYBODY
    return closed & ~(distances(deep, resolution) < _ANYBODY)
