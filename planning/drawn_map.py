"""A map with what people have drawn on it, made ready to plan on."""

from __future__ import annotations

from collections.abc import Sequence

from waychair.calibration.chair import BodyLayer, ChairBody
from waychair.maps.distance_field import are_within, distances
from waychair.maps.grid import occupied
from waychair.maps.zones import Zone
from waychair.planning.costmap import Costmap, CostmapSettings, LiveCostmap, closed_off
from waychair.types import BoolArray, FloatArray, OccupancyGrid


class DrawnMap:
    """The grid with its keep-out zones closed, and its costmap.

    Making one takes as long as many control steps: who drives has somebody else make it.
    """

    def __init__(
        self, grid: OccupancyGrid, body: ChairBody, settings: CostmapSettings, zones: Sequence[Zone] = ()
    ) -> None:
        self.grid = closed_off(grid, zones)
        self._from_things = self._from_known = distances(occupied(grid), grid.resolution)
        if self.grid is not grid:
            thin = _thin(occupied(self.grid) & ~occupied(grid), grid.resolution)
            self._from_known = distances(occupied(grid) | thin, grid.resolution)
        self._costmaps = LiveCostmap(grid, body, settings, zones)

    def costmap(
        self, live_points: FloatArray | None = None, layered: Sequence[tuple[BodyLayer, FloatArray]] = ()
    ) -> Costmap:
        """Under obstacles that come and go; see `LiveCostmap.costmap`."""
        return self._costmaps.costmap(live_points, layered)

    def shows(self, points: FloatArray, within: float) -> BoolArray:
        """(N,) which of points (N, 2) [m] in map are within so much [m] of a thing that the map shows; zones are none."""
        return are_within(self._from_things, self.grid, points, within)

    def explains(self, points: FloatArray, within: float | FloatArray) -> BoolArray:
        """As `shows`, and of points at a keep-out zone too narrow for anybody to be in: it is drawn round what they show.

        Glass shows where a beam meets it squarely, and that place moves with the chair like somebody who walks. within:
        of all, or (N,) of each.
        """
        return are_within(self._from_known, self.grid, points, within)


_ANYBODY = 0.25
"""Where there is room for a disc of this radius [m], somebody may be."""


def _thin(closed: BoolArray, resolution: float) -> BoolArray:
    """(H, W) the cells of a mask that no such disc within it covers."""
    deep = distances(~closed, resolution) >= _ANYBODY
    return closed & ~(distances(deep, resolution) < _ANYBODY)
