"""The chair's measurements as the default network's sensors take them: pictures, drop-offs, people, map and doorways.

Pure functions from the data of other rooms to `Fans`, `MapPart` and `DoorsSeen`. The cells do not learn from which
device a fan comes.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from numba import njit

from waychair.calibration.chair_body import TALLEST
from waychair.control.behaviours.doorway import DoorwayJambs
from waychair.control.behaviours.view.door_cells import DoorSeen, DoorsSeen
from waychair.control.behaviours.view.local_view import Beams, Fans, MapPart, Thing
from waychair.control.behaviours.view.view_kernels import CELL, SIDE, direction_part
from waychair.geometry import transform_points
from waychair.maps.depth.ground import BELOW, FARTHEST_GROUND, GROUND, MISSING, NOTHING, STANDS, GroundView
from waychair.maps.grid.cells import cells_from_points
from waychair.planning.body.personal_space import PERSON_RADIUS
from waychair.planning.seen.doorways import DoorState
from waychair.planning.seen.doorways import Doorway as FoundDoorway
from waychair.types import UNKNOWN, BoolArray, Bytes, FloatArray, OccupancyGrid, Pose2

_PARTS = 320
"""Directions round the camera; see `view_kernels.direction_part`."""

_BEAM = 2 * math.tau / _PARTS
"""rad; greatest width of such a direction: 12 cm at 3 m."""

_LOWEST = 0.06
"""m; points below this are floor."""

_PERSON_BEAMS = 12
"""Points of a person's outline."""

_DOOR_REACH = 6.0
"""m; doorways farther away are not told of."""


def picture_fans(view: GroundView) -> tuple[Fans, Fans]:
    """Return a picture's part for obstacles, and its part for drop-offs and missing ground.

    Each direction has one beam: free from the first to the last ground seen in it, and hit at the nearest thing at the
    heights of chair and rider, or at the nearest drop-off.
    """
    solid, drops = _directions(view.ends, view.kind, view.foot, view.rim, view.directions, view.lens)
    origin = view.lens[:2].copy()

    def part(found: tuple[FloatArray, FloatArray, BoolArray], thing: Thing) -> Fans:
        ends, near, hits = found
        return Fans((Beams(origin, ends.astype(np.float32), hits, _BEAM / 2, int(thing), True, near),), view.stamp_ns)

    return part(solid, Thing.SOLID), part(drops, Thing.DROP_OFF)


@njit(cache=True, nogil=True)
def _directions(
    ends: FloatArray, kind: Bytes, foot: FloatArray, rim: BoolArray, directions: FloatArray, lens: FloatArray
) -> tuple[tuple[FloatArray, FloatArray, BoolArray], tuple[FloatArray, FloatArray, BoolArray]]:
    """Return ends (B, 2) [m], `near` (B,) [m] and hits (B,) of the beams for things that stand, and for drop-offs."""
    first, last = np.full(_PARTS, np.inf), np.zeros(_PARTS)
    stands, drops = np.full(_PARTS, np.inf), np.full(_PARTS, np.inf)
    towards, drop_towards, stand_towards = np.zeros((_PARTS, 2)), np.zeros((_PARTS, 2)), np.zeros((_PARTS, 2))
    height, width = kind.shape
    for column in range(width):
        for row in range(height):
            what = kind[row, column]
            if what == NOTHING:
                continue
            x, y = directions[row, column, 0], directions[row, column, 1]
            place = direction_part(x, y, _PARTS)
            if what in (BELOW, MISSING):
                away = foot[row, column]
            else:
                away = math.hypot(ends[row, column, 0] - lens[0], ends[row, column, 1] - lens[1])
            if math.isnan(away):
                continue
            if what == GROUND and away < FARTHEST_GROUND:
                first[place] = min(first[place], away)
                if away > last[place]:
                    last[place] = away
                    towards[place, 0], towards[place, 1] = x, y
            if (what in (BELOW, MISSING) or rim[row, column]) and away < drops[place]:
                drops[place] = away
                drop_towards[place, 0], drop_towards[place, 1] = x, y
            if what == STANDS and _LOWEST <= ends[row, column, 2] <= TALLEST and away < stands[place]:
                stands[place] = away
                stand_towards[place, 0], stand_towards[place, 1] = x, y
    solid = _beams(first, last, towards, stands, stand_towards, drops, lens)
    return solid, _beams(first, last, towards, drops, drop_towards, stands, lens)


