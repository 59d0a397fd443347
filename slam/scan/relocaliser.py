"""Global search: where a scan fits on a whole map, by branch and bound over all positions and headings.

Level 0 of the pyramid is the likelihood of a beam's end; level h holds its maxima over 2^h x 2^h cells, so a sum over
the points at level h is an upper bound for all 4^h positions of a block (Hess et al. 2016, section V.B). A second
pyramid marks where the chair can stand: blocks without a free cell are never searched. Searches without a find are
cheap, because they start from the least response that counts.

The search uses the ends of beams only. Real places and lookalikes differ in the cells that the beams cross, so
`waychair.slam.scan.beam_model` rates the few hypotheses found here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numba import njit

from waychair.geometry import pose_from_array
from waychair.maps.grid.cells import occupied
from waychair.slam.scan.reference_surfaces import block_maxima, doubled_blocks
from waychair.types import BoolArray, Bytes, FloatArray, IntArray, OccupancyGrid, Pose2

RESOLUTION = 0.1  # m; default cell of the search; headings step by as much at the far beams
SIGMA = 0.1  # m; spread of a beam's end about the wall
LEVELS = 7  # of the pyramid; a block of the top level has 2^(LEVELS - 1) cells on a side
MAX_POINTS = 100  # points of the scan that are searched for
MIN_RESPONSE = 0.5  # places that fit worse do not count
SPREAD = 0.15  # places whose response is lower than the best by more do not count
HYPOTHESES = 8  # distinct places that are kept
ENDLESS = 1 << 60  # more points than any search looks up
_FARTHEST = 9  # cells of half the resolution; farther from a wall the likelihood of a beam's end rounds to 0
APART_DISTANCE = 0.5  # m; poses at this distance are distinct
APART_ANGLE = 0.35  # rad; poses at this angle are distinct


@dataclass(frozen=True, slots=True)
class Hypothesis:
    """A pose of the base in the map, and the mean likelihood in [0, 1] of the beams' ends there."""

    pose: Pose2
    response: float


@dataclass(frozen=True, slots=True)
class Pyramid:
    """The search pyramid: `likelihood` (L, H, W) u8 of a beam's end; `standing` (H, W) u8, bit h set where the chair may stand
    in some cell of the block of level h. Cell (r, c) of level h is the block [r, r + 2^h) x [c, c + 2^h) of level 0, whose
    cells have side `resolution` [m]; `map_from_pyramid` is the corner of cell (0, 0)."""

    likelihood: Bytes
    standing: Bytes
    resolution: float
    map_from_pyramid: Pose2 = field(default_factory=Pose2)


def pyramid_from_grid(grid: OccupancyGrid, resolution: float = RESOLUTION) -> Pyramid:
    """Return the pyramid of a whole map: occupied cells are walls, the chair can stand on free cells.

    A map without walls has zero likelihood everywhere, and no place is found on it.
    """
    ratio = max(1, round(resolution / grid.resolution))
    solid = occupied(grid)
    return _pyramid(solid, (grid.cells >= 0) & ~solid, grid.resolution, ratio, grid.map_from_grid)


def pyramid_from_points(points: FloatArray, standing: FloatArray, reach: float) -> Pyramid:
    """Return the pyramid of the points (N, 2) [m] of a few key scans; the chair can stand within `reach` [m] of `standing`.

    `standing` (M, 2) [m] and the points share one frame, whose axes are those of the pyramid.
    """
    step = RESOLUTION / 2
    every = np.concatenate([points, standing])
    low = every.min(axis=0) - reach - 1.0
    width, height = (2 * np.ceil((every.max(axis=0) + reach + 1.0 - low) / RESOLUTION)).astype(int)
    near = np.zeros((height, width), bool)
    cols, rows = np.floor((points - low) / step).T.astype(
        np.int64, order="C"
    )  # one layout, so that one kernel serves all
    far = int(reach / step)
    disc = np.hypot(*np.mgrid[-far : far + 1, -far : far + 1]) <= reach / step
    for col, row in np.floor((standing - low) / step).astype(int).tolist():
        near[row - far : row + far + 1, col - far : col + far + 1] |= disc
    free = near[::2, ::2] | near[1::2, ::2] | near[::2, 1::2] | near[1::2, 1::2]
    likelihood = _likelihood(rows, cols, height, width, step / SIGMA)
    corner = Pose2(float(low[0]), float(low[1]), 0.0)
    return Pyramid(block_maxima(likelihood, LEVELS), standing_room(free.view(np.uint8)), RESOLUTION, corner)


