"""The loops of the local view: fans laid on a layer's grids, their points, and the ground that was seen to be free.

Grids are (SIDE, SIDE) cells of `CELL` [m] in odom; `x` and `y` [m] are the chair's place from the grid's corner, `c` and
`s` cosine and sine of its heading. Stamps in grids are milliseconds of a clock that begins with them: small grids are
copied fast.
"""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np
from numba import njit
from numpy.typing import NDArray

from waychair.maps.grid.cells import OCCUPIED_FROM
from waychair.types import BoolArray, Bytes, Cells, FloatArray, IntArray

Stamps: TypeAlias = NDArray[np.int32]

CELL, SIDE = 0.05, 100
"""m and cells; the grid reaches 2.5 m to each side, beyond the longest orientation."""

NEVER = -(1 << 31)
"""Stamp of a cell that was never seen or hit."""

_MM = 1e-3
"""m; unit of the place of a hit in its cell."""

KEPT, _APART = 4, 0.004
"""Hits that are kept in a cell: a part's first, last and nearest to the sensor, and one of before that it did not look at.
Two within the distance [m] count as one. By one hit alone the edge of a post could lie almost a cell nearer."""

_BEYOND = 0.02
"""m; a hit is gone if beams end farther than it by this, and hidden if they end nearer by this: less is noise."""

_SPREAD = 1.5
"""Half widths of a beam in which a cell's middle must lie for the beam to tell of it."""

_BINS = 2048
"""Directions round a sensor, a third of a degree each at most: less than half a cell at the grid's edge."""


@njit(cache=True, inline="always")
def direction_part(dx: float, dy: float, parts: int) -> int:
    """Return the part of a direction: parts rise with the angle, and are equal on the square |x| + |y| = 1 round it.

    It needs no trigonometry. A part is between 4 / parts and 8 / parts [rad] wide.
    """
    length = abs(dx) + abs(dy)
    if length == 0.0:
        return 0
    along = dy / length
    part = along if dx >= 0.0 else 2.0 - along
    return int((part + 1.0) * (parts / 4)) % parts


@njit(cache=True, inline="always")
def _passed(places: Bytes, x: float, y: float, far: FloatArray) -> bool:
    """Return whether beams pass all hits kept in a cell whose corner lies at (x, y) [m] from the sensor.

    `far` (_BINS,) [m²] holds squared ranges by direction. A beam past the cell's middle may still miss a corner in it.
    """
    for each in range(KEPT):
        dx, dy = x + places[2 * each] * _MM, y + places[2 * each + 1] * _MM
        beyond = math.hypot(dx, dy) + _BEYOND
        if beyond * beyond >= far[direction_part(dx, dy, _BINS)]:
            return False
    return True


@njit(cache=True, inline="always")
def _not_looked_at(places: Bytes, x: float, y: float, far: FloatArray) -> int:
    """Return the number of a hit kept in a cell that lies beside or behind all beams, an older one first; -1: none."""
    for k in range(KEPT):
        each = (k + KEPT - 1) % KEPT
        dx, dy = x + places[2 * each] * _MM, y + places[2 * each + 1] * _MM
        reached = far[direction_part(dx, dy, _BINS)]
        if reached < 0.0 or math.sqrt(reached) + _BEYOND < math.hypot(dx, dy):
            return each
    return -1


