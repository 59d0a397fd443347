"""What the beams of a scan say about a pose on a map: not only where they end, but what they passed through.

Each beam is followed from the lidar through the map's cells and falls into one of seven classes. A real pose shows few
beams that go through walls; a lookalike shows many (the visibility test of likelihood-field localisation's weakness,
Thrun, Burgard and Fox 2005, section 6.4.2). Unknown ground contradicts little.

A beam that ends before the map's wall may have met somebody who is not on the map (the same book's p_short, section
6.3.1; Fox, Burgard and Thrun 1999 filter such beams by their distance). Whether it has is seen from what the beams
beside it met: a surface as narrow as a person or a cart hides the wall behind it and says nothing about the pose, a
wider one is rather a wall that the map does not have. A beam through a wall that ends on another one says nothing
either: the first may be glass, a door that stands open, or an edge that was drawn to keep chairs away from it.
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

ON_WALL, NEAR_WALL, IN_FREE, THROUGH_WALL, IN_UNKNOWN, ON_OBJECT, ON_FAR_WALL = range(7)
"""Classes of a beam. It ends on a wall; near one; on a wide surface on free ground; behind a wall; on unknown ground;
on something narrow on free ground; behind a wall, on another one."""

CLASSES = 7
_FREE, _WALL, _UNKNOWN = 0, 1, 2
_OBJECT = 1.0
"""Surfaces on free ground up to this width [m] are people, carts, chairs; wider ones are walls."""


@dataclass(frozen=True, slots=True)
class HealthSettings(Settings):
    """Log-odds that a pose which is followed is right (within 0.3 m and 5 degrees), linear in shares of its beams.

    What the weights leave out, objects and walls behind walls, says nothing. Nor is there a bias, so that a scan which
    is hidden by people altogether leaves even odds. Wide surfaces weigh little, since people who stand side by side are
    some too; those of a wrong pose come with beams through walls. Fitted on two recordings and two simulated floors,
    calm and in crowds, and verified on another floor and on scans that the fit has not seen (`python -m benchmarks.health`).
    """

    on_wall: float = setting(3.4, "", "weight of the share that ends on a wall", low=-100.0, high=100.0)
    near_wall: float = setting(-11.4, "", "weight of the share that ends near a wall", low=-100.0, high=100.0)
    in_free: float = setting(-3.6, "", "weight of the share that ends on wide surfaces", low=-100.0, high=100.0)
    through_wall: float = setting(-36.9, "", "weight of the share that ends behind a wall", low=-100.0, high=100.0)
    in_unknown: float = setting(-2.6, "", "weight of the share that ends on unknown ground", low=-100.0, high=100.0)


@dataclass(frozen=True, slots=True)
class PlaceSettings(Settings):
    """Log-odds that a place which was found from nowhere is right, linear in the shares of its beams' classes.

    Stricter than what is asked of a pose that is followed: all that is seen must fit, objects weigh as much as surfaces
    and no wall is seen through, since a search of the whole map finds whatever resembles it. In a crowd a lost chair
    stays lost until people make way. Fitted on two recordings and verified on scans of neither fit. That a beam through
    a wall weighs little more than one on unknown ground does no harm, since it takes its share from those on walls.
    """

    bias: float = setting(-15.6, "", "log-odds without any beam", low=-100.0, high=100.0)
    on_wall: float = setting(23.3, "", "weight of the share that ends on a wall", low=-100.0, high=100.0)
    near_wall: float = setting(-17.9, "", "weight of the share that ends near a wall", low=-100.0, high=100.0)
    in_free: float = setting(-28.4, "", "weight of the share that ends on free ground", low=-100.0, high=100.0)
    through_wall: float = setting(5.7, "", "weight of the share that went through a wall", low=-100.0, high=100.0)


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
    """(P, 7) share of the beams of each class, at each of the poses (P, 3) [m, m, rad] in the map.

    Points (N, 2) [m] are the beams' ends in the order in which they were taken, `sensors` (N, 2) [m] where each was
    seen from, both in the base frame. No points give shares of 0.
    """
    local = compose(beams.map_from_grid.inverse().array(), np.atleast_2d(map_from_base))
    return _classes(points, sensors, local, beams.kinds, beams.away, beams.resolution)


def probability(shares: FloatArray, settings: HealthSettings) -> FloatArray:
    """(P,) in (0, 1) that followed poses with these shares (P, 7) are right, were right and wrong as likely before."""
    weights = (settings.on_wall, settings.near_wall, settings.in_free, settings.through_wall, settings.in_unknown)
    odds = shares[:, [ON_WALL, NEAR_WALL, IN_FREE, THROUGH_WALL, IN_UNKNOWN]] @ np.array(weights)
    result: FloatArray = 1.0 / (1.0 + np.exp(-np.clip(odds, -50.0, 50.0)))
    return result


def place_log_odds(shares: FloatArray, settings: PlaceSettings) -> FloatArray:
    """(P,) log-odds that places found from nowhere with these shares (P, 7) are right."""
    result: FloatArray = (
        settings.bias
        + settings.on_wall * shares[:, ON_WALL]
        + settings.near_wall * shares[:, NEAR_WALL]
        + settings.in_free * (shares[:, IN_FREE] + shares[:, ON_OBJECT])
        + settings.through_wall * (shares[:, THROUGH_WALL] + shares[:, ON_FAR_WALL])
    )
    return result


@njit(cache=True, nogil=True)
def _classes(
    points: FloatArray, sensors: FloatArray, poses: FloatArray, kinds: Bytes, away: Float32Array, resolution: float
) -> FloatArray:
    shares = np.zeros((len(poses), CLASSES))
    for p in range(len(poses)):
        c, s = math.cos(poses[p, 2]), math.sin(poses[p, 2])
        first, wide = -1, 0.0  # where the surface on free ground began that the beam before ended on, and its width
        for i in range(len(points)):
            x0 = poses[p, 0] + c * sensors[i, 0] - s * sensors[i, 1]
            y0 = poses[p, 1] + s * sensors[i, 0] + c * sensors[i, 1]
            x1 = poses[p, 0] + c * points[i, 0] - s * points[i, 1]
            y1 = poses[p, 1] + s * points[i, 0] + c * points[i, 1]
            found = _class_of(x0, y0, x1, y1, kinds, away, resolution)
            if first >= 0 and not (found == IN_FREE and _joined(points, sensors, i)):
                shares[p, ON_OBJECT if wide <= _OBJECT else IN_FREE] += (i - first) / len(points)
                first = -1
            if found != IN_FREE:
                shares[p, found] += 1.0 / len(points)
            elif first < 0:
                first, wide = i, 0.0
            else:
                wide = max(wide, math.hypot(points[i, 0] - points[first, 0], points[i, 1] - points[first, 1]))
        if first >= 0:
            shares[p, ON_OBJECT if wide <= _OBJECT else IN_FREE] += (len(points) - first) / len(points)
    return shares


@njit(cache=True, nogil=True)
def _joined(points: FloatArray, sensors: FloatArray, i: int) -> bool:
    """Whether beam i ends on the same surface as the one before: about as near, or next to it."""
    gap = math.hypot(points[i, 0] - points[i - 1, 0], points[i, 1] - points[i - 1, 1])
    return gap <= max(0.1, 0.1 * math.hypot(points[i, 0] - sensors[i, 0], points[i, 1] - sensors[i, 1]))


_DIAGONAL = 1.42
"""Of a cell, in cells."""


@njit(cache=True, nogil=True)
def _class_of(x0: float, y0: float, x1: float, y1: float, kinds: Bytes, away: Float32Array, resolution: float) -> int:
    """Class of the beam from (x0, y0) to (x1, y1) [m, grid frame], followed in steps of half a cell.

    Steps on which no wall can be, by how far away the nearest is, are left out.
    """
    height, width = kinds.shape
    length = math.hypot(x1 - x0, y1 - y0)
    step = 0.5 * resolution
    # a wall this near the end is the one that was hit, grazed or slightly displaced
    last = length - max(0.3, 0.1 * length)
    through = False
    k, end = 1, int(last / step)
    while k < end:
        x, y = x0 + (x1 - x0) * k * step / length, y0 + (y1 - y0) * k * step / length
        row, col = math.floor(y / resolution), math.floor(x / resolution)
        if not (0 <= row < height and 0 <= col < width):
            k += 1
        elif kinds[row, col] == _WALL:
            through = True
            break
        else:  # `away` is from middle to middle of cells, so up to half a diagonal less at both ends
            k += max(1, int((away[row, col] - _DIAGONAL * resolution) / step))
    row, col = math.floor(y1 / resolution), math.floor(x1 / resolution)
    inside = 0 <= row < height and 0 <= col < width
    if through:
        return ON_FAR_WALL if inside and away[row, col] <= 0.1 else THROUGH_WALL
    if not inside:
        return IN_UNKNOWN
    if away[row, col] <= 0.1:
        return ON_WALL
    if away[row, col] <= 0.25:
        return NEAR_WALL
    return IN_UNKNOWN if kinds[row, col] == _UNKNOWN else IN_FREE
