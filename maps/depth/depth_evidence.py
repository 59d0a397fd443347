"""Evidence of depth images for and against obstacles and drop-offs, cell by cell, and the grid of all sensors.

The evidence is a sum of whole numbers like the lidar's (`occupancy.py`), but kept apart from it: a lidar beam that
passes under a table top, over a sill or across a stairwell is no evidence against them. Floor in an image is a miss for
both obstacles and drop-offs; an obstacle says nothing of drop-offs, nor a drop-off of obstacles.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from waychair.errors import MapError
from waychair.maps.depth.depth_scan import DROP_OFF, OBSTACLE, DepthScan, cells_of_kind, stretch_cells
from waychair.maps.grid.cells import OCCUPIED_FROM
from waychair.maps.grid.occupancy import EvidenceGrid, OccupancySettings
from waychair.types import UNKNOWN, BoolArray, Bytes, Cells, FloatArray, OccupancyGrid, Pose2


class DepthEvidence:
    """Two growing grids of evidence: one for obstacles, standing or hanging, and one for drop-offs."""

    def __init__(self, settings: OccupancySettings | None = None) -> None:
        self.settings = settings or OccupancySettings()
        self.obstacles, self.drops = EvidenceGrid(self.settings), EvidenceGrid(self.settings)

    def add(self, first: FloatArray, last: FloatArray, scans: Sequence[DepthScan]) -> None:
        """Add images taken with the base at poses (N, 3) [m, m, rad]; an image is one moment, so `first` equals `last`.

        Raises:
            MapError: a pose is not finite, or a grid would grow beyond its limit.
        """
        self._draw(first, scans, remove=False)

    def remove(self, first: FloatArray, last: FloatArray, scans: Sequence[DepthScan]) -> None:
        """Remove images that were added at exactly these poses."""
        self._draw(first, scans, remove=True)

    def beams(self, scan: DepthScan) -> int:
        """Return how many stretches an image has, the cost of adding it."""
        return len(scan)

    def reach(self, scan: DepthScan) -> float:
        """Return an upper bound of the distance [m] from the base to the cells of an image."""
        return float(scan.far.max(initial=0.0) + np.hypot(*scan.origin))

    def _draw(self, poses: FloatArray, scans: Sequence[DepthScan], *, remove: bool) -> None:
        if not np.isfinite(poses).all():
            raise MapError("the pose of a depth image is not finite; leave that image out")
        for (x, y, theta), scan in zip(poses.tolist(), scans, strict=True):
            lens = Pose2(x, y, theta) @ Pose2(float(scan.origin[0]), float(scan.origin[1]))
            cells, kinds = stretch_cells(
                x=lens.x,
                y=lens.y,
                theta=lens.theta,
                bearings=scan.bearings,
                near=scan.near,
                far=scan.far,
                kinds=scan.kinds,
                resolution=self.settings.resolution,
            )
            self.obstacles.put(*cells_of_kind(cells, kinds, OBSTACLE), remove=remove)
            self.drops.put(*cells_of_kind(cells, kinds, DROP_OFF), remove=remove)


_BEYOND = 0.5
"""Floor that only the lidar has seen this near [m] to a drop-off counts as drop-off: the stairwell may go on there."""


def merge_sensors(
    scanned: OccupancyGrid, obstacles: OccupancyGrid, drops: OccupancyGrid
) -> tuple[OccupancyGrid, BoolArray]:
    """Return the grid of lidar and depth, and which of its cells (H, W) are drop-offs or may be part of one.

    A cell takes the highest value that any sensor gives it. A drop-off is occupied, and so are the cells beyond its
    edge that only the lidar has seen. All three arguments are grids of `EvidenceGrid`s of one resolution.
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
        round(_BEYOND / side),
    )
    return OccupancyGrid(np.where(fallen, np.int8(100), cells), side, here), fallen


def _spread(cells: BoolArray, over: BoolArray, steps: int) -> BoolArray:
    """Return the cells (H, W) grown by that many steps to their four neighbours, as far as these are in `over`."""
    if not cells.any():
        return cells
    import cv2  # only drop-offs have need of it

    cross = np.array([[0, 1, 0], [1, 1, 1], [0, 1, 0]], np.uint8)
    grown: Bytes = cells.astype(np.uint8)
    mask: Bytes = (over | cells).astype(np.uint8)
    for _ in range(steps):
        grown = np.minimum(np.asarray(cv2.dilate(grown, cross), np.uint8), mask)
    result: BoolArray = grown.astype(np.bool_)
    return result


def _corner(grid: OccupancyGrid) -> tuple[int, int]:
    """Return column and row of a grid's first cell, counted from x = y = 0."""
    return round(grid.map_from_grid.x / grid.resolution), round(grid.map_from_grid.y / grid.resolution)