def global_search(points: FloatArray, pyramid: Pyramid, *, floor: float = MIN_RESPONSE) -> tuple[Hypothesis, ...]:
    """Return the distinct places where points (N, 2) [m, base] fit best, best first; none if no fit is good enough.

    A place counts if its response exceeds `floor` and lies within the spread of the best.
    The first is the best of all grid poses, the others the best of their surroundings, up to the number of hypotheses.
    Positions are exact to one cell; the caller refines them.
    """
    search = begin_global_search(points, pyramid, floor)
    search.go_on(pyramid, ENDLESS)
    return search.hypotheses(pyramid)


@dataclass(slots=True)
class GlobalSearch:
    """A search of a whole pyramid that is done in pieces; arrays only, so that it can be stored in between."""

    points: FloatArray
    bound: FloatArray
    """Upper bounds (B,) of the response in the blocks of the top level, at each heading, as far as they are rated."""
    order: IntArray
    progress: IntArray
    """Blocks of the top level that are rated, then those that are searched, then the number of poses found."""
    found: FloatArray
    """x, y [m] in the pyramid's frame, heading [rad] and response of the best poses, and in the row after them the least
    response that still counts."""

    def go_on(self, pyramid: Pyramid, most: int) -> bool:
        """Look up at least `most` points in the pyramid, or all that are left to look up; return whether the search is done.

        The pyramid must be that of the calls before.
        """
        if not len(self.points):
            return True
        done: bool = _search_everywhere(
            self.points, pyramid.likelihood, pyramid.standing, pyramid.resolution, SPREAD, APART_DISTANCE, APART_ANGLE,
            self.bound, self.order, self.progress, self.found, most,
        )  # fmt: skip
        return done

    def hypotheses(self, pyramid: Pyramid) -> tuple[Hypothesis, ...]:
        """Return the places found so far, best first."""
        own = self.found[: self.progress[2]]
        order = np.argsort(-own[:, 3], kind="stable")
        return tuple(
            Hypothesis(pyramid.map_from_pyramid @ pose_from_array(row[:3]), float(row[3])) for row in own[order]
        )


