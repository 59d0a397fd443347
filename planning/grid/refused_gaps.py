"""Gaps that are wide enough for the search over the cells, but that the whole chair does not pass: they are dear at once."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from waychair.errors import NoPath
from waychair.maps.grid.cells import cells_from_points, inside
from waychair.planning.grid.costmap import Costmap
from waychair.planning.grid.grid_graph import MAX_PRICE
from waychair.types import Float32Array, FloatArray, IntArray, Pose2

_GAP, _BEFORE_CHAIR, _OF_PLACE = 0.3, 0.8, 1.5
"""[m] Radius round the middle of a refused gap in which cells are dear; a gap is no nearer to the chair than the second, and
no farther than the third from the place where the chair does not fit: what lies ahead is refused where it cannot set off."""

_ROUND_GAP, _WIDER = 1.0, 2.5
"""[m] Surroundings of a refused gap where nothing may go away, and the cells by which the noise of a scan changes a clearance."""


@dataclass(frozen=True, slots=True)
class RefusedGap:
    """A gap with its middle (2,) [m] in map, wide enough for the cells' search, that the whole chair does not pass.

    `clearance` (N,) [m] is that of its surroundings then; `error` says why the chair does not fit.
    """

    place: FloatArray
    clearance: Float32Array
    error: NoPath

    def is_on(self, line: FloatArray) -> bool:
        """Return whether a line (N, 2) [m] leads through it."""
        return bool((np.hypot(*(line - self.place).T) < _GAP).any())

    def is_as_narrow(self, costmap: Costmap) -> bool:
        """Return whether nothing round it has gone."""
        now = costmap.clearance[_cells_round(costmap, self.place, _ROUND_GAP)]
        wider = _WIDER * costmap.grid.resolution
        return len(now) == len(self.clearance) and float((now - self.clearance).max(initial=0.0)) < wider


def refused_on(line: FloatArray, here: Pose2, error: NoPath, costmap: Costmap) -> RefusedGap | None:
    """Return the gap on a line (N, 2) [m] that an error is about; None if it is about none on the way."""
    if error.place is None:
        return None
    off = np.hypot(*(line - error.place).T)
    off[np.hypot(*(line - (here.x, here.y)).T) < _BEFORE_CHAIR] = math.inf
    k = int(np.argmin(off))
    if off[k] > _OF_PLACE:
        return None
    return RefusedGap(line[k], costmap.clearance[_cells_round(costmap, line[k], _ROUND_GAP)], error)


def with_dear_gaps(costmap: Costmap, gaps: Sequence[RefusedGap]) -> Costmap:
    """Return the costmap with these gaps at the highest price."""
    if not gaps:
        return costmap
    prices = costmap.prices.copy()
    for gap in gaps:
        at = _cells_round(costmap, gap.place, _GAP)
        prices[at] = np.where(prices[at] > 0, MAX_PRICE, 0)
    return replace(costmap, prices=prices)


def _cells_round(costmap: Costmap, place: FloatArray, within: float) -> tuple[IntArray, IntArray]:
    """Return rows and columns of the cells within a distance [m] of a place (2,) [m] in map."""
    reach = math.ceil(within / costmap.grid.resolution)
    around = np.indices((2 * reach + 1, 2 * reach + 1)).reshape(2, -1).T - reach
    cells = cells_from_points(costmap.grid, place[None]) + around[np.hypot(*around.T) <= reach]
    rows, columns = cells[inside(costmap.grid, cells)].T
    return rows, columns
