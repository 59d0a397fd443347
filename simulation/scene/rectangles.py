"""Covers the occupied cells of a grid with few upright blocks."""

from __future__ import annotations

import numpy as np

from waychair.maps.grid.cells import occupied
from waychair.simulation.scene.scene import Block, Finish
from waychair.simulation.scene.seeds import seed_from_names
from waychair.types import BoolArray, IntArray, OccupancyGrid, Pose2


def blocks_from_grid(grid: OccupancyGrid, name: str, finish: Finish) -> tuple[Block, ...]:
    """Return blocks from floor to ceiling that cover the occupied cells exactly; their seeds derive from `name`."""
    side = grid.resolution
    return tuple(
        Block(
            grid.map_from_grid @ Pose2((col + width / 2) * side, (row + height / 2) * side, 0.0),
            width * side,
            height * side,
            0.0,
            finish.height,
            seed=seed_from_names(name, "cells", i),
        )
        for i, (row, col, height, width) in enumerate(rectangles_from_cells(occupied(grid)).tolist())
    )


def rectangles_from_cells(cells: BoolArray) -> IntArray:
    """Return few disjoint rectangles (N, 4), row, column, height, width [cells], that cover the set cells (H, W).

    Greedy: from the first uncovered cell, the larger of the widest and the tallest rectangle that starts there.
    """
    left = cells.copy()
    rectangles = []
    for row, col in np.argwhere(cells).tolist():
        if not left[row, col]:
            continue
        wide, tall = _run(left[row, col:]), _run(left[row:, col])
        reach = left[row : row + tall, col : col + wide]
        widest, tallest = (_run(np.all(reach, axis=1)), wide), (tall, _run(np.all(reach, axis=0)))
        height, width = max(widest, tallest, key=lambda shape: shape[0] * shape[1])
        left[row : row + height, col : col + width] = False
        rectangles.append((row, col, height, width))
    return np.array(rectangles, np.int64).reshape(-1, 4)


def _run(mask: BoolArray) -> int:
    """Return the number of leading set values of (N,)."""
    return len(mask) if mask.all() else int(np.argmin(mask))
