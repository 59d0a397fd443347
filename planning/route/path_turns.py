"""The turns of a path: its turning angles at equal distances, and their histogram."""

from __future__ import annotations

import math

import numpy as np

from waychair.geometry import evenly_spaced
from waychair.types import FloatArray, IntArray, Path

EVERY_M = 0.10
"""Distance [m] at which a path is resampled to measure its turns."""

BIN_DEG = 5
"""Width of the histogram's bins [deg]."""


def turning_angles(points: FloatArray) -> FloatArray:
    """Return (N - 2,) the absolute turning angle [rad] at each inner point of a polyline."""
    steps = np.diff(points, axis=0)
    headings = np.arctan2(steps[:, 1], steps[:, 0])
    turns = np.diff(headings)
    return np.abs(np.arctan2(np.sin(turns), np.cos(turns)))


def turns_of(path: Path, every: float = EVERY_M) -> FloatArray:
    """Return turning angles (N,) [rad] of a path that is resampled at a distance [m]."""
    points = path.poses[:, :2]
    apart = np.append(True, np.hypot(*np.diff(points, axis=0).T) > 1e-6)
    return turning_angles(evenly_spaced(points[apart], every))


def turn_histogram(path: Path, every: float = EVERY_M) -> tuple[IntArray, IntArray]:
    """Return a histogram of a path's turns: lower edges of the bins [deg] and counts, up to the sharpest turn."""
    degrees = np.degrees(turns_of(path, every))
    bins = max(math.ceil((degrees.max(initial=0.0) + 1e-9) / BIN_DEG), 1)
    counts, edges = np.histogram(degrees, bins, (0, bins * BIN_DEG))
    return edges[:-1].astype(np.int64), counts.astype(np.int64)
