"""A line of poses that flows: the smoothest line near a given one along which the chair's outline keeps its room.

The line is an elastic band in Quinlan's sense ("Real-time modification of collision-free paths", PhD thesis, Stanford
1994), solved by damped Gauss-Newton steps instead of relaxation. Its energy is the price of length, of curvature, of the
change of curvature, and of the room that points of the outline lack. The chair heads along the line, so a push on its
front turns it: the band knows the outline, not a disc. Neighbours within three points interact, so the system is banded
and a step takes time in proportion to the length.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from waychair.calibration.chair_body import ChairBody
from waychair.geometry import evenly_spaced
from waychair.maps.grid.distance_field import DistanceField, interpolated
from waychair.resumable import CountedSteps
from waychair.types import Float32Array, FloatArray

SPACING = 0.08
"""[m] Distance of the line's points."""

LENGTH_PRICE, BEND_PRICE, BEND_RATE_PRICE, ROOM_PRICE = 0.3, 1.0, 0.12, 120.0
"""Prices of a metre, of curvature squared and its rate squared over a metre, and of lacking room squared over a metre."""

COMFORT, CORNER = 0.16, 0.05
"""[m] Room that the band wants beside the body, and round its corners."""

ROUNDS, STEPS, LONGEST_MOVE, STILL = 4, 10, 0.06, 0.002
"""Most rounds, after each of which the points are spaced anew, and most Gauss-Newton steps of each; the longest move [m] of
a point in one step, and the move below which the line rests."""

CELLS_A_POINT = 200
"""Work of one step for one point, in visited grid cells."""

NO_ZONES: Float32Array = np.empty((0, 0), np.float32)

FROM_ZONES = 0.05
"""[m] Room that the axle's middle keeps from a zone that the line goes round."""


def body_points(body: ChairBody, comfort: float = COMFORT, corner: float = CORNER) -> FloatArray:
    """Return (K, 3) [m] the outline as points: ahead, left, and the distance to obstacles that each one wants."""
    half = body.width / 2
    count = max(2, math.ceil(body.length / half))
    along = np.linspace(-body.rear + min(half, body.rear), body.front - half, count)
    middle = [(float(x), 0.0, half + comfort) for x in along]
    corners = [(x, y, corner) for x in (body.front, -body.rear) for y in (half, -half)]
    return np.array([*middle, *corners])


def flowing(
    line: FloatArray,
    field: DistanceField,
    body: ChairBody,
    leaves: float | None = None,
    arrives: float | None = None,
    comfort: float = COMFORT,
    backwards: bool = False,
    price: float = ROOM_PRICE,
    from_zones: Float32Array = NO_ZONES,
    stands: tuple[bool, bool] = (False, False),
) -> CountedSteps[FloatArray]:
    """Return poses (M, 3) [m, m, rad] of the band from a line (N, 2) [m], all in the field's map frame; resumable.

    `leaves` and `arrives` [rad] are the body's headings at the ends, where they are fixed. `stands`: whether the chair
    stands at either end, so that a bend may begin or end right there. `from_zones` holds distances [m] on the field's cells
    to zones that the axle's middle keeps out of; (0, 0) without any. The result need not be free: check it with the exact
    outline.
    """
    points = evenly_spaced(line, SPACING)
    if len(points) < 4:
        points = evenly_spaced(line, max(float(np.hypot(*np.diff(line, axis=0).T).sum()) / 4, 1e-3))
    gear = -1.0 if backwards else 1.0
    shape = body_points(body, comfort)
    shape[:, 0] *= gear
    shape[:, 2] += field.resolution / 2  # distances are to the middles of occupied cells
    h = float(np.hypot(*(points[1] - points[0])))
    to_grid = field.map_from_grid.inverse()
    c, s = math.cos(to_grid.theta), math.sin(to_grid.theta)
    turn = np.array([[c, -s], [s, c]])
    local = points @ turn.T + (to_grid.x, to_grid.y)
    ends = [
        math.nan if end is None else end + to_grid.theta + (0.0 if gear > 0 else math.pi) for end in (leaves, arrives)
    ]
    before, beyond = (
        0 if math.isnan(end) else STRAIGHT_STANDING if rests else STRAIGHT
        for end, rests in zip(ends, stands, strict=True)
    )
    for _ in range(ROUNDS):
        yield len(local) * STEPS * CELLS_A_POINT
        local = np.concatenate([local[:1].repeat(before, axis=0), local, local[-1:].repeat(beyond, axis=0)])
        straight = before, beyond
        still = _relax(
            local, field.metres, from_zones, field.resolution, shape, h, (ends[0], ends[1]), straight, STEPS, price
        )
        local = evenly_spaced(local[before : len(local) - beyond], SPACING)
        h = float(np.hypot(*(local[1] - local[0])))
        if len(local) < 4:
            break
        if still:
            break
    back = (local - (to_grid.x, to_grid.y)) @ turn
    return with_headings(back, leaves, arrives, backwards)


