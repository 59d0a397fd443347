"""The harmonic field as a grid planner, with the interface of D* Lite.

Prices enter as absorption: an impassable cell absorbs everything, a cell dearer than free floor a part of the flow
through it, so that paths avoid a cell the more the dearer it is.
"""

from __future__ import annotations

import cv2
import numpy as np

from waychair.errors import NoPath
from waychair.planning.grid.grid_graph import (
    DIAGONAL,
    FREE_PRICE,
    STRAIGHT,
    Cell,
    Prices,
    check_changes,
    check_prices,
    padded_index,
)
from waychair.planning.harmonic.harmonic_field import HarmonicSettings, LogField, descend, log_field_resumably
from waychair.planning.harmonic.laplace_solvers import HasTime, LaplaceProblem
from waychair.resumable import CELLS_PER_STEP, Resumable, finished, in_time_slices
from waychair.types import Bytes, Float32Array, IntArray

ABSORBED = 2e-3
"""Absorption of a cell of twice the price of free floor: ten such cells together act as a small part of a wall."""


def absorption_from_prices(prices: Prices) -> Float32Array:
    """Return absorption (H, W) float32 of cells with prices (H, W): 0 for free floor, infinite if impassable."""
    dearer = (prices.astype(np.float32) / np.float32(FREE_PRICE) - 1) * np.float32(ABSORBED)
    absorbed: Float32Array = np.where(prices > 0, np.maximum(dearer, 0), np.inf).astype(np.float32)
    return absorbed


_NEAR = 20
"""Largest distance [cells] of a start from the solved cells."""


class HarmonicSearch:
    """A planner with the interface of `DStarLite` over a harmonic field that is kept as a warm start for the next.

    Raises (constructor):
        ValueError: a cell outside the grid, an impossible price.
    """

    def __init__(
        self,
        prices: Prices,
        goal: Cell,
        start: Cell,
        barred: Bytes | None = None,
        settings: HarmonicSettings | None = None,
    ) -> None:
        check_prices(prices)
        for cell in (goal, start):
            padded_index(cell, prices.shape)
        self._prices, self._barred = prices.copy(), barred
        self._goal, self._start = goal, start
        self._settings = settings or HarmonicSettings()
        self._field: LogField | None = None
        self._solved_for, self._stale = start, True
        self._cells: IntArray | None = None
        self.pops = 0

    def move_start(self, cell: Cell) -> None:
        """Start the next `replan` from this cell."""
        padded_index(cell, self._prices.shape)
        self._start, self._cells = cell, None

    def update(self, cells: IntArray, prices: Prices) -> None:
        """Give cells (N, 2) new prices (N,)."""
        check_changes(cells, prices, self._prices.shape)
        self._prices[cells[:, 0], cells[:, 1]] = prices
        self._stale, self._cells = True, None

    def prepare(self, has_time: HasTime | None = None) -> Resumable[None]:
        """Solve the field, resumably, if prices have changed or the start is far from the solved cells.

        If the work is abandoned, the previous field is kept.

        Raises:
            MapTooLarge, NotConverged: see `log_field_resumably`.
        """
        if not self._connectable:
            return
        if self._field is None or self._stale or not (self._start == self._solved_for or self._solved_near()):
            problem = LaplaceProblem(absorption_from_prices(self._prices), self._goal)
            start = self._start
            work = log_field_resumably(
                problem=problem,
                settings=self._settings,
                warm_start=self._field,
                until=start,
                barred=self._barred,
                has_time=has_time,
            )
            found = yield from in_time_slices(work, CELLS_PER_STEP)
            self._field, self._solved_for, self._stale = found, start, False
            self.pops += found.sweeps * found.connected

    def _solved_near(self) -> bool:
        """Return whether cells near the start, on its side of the walls, are solved."""
        assert self._field is not None
        row, column = self._start
        top, left = max(row - _NEAR, 0), max(column - _NEAR, 0)
        about = (slice(top, row + _NEAR + 1), slice(left, column + _NEAR + 1))
        open_cells = np.isfinite(self._field.logs[about]).view(np.uint8)
        _, rooms = cv2.connectedComponents(open_cells, connectivity=4)
        return bool((self._field.solved[about] & (rooms == rooms[row - top, column - left]) & (rooms > 0)).any())

    def replan(self) -> int:
        """Return the cost of the field's path in the searches' unit; it is not the least possible.

        Raises:
            NoPath: the start is not connected to the goal.
            MapTooLarge, NotConverged: see `prepare`.
        """
        self._cells = None
        finished(self.prepare())
        if self._field is None or not self._connectable:
            raise NoPath("start and goal are not connected by passable cells; clear the way or choose another goal")
        self._cells = descend(self._field, self._start)
        return _cost(self._prices, self._cells)

    @property
    def _connectable(self) -> bool:
        """Whether both ends are passable."""
        return bool(self._prices[self._start] != 0 and self._prices[self._goal] != 0)

    def path(self) -> IntArray:
        """Return the cells (N, 2) of the present plan; raises `NoPath`."""
        if self._cells is None:
            raise NoPath("there is no plan; call replan first")
        return self._cells


def _cost(prices: Prices, cells: IntArray) -> int:
    """Return the sum of the steps' costs, as in `grid_graph`."""
    along = prices[cells[:, 0], cells[:, 1]].astype(np.int64)
    diagonal = (np.diff(cells, axis=0) != 0).all(axis=1)
    both = along[:-1] + along[1:]
    steps = np.where(diagonal, DIAGONAL // 2 * both // FREE_PRICE, STRAIGHT // (2 * FREE_PRICE) * both)
    return int(steps.sum())
