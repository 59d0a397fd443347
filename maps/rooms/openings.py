"""Openings between rooms: the narrowest place of each, its two jambs and its width."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from waychair.maps.grid.cells import points_from_cells
from waychair.maps.rooms.basins import Basins, Labels, edge_cells
from waychair.types import BoolArray, FloatArray, IntArray, OccupancyGrid

NARROWEST, WIDEST = 0.6, 1.65
"""Widths [m] of a door: from less than any chair passes, to a double door of 1.6 m; a wider opening is no door. Both
leave 5 cm, one cell, for the measurement."""

LEAST_GAP = 0.3
"""An opening below this width [m] is a leak of the map, such as a slanted wall one cell thick."""


@dataclass(frozen=True, slots=True)
class Opening:
    """A narrow place between two rooms, or within one: a door across a corridor.

    Attributes:
        rooms: numbers of the two rooms, the smaller first; twice the same number within a room.
        middle: (2,) [m] in map, half way between the jambs.
        jambs: (2, 2) [m] in map, the facing sides of the walls left and right.
        width: clear width between the jambs [m].
    """

    rooms: tuple[int, int]
    middle: FloatArray
    jambs: FloatArray
    width: float

    @property
    def is_door(self) -> bool:
        """Whether it is as wide as doors are."""
        return NARROWEST <= self.width <= WIDEST


def openings_between(basins: Basins, numbers: Labels, walls: BoolArray, grid: OccupancyGrid) -> tuple[Opening, ...]:
    """Return the openings in order of their rooms; a pair of rooms may have several.

    Args:
        basins: openings are the edges between basins.
        numbers: (N + 1,) the number of the room that each basin is part of, 0 for none.
        walls: (H, W) cells of walls.
        grid: gives the geometry.
    """
    cells, pairs, widths = edge_cells(basins.labels, basins.clearance)
    pairs = np.sort(numbers[pairs].astype(np.int64), axis=1)
    real = pairs[:, 0] > 0
    cells, pairs, widths = cells[real], pairs[real], widths[real]
    if not len(cells):
        return ()
    order = np.lexsort((cells[:, 1], cells[:, 0], pairs[:, 1], pairs[:, 0]))
    cells, pairs, widths = cells[order], pairs[order], widths[order]
    begins = np.flatnonzero(np.r_[True, (np.diff(pairs, axis=0) != 0).any(axis=1)])
    found = []
    for begin, end in zip(begins, [*begins[1:], len(pairs)], strict=True):
        one, other = pairs[begin].tolist()
        for part in _parts(cells[begin:end]):
            at = begin + part[np.argmax(widths[begin + part])]
            opening = _opening((one, other), cells[at], float(widths[at]), walls, grid)
            if opening is not None and opening.width >= LEAST_GAP:
                found.append(opening)
    return tuple(found)


def _parts(cells: IntArray) -> list[IntArray]:
    """Return the indices of the 8-connected parts of cells (N, 2)."""
    low = cells.min(axis=0)
    size = cells.max(axis=0) - low + 1
    mask = np.zeros(size, np.uint8)
    mask[tuple((cells - low).T)] = 1
    # cells one apart are joined too: an edge may step over a corner
    count, parts = cv2.connectedComponents(cv2.dilate(mask, np.ones((3, 3), np.uint8)), connectivity=8)
    which = parts[tuple((cells - low).T)]
    return [np.flatnonzero(which == part) for part in range(1, count)]


def _opening(
    rooms: tuple[int, int], cell: IntArray, clearance: float, walls: BoolArray, grid: OccupancyGrid
) -> Opening | None:
    """Return the opening at a saddle (row, column); None where it has a wall on one side only."""
    reach = math.ceil(1.5 * clearance / grid.resolution) + 2
    low = np.maximum(cell - reach, 0)
    near = np.argwhere(walls[low[0] : cell[0] + reach + 1, low[1] : cell[1] + reach + 1]) + low
    if not len(near):
        return None
    one = _nearest(near, cell)
    for _ in range(2):  # the second jamb of the first, and the first of the second
        beyond = near[(near - cell) @ (one - cell) < -0.5 * np.linalg.norm(one - cell)]
        if not len(beyond):
            return None
        one, other = _nearest(beyond, one), one
    centres = points_from_cells(grid, np.array([one, other]))
    across = centres[1] - centres[0]
    length = float(np.hypot(*across))
    half_cell = across / length * (grid.resolution / 2)
    jambs = np.array([centres[0] + half_cell, centres[1] - half_cell])
    return Opening(rooms, jambs.mean(axis=0), jambs, length - grid.resolution)


def _nearest(cells: IntArray, to: IntArray) -> IntArray:
    nearest: IntArray = cells[np.argmin(((cells - to) ** 2).sum(axis=1))]
    return nearest
