"""An occupancy grid from laser scans at known poses: log-odds per cell, free along the beam, occupied at its end.

A scan counts a cell at most once, as hit if any of its beams ends there and else as missed if one passes; a beam stops
at a cell that the scan has hit (as in RTAB-Map's grid: Labbe and Michaud, 2019). The log-odds are whole numbers, and
their sum is limited only where it is read: the grid does not depend on the order of its scans, and a scan can be
removed to the last bit.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numba import njit
from numpy.typing import NDArray

from waychair.config import Settings, setting
from waychair.errors import GridTooLarge, MapError
from waychair.geometry import wrap_angles
from waychair.maps.grid.cells import MOST_CELLS, OCCUPIED_FROM
from waychair.maps.grid.evidence_tiles import SHIFT, SIDE, Evidence, EvidenceTiles
from waychair.types import (
    UNKNOWN,
    BoolArray,
    Cells,
    Float32Array,
    FloatArray,
    IntArray,
    OccupancyGrid,
    Pose2,
    Scan,
)

_SKIP, _FREE, _HIT = 0, 1, 2  # kinds of beams: no information, free up to its end, occupied at its end

_UNIT = 4096  # steps of evidence per unit of natural log-odds: int32 holds that of half a million scans
_ENDLESS = 2**30  # evidence that no cell reaches
_BATCH = 64  # scans drawn at once, to limit memory

PROB_HIT, PROB_MISS = 0.7, 0.4
"""Probability that a cell is occupied after one hit, or after one miss."""

PROB_MIN, PROB_MAX = 0.1192, 0.971
"""Limits of the probability that a cell is read as (log-odds -2.0 and 3.5, as in OctoMap: Hornung et al. 2013)."""

MARGIN = 10
"""Unknown cells round the known ones of a finished grid."""

_Kinds = NDArray[np.int8]


@dataclass(frozen=True, slots=True)
class OccupancySettings(Settings):
    """How laser beams change the cells of a grid."""

    resolution: float = setting(
        0.05, "m", "side of a grid cell; larger: the map takes less memory and shows less detail", low=0.005, high=1.0
    )
    range_max: float = setting(
        20.0, "m",
        "longest lidar range that marks an obstacle or clears cells; larger: the map reaches farther from the lidar",
        low=0.5, high=200.0,
    )  # fmt: skip
    open_range: float = setting(
        0.0,
        "m",
        "range to which lidar beams without an echo clear cells; larger: more free space; 0: they clear nothing",
        low=0.0,
        high=200.0,
    )


class EvidenceGrid:
    """A growing grid of evidence for and against each cell being occupied.

    Cell borders are multiples of the resolution. Only unknown cells hold 0: no sum of hits and misses is 0. With
    `forgets`, evidence is limited after each scan and not only where it is read: a few scans then outweigh all earlier
    ones, their order matters, and they cannot be removed.
    """

    def __init__(self, settings: OccupancySettings | None = None, *, forgets: bool = False) -> None:
        self.settings = settings or OccupancySettings()
        self._hit, self._miss = _weights()
        self._least, self._most = (round(_log_odds(p) * _UNIT) for p in (PROB_MIN, PROB_MAX))
        self._percent = _percent(self._least, self._most)
        self._limits = (self._least, self._most) if forgets else (-_ENDLESS, _ENDLESS)
        self._box = np.zeros((2, 2), np.int64)  # first column and row in use, and the ones after the last
        self._tiles = EvidenceTiles()

    @property
    def area(self) -> FloatArray:
        """Lower left and upper right corner (2, 2) [m] of the area of `occupied`; equal while the grid is empty."""
        return self._box.astype(np.float64) * self.settings.resolution

    def occupied(self) -> BoolArray:
        """Return which cells (H, W) are occupied, by the limit of `grid.occupied`."""
        low, high = self._box
        result = np.zeros((high - low)[::-1], np.bool_)
        occupied = np.arange(self._least, self._most + 1) >= round(_log_odds(OCCUPIED_FROM / 100.0) * _UNIT)
        self._write_values(result.view(np.int8), low, occupied.view(np.int8))
        return result

    def add(self, first: FloatArray, last: FloatArray, scans: Sequence[Scan]) -> None:
        """Add scans.

        Args:
            first: (N, 3) [m, m, rad] poses of the laser at each scan's first beam.
            last: (N, 3) poses at its last beam; poses of the beams between are interpolated in even steps.
            scans: the N scans; nan, -inf and ranges outside the scan's own limits are ignored.

        Raises:
            MapError: poses do not match the scans or are not finite; no scan is added then.
            GridTooLarge: the grid would grow beyond `MOST_CELLS`; no scan is added then.
        """
        self._cast(first, last, scans, self._hit, self._miss)

    def remove(self, first: FloatArray, last: FloatArray, scans: Sequence[Scan]) -> None:
        """Remove scans that were added at exactly these poses."""
        self._cast(first, last, scans, -self._hit, -self._miss)

    def put(self, cells: IntArray, hits: BoolArray, *, remove: bool = False) -> None:
        """Add a hit or miss (N,) to each of cells (N, 2), or remove one; cells are column and row from x = y = 0.

        Raises:
            GridTooLarge: the grid would grow beyond `MOST_CELLS`.
        """
        if not len(cells):
            return
        self._include_cells(cells.min(axis=0), cells.max(axis=0) + 1)
        tiles, inside = self._tiles, cells - self._tiles.low
        corners = np.unique(inside // SIDE, axis=0) * SIDE
        tiles.reserve(corners, corners)
        amounts = np.where(hits, self._hit, self._miss).astype(np.int32)
        cols, rows = inside.T
        _put(tiles.table, tiles.pool, tiles.used, rows, cols, -amounts if remove else amounts, *self._limits)

    def beams(self, scan: Scan) -> int:
        """Return how many beams a scan has, the cost of adding it."""
        return len(scan.ranges)

    def reach(self, scan: Scan) -> float:
        """Return an upper bound of the length [m] of a scan's beams as drawn."""
        s, seen = self.settings, scan.ranges[np.isfinite(scan.ranges)]
        return min(max(float(seen.max(initial=0.0)), s.open_range), s.range_max)

    def include(self, low: FloatArray, high: FloatArray) -> None:
        """Grow until the area between two points (2,) [m] is inside.

        Raises:
            GridTooLarge: the grid would grow beyond `MOST_CELLS`.
        """
        s = self.settings
        self._include_cells(np.floor(low / s.resolution), np.floor(high / s.resolution) + 1.0)

    def _include_cells(self, low: FloatArray | IntArray, high: FloatArray | IntArray) -> None:
        """Grow until the cells from `low` (2,), column and row, to before `high` are inside."""
        box = np.array([low, high], np.float64)
        if self._tiles.table.size:
            box = np.array([np.minimum(box[0], self._box[0]), np.maximum(box[1], self._box[1])])
        width, height = (box[1] - box[0]).tolist()
        if not (width + 2 * MARGIN) * (height + 2 * MARGIN) <= MOST_CELLS:
            cell = self.settings.resolution
            raise GridTooLarge(
                f"the map would be {width * cell:.6g} x {height * cell:.6g} m, more than the {MOST_CELLS} cells of {cell:g} m "
                f"that can be planned on: check the poses for jumps, or give larger cells, such as --resolution {2 * cell:g}"
            )
        self._box = box.astype(np.int64)
        self._tiles.hold(*self._box)

    def grid(self) -> OccupancyGrid:
        """Return a copy of the known cells with a margin; it does not depend on where the grid began to grow."""
        resolution = self.settings.resolution
        low, high = self._tiles.extent()
        low, high = low - MARGIN, high + MARGIN
        cells = np.full((high - low)[::-1], UNKNOWN, np.int8)
        self._write_values(cells, low, self._percent)
        x, y = (low * resolution).tolist()
        return OccupancyGrid(cells, resolution, Pose2(x, y, 0.0))

    def overlaid(self, newer: EvidenceGrid, *, limited: bool = True) -> EvidenceGrid:
        """Return a new grid of this evidence plus newer evidence, of cells of the same size.

        In cells that the newer grid knows, older evidence is first limited (`PROB_MIN`, `PROB_MAX`), however many scans
        it comes from: a few new scans outweigh all earlier ones. Other cells keep the older evidence. Without
        `limited`, all evidence counts alike.
        """
        result = EvidenceGrid(self.settings)
        for part in (self, newer):
            if not part._tiles.table.size:
                continue
            result._include_cells(part._box[0], part._box[1])
            for first, own in part._tiles.tiles():
                under = result._tiles.tile(first)
                total = (np.clip(under, self._least, self._most) if limited else under) + own
                total[total == 0] = -1  # opposite evidence that cancels out is still known
                under[own != 0] = total[own != 0]
        return result

    def _cast(self, first: FloatArray, last: FloatArray, scans: Sequence[Scan], hit: int, miss: int) -> None:
        if not scans:
            return
        first, last = _checked(first, scans), _checked(last, scans)
        ends, kinds = beam_ends(first, last, scans, self.settings)
        middles = 0.5 * (first + last)[:, :2]
        seen = np.concatenate([middles, ends[kinds != _SKIP]])
        self.include(seen.min(axis=0), seen.max(axis=0))
        first_beam = np.concatenate([[0], np.cumsum([len(scan.ranges) for scan in scans])])
        origins, end_cells, tiles = self._cells(middles), self._cells(ends), self._tiles
        drawn = [end_cells[begin:end][kinds[begin:end] != _SKIP] for begin, end in pairwise(first_beam.tolist())]
        every = [np.concatenate([own, origins[k : k + 1]]) for k, own in enumerate(drawn)]
        tiles.reserve(np.array([own.min(axis=0) for own in every]), np.array([own.max(axis=0) for own in every]))
        _draw(
            tiles.table, tiles.pool, tiles.used, origins, end_cells, kinds, first_beam, hit, miss, *self._limits
        )  # fmt: skip

    def _write_values(self, cells: Cells, low: IntArray, values: Cells) -> None:
        """Write `values` for the limited evidence of all tiles into cells (H, W), whose first is `low` (2,)."""
        tiles = self._tiles
        _read(cells, tiles.table, tiles.pool, tiles.low - low, values, self._least)

    def _cells(self, points: FloatArray) -> IntArray:
        """Return column and row (N, 2) of points (N, 2) [m], from the first cell of the tiles on."""
        cells: IntArray = np.floor(points / self.settings.resolution).astype(np.int64) - self._tiles.low
        return cells


