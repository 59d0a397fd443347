"""A motion between knots at equal times, with constant jerks between them, and its dense integration.

Speeds are stored times dt, accelerations times dt^2 and jerks times dt^3, with dt the time between two knots. Then speed
and heading at the knots depend linearly on each other, whatever dt is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from evaluation.best_time.comfort import Comfort
from evaluation.best_time.gaps import BoxesRound, is_free
from waychair.geometry import wrap_angle
from waychair.types import FloatArray, Pose2

_DENSE = 10
"""Integrated poses for each interval between knots."""

_AT_END, _AT_END_HEADING = 0.01, 0.01
"""[m], [rad] Greatest error of the integrated motion's end."""

_OVER = 0.01
"""Part by which a speed may exceed its limit; three times that for the lateral acceleration between the knots."""


@dataclass(frozen=True, slots=True)
class BestDrive:
    """A motion in the least time: `times_s` (T,), poses (T, 3) in map, twists (T, 2) [m/s, rad/s].

    `first_s` [s]: rough time of the first way, without jerk.
    """

    seconds: float
    times_s: FloatArray
    poses: FloatArray
    twists: FloatArray
    first_s: float

    @property
    def turned(self) -> float:
        """The sum of all turning [rad]."""
        return float(np.abs(np.diff(self.poses[:, 2])).sum())

    @property
    def way_m(self) -> float:
        """The distance driven, in both gears [m]."""
        return float(np.hypot(*np.diff(self.poses[:, :2], axis=0).T).sum())


@dataclass(frozen=True, slots=True)
class Motion:
    """Knots (N + 1, 7): x, y [m], theta [rad], v, a, omega, alpha (scaled); jerks (N, 2) along and of turning (scaled).

    `dt` [s] is the time between two knots.
    """

    knots: FloatArray
    jerks: FloatArray
    dt: float

    @property
    def count(self) -> int:
        """The number N of intervals."""
        return len(self.jerks)

    @property
    def seconds(self) -> float:
        """The duration [s]."""
        return self.count * self.dt

    def middles(self) -> FloatArray:
        """Return (N, 2) heading [rad] and speed (scaled) in the middle of each interval."""
        _, _, theta, v, a, omega, alpha = self.knots[:-1].T
        j, k = self.jerks.T
        return np.column_stack([theta + omega / 2 + alpha / 8 + k / 48, v + a / 2 + j / 8])

    def defects(self) -> FloatArray:
        """Return (N, 2) [m] by how much x and y differ from the integral of the speed (Simpson's rule)."""
        theta, v = self.knots[:, 2], self.knots[:, 3]
        heading, speed = self.middles().T
        errors = []
        for axis, of in ((0, np.cos), (1, np.sin)):
            f = v * of(theta)
            errors.append(np.diff(self.knots[:, axis]) - (f[:-1] + 4 * speed * of(heading) + f[1:]) / 6)
        return np.column_stack(errors)

    def checked(self) -> FloatArray:
        """Return (2N + 1, 3) the poses at which gaps are measured: knots and the means of two neighbours."""
        poses = np.empty((2 * self.count + 1, 3))
        poses[::2] = self.knots[:, :3]
        poses[1::2] = (self.knots[1:, :3] + self.knots[:-1, :3]) / 2
        return poses


def motion_through(rows: FloatArray, seconds: float, ends: tuple[FloatArray, FloatArray]) -> Motion:
    """Return a motion through roughly timed rows (N + 1, 4): x, y, theta, distance; exact at its ends (3,).

    Its speeds and accelerations are differences, and keep no limits.
    """
    count = len(rows) - 1
    knots = np.zeros((count + 1, 7))
    knots[:, :3] = rows[:, :3]
    knots[0, :3], knots[-1, :3] = ends
    for column, values in ((3, rows[:, 3]), (5, rows[:, 2])):
        knots[1:-1, column] = (values[2:] - values[:-2]) / 2
        knots[1:-1, column + 1] = values[2:] - 2 * values[1:-1] + values[:-2]
    return Motion(knots, np.zeros((count, 2)), seconds / count)


