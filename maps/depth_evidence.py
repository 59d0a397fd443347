"""Evidence of depth images for and against obstacles and drop-offs, cell by cell, and the grid of all sensors.

It is the same sum of whole numbers as the lidar's (`occupancy.py`), but not the same sum: a lidar that looks under a
table top, over a sill or across a stairwell says nothing against them, however often it does. Floor that was seen is
a miss for both; what an image marks as an obstacle says nothing of drop-offs, nor the other way round.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from waychair.errors import MapError
from waychair.maps.depth_scan import DROP_OFF, OBSTACLE, DepthScan, cells_of, told_of
from waychair.maps.grid import OCCUPIED_FROM
from waychair.maps.occupancy import EvidenceGrid, OccupancySettings
from waychair.types import UNKNOWN, BoolArray, Bytes, Cells, FloatArray, OccupancyGrid, Pose2


class DepthEvidence:
    """Two grids that grow with what is seen: what stands or hangs, and where the floor ends."""

    def __init__(self, settings: OccupancySettings | None = None) -> None:
        self.settings = settings or OccupancySettings()
        self.obstacles, self.drops = EvidenceGrid(self.settings), EvidenceGrid(self.settings)

    def add(self, first: FloatArray, last: FloatArray, scans: Sequence[DepthScan]) -> None:
        """Draw images, each taken at once from a base at pose (N, 3) [m, m, rad]; `first` and `last` are the same.

        Raises:
            MapError: a pose is not finite, or a grid would grow beyond its limit.
        """
        self._draw(first, scans, take_out=False)

    def remove(self, first: FloatArray, last: FloatArray, scans: Sequence[DepthScan]) -> None:
        """Take out images that were added at the very same poses."""
        self._draw(first, scans, take_out=True)

    def beams(self, scan: DepthScan) -> int:
        """Stretches that drawing an image draws."""
        return len(scan)

    def reach(self, scan: DepthScan) -> float:
        """How far from the base [m] an image is drawn, or more."""
        return float(scan.far.max(initial=0.0) + np.hypot(*scan.origin))

    def _draw(self, poses: FloatArray, scans: Sequence[DepthScan], *, take_out: bool) -> None:
        if not np.isfinite(poses).all():
            raise MapError("the pose of a depth image is not finite; leave that image out")
        for (x, y, theta), scan in zip(poses.tolist(), scans, strict=True):
            lens = Pose2(x, y, theta) @ Pose2(float(scan.origin[0]), float(scan.origin[1]))
            cells, what = cells_of(
                lens.x, lens.y, lens.theta, scan.bearings, scan.near, scan.far, scan.kinds, self.settings.resolution
            )
            self.obstacles.put(*told_of(cells, what, OBSTACLE), take_out=take_out)
            self.drops.put(*told_of(cells, what, DROP_OFF), take_out=take_out)


BEYOND = 0.5
"""Round a drop-off so far [m], floor that no camera has seen is not believed in: the stairwell goes on there."""


def merged(scanned: OccupancyGrid, obstacles: OccupancyGrid, drops: OccupancyGrid) -> tuple[OccupancyGrid, BoolArray]:
    """The grid of lidar and depth, and which of its cells (H, W) are drop-offs or may be part of one.

    A cell is as occupied as the sensor says that found most there; a drop-off is occupied for sure, and so is what lies
    beyond its edge, where the lidar alone has looked. All three are grids of `EvidenceGrid`s of one resolution.
    """
    side, three = scanned.resolution, (scanned, obstacles, drops)
    corners = np.array([_corner(each) for each in three])
    low, high = corners.min(axis=0), (corners + [each.cells.shape[::-1] for each in three]).max(axis=0)
    parts: list[Cells] = []
    for grid, (col, row) in zip(three, (corners - low).tolist(), strict=True):
        part = np.full(tuple((high - low)[::-1]), UNKNOWN, np.int8)
        part[row : row + grid.cells.shape[0], col : col + grid.cells.shape[1]] = grid.cells
        parts.append(part)
    here = Pose2(float(low[0] * side), float(low[1] * side), 0.0)
    cells = np.maximum(parts[0], parts[1])
    fallen = _spread(
        parts[2] >= OCCUPIED_FROM,
        (parts[2] == UNKNOWN) & (cells != UNKNOWN) & (cells < OCCUPIED_FROM),
        round(BEYOND / side),
    )
    return OccupancyGrid(np.where(fallen, np.int8(100), cells), side, here), fallen


def _spread(cells: BoolArray, over: BoolArray, steps: int) -> BoolArray:
    """Cells (H, W) grown by so many steps, to the four beside each, over those of `over`."""
    if not cells.any():
        return cells
    cross = np.array([[0, 1, 0], [1, 1, 1], [0, 1, 0]], np.uint8)
    grown: Bytes = cells.astype(np.uint8)
    mask: Bytes = (over | cells).astype(np.uint8)
    for _ in range(steps):
        grown = np.minimum(np.asarray(cv2.dilate(grown, cross), np.uint8), mask)
    result: BoolArray = grown.astype(np.bool_)
    return result


def _corner(grid: OccupancyGrid) -> tuple[int, int]:
    """Column and row, from x = y = 0, of a grid's first cell."""
    return round(grid.map_from_grid.x / grid.resolution), round(grid.map_from_grid.y / grid.resolution)