@njit(cache=True, nogil=True)
def _beams(
    first: FloatArray,
    last: FloatArray,
    towards: FloatArray,
    nearest: FloatArray,
    met_towards: FloatArray,
    other: FloatArray,
    lens: FloatArray,
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return beams that hit at `nearest`, or else are free up to the `last` ground; none is free beyond an `other` thing."""
    points, near, hits = np.empty((_PARTS, 2)), np.empty(_PARTS), np.empty(_PARTS, np.bool_)
    count = 0
    for place in range(_PARTS):
        hits[count] = nearest[place] < np.inf
        if hits[count]:
            far, x, y = nearest[place], met_towards[place, 0], met_towards[place, 1]
            near[count] = min(first[place], far) if other[place] >= far else far
        elif first[place] < np.inf:
            far, x, y = min(last[place], other[place]), towards[place, 0], towards[place, 1]
            near[count] = min(first[place], far)
        else:
            continue
        points[count, 0], points[count, 1] = lens[0] + far * x, lens[1] + far * y
        count += 1
    return points[:count], near[:count], hits[:count]


def people_fans(positions: FloatArray) -> Fans:
    """Return people at positions (K, 2) [m] in base as a whole part: their outlines are hit, and clear no ground."""
    turns = np.linspace(0.0, math.tau, _PERSON_BEAMS, endpoint=False)
    circle = PERSON_RADIUS * np.column_stack([np.cos(turns), np.sin(turns)])
    ends = (positions[:, None] + circle).reshape(-1, 2).astype(np.float32)
    hits = np.ones(len(ends), np.bool_)
    return Fans((Beams(np.zeros(2), ends, hits, 0.0, int(Thing.PERSON), False),), whole=True)


def map_part(grid: OccupancyGrid, map_from_base: Pose2, odom_from_map: Pose2) -> MapPart | None:
    """Return the part of a map round the chair, in cells about as large as the view's; None off the map.

    A larger cell is occupied if any of its parts is.
    """
    n = max(1, round(CELL / grid.resolution))
    half = math.ceil(SIDE * CELL / 2 / grid.resolution)
    row, col = cells_from_points(grid, np.array([[map_from_base.x, map_from_base.y]]))[0].tolist()
    top, left = max(row - half, 0) // n * n, max(col - half, 0) // n * n  # the groups must not depend on the pose
    cells = grid.cells[top : max(row + half, 0), left : max(col + half, 0)]
    if not cells.size:
        return None
    padded = np.pad(cells, [(0, -size % n) for size in cells.shape], constant_values=UNKNOWN)
    height, width = padded.shape
    coarse = padded.reshape(height // n, n, width // n, n).max(axis=(1, 3))
    corner = odom_from_map @ grid.map_from_grid @ Pose2(left * grid.resolution, top * grid.resolution)
    return MapPart(coarse, n * grid.resolution, corner.x, corner.y, corner.theta)


def doors_seen(doorways: Iterable[FoundDoorway], odom_from_base: Pose2) -> DoorsSeen:
    """Return the doorways near the chair, in base; left and right are those of the way along their pose's x axis."""
    base_from_odom = odom_from_base.inverse()
    near = []
    for found in doorways:
        at = base_from_odom @ found.pose
        if math.hypot(at.x, at.y) <= _DOOR_REACH:
            left, right = transform_points(at, np.array([[0.0, found.width / 2], [0.0, -found.width / 2]])).tolist()
            clear = max(found.clear - found.error, 0.0)
            is_open = found.state is DoorState.OPEN
            near.append(DoorSeen(found.number, DoorwayJambs(*left, *right), clear, is_open, found.validated))
    return DoorsSeen(tuple(near))
