"""A planar lidar in a grid world: exact rays, then the faults of a real one.

A scan is a snapshot: all beams are cast from one pose (`time_step` 0).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from waychair.config import Settings, setting
from waychair.simulation.contact import Solid
from waychair.topics import SCAN
from waychair.types import BoolArray, FloatArray, Pose2, Scan


@dataclass(frozen=True, slots=True)
class LidarSettings(Settings):
    """Field of view, range and noise of the lidar; beams are spread evenly from one edge of the view to the other."""

    rate_hz: float = setting(SCAN.rate_hz, "Hz", "scans per second", low=1.0, high=100.0)
    beams: int = setting(720, "", "beams per scan", low=2, high=10_000)
    field_of_view: float = setting(math.radians(270.0), "rad", "centred on the laser's x axis", low=0.1, high=6.28)
    range_min: float = setting(0.05, "m", "anything nearer reads -inf", low=0.0, high=1.0)
    range_max: float = setting(25.0, "m", "anything farther reads +inf", low=1.0, high=200.0)
    sigma: float = setting(0.01, "m", "noise of a range (one sigma)", low=0.0, high=0.2)
    drop_out: float = setting(0.002, "", "part of the beams that read nan", low=0.0, high=1.0)


class Lidar:
    """Keeps its own random stream, of which every scan uses equally much, whatever it sees."""

    def __init__(self, settings: LidarSettings, base_from_laser: Pose2, rng: np.random.Generator) -> None:
        self._settings = settings
        self._base_from_laser = base_from_laser
        self._rng = rng
        half = settings.field_of_view / 2
        self._angles = np.linspace(-half, half, settings.beams)

    def scan(self, solid: Solid, map_from_base: Pose2, stamp_ns: int) -> Scan:
        """Scan from a pose of the chair; ranges by REP-117: +inf nothing seen, -inf too close, nan dropped out."""
        s = self._settings
        laser = solid.grid_from_map @ map_from_base @ self._base_from_laser
        ranges = cast_rays(solid.cells, solid.resolution, laser.x, laser.y, self._angles + laser.theta, s.range_max)
        ranges += s.sigma * self._rng.standard_normal(s.beams)
        ranges[ranges > s.range_max] = math.inf
        ranges[ranges < s.range_min] = -math.inf
        ranges[self._rng.random(s.beams) < s.drop_out] = math.nan
        return Scan(
            stamp_ns=stamp_ns,
            ranges=ranges.astype(np.float32),
            angle_min=-s.field_of_view / 2,
            angle_step=s.field_of_view / (s.beams - 1),
            range_min=s.range_min,
            range_max=s.range_max,
        )


@njit(cache=True, nogil=True)
def cast_rays(
    cells: BoolArray, resolution: float, x: float, y: float, angles: FloatArray, range_max: float
) -> FloatArray:
    """Distance [m] from (x, y) [m] in the grid to the face of the first solid cell along each angle [rad], (N,).

    +inf where there is none within `range_max`; 0 from inside a solid cell. The cells on a ray are visited in order,
    one face crossing at a time (Amanatides and Woo, A Fast Voxel Traversal Algorithm, 1987).
    """
    ranges = np.empty(angles.shape[0])
    for i in range(angles.shape[0]):
        distance = _cast(cells, x / resolution, y / resolution, math.cos(angles[i]), math.sin(angles[i]))
        ranges[i] = distance * resolution
        if ranges[i] > range_max:
            ranges[i] = math.inf
    return ranges


@njit(cache=True, nogil=True)
def _cast(cells: BoolArray, x: float, y: float, dx: float, dy: float) -> float:
    """Distance [cells] along one ray."""
    rows, cols = cells.shape
    per_x = 1.0 / dx if dx != 0.0 else math.inf
    per_y = 1.0 / dy if dy != 0.0 else math.inf
    entry = max(_entry(x, per_x, cols), _entry(y, per_y, rows), 0.0)
    if entry == math.inf:
        return math.inf
    col = min(max(math.floor(x + entry * dx), 0), cols - 1)
    row = min(max(math.floor(y + entry * dy), 0), rows - 1)
    # A ray that misses the grid is clamped to its rim above, and must not hit what is there.
    if abs(x + entry * dx - col - 0.5) > 0.5 + 1e-6 or abs(y + entry * dy - row - 0.5) > 0.5 + 1e-6:
        return math.inf
    step_x, step_y = (1 if dx > 0 else -1), (1 if dy > 0 else -1)
    ahead_x, ahead_y = (1 if dx > 0 else 0), (1 if dy > 0 else 0)
    distance = entry
    while not cells[row, col]:
        to_x = (col + ahead_x - x) * per_x if dx != 0.0 else math.inf
        to_y = (row + ahead_y - y) * per_y if dy != 0.0 else math.inf
        if to_x < to_y:
            distance = to_x
            col += step_x
            if col < 0 or col >= cols:
                return math.inf
        else:
            distance = to_y
            row += step_y
            if row < 0 or row >= rows:
                return math.inf
    return distance


@njit(cache=True, nogil=True)
def _entry(start: float, per: float, size: int) -> float:
    """Distance to where a coordinate enters [0, size]: 0 from within, +inf if it never does."""
    if 0.0 <= start <= size:
        return 0.0
    distance = -start * per if start < 0.0 else (size - start) * per
    return distance if distance >= 0.0 else math.inf
