"""The rubber band: a path as an elastic line, pulled straight by its tension and pushed off by obstacles.

`paper_band` is the source paper's (section IV, Eq 2): each point moves towards the place where the tension of its two
neighbours and the force of the harmonic potential balance best. `band` needs no potential and so works with any
planner's path: tension pulls the line taut, stiffness spreads its bends, the distance field pushes it off obstacles. No
point moves to where the chair's footprint would not fit or would have to turn more sharply than before.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from waychair.maps.grid.distance_field import interpolated
from waychair.planning.body.clearance import COMFORTABLE_BAND, PLANNED_ON_PATH
from waychair.planning.body.footprint import Footprint, footprint, room
from waychair.planning.grid.costmap import Costmap
from waychair.planning.grid.grid_graph import Prices
from waychair.planning.grid.resumable import CountedSteps, ranges_of
from waychair.planning.harmonic.harmonic_field import LogField
from waychair.types import Float32Array, FloatArray

SPACING = 0.1
"""[m] Distance of the band's points."""

PASSES = 800
"""Most passes over all points; most bands rest sooner."""

TENSION, STIFFNESS, PUSH = 0.01, 0.5, 0.03
"""Per pass, a point moves by these parts of its distance to the middle of both neighbours, of its distance to where the
bend is evenly spread, and of the missing clearance."""

SHARPEST = math.radians(14.0)
"""[rad] Sharpest turn from one point to the next."""


def band(
    costmap: Costmap,
    points: FloatArray,
    leaves: FloatArray | None = None,
    arrives: FloatArray | None = None,
    longest: float | None = None,
) -> CountedSteps[FloatArray]:
    """Return points (M, 2) of the relaxed line of points (N, 2), columns and rows [cells]; parts take about 1 ms.

    Guarantees: no point enters an impassable cell; where the footprint fitted along the line, it still fits; where it
    did not, the line comes no nearer to obstacles. The line gets no longer than it was, or than `longest` [cells]; the
    push is reduced for that. `leaves` and `arrives` (2,) are fixed directions at the ends; they are dropped where the
    line would get too long.
    """
    cell = costmap.grid.resolution
    line = resampled(points, SPACING / cell)
    if len(line) < 3:
        return line
    most = polyline_length(points) if longest is None else longest
    tries: list[tuple[float, tuple[FloatArray | None, FloatArray | None]]] = [(TENSION, (None, None))]
    if leaves is not None or arrives is not None:  # under full tension it would bend right at its end
        tries.insert(0, (_SLACK * TENSION, (leaves, arrives)))
    for tension, ends in tries:
        for share in (1.0, 0.25, 0.0):
            moved = yield from _relaxed(costmap, line, tension, share, ends)
            if polyline_length(moved) <= most:
                return moved
    return line


_SLACK = 0.1
"""Part of the tension for a line with a fixed direction at an end."""


