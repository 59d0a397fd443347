"""Out of a place with hardly any room, say parked beside a wall: straight along it, then away in a widening turn.

Who turns beside a wall swings an end into it. Of a chair whose other end is b behind the axle, the corner comes nearer
by b theta and goes away with the way gained, y' = theta; both in balance make a turn that grows as exp(s / b) with the
way s. A search over places and headings has steps and bins of its own, too tight for that; here they are as wide as it
takes.
"""

from __future__ import annotations

import math
from itertools import product

import numpy as np
from numba import njit

from waychair.calibration.chair import ChairBody
from waychair.geometry import compose, transform_points
from waychair.maps.distance_field import DistanceField
from waychair.planning.footprint import Footprint, fits, footprint, in_cells, room
from waychair.planning.slices import Slices
from waychair.types import FloatArray, Pose2

CRAMPED = 0.03
"""A chair that has less than this [m] round it is to be led out."""

BY_HAND = "drive it a little away from there by hand"
"""What helps a chair that is not led out."""

_ENOUGH = 0.06
"""Kept free round the body [m] where the way out ends: a place to turn from like any other."""

_MARGINS = (0.025, 0.02, 0.015, 0.0125, 0.01, 0.0075, 0.005, 0.0025, 0.0)
"""Tried in turn [m]: the first that fits is what is kept where the chair stands."""

_DIP = 1 / 3
"""The part of what is free round the chair by which the way out may come nearer; every turn begins with a little."""

_SPACING = 0.05
"""Of the poses along the way [m]."""

_STRAIGHT, _TURN = 30, 60
"""Steps of either part of the way, at most. A chair with its axle in the middle takes the longest to get its end away."""

_ARCS, _WIDENING, _TIGHTEST = (0.1, 0.2, 0.4, 0.8), (0.005, 0.01, 0.02, 0.05, 0.1), 0.8
"""Curvatures [1/m] of arcs, those with which turns begin that grow tighter, and the tightest that one becomes."""

_REVERSE_PRICE, _GEAR_PRICE = 1.6, 0.5
"""A metre backwards in metres forwards, and a stop to go the other way [m]."""


def way_out(field: DistanceField, body: ChairBody, start: Pose2) -> Slices[FloatArray | None]:
    """Poses (N, 3) [m, m, rad] of the body in map, every 5 cm from the start to the nearest with room; in slices.

    The way is a straight line, a turn, or the one and then the other, each of them forwards or backwards. None when the
    chair has room where it stands, when it touches something there, or when there is no such way.
    """
    if fits(body, CRAMPED, field, start):
        return None
    kept = next((margin for margin in _MARGINS if fits(body, margin, field, start)), None)
    if kept is None:
        return None
    yield
    tight, roomy = footprint(body, kept * (1.0 - _DIP), field), footprint(body, _ENOUGH, field)
    turns = {1: _turns(body.rear, 1), -1: _turns(body.front, -1)}
    best: FloatArray | None = None
    least = math.inf
    for gear, onwards in product((1, -1), (1, -1)):
        straight = compose(start.array(), _turn(0.0, 0.0, gear, _STRAIGHT))
        for k in range(0, len(straight), 4):
            yield
            before = _price(k, gear) + (_GEAR_PRICE if k and gear != onwards else 0.0)
            longest = _TURN if best is None else min(_TURN, math.floor((least - before) / _price(1, onwards)) - 1)
            if longest < 0 or not fits(body, kept * (1.0 - _DIP), field, Pose2(*straight[k])):
                break
            which, end = _shortest(tight, roomy, in_cells(field, Pose2(*straight[k])), turns[onwards], longest)
            if which >= 0:
                least = before + _price(end, onwards)
                best = np.concatenate([straight[:k], compose(straight[k], turns[onwards][which, : end + 1])])
    return best


def why_cramped(field: DistanceField, body: ChairBody, pose: Pose2, needed: float = CRAMPED) -> str | None:
    """What leaves a body at a pose less room than is needed [m], as its rider would say it; None where there is more."""
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

    return f"what is {min(edges, key=away)} leaves the chair no room to turn"


@njit(cache=True, nogil=True)
def _shortest(
    tight: Footprint, roomy: Footprint, start: FloatArray, turns: FloatArray, longest: int
) -> tuple[int, int]:
    """Which of turns (M, N, 3) [m, m, rad] comes from a start (3,) [cells, cells, rad] to where there is room first.

    And at which of its poses, no later than the one numbered `longest`; -1 when none does.
    """
    c, s = math.cos(start[2]), math.sin(start[2])
    which = -1
    for i in range(len(turns)):
        for k in range(longest + 1):
            u, v = turns[i, k, 0] / tight.cell, turns[i, k, 1] / tight.cell
            x, y, theta = start[0] + c * u - s * v, start[1] + s * u + c * v, start[2] + turns[i, k, 2]
            if room(tight, x, y, theta) < 0.0:
                break
            if room(roomy, x, y, theta) >= 0.0:
                which, longest = i, k - 1
                break
    return which, longest + 1


_LEAST_END = 0.05
"""An end that lies nearer to the axle [m] swings out so little that a turn may widen as if it lay here."""


def _turns(other_end: float, gear: int) -> FloatArray:
    """Turns (M, _TURN + 1, 3) from the origin; of a chair that reaches so far [m] the other way from its axle."""
    kinds = [(k, 0.0) for k in _ARCS] + [(k, g / max(other_end, _LEAST_END)) for g, k in product((0.7, 1.0), _WIDENING)]
    bent = [_turn(side * k, growth, gear, _TURN) for k, growth in kinds for side in (1.0, -1.0)]
    return np.array([_turn(0.0, 0.0, gear, _TURN), *bent])


def _turn(curvature: float, growth: float, gear: int, steps: int) -> FloatArray:
    """Poses (steps + 1, 3) from the origin on, whose curvature [1/m] grows as exp(growth s) up to the tightest."""
    s = (np.arange(steps) + 0.5) * _SPACING
    bent = math.copysign(1.0, curvature) * np.minimum(np.abs(curvature) * np.exp(growth * s), _TIGHTEST)
    theta = np.concatenate([[0.0], np.cumsum(gear * bent * _SPACING)])
    middle = (theta[:-1] + theta[1:]) / 2
    x, y = np.cumsum(gear * _SPACING * np.array([np.cos(middle), np.sin(middle)]), axis=1)
    return np.column_stack([np.concatenate([[0.0], x]), np.concatenate([[0.0], y]), theta])


def _price(steps: int, gear: int) -> float:
    return steps * _SPACING * (1.0 if gear > 0 else _REVERSE_PRICE)
