"""An occupancy grid from laser scans at known poses: log-odds per cell, free along the beam, occupied at its end.

The update is that of RTAB-Map's grid (Labbe and Michaud, 2019, and its OccupancyGrid): a scan counts a cell at most
once, as hit if any of its beams ends there and else as missed if one passes; a beam stops where the scan hit a cell.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from waychair.config import Settings, setting
from waychair.errors import MapError
from waychair.geometry import wrap_angles
from waychair.types import UNKNOWN, Cells, Float32Array, FloatArray, IntArray, OccupancyGrid, Pose2, Scan

_SKIP, _FREE, _HIT = 0, 1, 2  # what a beam tells: nothing, free up to its end, occupied at its end

_Kinds = NDArray[np.int8]
_Marks = NDArray[np.int32]


@dataclass(frozen=True, slots=True)
class OccupancySettings(Settings):
    """How beams become cells."""

    resolution: float = setting(0.05, "m", "side of a cell", low=0.005, high=1.0)
    range_max: float = setting(20.0, "m", "beams are cut here and longer ones only clear", low=0.5, high=200.0)
    open_range: float = setting(
        0.0, "m", "beams that saw nothing clear this far (0: they clear nothing)", low=0.0, high=200.0
    )
    prob_hit: float = setting(0.7, "", "probability of occupied after one hit", low=0.51, high=0.99)
    prob_miss: float = setting(0.4, "", "probability of occupied after one miss", low=0.01, high=0.49)
    prob_min: float = setting(0.1192, "", "a cell is never held for more surely free", low=0.001, high=0.49)
    prob_max: float = setting(0.971, "", "a cell is never held for more surely occupied", low=0.51, high=0.999)
    margin: int = setting(10, "cells", "unknown border around what was seen", low=0, high=1000)
    max_cells: int = setting(200_000_000, "cells", "larger grids are refused", low=1, high=2_000_000_000)


def build_grid(
    poses_laser: FloatArray,
    scans: Sequence[Scan],
    settings: OccupancySettings | None = None,
    last_poses_laser: FloatArray | None = None,
) -> OccupancyGrid:
    """The grid of all scans, each taken at its pose.

    Args:
        poses_laser: (N, 3) [m, m, rad] of the laser in map.
        scans: the N scans; nan, -inf and ranges outside the scan's own limits tell nothing of the distance.
        settings: resolution, probabilities and limits.
        last_poses_laser: (N, 3) of the laser at each scan's last beam, where it moved meanwhile; beams between are
            taken from poses between, in even steps.

    Returns:
        Cells hold the probability of being occupied in percent, -1 where no beam passed. Its axes are those of map,
        its lines multiples of the resolution.

    Raises:
        MapError: no scans, poses that do not belong to them or are not finite, or a grid beyond `max_cells`.
    """
    settings = settings or OccupancySettings()
    poses = _checked(poses_laser, scans)
    first_beam = np.concatenate([[0], np.cumsum([len(scan.ranges) for scan in scans])])
    last = poses if last_poses_laser is None else _checked(last_poses_laser, scans)
    ends, kinds = beam_ends(poses, last, scans, settings)
    seen = np.concatenate([poses[:, :2], ends[kinds != _SKIP]])
    lowest = np.floor(seen.min(axis=0) / settings.resolution) - settings.margin
    highest = np.floor(seen.max(axis=0) / settings.resolution) + settings.margin
    width, height = (highest - lowest + 1.0).tolist()
    if width * height > settings.max_cells:
        raise MapError(
            f"a grid of {width:.0f} x {height:.0f} cells of {settings.resolution:g} m is too large: check the poses "
            "for jumps, or choose larger cells"
        )
    low = lowest.astype(np.int64)
    middles = 0.5 * (poses[:, :2] + last[:, :2])
    origins = np.floor(middles / settings.resolution).astype(np.int64) - low
    end_cells = np.floor(ends / settings.resolution).astype(np.int64) - low
    log_odds = np.zeros((int(height), int(width)), np.float32)
    marks = np.full(log_odds.shape, -1, np.int32)
    limits = [log_odds_of(p) for p in (settings.prob_hit, settings.prob_miss, settings.prob_min, settings.prob_max)]
    fuse_scans(log_odds, marks, origins, end_cells, kinds, first_beam, *limits)
    x, y = (low * settings.resolution).tolist()
    return OccupancyGrid(_percent(log_odds, marks), settings.resolution, Pose2(x, y, 0.0))


def _checked(poses_laser: FloatArray, scans: Sequence[Scan]) -> FloatArray:
    poses = np.asarray(poses_laser, np.float64)
    if not scans:
        raise MapError("there are no scans to make a map of; give at least one")
    if poses.shape != (len(scans), 3):
        raise MapError(f"poses of shape {poses.shape} do not belong to {len(scans)} scans; give one pose per scan")
    if not np.isfinite(poses).all():
        raise MapError(f"pose {int(np.argmin(np.isfinite(poses).all(axis=1)))} is not finite; leave that scan out")
    return poses


def beam_ends(
    poses: FloatArray, last: FloatArray, scans: Sequence[Scan], settings: OccupancySettings
) -> tuple[FloatArray, _Kinds]:
    """Ends (B, 2) [m] in map of all beams of all scans, and what each tells (B,): see `fuse_scans`."""
    counts = [len(scan.ranges) for scan in scans]
    per_scan = np.array([[s.angle_min, s.angle_step, s.range_min, s.range_max] for s in scans])
    ends = np.zeros((sum(counts), 2))
    kinds = np.zeros(len(ends), np.int8)
    ranges = np.concatenate([scan.ranges for scan in scans]).astype(np.float32, copy=False)
    steps = last - poses
    steps[:, 2] = wrap_angles(steps[:, 2])
    steps /= np.maximum(np.array(counts) - 1, 1)[:, None]
    _trace_ends(ends, kinds, ranges, np.array(counts), poses, steps, per_scan, settings.range_max, settings.open_range)
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
    """Fill in `ends` and `kinds`."""
    beam = 0
    for scan in range(len(counts)):
        angle_min, angle_step, nearest, farthest = per_scan[scan]
        for i in range(counts[scan]):
            r = float(ranges[beam])
            kind = _HIT
            if r > farthest or r == math.inf:  # nothing was seen
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
def fuse_scans(
    log_odds: Float32Array,
    marks: _Marks,
    origins: IntArray,
    ends: IntArray,
    kinds: _Kinds,
    first_beam: IntArray,
    hit: float,
    miss: float,
    least: float,
    most: float,
) -> None:
    """Add all scans to the grid; `marks` holds 2 k for the cells that scan k has missed and 2 k + 1 for those hit."""
    for scan in range(len(origins)):
        missed, was_hit = 2 * scan, 2 * scan + 1
        for beam in range(first_beam[scan], first_beam[scan + 1]):
            x, y = ends[beam]
            if kinds[beam] == _HIT and marks[y, x] != was_hit:
                marks[y, x] = was_hit
                log_odds[y, x] = min(most, log_odds[y, x] + hit)
        for beam in range(first_beam[scan], first_beam[scan + 1]):
            if kinds[beam] == _SKIP:
                continue
            # Bresenham's line from the laser to the end of the beam
            x, y = origins[scan]
            to_x, to_y = ends[beam]
            dx, dy = abs(to_x - x), -abs(to_y - y)
            step_x, step_y = (1 if to_x > x else -1), (1 if to_y > y else -1)
            error = dx + dy
            while marks[y, x] != was_hit:
                if marks[y, x] != missed:
                    marks[y, x] = missed
                    log_odds[y, x] = max(least, log_odds[y, x] + miss)
                if x == to_x and y == to_y:
                    break
                twice = 2 * error
                if twice >= dy:
                    error += dy
                    x += step_x
                if twice <= dx:
                    error += dx
                    y += step_y


def _percent(log_odds: Float32Array, marks: _Marks) -> Cells:
    """Probability [%] of the cells that were seen."""
    cells = np.rint(100.0 / (1.0 + np.exp(-log_odds))).astype(np.int8)
    cells[marks < 0] = UNKNOWN
    return cells


def log_odds_of(probability: float) -> float:
    """Natural logarithm of the odds of a probability in (0, 1)."""
    return math.log(probability / (1.0 - probability))