def with_headings(
    points: FloatArray, leaves: float | None = None, arrives: float | None = None, backwards: bool = False
) -> FloatArray:
    """Return poses (N, 3) with the body's headings along points (N, 2), fixed at the ends where given."""
    if len(points) < 2:
        heading = leaves if leaves is not None else arrives if arrives is not None else 0.0
        return np.column_stack([points, np.full(len(points), heading)])
    ahead = np.diff(points, axis=0)
    steps = np.unwrap(np.arctan2(ahead[:, 1], ahead[:, 0]))
    inner = (steps[:-1] + steps[1:]) / 2
    first = steps[0] - (steps[1] - steps[0]) / 2 if len(steps) > 1 else steps[0]
    last = steps[-1] + (steps[-1] - steps[-2]) / 2 if len(steps) > 1 else steps[-1]
    headings = np.concatenate([[first], inner, [last]]) + (math.pi if backwards else 0.0)
    if leaves is not None:
        headings += math.tau * round((leaves - headings[0]) / math.tau)
        headings[0] = leaves
    if arrives is not None:
        headings[-1] = arrives + math.tau * round((headings[-1] - arrives) / math.tau)
    return np.column_stack([points, headings])


@njit(cache=True, nogil=True)
def _relax(
    p: FloatArray,
    metres: Float32Array,
    from_zones: Float32Array,
    cell: float,
    shape: FloatArray,
    h: float,
    headings: tuple[float, float],
    straight: tuple[int, int],
    steps: int,
    room_price: float,
) -> bool:
    """Move points (N, 2) [m] in place by at most so many Gauss-Newton steps; return whether they rest.

    So many points at the ends go on `straight` beyond them, in the `headings` [rad].
    """
    n = len(p)
    before, beyond = straight
    first, stop = before + 1, n - beyond - 1
    for j in range(before):
        away = (before - j) * h
        p[j, 0] = p[before, 0] - away * math.cos(headings[0])
        p[j, 1] = p[before, 1] - away * math.sin(headings[0])
    for j in range(beyond):
        away, end = (beyond - j) * h, n - 1 - beyond
        p[n - 1 - j, 0] = p[end, 0] + away * math.cos(headings[1])
        p[n - 1 - j, 1] = p[end, 1] + away * math.sin(headings[1])
    count = stop - first
    if count < 1:
        return True
    band = np.zeros((count, 4))  # half bandwidth of the system, with the diagonal: a point moves across the line only
    right = np.zeros(count)
    across = np.zeros((n, 2))
    for _ in range(steps):
        for i in range(n):
            before, after = max(i - 1, 0), min(i + 1, n - 1)
            tx, ty = p[after, 0] - p[before, 0], p[after, 1] - p[before, 1]
            long = math.hypot(tx, ty) + 1e-9
            across[i, 0], across[i, 1] = -ty / long, tx / long
        band[:] = 0.0
        right[:] = 0.0
        _add_smoothness(p, across, h, first, stop, straight, band, right)
        _add_room(p, across, metres, from_zones, cell, shape, room_price * h, first, stop, band, right)
        for row in range(count):
            band[row, 0] += DAMPING
        _solve(band, right)
        longest = 0.0
        for j in range(count):
            longest = max(longest, abs(right[j]))
        share = min(1.0, LONGEST_MOVE / max(longest, 1e-12))
        for j in range(count):
            p[first + j, 0] += share * right[j] * across[first + j, 0]
            p[first + j, 1] += share * right[j] * across[first + j, 1]
        if longest < STILL:
            return True
    return False


@njit(cache=True, nogil=True)
def _add_smoothness(
    p: FloatArray,
    across: FloatArray,
    h: float,
    first: int,
    stop: int,
    straight: tuple[int, int],
    band: FloatArray,
    right: FloatArray,
) -> None:
    """Add the price of length, bends and their rate to the system of the points from `first` to `stop`.

    At an end where the chair stands the bend costs more: it begins to turn with its whole acceleration.
    """
    stencils = np.array([[-1.0, 1.0, 0.0, 0.0], [1.0, -2.0, 1.0, 0.0], [-1.0, 3.0, -3.0, 1.0]])
    prices = np.array([LENGTH_PRICE / h, BEND_PRICE / h**3, BEND_RATE_PRICE / h**5])
    slopes = np.zeros(4)
    for term in range(3):
        size = term + 2
        for i in range(len(p) - size + 1):
            price, rx, ry = prices[term], 0.0, 0.0
            if term == 1 and (
                (i == 0 and straight[0] == STRAIGHT_STANDING)
                or (i == len(p) - size and straight[1] == STRAIGHT_STANDING)
            ):
                price *= STANDING_BEND
            for a in range(size):
                rx += stencils[term, a] * p[i + a, 0]
                ry += stencils[term, a] * p[i + a, 1]
            if term > 0:  # bends are what deviates across the line; along it only the points' spacing does
                nx, ny = across[i + 1, 0], across[i + 1, 1]
                if term == 2:
                    nx, ny = nx + across[i + 2, 0], ny + across[i + 2, 1]
                    long = math.hypot(nx, ny) + 1e-9
                    nx, ny = nx / long, ny / long
                residual = rx * nx + ry * ny
                for a in range(size):
                    slopes[a] = stencils[term, a] * (across[i + a, 0] * nx + across[i + a, 1] * ny)
                for a in range(size):
                    if first <= i + a < stop:
                        row = i + a - first
                        right[row] -= price * slopes[a] * residual
                        for b in range(a + 1):
                            if first <= i + b < stop:
                                band[row, a - b] += price * slopes[a] * slopes[b]
                continue
            for a in range(size):
                if first <= i + a < stop:
                    row = i + a - first
                    right[row] -= price * stencils[term, a] * (rx * across[i + a, 0] + ry * across[i + a, 1])
                    for b in range(a + 1):
                        if first <= i + b < stop:
                            dot = across[i + a, 0] * across[i + b, 0] + across[i + a, 1] * across[i + b, 1]
                            band[row, a - b] += price * stencils[term, a] * stencils[term, b] * dot


