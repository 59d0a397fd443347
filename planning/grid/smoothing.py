"""Straightening a chain of cells without losing the clearance that its prices ensure.

Points are (N, 2) columns and rows in cell units: (0.5, 0.5) is the centre of cell (0, 0).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from waychair.planning.grid.grid_graph import FREE_PRICE, Prices
from waychair.types import Bytes, FloatArray, IntArray

_SAMPLES_PER_CELL = 4
_REACH = 400
"""Most points that a shortcut may skip; each further try skips three quarters of the last."""


@njit(cache=True)
def line_cost(prices: Prices, x0: float, y0: float, x1: float, y1: float, barred: Bytes | None) -> float:
    """Return price times length [cells of free floor] of a line; infinite through impassable cells or off the map.

    Also infinite through cells whose `barred` directions (see `grid_graph`) include the line's, rounded to one of
    eight. Sampled every quarter of a cell with equal weights.
    """
    height, width = prices.shape
    if min(x0, x1) < 0 or min(y0, y1) < 0 or max(x0, x1) >= width or max(y0, y1) >= height:
        return math.inf
    length = math.hypot(x1 - x0, y1 - y0)
    count = max(math.ceil(length * _SAMPLES_PER_CELL), 1)
    direction = round(math.atan2(y1 - y0, x1 - x0) / (math.pi / 4)) % 8
    total = 0
    for i in range(count):
        fraction = (i + 0.5) / count
        row, column = int(y0 + fraction * (y1 - y0)), int(x0 + fraction * (x1 - x0))
        price = prices[row, column]
        if price == 0 or (barred is not None and barred[row, column] >> direction & 1):
            return math.inf
        total += price
    return length * total / (count * FREE_PRICE)


@njit(cache=True, nogil=True)
def pull_taut(prices: Prices, points: FloatArray, barred: Bytes | None = None) -> IntArray:
    """Return the indices of the points to keep: from each one, a far one that costs no more in a straight line.

    Costs are the costmap's prices, so a path in the middle of a corridor stays there. A step that is impassable from
    the beginning (leaving a wall) is kept.
    """
    count = len(points)
    along = np.zeros(count)
    for i in range(1, count):
        cost = line_cost(prices, points[i - 1, 0], points[i - 1, 1], points[i, 0], points[i, 1], None)
        # An impassable step costs more than any shortcut across it could save.
        along[i] = along[i - 1] + (cost if cost < math.inf else 0.0)
    kept = np.zeros(count, np.int64)
    used = 1
    here = 0
    while here < count - 1:
        reach = min(_REACH, count - 1 - here)
        while reach > 1:
            far = here + reach
            direct = line_cost(prices, points[here, 0], points[here, 1], points[far, 0], points[far, 1], barred)
            if direct <= (along[far] - along[here]) * (1 + 1e-6):
                break
            reach = 3 * reach // 4
        following = here + max(reach, 1)
        kept[used] = following
        used += 1
        here = following
    return kept[:used]


@njit(cache=True, nogil=True)
def round_corners(prices: Prices, points: FloatArray, passes: int, barred: Bytes | None = None) -> FloatArray:
    """Return the points moved towards the middle of their neighbours, where that is passable and costs no more.

    The ends stay, and no line may lead in a `barred` direction.
    """
    moved = points.copy()
    for _ in range(passes):
        for i in range(1, len(moved) - 1):
            x = 0.5 * moved[i, 0] + 0.25 * (moved[i - 1, 0] + moved[i + 1, 0])
            y = 0.5 * moved[i, 1] + 0.25 * (moved[i - 1, 1] + moved[i + 1, 1])
            now = prices[int(moved[i, 1]), int(moved[i, 0])]
            then = prices[int(y), int(x)]
            before = line_cost(prices, moved[i - 1, 0], moved[i - 1, 1], x, y, barred)
            after = line_cost(prices, x, y, moved[i + 1, 0], moved[i + 1, 1], barred)
            if 0 < then <= max(now, FREE_PRICE) and before < math.inf and after < math.inf:
                moved[i, 0], moved[i, 1] = x, y
    return moved