def begin_global_search(points: FloatArray, pyramid: Pyramid, floor: float = MIN_RESPONSE) -> GlobalSearch:
    """Return a search of a pyramid that has done nothing yet; arguments as of `global_search`."""
    few = thinned(points, pyramid.resolution, MAX_POINTS)
    height, width = pyramid.standing.shape
    block = 2 ** (len(pyramid.likelihood) - 1)
    headings = heading_count(few, pyramid.resolution) if len(few) else 0
    blocks = headings * -(-height // block) * -(-width // block)
    found = np.zeros((HYPOTHESES + 1, 4))
    found[HYPOTHESES, 3] = floor
    return GlobalSearch(few, np.zeros(blocks), np.empty(blocks, np.int64), np.zeros(3, np.int64), found)


def heading_count(points: FloatArray, resolution: float) -> int:
    """Return the number of headings for which far points move by one cell per step (Hess et al. 2016, eq. 7)."""
    far = max(1.0, float(np.quantile(np.hypot(points[:, 0], points[:, 1]), 0.8)))
    return math.ceil(math.tau / math.acos(1.0 - resolution**2 / (2.0 * far**2)))


def thinned(points: FloatArray, resolution: float, most: int) -> FloatArray:
    """Return points (M, 2), M <= `most`: one per cell of `resolution` [m], then every n-th."""
    _, first = np.unique(np.floor(points / resolution).astype(np.int64), axis=0, return_index=True)
    kept = points[np.sort(first)]
    step = max(1, -(-len(kept) // most))
    return np.ascontiguousarray(kept[::step])


def _pyramid(solid: BoolArray, standing: BoolArray, cell: float, ratio: int, map_from_grid: Pose2) -> Pyramid:
    """Build the pyramid over blocks of `ratio` x `ratio` grid cells: likelihood at their centres, and standing room."""
    import cv2  # only a search on a whole map has need of it

    height, width = (-(-side // ratio) * ratio for side in solid.shape)
    padded = np.zeros((2, height, width), np.uint8)
    padded[:, : solid.shape[0], : solid.shape[1]] = ~solid, standing
    padded[0, solid.shape[0] :] = padded[0, :, solid.shape[1] :] = 1
    blocks = (width // ratio, height // ratio)
    if solid.any():
        # the centre of a block of 2 x 2 cells is a cell corner: take the mean distance of the cells round it
        away = cv2.distanceTransform(padded[0], cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        centre = cv2.resize(away, blocks, interpolation=cv2.INTER_AREA) * (cell / SIGMA)
        likelihood = np.round(255.0 * np.exp(-0.5 * centre**2)).astype(np.uint8)
    else:
        likelihood = np.zeros(blocks[::-1], np.uint8)
    free = np.maximum.reduce([padded[1, r::ratio, c::ratio] for r in range(ratio) for c in range(ratio)])
    return Pyramid(block_maxima(likelihood, LEVELS), standing_room(free), cell * ratio, map_from_grid)


def standing_room(free: Bytes, levels: int = LEVELS) -> Bytes:
    """Return (H, W) u8 with bit h set where the block of level h from a cell on has a free cell, 1 in `free` (H, W)."""
    bits, level = free.copy(), free
    for h in range(1, levels):
        level = doubled_blocks(level, 2 ** (h - 1))
        bits |= level << np.uint8(h)
    return bits


@njit(cache=True, nogil=True)
def _likelihood(rows: IntArray, cols: IntArray, height: int, width: int, spread: float) -> Bytes:
    """Return the likelihood (height / 2, width / 2) of a beam's end at the centre of each block of 2 x 2 cells.

    It follows from the mean distance of the four cells to the nearest of the cells (N,) `rows`, `cols`, as in `_pyramid`;
    beyond `_FARTHEST` cells it is 0. `spread`: the side of a cell over the standard deviation.
    """
    square = np.full((height, width), _FARTHEST * _FARTHEST, np.uint8)
    seen = np.zeros((height, width), np.bool_)
    for k in range(len(rows)):
        row, col = rows[k], cols[k]
        if seen[row, col]:
            continue
        seen[row, col] = True
        for r in range(max(0, row - _FARTHEST), min(height, row + _FARTHEST + 1)):
            for c in range(max(0, col - _FARTHEST), min(width, col + _FARTHEST + 1)):
                away = (r - row) ** 2 + (c - col) ** 2
                square[r, c] = min(square[r, c], away)
    roots = np.sqrt(np.arange(_FARTHEST * _FARTHEST + 1).astype(np.float64))
    likelihood = np.zeros((height // 2, width // 2), np.uint8)
    for r in range(height // 2):
        for c in range(width // 2):
            mean = (
                0.25
                * spread
                * (
                    roots[square[2 * r, 2 * c]]
                    + roots[square[2 * r + 1, 2 * c]]
                    + roots[square[2 * r, 2 * c + 1]]
                    + roots[square[2 * r + 1, 2 * c + 1]]
                )
            )
            if mean < 4.0:
                likelihood[r, c] = round(255.0 * math.exp(-0.5 * mean * mean))
    return likelihood


@njit(cache=True, nogil=True)
def _turned_cells(points: FloatArray, resolution: float, count: int) -> tuple[IntArray, IntArray]:
    """Return rows and columns (count, N) of the points at each heading, relative to the centre of cell (0, 0)."""
    rows = np.empty((count, len(points)), np.int64)
    cols = np.empty((count, len(points)), np.int64)
    for a in range(count):
        theta = 2.0 * math.pi * a / count
        c, s = math.cos(theta), math.sin(theta)
        for i in range(len(points)):
            rows[a, i] = math.floor((s * points[i, 0] + c * points[i, 1]) / resolution + 0.5)
            cols[a, i] = math.floor((c * points[i, 0] - s * points[i, 1]) / resolution + 0.5)
    return rows, cols


@njit(cache=True, nogil=True)
def _block_score(level: Bytes, rows: IntArray, cols: IntArray, row: int, col: int, side: int) -> int:
    """Return the sum of the level's values at the points, shifted by (row, col), for blocks of `side` x `side` cells.

    A block that begins outside the grid but reaches into it takes the value of the block at the grid's edge, which keeps
    the sum an upper bound. Cells outside the grid are 0.
    """
    height, width = level.shape
    total = 0
    for i in range(len(rows)):
        r, c = rows[i] + row, cols[i] + col
        if -side < r < height and -side < c < width:
            total += level[max(r, 0), max(c, 0)]
    return total


@njit(cache=True, nogil=True)
def _keep(
    found: FloatArray, used: int, x: float, y: float, theta: float, value: float, apart: float, apart_angle: float
) -> int:
    """Insert a pose into the distinct best ones (K, 4) x, y, theta, value; return their number."""
    near, worst = -1, 0
    for k in range(used):
        turn = abs(theta - found[k, 2])
        turn = min(turn, 2.0 * math.pi - turn)
        if math.hypot(x - found[k, 0], y - found[k, 1]) < apart and turn < apart_angle:
            near = k if near < 0 or found[k, 3] > found[near, 3] else near
        worst = k if found[k, 3] < found[worst, 3] else worst
    slot = near if near >= 0 else (used if used < len(found) else worst)
    if near < 0 and used < len(found):
        used += 1
    elif value <= found[slot, 3]:
        return used
    found[slot, 0], found[slot, 1], found[slot, 2], found[slot, 3] = x, y, theta, value
    return used


@njit(cache=True, nogil=True)
def _open(
    likelihood: Bytes, standing: Bytes, rows: IntArray, cols: IntArray, row: int, col: int, level: int, least: float,
    bounds: FloatArray, corners: IntArray,
) -> int:  # fmt: skip
    """Write the bounds of a block's quarters, of this level, above `least`, ascending, and their corners; return their number."""
    count, half = 0, 2**level
    for quarter in range(4):
        r, c = row + half * (quarter // 2), col + half * (quarter % 2)
        if r >= likelihood.shape[0] or c >= likelihood.shape[1] or not standing[r, c] >> level & 1:
            continue
        value = _block_score(likelihood, rows, cols, r, c, half) / (255.0 * len(rows))
        if value <= least:
            continue
        place = count
        while place > 0 and bounds[place - 1] > value:
            bounds[place] = bounds[place - 1]
            corners[place] = corners[place - 1]
            place -= 1
        bounds[place], corners[place, 0], corners[place, 1] = value, r, c
        count += 1
    return count


@njit(cache=True, nogil=True)
def _search_everywhere(
    points: FloatArray,
    likelihood: Bytes,
    standing: Bytes,
    resolution: float,
    spread: float,
    apart: float,
    apart_angle: float,
    bound: FloatArray,
    order: IntArray,
    progress: IntArray,
    found: FloatArray,
    most: int,
) -> bool:
    """Go on with a depth-first search by branch and bound over (heading, row, col), best block first, until so many points
    are looked up, or all is searched; return whether it is done. See `GlobalSearch` for the arrays."""
    levels, height, width = likelihood.shape
    block, each, keep = 2 ** (levels - 1), len(points), len(found) - 1
    down, across = -(-height // block), -(-width // block)
    count = len(bound) // (down * across)
    rows, cols = _turned_cells(points, resolution, count)
    spent = 0
    while progress[0] < len(bound):
        if spent >= most:
            return False
        entry = progress[0]
        a, row, col = entry // (down * across), entry // across % down * block, entry % across * block
        if standing[row, col] >> (levels - 1) & 1:
            bound[entry] = _block_score(likelihood[levels - 1], rows[a], cols[a], row, col, block) / (255.0 * each)
            spent += each
        progress[0] += 1
        if progress[0] == len(bound):
            order[:] = np.argsort(-bound)
    used, least = progress[2], found[keep, 3]
    bounds, corners = np.empty(4), np.empty((4, 2), np.int64)
    waiting, blocks = np.empty(4 * levels), np.empty((4 * levels, 3), np.int64)
    while progress[1] < len(order):
        entry = order[progress[1]]
        if bound[entry] <= least:
            break
        if spent >= most:
            return False
        progress[1] += 1
        a, depth = entry // (down * across), 1
        theta = 2.0 * math.pi * a / count
        waiting[0] = bound[entry]
        blocks[0] = (levels - 1, entry // across % down * block, entry % across * block)
        while depth > 0:
            depth -= 1
            h, row, col = blocks[depth]
            value = waiting[depth]
            if value <= least:
                continue
            if h > 0:
                opened = _open(likelihood[h - 1], standing, rows[a], cols[a], row, col, h - 1, least, bounds, corners)
                spent += 4 * each
                for k in range(opened):
                    waiting[depth] = bounds[k]
                    blocks[depth] = (h - 1, corners[k, 0], corners[k, 1])
                    depth += 1
                continue
            x, y = (col + 0.5) * resolution, (row + 0.5) * resolution
            used = _keep(found[:keep], used, x, y, theta, value, apart, apart_angle)
            least = max(least, value - spread)
            if used == keep:
                least = max(least, found[:keep, 3].min())
            progress[2], found[keep, 3] = used, least
    return True