def build_grid(
    poses_laser: FloatArray,
    scans: Sequence[Scan],
    settings: OccupancySettings | None = None,
    last_poses_laser: FloatArray | None = None,
) -> OccupancyGrid:
    """Return the grid of all scans, each taken at its pose, in any order.

    Args:
        poses_laser: (N, 3) [m, m, rad] poses of the laser in map.
        scans: the N scans; nan, -inf and ranges outside the scan's own limits are ignored.
        settings: resolution and ranges.
        last_poses_laser: (N, 3) poses at each scan's last beam if the laser moved meanwhile; poses of the beams between
            are interpolated in even steps.

    Returns:
        Cells hold the probability of being occupied in percent, -1 where no beam passed. The grid has the axes of map;
        its cell borders are multiples of the resolution.

    Raises:
        MapError: no scans, poses that do not match them or are not finite, or a grid beyond `MOST_CELLS`.
    """
    if not scans:
        raise MapError("there are no scans to make a map of; give at least one")
    first = _checked(poses_laser, scans)
    last = first if last_poses_laser is None else _checked(last_poses_laser, scans)
    evidence = EvidenceGrid(settings)
    for part in batches(len(scans)):
        evidence.add(first[part], last[part], scans[part])
    return evidence.grid()


def batches(count: int) -> Iterator[slice]:
    """Return slices of `count` scans that fit well into memory."""
    return (slice(start, start + _BATCH) for start in range(0, count, _BATCH))


