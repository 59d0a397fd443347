"""A floor plan as a map of 1 m cells, for planners on grids: a chair fills one cell and drives to the next in 3 s.

Cell (x, y) has its middle at the whole metres x, y. Corridors are one cell wide; each room is one cell beside them.
"""

from __future__ import annotations

import numpy as np

from waychair.maps.traffic.corridors import CorridorPlan, corridor_cells, room_doors
from waychair.types import BoolArray

CELL_S = 3.0
"""s; one cell at the paper's 0.33 m/s."""


def free_cells(plan: CorridorPlan, *, rooms: bool = True) -> BoolArray:
    """Return which cells (H, W) of a plan are free, row 0 at y = 0."""
    width, height = (int(np.ceil(side)) + 1 for side in plan.size)
    free = np.zeros((height, width), dtype=bool)
    for x, y in corridor_cells(plan):
        free[y, x] = True
    if rooms:
        for x, y in room_cells(plan).values():
            free[y, x] = True
    return free


def room_cells(plan: CorridorPlan) -> dict[str, tuple[int, int]]:
    """Return the cell (x, y) of each room by its name."""
    return {name: (round(place[0]), round(place[1])) for name, (_, place) in room_doors(plan).items()}


def moving_ai_text(free: BoolArray) -> str:
    """Return cells (H, W), row 0 at y = 0, as the text of a Moving AI `.map` file, whose first row is the top one."""
    height, width = free.shape
    rows = ["".join("." if cell else "@" for cell in row) for row in free[::-1]]
    return "\n".join(["type octile", f"height {height}", f"width {width}", "map", *rows]) + "\n"