def _relaxed(
    costmap: Costmap,
    line: FloatArray,
    tension: float,
    share: float,
    ends: tuple[FloatArray | None, FloatArray | None],
) -> CountedSteps[FloatArray]:
    """Return the line at rest under a share of the push; a fixed direction is an extra point beyond that end."""
    cell = costmap.grid.resolution
    shape = footprint(costmap.body, PLANNED_ON_PATH, costmap.field)
    forces = (tension, STIFFNESS, share * PUSH, COMFORTABLE_BAND / cell)
    step = SPACING / cell
    before, beyond = (int(end is not None) for end in ends)
    line = line.copy()
    for _ in range(_ROUNDS):
        if ends[0] is not None:
            line = np.concatenate([line[:1] - step * ends[0], line])
        if ends[1] is not None:
            line = np.concatenate([line, line[-1:] + step * ends[1]])
        free = 1 + before, len(line) - 1 - beyond
        for begin, end in ranges_of(0, PASSES // _ROUNDS, max(1, _PART // len(line))):
            still = _relax(costmap.prices, shape, costmap.clearance, line, *forces, SHARPEST, begin, end, *free)
            yield _POINT_PRICE * len(line) * (end - begin)
            if still:
                break
        line = resampled(line[before : len(line) - beyond], step)
    return line


_ROUNDS = 4
"""Number of times that the points are spaced evenly again: tension draws them together."""

_PART, _POINT_PRICE = 2000, 300
"""Points of one part, over all its passes, and the time per point in units of a solver's visit to a cell."""


def paper_band(found: LogField, points: FloatArray, delta: float = 0.2, passes: int = 200) -> FloatArray:
    """Return the source paper's band of points (N, 2), columns and rows [cells], over a field; the ends stay.

    Among a point and its eight neighbours one cell away, the point steps by delta [cells] towards the best balance of
    forces, in each of so many passes; the paper gives neither number.
    The potential's force against a step is F = 1/v there - 1/v here, in units of 1/v here: v falls so fast with the
    distance from the goal that a force in fixed units would vanish near the goal and explode far from it.
    """
    return _paper_relaxed(found.logs, points, delta, passes)


def resampled(points: FloatArray, spacing: float) -> FloatArray:
    """Return points along a polyline, evenly spaced by at most `spacing`, both ends included."""
    steps = np.hypot(*np.diff(points, axis=0).T)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    count = max(math.ceil(along[-1] / spacing - 1e-9), 1) + 1
    at = np.linspace(0.0, along[-1], count)
    return np.column_stack([np.interp(at, along, points[:, 0]), np.interp(at, along, points[:, 1])])


def turning_angles(points: FloatArray) -> FloatArray:
    """Return (N - 2,) the absolute turning angle [rad] at each inner point of a polyline."""
    steps = np.diff(points, axis=0)
    headings = np.arctan2(steps[:, 1], steps[:, 0])
    turns = np.diff(headings)
    return np.abs(np.arctan2(np.sin(turns), np.cos(turns)))


def polyline_length(points: FloatArray) -> float:
    """Return the length of a polyline (N, 2), in the points' unit."""
    return float(np.hypot(*np.diff(points, axis=0).T).sum())


@njit(cache=True, nogil=True)
def _relax(
    prices: Prices,
    shape: Footprint,
    clearance: Float32Array,
    line: FloatArray,
    tension: float,
    stiffness: float,
    push: float,
    wanted: float,
    sharpest: float,
    begin: int,
    end: int,
    first: int,
    stop: int,
) -> bool:
    """Move a line's points from `first` to before `stop`, alternately forwards and backwards, in the given passes.

    The passes are those from `begin` to before `end`. Return whether the points are at rest.
    """
    last = len(line) - 1
    for turn in range(begin, end):
        moved = 0.0
        for step in range(stop - first):
            k = first + step if turn % 2 == 0 else stop - 1 - step
            x, y = line[k, 0], line[k, 1]
            middle_x = 0.5 * (line[k - 1, 0] + line[k + 1, 0]) - x
            middle_y = 0.5 * (line[k - 1, 1] + line[k + 1, 1]) - y
            dx, dy = tension * middle_x, tension * middle_y
            if 1 < k < last - 1:  # towards the least sum of squared second differences
                dx += stiffness * ((4 * middle_x * 2 - (line[k - 2, 0] + line[k + 2, 0] - 2 * x)) / 6)
                dy += stiffness * ((4 * middle_y * 2 - (line[k - 2, 1] + line[k + 2, 1] - 2 * y)) / 6)
            else:
                dx, dy = dx + stiffness * middle_x, dy + stiffness * middle_y
            off_x, off_y = _push(clearance, shape.cell, x, y, wanted)
            dx, dy = dx + push * off_x, dy + push * off_y
            for share in (1.0, 0.5, 0.25):
                if _may_move(prices, shape, clearance, line, k, x + share * dx, y + share * dy, sharpest):
                    line[k, 0], line[k, 1] = x + share * dx, y + share * dy
                    moved = max(moved, share * math.hypot(dx, dy))
                    break
        if moved < _STILL:
            return True
    return False


@njit(cache=True, inline="always")
def _push(clearance: Float32Array, cell: float, x: float, y: float, wanted: float) -> tuple[float, float]:
    """Return the missing part of the wanted clearance [cells] as a vector away from the nearest obstacle."""
    lacking = wanted - interpolated(clearance, x, y) / cell
    if lacking <= 0.0:
        return 0.0, 0.0
    gx = interpolated(clearance, x + 0.5, y) - interpolated(clearance, x - 0.5, y)
    gy = interpolated(clearance, x, y + 0.5) - interpolated(clearance, x, y - 0.5)
    steep = math.hypot(gx, gy) + 1e-12
    return lacking * gx / steep, lacking * gy / steep


_STILL = 1e-3
"""Displacement [cells] in a pass below which the line is at rest."""


@njit(cache=True, nogil=True)
def _may_move(
    prices: Prices,
    shape: Footprint,
    clearance: Float32Array,
    line: FloatArray,
    k: int,
    x: float,
    y: float,
    sharpest: float,
) -> bool:
    """Return whether point k may go to (x, y): passable, no sharper turn, and the footprint fits or did not before."""
    old_x, old_y = line[k, 0], line[k, 1]
    for side in range(-1, 2, 2):
        if not _passable(prices, x, y, line[k + side, 0], line[k + side, 1]):
            return False
    turned = _sharpest_about(line, k)
    line[k, 0], line[k, 1] = x, y
    allowed = _sharpest_about(line, k) <= max(sharpest, turned)
    fits = allowed and _fits_about(shape, line, k)
    line[k, 0], line[k, 1] = old_x, old_y
    if fits or not allowed:
        return bool(fits)
    nearer = interpolated(clearance, x, y) < interpolated(clearance, old_x, old_y)
    return not nearer and not _fits_about(shape, line, k)


@njit(cache=True, inline="always")
def _passable(prices: Prices, x: float, y: float, to_x: float, to_y: float) -> bool:
    """Return whether all cells under a short line are passable, not counting the cell at its end."""
    count = int(4 * max(abs(to_x - x), abs(to_y - y))) + 1
    for i in range(count):
        at_x, at_y = x + i / count * (to_x - x), y + i / count * (to_y - y)
        if not (0 <= at_x < prices.shape[1] and 0 <= at_y < prices.shape[0]):
            return False
        row, column = int(at_y), int(at_x)
        if prices[row, column] == 0 and not (row == int(to_y) and column == int(to_x)):
            return False
    return True


@njit(cache=True, nogil=True)
def _sharpest_about(line: FloatArray, k: int) -> float:
    """Return the sharpest turn [rad] at point k or one of its neighbours."""
    sharpest = 0.0
    for m in range(max(k - 1, 1), min(k + 2, len(line) - 1)):
        ax, ay = line[m, 0] - line[m - 1, 0], line[m, 1] - line[m - 1, 1]
        bx, by = line[m + 1, 0] - line[m, 0], line[m + 1, 1] - line[m, 1]
        sharpest = max(sharpest, abs(math.atan2(ax * by - ay * bx, ax * bx + ay * by)))
    return sharpest


@njit(cache=True, nogil=True)
def _fits_about(shape: Footprint, line: FloatArray, k: int) -> bool:
    """Return whether the footprint fits at point k and halfway to both neighbours, headed along the line."""
    if not _fits(shape, line[k, 0], line[k, 1], line[k + 1, 0] - line[k - 1, 0], line[k + 1, 1] - line[k - 1, 1]):
        return False
    for m in range(k - 1, k + 1):
        dx, dy = line[m + 1, 0] - line[m, 0], line[m + 1, 1] - line[m, 1]
        if not _fits(shape, line[m, 0] + dx / 2, line[m, 1] + dy / 2, dx, dy):
            return False
    return True


@njit(cache=True, inline="always")
def _fits(shape: Footprint, x: float, y: float, dx: float, dy: float) -> bool:
    return bool(room(shape, x, y, math.atan2(dy, dx), 0.0) >= 0.0)


@njit(cache=True, nogil=True)
def _paper_relaxed(logs: FloatArray, points: FloatArray, delta: float, passes: int) -> FloatArray:
    line = points.copy()
    for _ in range(passes):
        for k in range(1, len(line) - 1):
            x, y = line[k, 0], line[k, 1]
            here = log_between(logs, x, y)
            # tension at a point moved by (dx, dy): (sum of the neighbours - 2 * point) - 2 * (dx, dy)
            pull_x = line[k - 1, 0] + line[k + 1, 0] - 2 * x
            pull_y = line[k - 1, 1] + line[k + 1, 1] - 2 * y
            best, to_x, to_y = pull_x * pull_x + pull_y * pull_y, 0.0, 0.0
            for i in range(9):
                dx, dy = float(i % 3 - 1), float(i // 3 - 1)
                there = log_between(logs, x + delta * dx, y + delta * dy)
                if there == -np.inf or (dx == 0.0 and dy == 0.0):
                    continue
                force = math.exp(min(here - there, 50.0)) - 1.0  # F, against the step
                size = math.sqrt(dx * dx + dy * dy)
                rest_x = pull_x - 2 * delta * dx - force * dx / size
                rest_y = pull_y - 2 * delta * dy - force * dy / size
                if rest_x * rest_x + rest_y * rest_y < best - 1e-12:
                    best, to_x, to_y = rest_x * rest_x + rest_y * rest_y, dx, dy
            line[k, 0], line[k, 1] = x + delta * to_x, y + delta * to_y
    return line


@njit(cache=True, inline="always")
def log_between(logs: FloatArray, x: float, y: float) -> float:
    """Return log v at a point [cells], v interpolated between the middles of the four nearest cells; -inf in a wall."""
    if not (0 <= x < logs.shape[1] and 0 <= y < logs.shape[0]) or logs[int(y), int(x)] == -np.inf:
        return -np.inf
    left, above = math.floor(x - 0.5), math.floor(y - 0.5)
    top, total = logs[int(y), int(x)], 0.0
    for i in range(above, above + 2):
        for j in range(left, left + 2):
            if 0 <= i < logs.shape[0] and 0 <= j < logs.shape[1]:
                share = (1.0 - abs(x - 0.5 - j)) * (1.0 - abs(y - 0.5 - i))
                total += share * math.exp(logs[i, j] - top)
    return float(top + math.log(max(total, 1e-300)))
