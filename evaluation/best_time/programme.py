"""Successive linear programmes that shorten a motion: poses, speeds and the time between the knots at once.

In the scaled unknowns of `motion.py`, the motion along the path is linear and exact, and a limit that grows with dt^2 or
dt^3 is replaced by its tangent in dt, which lies below it. Only x and y (Simpson's rule), the gaps to obstacles and the
lateral acceleration are linearised round the motion so far, within a trust region. They may be violated at a price that
is higher than any violation is worth (exact penalty), so that every programme has a solution.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import linprog
from scipy.sparse import coo_array, csc_array

from evaluation.best_time.comfort import Comfort
from evaluation.best_time.gaps import BoxesRound, gaps, overlaps
from evaluation.best_time.motion import Motion
from waychair.types import FloatArray, IntArray

_PRICE_WAY, _PRICE_GAP, _PRICE_LATERAL = 60.0, 60.0, 6.0
"""[s/m], [s/m], [s per m/s^2] Prices of violations; more than any of them can save."""

_PRICE_TURN = 0.03
"""[s/rad] Price of turning: among motions that take equally long, the one that turns least."""

_REACH, _REACH_HEADING, _REACH_TIME = 0.4, 0.5, 0.25
"""[m], [rad], part: first trust region of x and y, of the heading, and of the time between knots (up: twice that)."""

_LEAST_TRUST = 0.01
"""Part of the first trust region at which the search ends."""

_MOST_STEPS, _FREE_STEPS = 45, 3
"""Programmes in all; the first ones are accepted in any case, as the first motion keeps no limits."""

_ENOUGH = 5e-4
"""Part of the time: a programme that promises less ends the search."""

_MOST_GAPS = 10
"""Rows of gaps for each pose."""

_SLOW = 0.03
"""[m/s] At a knot slower than this the gear is open."""


@dataclass(frozen=True, slots=True)
class MotionTask:
    """What a motion has to keep: the chair's surroundings, limits, both end poses (3,), and the least gap [m]."""

    around: BoxesRound
    comfort: Comfort
    ends: tuple[FloatArray, FloatArray]
    clear: float


def shortened(task: MotionTask, motion: Motion) -> Motion:
    """Return the fastest motion that successive linear programmes find from another one."""
    trust, cost = 1.0, _cost(task, motion)
    for step in range(_MOST_STEPS):
        found = _solved(task, motion, trust)
        if found is None:
            trust /= 2
            continue
        candidate, promised = found
        real = _cost(task, candidate)
        gain, hoped = cost - real, cost - promised
        ends = step >= _FREE_STEPS and hoped < _ENOUGH * motion.seconds
        if step < _FREE_STEPS or gain > 0.1 * hoped:
            motion, cost = candidate, real
        if step >= _FREE_STEPS:
            trust *= 1.6 if gain > 0.7 * hoped else 1.0 if gain > 0.3 * hoped else 0.5
            trust = min(trust, 1.0)
        if ends or trust < _LEAST_TRUST:
            break
    return motion


def _cost(task: MotionTask, motion: Motion) -> float:
    """Return the time [s] of a motion, plus the prices of turning and of violations."""
    knots = motion.knots
    lateral = np.abs(knots[:, 3] * knots[:, 5]) / motion.dt**2
    return float(
        motion.seconds
        + _PRICE_TURN * np.abs(np.diff(knots[:, 2])).sum()
        + _PRICE_WAY * np.abs(motion.defects()).sum()
        + _PRICE_GAP * overlaps(task.around, motion.checked(), task.clear)
        + _PRICE_LATERAL * np.maximum(lateral - task.comfort.lateral, 0.0).sum()
    )


def _solved(task: MotionTask, motion: Motion, trust: float) -> tuple[Motion, float] | None:
    """Return the solution of the linear programme round a motion, and its cost there; None if it has none."""
    near = gaps(task.around, motion.checked(), task.clear + 2 * _REACH * trust + 0.02, _MOST_GAPS)
    at = _Unknowns(motion.count, len(near))
    equal, below = _Rows(at.total), _Rows(at.total)
    _add_motion_along(equal, at)
    _add_places(equal, at, motion)
    _add_limits(below, at, motion, task.comfort)
    _add_lateral(below, at, motion, task.comfort)
    _add_turning(below, at)
    _add_gaps(below, at, motion, near, task.clear)
    found = linprog(
        _prices(at, motion),
        A_ub=below.matrix(),
        b_ub=below.right(),
        A_eq=equal.matrix(),
        b_eq=equal.right(),
        bounds=_bounds(at, motion, trust, task.ends),
        method="highs-ipm",
    )
    if found.x is None or found.status != 0:
        return None
    knots = np.column_stack([found.x[each] for each in at.knots])
    jerks = np.column_stack([found.x[at.jerk], found.x[at.turn_jerk]])
    return Motion(knots, jerks, float(found.x[at.dt])), float(found.fun)