@njit(cache=True, nogil=True)
def _add_room(
    p: FloatArray,
    across: FloatArray,
    metres: Float32Array,
    from_zones: Float32Array,
    cell: float,
    shape: FloatArray,
    price: float,
    first: int,
    stop: int,
    band: FloatArray,
    right: FloatArray,
) -> None:
    """Add the price of the room that points of the outline lack to the system of the points from `first` to `stop`."""
    lever = np.zeros(3)
    for i in range(1, len(p) - 1):
        tx, ty = p[i + 1, 0] - p[i - 1, 0], p[i + 1, 1] - p[i - 1, 1]
        long = math.hypot(tx, ty) + 1e-9
        tx, ty = tx / long, ty / long
        for k in range(len(shape) + (from_zones.size > 0)):
            if k < len(shape):
                field, o, w, want = metres, shape[k, 0], shape[k, 1], shape[k, 2]
            else:
                field, o, w, want = from_zones, 0.0, 0.0, FROM_ZONES + cell / 2
            x, y = p[i, 0] + o * tx - w * ty, p[i, 1] + o * ty + w * tx
            u, v = x / cell, y / cell
            lacking = want - interpolated(field, u, v)
            if lacking <= 0.0:
                continue
            gx = (interpolated(field, u + 1.0, v) - interpolated(field, u - 1.0, v)) / (2 * cell)
            gy = (interpolated(field, u, v + 1.0) - interpolated(field, u, v - 1.0)) / (2 * cell)
            # the point moves with the turn of the heading: d(point)/d(theta) = (-o ty - w tx, o tx - w ty)
            turned = gx * (-o * ty - w * tx) + gy * (o * tx - w * ty)
            for a in range(3):
                nx, ny = across[i + a - 1, 0], across[i + a - 1, 1]
                if a == 1:
                    lever[a] = -(gx * nx + gy * ny)
                else:
                    lever[a] = -turned * (a - 1) * (-ty * nx + tx * ny) / long
            for a in range(3):
                if not first <= i + a - 1 < stop:
                    continue
                row = i + a - 1 - first
                right[row] -= price * lever[a] * lacking
                for b in range(a + 1):
                    if first <= i + b - 1 < stop:
                        band[row, a - b] += price * lever[a] * lever[b]


STRAIGHT, STRAIGHT_STANDING = 3, 1
"""Points by which a line with a fixed heading goes on straight beyond its end while it is relaxed: with the first its curvature
begins from 0, as a chair needs that is on the move there; the second, for one that stands, fixes the heading alone."""

STANDING_BEND = 4.0
"""So many times dearer is the bend with which a chair sets off or comes to rest."""

DAMPING = 2.0
"""Added to the diagonal of the system: a point moves no farther than its neighbours' room tells."""


@njit(cache=True, nogil=True)
def _solve(band: FloatArray, right: FloatArray) -> None:
    """Solve a symmetric banded system in place by Cholesky's method; band[row, k] is the entry k left of the diagonal."""
    n, width = band.shape
    for i in range(n):
        for j in range(max(0, i - width + 1), i + 1):
            total = band[i, i - j]
            for k in range(max(0, i - width + 1, j - width + 1), j):
                total -= band[i, i - k] * band[j, j - k]
            band[i, i - j] = math.sqrt(max(total, 1e-12)) if i == j else total / band[j, 0]
    for i in range(n):
        total = right[i]
        for k in range(max(0, i - width + 1), i):
            total -= band[i, i - k] * right[k]
        right[i] = total / band[i, 0]
    for i in range(n - 1, -1, -1):
        total = right[i]
        for k in range(i + 1, min(n, i + width)):
            total -= band[k, k - i] * right[k]
        right[i] = total / band[i, 0]