def _weights() -> tuple[int, int]:
    """Return the evidence of one hit and of one miss: log-odds in whole steps without a common divisor."""
    hit, miss = (round(_log_odds(p) * _UNIT) for p in (PROB_HIT, PROB_MISS))
    while math.gcd(hit, miss) > 1:
        hit += 1
    return hit, miss


def _checked(poses_laser: FloatArray, scans: Sequence[Scan]) -> FloatArray:
    poses = np.asarray(poses_laser, np.float64)
    if poses.shape != (len(scans), 3):
        raise MapError(f"poses of shape {poses.shape} do not match {len(scans)} scans; give one pose per scan")
    if not np.isfinite(poses).all():
        raise MapError(f"pose {int(np.argmin(np.isfinite(poses).all(axis=1)))} is not finite; leave that scan out")
    return poses


def beam_ends(
    poses: FloatArray, last: FloatArray, scans: Sequence[Scan], settings: OccupancySettings
) -> tuple[FloatArray, _Kinds]:
    """Return the ends (B, 2) [m] in map of all beams of all scans, and their kinds (B,) for `_draw`."""
    counts = [len(scan.ranges) for scan in scans]
    per_scan = np.array([[s.angle_min, s.angle_step, s.range_min, s.range_max] for s in scans])
    ends = np.zeros((sum(counts), 2))
    kinds = np.zeros(len(ends), np.int8)
    ranges = np.concatenate([scan.ranges for scan in scans]).astype(np.float32, copy=False)
    steps = last - poses
    steps[:, 2] = wrap_angles(steps[:, 2])
    steps /= np.maximum(np.array(counts) - 1, 1)[:, None]
    _trace_ends(
        ends=ends,
        kinds=kinds,
        ranges=ranges,
        counts=np.array(counts),
        poses=poses,
        steps=steps,
        per_scan=per_scan,
        range_max=settings.range_max,
        open_range=settings.open_range,
    )
    return ends, kinds


