"""Views of a range sensor: the beams of a lidar scan, of a depth image or of a grid, in one common form."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from waychair.geometry import transform_points
from waychair.maps.depth.depth_scan import FLOOR, OBSTACLE, DepthScan
from waychair.maps.grid.cells import OCCUPIED_FROM
from waychair.types import UNKNOWN, BoolArray, Cells, FloatArray, OccupancyGrid, Pose2, Scan

DEPTH_BEAM = math.radians(0.4)
"""rad; step between the beams of a depth image's view."""

GRID_BEAMS = 720
"""Beams of a grid's view, all round."""


@dataclass(frozen=True, slots=True)
class RangeView:
    """The beams of one view, in the order in which they turn to the left.

    `origin` (2,) [m] is the sensor's place and `ends` (N, 2) [m] the farthest points known to be reached, in one frame;
    a beam with an end that is not a number says nothing. `met` (N,) tells which beams met something at their end; the
    others only go on to there.
    """

    origin: FloatArray
    ends: FloatArray
    met: BoolArray


def view_from_scan(scan: Scan, frame_from_laser: Pose2, farthest: float = 40.0) -> RangeView:
    """Return the view of a scan; beams without an echo or with one beyond `farthest` [m] say nothing.

    A beam without an echo may be free, but may as well have met glass, black cloth or the sun.
    """
    ranges = scan.ranges.astype(np.float64)
    with np.errstate(invalid="ignore"):
        met = (ranges >= max(scan.range_min, 1e-3)) & (ranges <= min(scan.range_max, farthest))
    ranges[~met] = np.nan
    return _view(frame_from_laser, scan.angles(), ranges, met)


def view_from_depth(seen: DepthScan, frame_from_base: Pose2) -> RangeView:
    """Return the view of one depth image: each beam ends at the nearest obstacle of any height, or where the floor seen
    on it ends."""
    if len(seen) == 0:
        return RangeView(seen.origin, np.zeros((0, 2)), np.zeros(0, np.bool_))
    low, high = float(seen.bearings.min()), float(seen.bearings.max())
    angles = (low + DEPTH_BEAM * np.arange(round((high - low) / DEPTH_BEAM) + 1)).astype(np.float64)
    beam = np.rint((seen.bearings - low) / DEPTH_BEAM).astype(np.int64)
    ends, reached = np.full(len(angles), np.inf), np.full(len(angles), np.nan)
    stands, floor = seen.kinds == OBSTACLE, seen.kinds == FLOOR
    np.minimum.at(ends, beam[stands], seen.far[stands])
    np.fmax.at(reached, beam[floor], seen.far[floor].astype(np.float64))
    met = np.isfinite(ends)
    lens = Pose2(float(seen.origin[0]), float(seen.origin[1]), 0.0)
    return _view(frame_from_base @ lens, angles, np.where(met, ends, reached), met)


def view_from_points(points: FloatArray, frame_from_sensor: Pose2) -> RangeView:
    """Return the view of surface points (N, 2) [m] in the sensor's frame, such as those that a laser line lights up.

    Points that are not numbers say nothing.
    """
    seen = points[np.isfinite(points).all(axis=1)]
    bearings = np.arctan2(seen[:, 1], seen[:, 0])
    order = np.argsort(bearings, kind="stable")
    ranges = np.hypot(seen[:, 0], seen[:, 1])[order]
    return _view(frame_from_sensor, bearings[order], ranges, np.ones(len(seen), np.bool_))


def view_from_grid(grid: OccupancyGrid, place: FloatArray, farthest: float = 8.0) -> RangeView:
    """Return the view all round from a place (2,) [m] in map, as a lidar would see the grid's occupied cells.

    A beam says nothing where it comes to an unknown cell, to the grid's edge or `farthest` [m] without an obstacle.
    """
    angles = np.linspace(-math.pi, math.pi, GRID_BEAMS, endpoint=False)
    at = transform_points(grid.map_from_grid.inverse(), place[None])[0] / grid.resolution
    turned = angles - grid.map_from_grid.theta
    ranges = _cast(grid.cells, float(at[0]), float(at[1]), turned, farthest / grid.resolution) * grid.resolution
    return _view(Pose2(float(place[0]), float(place[1]), 0.0), angles, ranges, np.isfinite(ranges))


def moved_view(view: RangeView, frame_from_base: Pose2) -> RangeView:
    """Return a view in base in another frame."""
    origin, ends = transform_points(frame_from_base, view.origin[None])[0], transform_points(frame_from_base, view.ends)
    return RangeView(origin, ends, view.met)


def _view(frame_from_sensor: Pose2, angles: FloatArray, ranges: FloatArray, met: BoolArray) -> RangeView:
    turned = angles + frame_from_sensor.theta
    origin = np.array([frame_from_sensor.x, frame_from_sensor.y])
    ends = origin + ranges[:, None] * np.stack([np.cos(turned), np.sin(turned)], axis=1)
    if len(angles) > 1 and angles[1] < angles[0]:
        ends, met = ends[::-1].copy(), met[::-1].copy()
    return RangeView(origin, ends, met)


@njit(cache=True, nogil=True)
def _cast(cells: Cells, x: float, y: float, angles: FloatArray, reach: float) -> FloatArray:
    """Return the distance (N,) [cells] along each ray to the first occupied cell, in steps of a fifth of a cell; nan
    where a ray meets an unknown cell or none."""
    ranges = np.full(len(angles), np.nan)
    for i in range(len(angles)):
        c, s = math.cos(angles[i]), math.sin(angles[i])
        for step in range(int(5.0 * reach)):
            column, row = math.floor(x + 0.2 * step * c), math.floor(y + 0.2 * step * s)
            if row < 0 or column < 0 or row >= cells.shape[0] or column >= cells.shape[1]:
                break
            if cells[row, column] == UNKNOWN:
                break
            if cells[row, column] >= OCCUPIED_FROM:
                ranges[i] = 0.2 * step
                break
    return ranges
