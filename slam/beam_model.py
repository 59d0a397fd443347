"""What the beams of a scan say about a pose on a map: not only where they end, but what they passed through.

Each beam is followed from the lidar through the map's cells and falls into one of five classes. A real pose shows few
beams that go through walls; a lookalike shows many (the visibility test of likelihood-field localisation's weakness,
Thrun, Burgard and Fox 2005, section 6.4.2). Unknown ground contradicts nothing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numba import njit

from waychair.config import Settings, setting
from waychair.geometry import compose
from waychair.maps.distance_field import distances
from waychair.maps.grid import occupied
from waychair.types import BoolArray, Bytes, Float32Array, FloatArray, OccupancyGrid, Pose2

ON_WALL, NEAR_WALL, IN_FREE, THROUGH_WALL, IN_UNKNOWN = range(5)
"""Classes of a beam: it ends on a wall, near one, on free ground far from any, behind a wall, on unknown ground."""

CLASSES = 5
_FREE, _WALL, _UNKNOWN = 0, 1, 2


@dataclass(frozen=True, slots=True)
class HealthSettings(Settings):
    """Log-odds that a pose is right (within 0.3 m and 5 degrees), linear in the shares of its beams' classes.

    Fitted on two recordings and verified on scans of neither fit (`python -m benchmarks.health`). Maps differ in what a
    right pose shows: beside one recording's, the same fit believes too much on simulated floors, whose maps are clean.
    `probability` is tempered to what holds on both kinds together (Platt 1999); places that are weighed against each
    other on one map need no tempering. Unknown ground is the
    zero that the other classes are weighed against; that a beam through a wall weighs little more does no harm, since
    it takes its share from the beams that end on one.
    """

    bias: float = setting(-15.6, "", "log-odds without any beam", low=-100.0, high=100.0)
    on_wall: float = setting(23.3, "", "weight of the share that ends on a wall", low=-100.0, high=100.0)
    near_wall: float = setting(-17.9, "", "weight of the share that ends near a wall", low=-100.0, high=100.0)
    in_free: float = setting(-28.4, "", "weight of the share that ends on free ground", low=-100.0, high=100.0)
    through_wall: float = setting(5.7, "", "weight of the share that went through a wall", low=-100.0, high=100.0)
    temper: float = setting(0.6, "", "share of these log-odds that holds on other maps", low=0.01, high=10.0)
    caution: float = setting(0.8, "", "log-odds that are taken off then", low=-10.0, high=10.0)


@dataclass(frozen=True, slots=True)
class BeamMap:
    """A map as beams see it: `kinds` (H, W) u8 0 free, 1 wall, 2 unknown; `away` (H, W) f32 [m] to the nearest wall."""

    kinds: Bytes
    away: Float32Array
    resolution: float
    map_from_grid: Pose2 = field(default_factory=Pose2)


def beam_map(grid: OccupancyGrid) -> BeamMap:
    """The map as beams see it."""
    solid: BoolArray = occupied(grid)
    kinds = np.where(grid.cells < 0, _UNKNOWN, np.where(solid, _WALL, _FREE)).astype(np.uint8)
    return BeamMap(kinds, distances(solid, grid.resolution), grid.resolution, grid.map_from_grid)


def beam_classes(points: FloatArray, sensors: FloatArray, map_from_base: FloatArray, beams: BeamMap) -> FloatArray:
    """(P, 5) share of the beams of each class, at each of the poses (P, 3) [m, m, rad] in the map.

    Points (N, 2) [m] are the beams' ends, `sensors` (N, 2) [m] where each was seen from, both in the base frame.
    No points give shares of 0.
    """
    local = compose(beams.map_from_grid.inverse().array(), np.atleast_2d(map_from_base))
    return _classes(points, sensors, local, beams.kinds, beams.away, beams.resolution)


def log_odds(shares: FloatArray, settings: HealthSettings) -> FloatArray:
    """(P,) log-odds that poses with these shares (P, 5) are right."""
    weights = np.array([settings.on_wall, settings.near_wall, settings.in_free, settings.through_wall, 0.0])
    result: FloatArray = settings.bias + shares @ weights
    return result


def probability(odds: FloatArray, settings: HealthSettings) -> FloatArray:
    """(P,) in (0, 1) that poses with these log-odds (P,) are right, where right and wrong are as likely beforehand."""
    tempered = settings.temper * odds - settings.caution
    result: FloatArray = 1.0 / (1.0 + np.exp(-np.clip(tempered, -50.0, 50.0)))
    return result


@njit(cache=True, nogil=True)
def _classes(
    points: FloatArray, sensors: FloatArray, poses: FloatArray, kinds: Bytes, away: Float32Array, resolution: float
) -> FloatArray:
    shares = np.zeros((len(poses), CLASSES))
    for p in range(len(poses)):
        c, s = math.cos(poses[p, 2]), math.sin(poses[p, 2])
        for i in range(len(points)):
            x0 = poses[p, 0] + c * sensors[i, 0] - s * sensors[i, 1]
            y0 = poses[p, 1] + s * sensors[i, 0] + c * sensors[i, 1]
            x1 = poses[p, 0] + c * points[i, 0] - s * points[i, 1]
            y1 = poses[p, 1] + s * points[i, 0] + c * points[i, 1]
            shares[p, _class_of(x0, y0, x1, y1, kinds, away, resolution)] += 1.0 / len(points)
    return shares


@njit(cache=True, nogil=True)
def _class_of(x0: float, y0: float, x1: float, y1: float, kinds: Bytes, away: Float32Array, resolution: float) -> int:
    """Class of the beam from (x0, y0) to (x1, y1) [m, grid frame], followed in steps of half a cell."""
    height, width = kinds.shape
    length = math.hypot(x1 - x0, y1 - y0)
    step = 0.5 * resolution
    # a wall this near the end is the one that was hit, grazed or slightly displaced
    last = length - max(0.3, 0.1 * length)
    for k in range(1, int(last / step)):
        x, y = x0 + (x1 - x0) * k * step / length, y0 + (y1 - y0) * k * step / length
        row, col = math.floor(y / resolution), math.floor(x / resolution)
        if 0 <= row < height and 0 <= col < width and kinds[row, col] == 1:
            return THROUGH_WALL
    row, col = math.floor(y1 / resolution), math.floor(x1 / resolution)
    if not (0 <= row < height and 0 <= col < width):
        return IN_UNKNOWN
    if away[row, col] <= 0.1:
        return ON_WALL
    if away[row, col] <= 0.25:
        return NEAR_WALL
    return IN_UNKNOWN if kinds[row, col] == 2 else IN_FREE