class _Unknowns:
    """The columns of the unknowns: knots as in `Motion`, jerks, dt, and the auxiliary ones that the cost adds up."""

    def __init__(self, count: int, near: int) -> None:
        self.total = 0
        self.knots = tuple(self._next(count + 1) for _ in range(7))
        self.jerk, self.turn_jerk = self._next(count), self._next(count)
        self.turning = self._next(count)  # at least the change of the heading
        self.off = tuple(self._next(count) for _ in range(4))  # x and y off the integral, up and down
        self.aside = self._next(count + 1)  # lateral acceleration above its limit, times dt^2
        self.near = self._next(near)  # gaps below the least
        self.dt = int(self._next(1)[0])

    def _next(self, count: int) -> IntArray:
        self.total += count
        return np.arange(self.total - count, self.total)


def _add_motion_along(equal: _Rows, at: _Unknowns) -> None:
    """Add speed, acceleration and heading of each knot after those of the knot before and the constant jerk."""
    _, _, theta, v, a, omega, alpha = at.knots
    none = np.zeros(len(at.jerk))
    for speed, rate, jerk in ((v, a, at.jerk), (omega, alpha, at.turn_jerk)):
        equal.add(((speed[1:], 1.0), (speed[:-1], -1.0), (rate[:-1], -1.0), (jerk, -1 / 2)), none)
        equal.add(((rate[1:], 1.0), (rate[:-1], -1.0), (jerk, -1.0)), none)
    turned = (omega[:-1], -1.0), (alpha[:-1], -1 / 2), (at.turn_jerk, -1 / 6)
    equal.add(((theta[1:], 1.0), (theta[:-1], -1.0), *turned), none)


def _add_places(equal: _Rows, at: _Unknowns, motion: Motion) -> None:
    """Add x and y of each knot after those of the knot before, by Simpson's rule, linear in speeds and headings."""
    _, _, theta, v, a, omega, alpha = at.knots
    angle, speed = motion.knots[:, 2], motion.knots[:, 3]
    middle_angle, middle_speed = motion.middles().T
    for axis, of, slope in ((0, np.cos, _minus_sin), (1, np.sin, np.cos)):
        place, over, under = at.knots[axis], at.off[2 * axis], at.off[2 * axis + 1]
        by_v, by_angle = of(angle) / 6, speed * slope(angle) / 6
        mid_v, mid_angle = 4 / 6 * of(middle_angle), 4 / 6 * middle_speed * slope(middle_angle)
        here = by_angle[:-1] * angle[:-1] + by_angle[1:] * angle[1:] + mid_angle * middle_angle
        equal.add(
            (
                (place[1:], 1.0),
                (place[:-1], -1.0),
                (v[:-1], -by_v[:-1] - mid_v),
                (a[:-1], -mid_v / 2),
                (at.jerk, -mid_v / 8),
                (v[1:], -by_v[1:]),
                (theta[:-1], -by_angle[:-1] - mid_angle),
                (omega[:-1], -mid_angle / 2),
                (alpha[:-1], -mid_angle / 8),
                (at.turn_jerk, -mid_angle / 48),
                (theta[1:], -by_angle[1:]),
                (over, -1.0),
                (under, 1.0),
            ),
            -here,
        )


def _minus_sin(angle: FloatArray) -> FloatArray:
    return -np.sin(angle)


def _gears(motion: Motion) -> FloatArray:
    """Return (N + 1,) 1 at knots that drive forwards, -1 backwards, 0 where the gear is open."""
    v = motion.knots[:, 3]
    return np.where(np.abs(v) > _SLOW * motion.dt, np.sign(v), 0.0)


def _add_limits(below: _Rows, at: _Unknowns, motion: Motion, comfort: Comfort) -> None:
    """Add the limits on speeds, accelerations and jerks; slowing down counts as such only where the gear is clear."""
    _, _, _, v, a, omega, alpha = at.knots
    gear = _gears(motion)
    up = np.where(gear < 0, comfort.braking, comfort.acceleration)
    down = np.where(gear > 0, comfort.braking, comfort.acceleration)
    for unknowns, most, least, power in (
        (v, comfort.speed, comfort.reverse, 1),
        (a, up, down, 2),
        (at.jerk, comfort.jerk, comfort.jerk, 3),
        (omega, comfort.turn_rate, comfort.turn_rate, 1),
        (alpha, comfort.turn_acceleration, comfort.turn_acceleration, 2),
        (at.turn_jerk, comfort.turn_jerk, comfort.turn_jerk, 3),
    ):
        # dt^p is at least p dt0^(p-1) dt - (p - 1) dt0^p
        slope, rest = power * motion.dt ** (power - 1), (power - 1) * motion.dt**power
        step = np.full(len(unknowns), at.dt)
        for sign, limit in ((1.0, most), (-1.0, least)):
            limits = np.broadcast_to(np.asarray(limit, float), len(unknowns))
            below.add(((unknowns, sign), (step, -limits * slope)), -limits * rest)
    # Between two knots a speed is a parabola; v + a / 2 is the middle corner of the polygon that holds it (Bezier).
    for speed, rate, most, least in (
        (v, a, comfort.speed, comfort.reverse),
        (omega, alpha, comfort.turn_rate, comfort.turn_rate),
    ):
        step = np.full(len(speed) - 1, at.dt)
        for sign, limit in ((1.0, most), (-1.0, least)):
            below.add(((speed[:-1], sign), (rate[:-1], sign / 2), (step, -limit)), np.zeros(len(step)))