@njit(cache=True, nogil=True)
def lay(
    seen: Stamps,
    hit: Stamps,
    offset: Bytes,
    thing: Bytes,
    origins: FloatArray,
    starts: IntArray,
    ends: FloatArray,
    near: FloatArray,
    hits: BoolArray,
    half_angles: FloatArray,
    things: IntArray,
    clears: BoolArray,
    x: float,
    y: float,
    c: float,
    s: float,
    stamp: int,
) -> None:
    """Mark the cells whose middle all neighbouring beams pass as seen, then the cells of hits, fan by fan.

    A cell with a hit is seen only if beams pass the hit as well. `offset` (SIDE, SIDE, 2 * KEPT) [mm] are its hits' places.
    `origins` (F, 2) and `ends` (N, 2) [m] are in base, and the beams of fan f are those from `starts[f]` to
    `starts[f + 1]`. `near` (N,) [m]: distance from which a beam tells of free ground. Ends that are not finite say nothing.
    """
    size = seen.shape[0]
    far, begin = np.empty(_BINS), np.empty(_BINS)  # squared
    for fan in range(len(origins)):
        first_beam, last_beam = starts[fan], starts[fan + 1]
        ox, oy = x + c * origins[fan, 0] - s * origins[fan, 1], y + s * origins[fan, 0] + c * origins[fan, 1]
        if clears[fan]:
            far[:] = -1.0
            begin[:] = 0.0
            reach = 0.0
            low_x = high_x = ox
            low_y = high_y = oy
            turn_c, turn_s = math.cos(_SPREAD * half_angles[fan]), math.sin(_SPREAD * half_angles[fan])
            for i in range(first_beam, last_beam):
                ex, ey = ends[i, 0], ends[i, 1]
                if not (math.isfinite(ex) and math.isfinite(ey)):
                    continue
                px, py = x + c * ex - s * ey, y + s * ex + c * ey
                low_x, high_x, low_y, high_y = min(low_x, px), max(high_x, px), min(low_y, py), max(high_y, py)
                dx, dy = px - ox, py - oy
                squared = dx * dx + dy * dy
                reach = max(reach, squared)
                place = direction_part(turn_c * dx + turn_s * dy, turn_c * dy - turn_s * dx, _BINS)
                last = direction_part(turn_c * dx - turn_s * dy, turn_c * dy + turn_s * dx, _BINS)
                while True:
                    if far[place] < 0.0 or squared < far[place]:
                        far[place] = squared
                    begin[place] = max(begin[place], near[i] * near[i])
                    if place == last:
                        break
                    place = place + 1 if place + 1 < _BINS else 0
            first_row, last_row = max(math.floor(low_y / CELL), 0), min(math.floor(high_y / CELL) + 1, size)
            first_col, last_col = max(math.floor(low_x / CELL), 0), min(math.floor(high_x / CELL) + 1, size)
            for row in range(first_row, last_row):
                dy = (row + 0.5) * CELL - oy
                for col in range(first_col, last_col):
                    dx = (col + 0.5) * CELL - ox
                    squared = dx * dx + dy * dy
                    if squared < reach:
                        place = direction_part(dx, dy, _BINS)
                        if begin[place] <= squared < far[place] and stamp > seen[row, col]:
                            stands = hit[row, col] > NEVER and hit[row, col] >= seen[row, col]
                            if not stands or _passed(offset[row, col], col * CELL - ox, row * CELL - oy, far):
                                seen[row, col] = stamp
        for i in range(first_beam, last_beam):
            ex, ey = ends[i, 0], ends[i, 1]
            if hits[i] and math.isfinite(ex) and math.isfinite(ey):
                px, py = x + c * ex - s * ey, y + s * ex + c * ey
                col, row = math.floor(px / CELL), math.floor(py / CELL)
                if 0 <= col < size and 0 <= row < size and stamp >= hit[row, col]:
                    right, up = round((px - col * CELL) / _MM), round((py - row * CELL) / _MM)
                    places, cell_x, cell_y = offset[row, col], col * CELL - ox, row * CELL - oy
                    if stamp > hit[row, col]:  # a part is laid in one stamp
                        stood = clears[fan] and hit[row, col] > NEVER and hit[row, col] >= seen[row, col]
                        each = _not_looked_at(places, cell_x, cell_y, far) if stood else -1
                        places[6] = places[2 * each] if each >= 0 else right
                        places[7] = places[2 * each + 1] if each >= 0 else up
                        places[0], places[1], places[4], places[5] = right, up, right, up
                    places[2], places[3] = right, up
                    nearest_x, nearest_y = cell_x + places[4] * _MM, cell_y + places[5] * _MM
                    if (px - ox) ** 2 + (py - oy) ** 2 < nearest_x * nearest_x + nearest_y * nearest_y:
                        places[4], places[5] = right, up
                    hit[row, col] = stamp
                    thing[row, col] = things[fan]


