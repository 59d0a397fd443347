"""Speed along a line of poses: as fast as bends, room and comfort allow at each pose, and as the chair can slow down."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from waychair.calibration.chair_body import ChairBody
from waychair.geometry import arc_lengths
from waychair.maps.grid.distance_field import DistanceField
from waychair.planning.body.footprint import fits_each
from waychair.planning.window.motion_limits import DwaSettings
from waychair.types import FloatArray

ROOMS = (0.0, 0.01, 0.02, 0.03, 0.04, 0.06, 0.08, 0.10, 0.13, 0.16)
"""[m] Clearances that are told apart along a line."""

ERROR_STANDING, ERROR_PER_SPEED = 0.01, 0.05
"""[m], [s] Foreseen distance from the line: at a crawl, and more for each m/s."""

LEAST_SPEED = 0.15
"""[m/s] A chair is no slower than this beside things."""

STEERING_SHARE = 0.7
"""Part of the turning speed and acceleration that a line may need; the rest corrects the chair's errors."""

SEEN_TURN = 0.5
"""[rad/s] About the rate of a turn on the spot whose rear corners no sensor sees."""

RESERVE = 0.8
"""Part of the braking and jerk that a profile plans with; the rest is for the chair's lag."""


def rooms_along(body: ChairBody, field: DistanceField, poses: FloatArray) -> FloatArray:
    """Return (N,) [m] the clearance of the outline at poses (N, 3), rounded down to `ROOMS`; -1 where it does not fit."""
    rooms = np.full(len(poses), -1.0)
    left = np.arange(len(poses))
    for margin in ROOMS:
        left = left[fits_each(body, margin, field, poses[left])]
        if not len(left):
            break
        rooms[left] = margin
    return rooms


def curvatures(poses: FloatArray) -> FloatArray:
    """Return (N,) [1/m] the body's turn per metre driven at poses (N, 3)."""
    along = arc_lengths(poses[:, :2])
    headings = np.unwrap(poses[:, 2])
    if len(poses) < 3:
        return np.zeros(len(poses))
    inner = (headings[2:] - headings[:-2]) / np.maximum(along[2:] - along[:-2], 1e-6)
    return np.concatenate([inner[:1], inner, inner[-1:]])


def speeds_along(
    bends: FloatArray, rooms: FloatArray, along: FloatArray, body: ChairBody, limits: DwaSettings, gear: float = 1.0
) -> FloatArray:
    """Return (N,) [m/s] the highest comfortable speed at each pose, its neighbours left out of account."""
    top = limits.max_speed if gear > 0 else limits.max_reverse
    tight = np.abs(bends)
    speed = np.minimum(top, np.sqrt(limits.max_lateral / np.maximum(tight, 1e-6)))
    speed = np.minimum(speed, STEERING_SHARE * limits.max_omega / np.maximum(tight, 1e-6))
    speed = np.minimum(speed, limits.max_wheel_speed / (1.0 + tight * body.track / 2))
    if len(along) > 1:
        rate = np.abs(np.gradient(bends, np.maximum(along, np.arange(len(along)) * 1e-6)))
        speed = np.minimum(speed, np.sqrt(STEERING_SHARE * limits.alpha / np.maximum(rate, 1e-6)))
    room = np.maximum(rooms, 0.0)
    free = rooms >= ROOMS[-1]
    near = np.maximum((room - ERROR_STANDING) / ERROR_PER_SPEED, LEAST_SPEED)
    return np.where(free, speed, np.minimum(speed, near))


@njit(cache=True, nogil=True)
def slowed(way: float, end: float, a: float, jerk: float) -> float:
    """Return the greatest speed [m/s] that slows to `end` within `way` [m] at braking a and jerk, from and to a = 0."""
    way = max(way, 0.0)
    ramps = a * a / jerk
    speed = math.hypot(ramps / 2 - end, math.sqrt(2 * a * way)) - ramps / 2
    if speed - end >= ramps:
        return speed
    half, third = way * math.sqrt(jerk) / 2, 2 * end / 3
    root = math.sqrt(half**2 + third**3)
    return float(end + (np.cbrt(half + root) + np.cbrt(half - root)) ** 2)


@njit(cache=True, nogil=True)
def fastest_now(speeds: FloatArray, along: FloatArray, s: float, lead: float, a: float, jerk: float) -> float:
    """Return the highest speed at `s` [m] from which the chair can keep every speed ahead; it brakes after `lead` [m]."""
    best = math.inf
    for i in range(len(speeds)):
        if along[i] < s - 0.1 and i < len(speeds) - 1:
            continue
        way = along[i] - s - lead
        if way > 4.0:
            break
        best = min(best, slowed(way, speeds[i], a, jerk))
    return best


def time_along(poses: FloatArray, rooms: FloatArray, body: ChairBody, limits: DwaSettings) -> float:
    """Return how long [s] a drive along poses (N, 3) with room (N,) [m] beside them takes, from and to standstill."""
    along = arc_lengths(poses[:, :2])
    return predicted_time(speeds_along(curvatures(poses), rooms, along, body, limits), along, limits)


def predicted_time(speeds: FloatArray, along: FloatArray, limits: DwaSettings, rolls: float = 0.0) -> float:
    """Return how long [s] a drive along a line takes that begins at a speed `rolls` [m/s] and ends standing."""
    ended = speeds.copy()
    ended[-1] = 0.0
    return float(
        _drive_time(
            ended, along, rolls, limits.acceleration, limits.braking, RESERVE * limits.braking, limits.jerk, RESERVE
        )
    )


@njit(cache=True, nogil=True)
def _drive_time(
    speeds: FloatArray,
    along: FloatArray,
    v: float,
    faster: float,
    slower: float,
    a_brake: float,
    jerk: float,
    reserve: float,
) -> float:
    s, a, t, dt = 0.0, 0.0, 0.0, 0.05
    while s < along[-1] - 0.02 and t < 300.0:
        gain = max(a, 0.0)
        lead = v * dt + v * gain / jerk + gain**3 / (3 * jerk**2)
        wanted = max(fastest_now(speeds, along, s, lead, a_brake, reserve * jerk), 0.06)
        goal = min(max((wanted - v) / dt, -slower), faster)
        # the acceleration that jerk can bring to 0 by the time the speed is reached
        most = math.sqrt(2 * jerk * max(abs(wanted - v), 1e-9))
        goal = min(max(goal, -most), most)
        a = min(max(goal, a - jerk * dt), a + jerk * dt)
        v = max(v + a * dt, 0.0)
        s += max(v, 0.01) * dt
        t += dt
    return t


def turn_time(turn: float, limits: DwaSettings) -> float:
    """Return how long [s] a turn on the spot takes from standstill to standstill."""
    turn = abs(turn)
    if turn < 1e-3:
        return 0.0
    rate = min(limits.max_omega, SEEN_TURN)
    ramp = rate**2 / limits.alpha
    return 0.5 + (2 * math.sqrt(turn / limits.alpha) if turn < ramp else turn / rate + rate / limits.alpha)