@njit(cache=True, nogil=True)
def _trace_ends(
    ends: FloatArray,
    kinds: _Kinds,
    ranges: Float32Array,
    counts: IntArray,
    poses: FloatArray,
    steps: FloatArray,
    per_scan: FloatArray,
    range_max: float,
    open_range: float,
) -> None:
    """Fill in the `ends` and `kinds` of all beams."""
    beam = 0
    for scan in range(len(counts)):
        angle_min, angle_step, nearest, farthest = per_scan[scan]
        for i in range(counts[scan]):
            r = float(ranges[beam])
            kind = _HIT
            if r > farthest or r == math.inf:  # no echo
                kind = _FREE
                r = min(open_range, farthest, range_max)
            elif r > range_max:
                kind = _FREE
                r = range_max
            if r > 0.0 and (kind == _FREE or r >= nearest):  # false for nan
                angle = poses[scan, 2] + i * steps[scan, 2] + angle_min + i * angle_step
                ends[beam, 0] = poses[scan, 0] + i * steps[scan, 0] + r * math.cos(angle)
                ends[beam, 1] = poses[scan, 1] + i * steps[scan, 1] + r * math.sin(angle)
                kinds[beam] = kind
            beam += 1


@njit(cache=True, nogil=True)
def _put(
    table: Evidence, pool: Evidence, used: IntArray, rows: IntArray, cols: IntArray, amounts: Evidence, least: int,
    most: int,
) -> None:  # fmt: skip
    """Add an amount to each cell, within the limits."""
    for i in range(len(rows)):
        _change(table, pool, used, rows[i], cols[i], amounts[i], least, most)