@njit(cache=True, nogil=True)
def standing(
    seen: Stamps, hit: Stamps, offset: Bytes, thing: Bytes, column: int, row: int
) -> tuple[FloatArray, Bytes, Stamps]:
    """Return the points (N, 2) [m] in odom of hits that nothing has seen to be gone, their classes and stamps (N,).

    `column` and `row` are the cell of the grid's corner.
    """
    size = seen.shape[0]
    count = 0
    for r in range(size):
        for k in range(size):
            count += hit[r, k] > NEVER and hit[r, k] >= seen[r, k]
    points = np.empty((KEPT * count, 2))
    classes, stamps = np.empty(KEPT * count, np.uint8), np.empty(KEPT * count, np.int32)
    at = 0
    for r in range(size):
        for k in range(size):
            if hit[r, k] > NEVER and hit[r, k] >= seen[r, k]:
                begun = at
                for each in range(KEPT):
                    x = (k + column) * CELL + offset[r, k, 2 * each] * _MM
                    y = (r + row) * CELL + offset[r, k, 2 * each + 1] * _MM
                    apart = True
                    for other in range(begun, at):
                        apart = apart and math.hypot(points[other, 0] - x, points[other, 1] - y) > _APART
                    if apart:
                        points[at, 0], points[at, 1] = x, y
                        classes[at], stamps[at] = thing[r, k], hit[r, k]
                        at += 1
    return points[:at], classes[:at], stamps[:at]


@njit(cache=True, nogil=True)
def explained(
    starts: IntArray, ends: FloatArray, hits: BoolArray, shown: FloatArray, pose: FloatArray, gap: float
) -> BoolArray:
    """Return (F,) whether a hit of each fan lies within `gap` [m] of a point shown (M, 2) [m] in odom.

    `ends` (N, 2) [m] are in base; `pose` (3,) is odom_from_base.
    """
    c, s = math.cos(pose[2]), math.sin(pose[2])
    found = np.zeros(len(starts) - 1, np.bool_)
    for fan in range(len(starts) - 1):
        for i in range(starts[fan], starts[fan + 1]):
            if found[fan]:
                break
            if hits[i]:
                x, y = pose[0] + c * ends[i, 0] - s * ends[i, 1], pose[1] + s * ends[i, 0] + c * ends[i, 1]
                for j in range(len(shown)):
                    if (shown[j, 0] - x) ** 2 + (shown[j, 1] - y) ** 2 <= gap * gap:
                        found[fan] = True
                        break
    return found


@njit(cache=True, nogil=True)
def stand(seen: Stamps, x: float, y: float, theta: float, front: float, rear: float, half: float, stamp: int) -> None:
    """Mark the cells whose middle lies under the outline of a chair at a pose from the grid's corner [m]."""
    c, s = math.cos(theta), math.sin(theta)
    for row in range(seen.shape[0]):
        for col in range(seen.shape[1]):
            dx, dy = (col + 0.5) * CELL - x, (row + 0.5) * CELL - y
            if -rear <= c * dx + s * dy <= front and abs(c * dy - s * dx) <= half:
                seen[row, col] = stamp


@njit(cache=True, nogil=True)
def add_fresh(fresh: BoolArray, seen: Stamps, since: int) -> None:
    """Mark the cells that were seen since a stamp."""
    for row in range(seen.shape[0]):
        for col in range(seen.shape[1]):
            if seen[row, col] >= since:
                fresh[row, col] = True


