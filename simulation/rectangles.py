"""Solid things from a grid: its occupied cells as few upright blocks."""

from __future__ import annotations

import numpy as np

from waychair.maps.grid import occupied
from waychair.simulation.scene import Block, Finish
from waychair.simulation.seeds import seed_of
from waychair.types import BoolArray, IntArray, OccupancyGrid, Pose2


def blocks_from_grid(grid: OccupancyGrid, name: str, finish: Finish) -> tuple[Block, ...]:
    """Blocks from the floor to the ceiling that cover the occupied cells exactly; `name` makes their seeds."""
    side = grid.resolution
    return tuple(
        Block(
            grid.map_from_grid @ Pose2((col + width / 2) * side, (row + height / 2) * side, 0.0),
            width * side,
            height * side,
            0.0,
            finish.height,
            seed=seed_of(name, "cells", i),
        )
        for i, (row, col, height, width) in enumerate(rectangles_from_cells(occupied(grid)).tolist())
    )


def rectangles_from_cells(cells: BoolArray) -> IntArray:
    """Few disjoint rectangles (N, 4) of row, column, height, width [cells] that cover the set cells (H, W) exactly.

    Greedy: from the first cell left over, the larger of the widest and the tallest rectangle that starts there.
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
    """Number of leading set values of (N,)."""
    return len(mask) if mask.all() else int(np.argmin(mask))
