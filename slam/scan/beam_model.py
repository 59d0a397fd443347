"""Beam model: classify each beam of a scan by its end and by the cells it crosses, and rate a pose by the shares.

Each beam is traced from the lidar through the map's cells and falls into one of seven classes. At a true pose few
beams pass through walls; at a lookalike pose many do. Likelihood fields ignore this (Thrun, Burgard and Fox,
Probabilistic Robotics, 2005, section 6.4.2). Beams into unknown ground are weak evidence.

A beam that ends before the map's wall may have hit a person or object that is not on the map (the book's p_short,
section 6.3.1; Fox, Burgard and Thrun 1999 filter such beams by their distance). The neighbouring beams decide: a
surface as narrow as a person or a cart hides the wall behind it and is no evidence, a wider one is probably a wall that
the map lacks. A beam through a wall that ends on another wall is no evidence either: the first may be glass, an open
door, or an edge that was drawn to keep chairs away. A beam that ends on unknown ground beside a wall without having
crossed it has hit the other side of a thing that was seen from one side only.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numba import njit

from waychair.geometry import compose
from waychair.maps.grid.cells import occupied
from waychair.maps.grid.distance_field import distances
from waychair.types import BoolArray, Bytes, Float32Array, FloatArray, OccupancyGrid, Pose2

ON_WALL, NEAR_WALL, IN_FREE, THROUGH_WALL, IN_UNKNOWN, ON_OBJECT, ON_FAR_WALL = range(7)
"""Classes of a beam, by where it ends: on a wall; near a wall; on a wide surface in free space; behind a wall; on unknown
ground; on a narrow object in free space; behind a wall and on another wall."""

CLASSES = 7
_FREE, _WALL, _UNKNOWN = 0, 1, 2
_MAX_OBJECT_WIDTH = 1.0
"""Surfaces in free space up to this width [m] count as people, carts or chairs; wider ones count as walls."""


@dataclass(frozen=True, slots=True)
class HealthWeights:
    """Weights of the log-odds that a tracked pose is right (within 0.3 m and 5 degrees), linear in the beam shares.

    `ON_OBJECT` and `ON_FAR_WALL` have no weight: they are no evidence. There is no bias, so a scan that people hide
    completely gives even odds. Wide surfaces weigh little, because people side by side also form one; at a wrong pose
    they come with beams through walls. Fitted on two recordings and two simulated floors, empty and crowded; verified
    on another floor and on scans outside the fit (`python -m evaluation.speed.health`).
    """

    on_wall: float = 3.4  # weight of the share that ends on a wall
    near_wall: float = -11.4  # weight of the share that ends near a wall
    in_free: float = -3.6  # weight of the share that ends on wide surfaces
    through_wall: float = -36.9  # weight of the share that ends behind a wall
    in_unknown: float = -2.6  # weight of the share that ends on unknown ground


@dataclass(frozen=True, slots=True)
class PlaceWeights:
    """Weights of the log-odds that a place found by global search is right, linear in the beam shares.

    The test is stricter than that of a tracked pose, because a search of the whole map returns every lookalike: objects
    weigh as much as wide surfaces, and far walls as much as beams through walls. In a crowd a lost chair stays lost
    until people move. Fitted on two recordings and verified on scans outside the fit. The positive weight of
    `through_wall` does no harm: such beams reduce the share of beams on walls.
    """

    bias: float = -15.6  # log-odds without any beam
    on_wall: float = 23.3  # weight of the share that ends on a wall
    near_wall: float = -17.9  # weight of the share that ends near a wall
    in_free: float = -28.4  # weight of the share that ends on free ground
    through_wall: float = 5.7  # weight of the share that went through a wall


HEALTH = HealthWeights()
PLACE = PlaceWeights()


@dataclass(frozen=True, slots=True)
class BeamMap:
    """A map for beam tracing: `kinds` (H, W) u8 0 free, 1 wall, 2 unknown; `wall_distance` (H, W) f32 [m] to the nearest wall."""

    kinds: Bytes
    wall_distance: Float32Array
    resolution: float
    map_from_grid: Pose2 = field(default_factory=Pose2)


def beam_map(grid: OccupancyGrid) -> BeamMap:
    """Return the map in the form that beam tracing needs."""
    solid: BoolArray = occupied(grid)
    kinds = np.where(grid.cells < 0, _UNKNOWN, np.where(solid, _WALL, _FREE)).astype(np.uint8)
    return BeamMap(kinds, distances(solid, grid.resolution), grid.resolution, grid.map_from_grid)


def beam_classes(points: FloatArray, sensors: FloatArray, map_from_base: FloatArray, beams: BeamMap) -> FloatArray:
    """Return the share (P, 7) of beams in each class, at each of the poses (P, 3) [m, m, rad] in the map frame.

    `points` (N, 2) [m] are the beams' ends in the order of measurement, `sensors` (N, 2) [m] the lidar's position for
    each beam, both in the base frame. Without points all shares are 0.
    """
    local = compose(beams.map_from_grid.inverse().array(), np.atleast_2d(map_from_base))
    return _classes(points, sensors, local, beams.kinds, beams.wall_distance, beams.resolution)


def pose_probability(shares: FloatArray, weights: HealthWeights = HEALTH) -> FloatArray:
    """Return the probability (P,) in (0, 1) that tracked poses with shares (P, 7) are right, at prior odds of 1 : 1."""
    w = (weights.on_wall, weights.near_wall, weights.in_free, weights.through_wall, weights.in_unknown)
    odds = shares[:, [ON_WALL, NEAR_WALL, IN_FREE, THROUGH_WALL, IN_UNKNOWN]] @ np.array(w)
    result: FloatArray = 1.0 / (1.0 + np.exp(-np.clip(odds, -50.0, 50.0)))
    return result


def place_log_odds(shares: FloatArray, weights: PlaceWeights = PLACE) -> FloatArray:
    """Return the log-odds (P,) that places found by global search, with shares (P, 7), are right."""
    result: FloatArray = (
        weights.bias
        + weights.on_wall * shares[:, ON_WALL]
        + weights.near_wall * shares[:, NEAR_WALL]
        + weights.in_free * (shares[:, IN_FREE] + shares[:, ON_OBJECT])
        + weights.through_wall * (shares[:, THROUGH_WALL] + shares[:, ON_FAR_WALL])
    )
    return result


@njit(cache=True, nogil=True)
def _classes(
    points: FloatArray,
    sensors: FloatArray,
    poses: FloatArray,
    kinds: Bytes,
    wall_distance: Float32Array,
    resolution: float,
) -> FloatArray:
    shares = np.zeros((len(poses), CLASSES))
    for p in range(len(poses)):
        c, s = math.cos(poses[p, 2]), math.sin(poses[p, 2])
        first, wide = -1, 0.0  # first beam [index] and width [m] of the current surface in free space
        for i in range(len(points)):
            x0 = poses[p, 0] + c * sensors[i, 0] - s * sensors[i, 1]
            y0 = poses[p, 1] + s * sensors[i, 0] + c * sensors[i, 1]
            x1 = poses[p, 0] + c * points[i, 0] - s * points[i, 1]
            y1 = poses[p, 1] + s * points[i, 0] + c * points[i, 1]
            found = _trace_beam(x0, y0, x1, y1, kinds, wall_distance, resolution)
            if first >= 0 and not (found == IN_FREE and _on_same_surface(points, sensors, i)):
                shares[p, ON_OBJECT if wide <= _MAX_OBJECT_WIDTH else IN_FREE] += (i - first) / len(points)
                first = -1
            if found != IN_FREE:
                shares[p, found] += 1.0 / len(points)
            elif first < 0:
                first, wide = i, 0.0
            else:
                wide = max(wide, math.hypot(points[i, 0] - points[first, 0], points[i, 1] - points[first, 1]))
        if first >= 0:
            shares[p, ON_OBJECT if wide <= _MAX_OBJECT_WIDTH else IN_FREE] += (len(points) - first) / len(points)
    return shares


@njit(cache=True, nogil=True)
def _on_same_surface(points: FloatArray, sensors: FloatArray, i: int) -> bool:
    """Return whether beam i ends on the same surface as beam i - 1: their ends lie close together for their range."""
    gap = math.hypot(points[i, 0] - points[i - 1, 0], points[i, 1] - points[i - 1, 1])
    return gap <= max(0.1, 0.1 * math.hypot(points[i, 0] - sensors[i, 0], points[i, 1] - sensors[i, 1]))


_DIAGONAL = 1.42
"""Diagonal of a cell, in cells."""


@njit(cache=True, nogil=True)
def _trace_beam(
    x0: float, y0: float, x1: float, y1: float, kinds: Bytes, wall_distance: Float32Array, resolution: float
) -> int:
    """Return the class of the beam from (x0, y0) to (x1, y1) [m, grid frame], traced in steps of half a cell.

    The distance to the nearest wall lets the trace skip steps that cannot meet one.
    """
    height, width = kinds.shape
    row, col = math.floor(y1 / resolution), math.floor(x1 / resolution)
    inside = 0 <= row < height and 0 <= col < width
    length = math.hypot(x1 - x0, y1 - y0)
    step = 0.5 * resolution
    # a wall this near the beam's end is the wall that it hit, grazed or slightly displaced
    last = length - max(0.3, 0.1 * length)
    unknown = inside and kinds[row, col] == _UNKNOWN
    before = int(last / step)
    k, end = 1, int(length / step) if unknown else before
    crosses = False
    while k < end:
        x, y = x0 + (x1 - x0) * k * step / length, y0 + (y1 - y0) * k * step / length
        i, j = math.floor(y / resolution), math.floor(x / resolution)
        if not (0 <= i < height and 0 <= j < width):
            k += 1
        elif kinds[i, j] == _WALL:
            crosses = True
            break
        else:  # `wall_distance` runs between cell centres: up to half a diagonal less at both ends
            k += max(1, int((wall_distance[i, j] - _DIAGONAL * resolution) / step))
    if crosses and k < before:
        return ON_FAR_WALL if inside and wall_distance[row, col] <= 0.1 else THROUGH_WALL
    if not inside:
        return IN_UNKNOWN
    if wall_distance[row, col] <= 0.1:
        return ON_WALL
    if wall_distance[row, col] <= 0.25 and (crosses or not unknown):
        return NEAR_WALL
    return IN_UNKNOWN if unknown else IN_FREE