def integrated(motion: Motion, first_s: float) -> BestDrive:
    """Return the motion of the constant jerks, integrated from its start in steps of a tenth of an interval."""
    n, dt = motion.count, motion.dt
    part = np.arange(2 * _DENSE + 1) / (2 * _DENSE)  # with the middles that Simpson's rule needs
    _, _, theta, v, a, omega, alpha = (column[:-1, None] for column in motion.knots.T)
    j, k = (column[:, None] for column in motion.jerks.T)
    heading = theta + omega * part + alpha * part**2 / 2 + k * part**3 / 6
    speed, rate = v + a * part + j * part**2 / 2, omega + alpha * part + k * part**2 / 2
    places = []
    for axis, of in ((0, np.cos), (1, np.sin)):
        f = speed * of(heading)
        moved = (f[:, :-2:2] + 4 * f[:, 1::2] + f[:, 2::2]) / (6 * _DENSE)
        places.append(motion.knots[0, axis] + np.concatenate([[0.0], np.cumsum(moved.ravel())]))

    def joined(values: FloatArray) -> FloatArray:
        """Return (10 N + 1,) the values at the integrated poses."""
        return np.append(values[:, :-1:2].ravel(), values[-1, -1])

    return BestDrive(
        seconds=motion.seconds,
        times_s=np.arange(n * _DENSE + 1) * dt / _DENSE,
        poses=np.column_stack([*places, joined(heading)]),
        twists=np.column_stack([joined(speed), joined(rate)]) / dt,
        first_s=first_s,
    )


def within_limits(motion: Motion, drive: BestDrive, comfort: Comfort) -> Motion:
    """Return the motion along the same path, slower where its integration `drive` exceeds a limit between the knots.

    Over a longer time all speeds fall in proportion, and accelerations and jerks still more.
    """
    v, omega = drive.twists.T
    longer = max(
        1.0,
        float(v.max()) / comfort.speed,
        -float(v.min()) / max(comfort.reverse, _NO_SPEED),
        float(np.abs(omega).max()) / comfort.turn_rate,
        math.sqrt(float(np.abs(v * omega).max()) / comfort.lateral),
    )
    return replace(motion, dt=longer * motion.dt) if longer <= _LONGEST else motion


_NO_SPEED = 0.01
"""[m/s] A chair that may not reverse may still roll back by so little between two knots."""

_LONGEST = 1.1
"""A motion that would have to last longer by more than this is no best one."""


def faults(around: BoxesRound, drive: BestDrive, goal: Pose2, comfort: Comfort) -> str:
    """Return what a motion violates, as the end of a sentence; empty if the chair could drive it."""
    x, y, theta = drive.poses[-1].tolist()
    away = math.hypot(x - goal.x, y - goal.y)
    if away > _AT_END or abs(wrap_angle(theta - goal.theta)) > _AT_END_HEADING:
        return f"ends {away:.3f} m from it"
    v, omega = drive.twists.T
    if v.max() > comfort.speed * (1 + _OVER) or -v.min() > comfort.reverse * (1 + _OVER) + 1e-3:
        return f"is too fast ({v.min():.3f} to {v.max():.3f} m/s)"
    if np.abs(omega).max() > comfort.turn_rate * (1 + _OVER):
        return f"turns too fast ({np.abs(omega).max():.3f} rad/s)"
    if np.abs(v * omega).max() > comfort.lateral * (1 + 3 * _OVER):
        return f"has a lateral acceleration of {np.abs(v * omega).max():.3f} m/s^2"
    for x, y, theta in drive.poses.tolist():
        if not is_free(around, x, y, theta):
            return f"touches something at ({x:.2f}, {y:.2f})"
    return ""