@njit(cache=True, nogil=True)
def unseen_in_base(fresh: BoolArray, x: float, y: float, theta: float, front: float, rear: float, half: float) -> Bytes:
    """Return the cells of a grid centred on base that are not known to be free, as packed bits, row by row.

    A cell is free if its middle lies in a fresh cell in odom, or under the chair itself.
    """
    size = fresh.shape[0]
    c, s = math.cos(theta), math.sin(theta)
    packed = np.zeros((size * size + 7) // 8, np.uint8)
    for r in range(size):
        v = (r + 0.5 - size / 2) * CELL
        for k in range(size):
            u = (k + 0.5 - size / 2) * CELL
            if -rear - CELL / 2 <= u <= front + CELL / 2 and abs(v) <= half + CELL / 2:
                continue
            col, line = math.floor((x + c * u - s * v) / CELL), math.floor((y + s * u + c * v) / CELL)
            if not (0 <= col < size and 0 <= line < size and fresh[line, col]):
                place = r * size + k
                packed[place >> 3] |= 128 >> (place & 7)
    return packed


@njit(cache=True, nogil=True)
def places_of_bits(packed: Bytes, side: int, within: float) -> FloatArray:
    """Return the middles (M, 2) [m] of the cells of a grid centred on base whose bit is set, within a distance [m]."""
    places = np.empty((side * side, 2))
    count = 0
    for byte in range(len(packed)):
        if packed[byte] == 0:
            continue
        for bit in range(8):
            place = 8 * byte + bit
            if packed[byte] & (128 >> bit):
                x, y = (place % side + 0.5 - side / 2) * CELL, (place // side + 0.5 - side / 2) * CELL
                if x * x + y * y <= within * within:
                    places[count, 0], places[count, 1] = x, y
                    count += 1
    return places[:count]


@njit(cache=True, nogil=True)
def points_in_base(
    points: FloatArray, classes: Bytes, stamps: Stamps, pose: FloatArray, since: IntArray, reach: float
) -> tuple[NDArray[np.int16], Bytes]:
    """Return the points (N, 2) [m] in odom within `reach` [m] as (M, 2) [mm] in base, with their classes.

    `since` (classes,): a point of a class that was last hit before is forgotten.
    """
    c, s = math.cos(pose[2]), math.sin(pose[2])
    near, kinds = np.empty((len(points), 2), np.int16), np.empty(len(points), np.uint8)
    count = 0
    for i in range(len(points)):
        dx, dy = points[i, 0] - pose[0], points[i, 1] - pose[1]
        x, y = c * dx + s * dy, c * dy - s * dx
        if stamps[i] >= since[classes[i]] and abs(x) < reach and abs(y) < reach:
            near[count, 0], near[count, 1] = round(1000.0 * x), round(1000.0 * y)
            kinds[count] = classes[i]
            count += 1
    return near[:count], kinds[:count]


@njit(cache=True, inline="always")
def _is_within(cells: Cells, row: int, col: int) -> bool:
    """Return whether an occupied cell has occupied cells on all four sides."""
    if row == 0 or col == 0 or row + 1 == cells.shape[0] or col + 1 == cells.shape[1]:
        return False
    least = min(cells[row - 1, col], cells[row + 1, col], cells[row, col - 1], cells[row, col + 1])
    return bool(least >= OCCUPIED_FROM)


@njit(cache=True, nogil=True)
def walls_of_map(
    cells: Cells, resolution: float, grid: FloatArray, seen: Stamps, hit: Stamps, column: int, row: int, gap: float
) -> FloatArray:
    """Return the faces of a map's walls (N, 2) [m] in odom without those that the lidar's hits show already.

    `grid` (3,) is odom_from_grid; `seen` and `hit` are those of the lidar's layer. A cell within `gap` [m] of a hit that
    stands is the same wall, and the lidar knows its place better.
    """
    c, s = math.cos(grid[2]), math.sin(grid[2])
    size, steps = hit.shape[0], math.ceil(gap / CELL)
    points = np.empty((cells.size, 2))
    count = 0
    for r in range(cells.shape[0]):
        for k in range(cells.shape[1]):
            if cells[r, k] < OCCUPIED_FROM or _is_within(cells, r, k):
                continue
            u, v = (k + 0.5) * resolution, (r + 0.5) * resolution
            x, y = grid[0] + c * u - s * v, grid[1] + s * u + c * v
            col, line = math.floor(x / CELL) - column, math.floor(y / CELL) - row
            shown = False
            for i in range(max(line - steps, 0), min(line + steps + 1, size)):
                for j in range(max(col - steps, 0), min(col + steps + 1, size)):
                    shown = shown or (hit[i, j] > NEVER and hit[i, j] >= seen[i, j])
            if not shown:
                points[count, 0], points[count, 1] = x, y
                count += 1
    return points[:count]
