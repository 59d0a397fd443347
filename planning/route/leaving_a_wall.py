"""Leaving a cramped place, such as parked along a wall: straight along it, then away in a tightening turn.

A chair that turns beside a wall swings an end into it. If its other end is b behind the axle, that corner comes nearer
by b theta and moves away with the distance gained, y' = theta. Both in balance give a turn whose heading grows as
exp(s / b) with the distance s. The fixed steps and bins of `manoeuvre` are too coarse for that, so such turns are
generated here directly.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import product

import numpy as np
from numba import njit

from waychair.calibration.chair_body import ChairBody
from waychair.errors import ConfigError
from waychair.geometry import compose, transform_points
from waychair.maps.grid.distance_field import DistanceField
from waychair.planning.body.clearance import CRAMPED, LEAVING, LEAVING_DIP, LEAVING_STEP, LEFT
from waychair.planning.body.footprint import Footprint, fits, footprint, in_cells, room
from waychair.resumable import Resumable
from waychair.types import FloatArray, Pose2

BY_HAND = "drive it a little away by hand"
"""Advice for a chair that cannot be led out."""


_SPACING = 0.05
"""Distance [m] between poses."""

_STRAIGHT, _TURN = 30, 60
"""Most steps of the straight and of the turning part. A chair with its axle in the middle needs the most."""

_ARCS, _WIDENING, _TIGHTEST = (0.1, 0.2, 0.4, 0.8), (0.005, 0.01, 0.02, 0.05, 0.1), 0.8
"""Curvatures [1/m]: of constant arcs, of the beginnings of tightening turns, and the largest of any turn."""

_REVERSE_PRICE, _GEAR_PRICE = 1.6, 0.5
"""Cost of a metre backwards in metres forwards, and of a change of direction [m]."""


def leading_out_path(
    field: DistanceField, body: ChairBody, start: Pose2, doubt: float = 0.0
) -> Resumable[FloatArray | None]:
    """Return poses (N, 3) [m, m, rad] in map, every 5 cm from the start to the nearest place with room; resumable.

    The path is a straight line, a turn, or a line and then a turn, each forwards or backwards. None when the chair has
    room at the start, when it touches something there, or when there is no such path. `doubt` [m]: by so much the cells
    of a coarse map may reach beyond the true obstacles, so that a chair whose front or rear seems to touch one by less
    stands free, and is led straight away from it.
    """
    if fits(body, CRAMPED, field, start):
        return None
    kept = next((margin for margin in LEAVING if fits(body, margin, field, start)), None)
    if kept is None:
        return (yield from _straight_out(field, body, start, doubt))
    yield
    tight, roomy = footprint(body, kept * (1.0 - LEAVING_DIP), field), footprint(body, LEFT, field)
    turns = {1: _turns(body.rear, 1), -1: _turns(body.front, -1)}
    best: FloatArray | None = None
    least = math.inf
    for gear, onwards in product((1, -1), (1, -1)):
        straight = compose(start.array(), _turn(0.0, 0.0, gear, _STRAIGHT))
        for k in range(0, len(straight), 4):
            yield
            before = _price(k, gear) + (_GEAR_PRICE if k and gear != onwards else 0.0)
            longest = _TURN if best is None else min(_TURN, math.floor((least - before) / _price(1, onwards)) - 1)
            if longest < 0 or not fits(body, kept * (1.0 - LEAVING_DIP), field, Pose2(*straight[k])):
                break
            which, end = _shortest(tight, roomy, in_cells(field, Pose2(*straight[k])), turns[onwards], longest)
            if which >= 0:
                least = before + _price(end, onwards)
                best = np.concatenate([straight[:k], compose(straight[k], turns[onwards][which, : end + 1])])
    return best


def standing_body(field: DistanceField, body: ChairBody, pose: Pose2, doubt: float) -> ChairBody | None:
    """Return the body, shortened at both ends by at most `doubt` [m] until it fits at a pose; None if it does not.

    Its sides are not doubted: along a wall, no straight line leads away from it.
    """
    for step in range(math.floor(doubt / LEAVING_STEP + 1e-9) + 1):
        by = step * LEAVING_STEP
        try:
            shorter = (
                replace(body, length=body.length - 2 * by, axle_from_rear=body.axle_from_rear - by) if step else body
            )
        except ConfigError:  # no body is so short, or has its axle so near to its rear
            return None
        if fits(shorter, 0.0, field, pose):
            return shorter
    return None


def _straight_out(field: DistanceField, body: ChairBody, start: Pose2, doubt: float) -> Resumable[FloatArray | None]:
    """Return a path out that begins with a straight line, on which the body as it stands keeps free, or None; resumable.

    The line ends where the whole body has room, or where it can be led out like anywhere else.
    """
    shorter = standing_body(field, body, start, doubt)
    if shorter is None or shorter is body:
        return None
    for gear in (-1, 1):
        line = compose(start.array(), _turn(0.0, 0.0, gear, _STRAIGHT))
        for k, pose in enumerate(line):
            yield
            here = Pose2(*pose)
            if not fits(shorter, 0.0, field, here):
                break
            if fits(body, CRAMPED, field, here):
                return line[: k + 1]
            if k >= _OUT_FIRST and fits(body, LEAVING[-2], field, here):
                onwards = yield from leading_out_path(field, body, here)
                if onwards is not None:
                    return np.concatenate([line[:k], onwards])
                break
    return None


_OUT_FIRST = 2
"""Steps of the straight line before any turn: as far as two cells of a usual map."""


def reason_for_cramped(field: DistanceField, body: ChairBody, pose: Pose2, needed: float = CRAMPED) -> str | None:
    """Return a sentence on why a body at a pose has less clearance than needed [m]; None if it has enough."""
    if fits(body, needed, field, pose):
        return None
    front, rear, half = body.front, body.rear, body.width / 2
    along, across = np.linspace(0.05 - rear, front - 0.05, 50), np.linspace(0.05 - half, half - 0.05, 50)
    edges = {
        "ahead": (np.full(50, front), across),
        "behind": (np.full(50, -rear), across),
        "on its left": (along, np.full(50, half)),
        "on its right": (along, np.full(50, -half)),
    }
    grid_from_body = field.map_from_grid.inverse() @ pose

    def away(side: str) -> float:
        cells = np.floor(transform_points(grid_from_body, np.column_stack(edges[side])) / field.resolution)
        rows, columns = np.clip(cells[:, ::-1].astype(np.int64), 0, np.array(field.metres.shape) - 1).T
        return float(field.metres[rows, columns].min())

    return f"an obstacle {min(edges, key=away)} leaves the chair no room to turn"


@njit(cache=True, nogil=True)
def _shortest(
    tight: Footprint, roomy: Footprint, start: FloatArray, turns: FloatArray, longest: int
) -> tuple[int, int]:
    """Return which of turns (M, N, 3) [m, m, rad] first reaches room from a start (3,) [cells, cells, rad], and where.

    The second number is the index of its pose, at most `longest`; the first is -1 when no turn reaches room.
    """
    c, s = math.cos(start[2]), math.sin(start[2])
    which = -1
    for i in range(len(turns)):
        for k in range(longest + 1):
            u, v = turns[i, k, 0] / tight.cell, turns[i, k, 1] / tight.cell
            x, y, theta = start[0] + c * u - s * v, start[1] + s * u + c * v, start[2] + turns[i, k, 2]
            if room(tight, x, y, theta, 0.0) < 0.0:
                break
            if room(roomy, x, y, theta, 0.0) >= 0.0:
                which, longest = i, k - 1
                break
    return which, longest + 1


_LEAST_END = 0.05
"""Least distance [m] from axle to end in the tightening rate: a shorter end hardly swings out."""


def _turns(other_end: float, gear: int) -> FloatArray:
    """Return turns (M, _TURN + 1, 3) from the origin for a chair whose other end is so far [m] from its axle."""
    kinds = [(k, 0.0) for k in _ARCS] + [(k, g / max(other_end, _LEAST_END)) for g, k in product((0.7, 1.0), _WIDENING)]
    bent = [_turn(side * k, growth, gear, _TURN) for k, growth in kinds for side in (1.0, -1.0)]
    return np.array([_turn(0.0, 0.0, gear, _TURN), *bent])


def _turn(curvature: float, growth: float, gear: int, steps: int) -> FloatArray:
    """Return poses (steps + 1, 3) from the origin whose curvature [1/m] grows as exp(growth s) up to the tightest."""
    s = (np.arange(steps) + 0.5) * _SPACING
    bent = math.copysign(1.0, curvature) * np.minimum(np.abs(curvature) * np.exp(growth * s), _TIGHTEST)
    theta = np.concatenate([[0.0], np.cumsum(gear * bent * _SPACING)])
    middle = (theta[:-1] + theta[1:]) / 2
    x, y = np.cumsum(gear * _SPACING * np.array([np.cos(middle), np.sin(middle)]), axis=1)
    return np.column_stack([np.concatenate([[0.0], x]), np.concatenate([[0.0], y]), theta])


def _price(steps: int, gear: int) -> float:
    return steps * _SPACING * (1.0 if gear > 0 else _REVERSE_PRICE)