def _add_lateral(below: _Rows, at: _Unknowns, motion: Motion, comfort: Comfort) -> None:
    """Add the limit on v * omega, linear round the motion."""
    v, omega = motion.knots[:, 3], motion.knots[:, 5]
    dt, most = motion.dt, comfort.lateral
    step = np.full(len(v), at.dt)
    for sign in (1.0, -1.0):
        below.add(
            ((at.knots[3], sign * omega), (at.knots[5], sign * v), (step, -2 * most * dt), (at.aside, -(dt**2))),
            sign * v * omega - most * dt**2,
        )


def _add_turning(below: _Rows, at: _Unknowns) -> None:
    theta = at.knots[2]
    for sign in (1.0, -1.0):
        below.add(((theta[1:], sign), (theta[:-1], -sign), (at.turning, -1.0)), np.zeros(len(at.turning)))


def _add_gaps(below: _Rows, at: _Unknowns, motion: Motion, near: FloatArray, clear: float) -> None:
    """Add the gaps at the checked poses, each the mean of two knots or a knot twice, linear round the motion."""
    if not len(near):
        return
    pose, gap, slopes = near[:, 0].astype(np.int64), near[:, 1], near[:, 2:]
    there = motion.checked()[pose]
    entries = [
        (at.knots[axis][knot], -slopes[:, axis] / 2) for knot in (pose // 2, (pose + 1) // 2) for axis in range(3)
    ]
    below.add((*entries, (at.near, -1.0)), gap - clear - (slopes * there).sum(axis=1))


def _bounds(at: _Unknowns, motion: Motion, trust: float, ends: tuple[FloatArray, FloatArray]) -> FloatArray:
    """Return (total, 2) the trust region, the gears, and rest at both end poses."""
    low, high = np.full(at.total, -np.inf), np.full(at.total, np.inf)
    for axis, reach in ((0, _REACH), (1, _REACH), (2, _REACH_HEADING)):
        low[at.knots[axis]] = motion.knots[:, axis] - trust * reach
        high[at.knots[axis]] = motion.knots[:, axis] + trust * reach
    gear = _gears(motion)
    low[at.knots[3][gear > 0]] = high[at.knots[3][gear < 0]] = 0.0
    for unknowns in (at.turning, *at.off, at.aside, at.near):
        low[unknowns] = 0.0
    low[at.dt] = motion.dt * (1 - trust * _REACH_TIME)
    high[at.dt] = motion.dt * (1 + 2 * trust * _REACH_TIME)
    for k, end in ((0, ends[0]), (-1, ends[1])):
        for axis in range(7):
            low[at.knots[axis][k]] = high[at.knots[axis][k]] = end[axis] if axis < 3 else 0.0
    return np.column_stack([low, high])


def _prices(at: _Unknowns, motion: Motion) -> FloatArray:
    prices = np.zeros(at.total)
    prices[at.dt] = motion.count
    prices[at.turning], prices[at.near], prices[at.aside] = _PRICE_TURN, _PRICE_GAP, _PRICE_LATERAL
    for unknowns in at.off:
        prices[unknowns] = _PRICE_WAY
    return prices


class _Rows:
    """Rows of a sparse matrix with their right sides, added in blocks."""

    def __init__(self, columns: int) -> None:
        self._columns, self._count = columns, 0
        self._parts: list[tuple[IntArray, IntArray, FloatArray]] = []
        self._right: list[FloatArray] = []

    def add(self, entries: tuple[tuple[IntArray, float | FloatArray], ...], right: FloatArray) -> None:
        """Add one row for each value on the right: the sum of coefficient times unknown over the entries."""
        rows = np.arange(self._count, self._count + len(right))
        for columns, values in entries:
            self._parts.append((rows, columns, np.broadcast_to(np.asarray(values, float), len(right))))
        self._right.append(right)
        self._count += len(right)

    def matrix(self) -> csc_array:
        """Return the matrix; entries of one place are added up."""
        rows, columns, values = (np.concatenate(parts) for parts in zip(*self._parts, strict=True))
        return coo_array((values, (rows, columns)), shape=(self._count, self._columns)).tocsc()

    def right(self) -> FloatArray:
        """Return the right sides."""
        return np.concatenate(self._right)