@njit(cache=True, nogil=True)
def _change(
    table: Evidence, pool: Evidence, used: IntArray, row: int, col: int, amount: int, least: int, most: int
) -> None:
    """Add an amount to the evidence of a cell, within the limits; a tile is taken into use where there is none yet."""
    down, across = row >> SHIFT, col >> SHIFT
    number = table[down, across]
    if number == 0:
        used[0] += 1
        number = used[0]
        table[down, across] = number
    r, c = row & (SIDE - 1), col & (SIDE - 1)
    pool[number, r, c] = min(most, max(least, pool[number, r, c] + amount))


@njit(cache=True, nogil=True)
def _draw(
    table: Evidence,
    pool: Evidence,
    used: IntArray,
    origins: IntArray,
    ends: IntArray,
    kinds: _Kinds,
    first_beam: IntArray,
    hit: int,
    miss: int,
    least: int,
    most: int,
) -> None:
    """Add scans one after another, all of whose cells lie in the grid; evidence is limited with each."""
    marks = np.zeros(0, np.uint8)  # of the cells round one scan: 0, or _FREE or _HIT once counted
    for scan in range(len(origins)):
        low_x, low_y = origins[scan]
        high_x, high_y = low_x, low_y
        for beam in range(first_beam[scan], first_beam[scan + 1]):
            if kinds[beam] != _SKIP:
                x, y = ends[beam]
                low_x, high_x = min(low_x, x), max(high_x, x)
                low_y, high_y = min(low_y, y), max(high_y, y)
        width = high_x - low_x + 1
        size = width * (high_y - low_y + 1)
        if size > len(marks):
            marks = np.empty(size, np.uint8)
        marks[:size] = 0
        for beam in range(first_beam[scan], first_beam[scan + 1]):
            if kinds[beam] == _HIT:
                x, y = ends[beam]
                mark = (y - low_y) * width + x - low_x
                if marks[mark] == 0:
                    marks[mark] = _HIT
                    _change(table, pool, used, y, x, hit, least, most)
        for beam in range(first_beam[scan], first_beam[scan + 1]):
            if kinds[beam] == _SKIP:
                continue
            # Bresenham's line from the laser to the end of the beam
            x, y = origins[scan]
            to_x, to_y = ends[beam]
            dx, dy = abs(to_x - x), -abs(to_y - y)
            step_x, step_y = (1 if to_x > x else -1), (1 if to_y > y else -1)
            error = dx + dy
            mark = (y - low_y) * width + x - low_x
            while marks[mark] != _HIT:
                if marks[mark] == 0:
                    marks[mark] = _FREE
                    _change(table, pool, used, y, x, miss, least, most)
                if x == to_x and y == to_y:
                    break
                twice = 2 * error
                if twice >= dy:
                    error += dy
                    x += step_x
                    mark += step_x
                if twice <= dx:
                    error += dx
                    y += step_y
                    mark += step_y * width


@njit(cache=True, nogil=True)
def _read(cells: Cells, table: Evidence, pool: Evidence, table_low: IntArray, values: Cells, least: int) -> None:
    """Look up the value of each cell of the tiles in use, with its evidence clipped to the limits.

    `table_low` (2,) is the first cell of the table, column and row, counted from the first of `cells`.
    """
    most = least + len(values) - 1
    for down in range(len(table)):
        for across in range(table.shape[1]):
            number = table[down, across]
            if number == 0:
                continue
            row, col = table_low[1] + (down << SHIFT), table_low[0] + (across << SHIFT)
            for r in range(max(0, -row), min(SIDE, len(cells) - row)):
                for c in range(max(0, -col), min(SIDE, cells.shape[1] - col)):
                    cells[row + r, col + c] = values[min(max(pool[number, r, c], least), most) - least]


def _percent(least: int, most: int) -> Cells:
    """Return the probability [%] for evidence from `least` to `most`; unknown at 0."""
    log_odds = np.arange(least, most + 1) / _UNIT
    cells = np.rint(100.0 / (1.0 + np.exp(-log_odds))).astype(np.int8)
    cells[-least] = UNKNOWN
    return cells


def _log_odds(probability: float) -> float:
    """Return the natural logarithm of the odds of a probability in (0, 1)."""
    return math.log(probability / (1.0 - probability))
