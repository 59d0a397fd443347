"""Speed along a line of poses: as fast as bends, room and comfort allow at each pose, and as the chair can slow down."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from waychair.calibration.chair_body import ChairBody
from waychair.geometry import arc_lengths
from waychair.maps.grid.distance_field import DistanceField
from waychair.planning.body.footprint import fits_each
from waychair.planning.window.motion_limits import ERROR_PER_SPEED, ERROR_STANDING, PERIOD, DwaSettings
from waychair.types import FloatArray

ROOMS = (0.0, 0.01, 0.02, 0.03, 0.04, 0.06, 0.08, 0.10, 0.13, 0.16)
"""[m] Clearances that are told apart along a line."""

LEAST_SPEED = 0.15
"""[m/s] A chair is no slower than this beside things,"""

MUCH_STRAYING = 0.2
"""[s] unless it strays by more than this for each m/s: then it is not as its file says, and slower in proportion."""

STEERING_SHARE = 0.7
"""Part of the turning speed and acceleration that a line may need; the rest corrects the chair's errors."""

BLIND_SPEED = 0.15
"""[m/s] About the speed at which the rear corners, which no sensor sees, may move outwards."""

RESERVE = 0.9
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
    bends: FloatArray,
    rooms: FloatArray,
    along: FloatArray,
    body: ChairBody,
    limits: DwaSettings,
    gear: float = 1.0,
    strays: float = 0.0,
) -> FloatArray:
    """Return (N,) [m/s] the highest comfortable speed at each pose, its neighbours left out of account.

    `strays` [s]: the chair has been seen off its line by so much for each m/s of its faster end; more than foreseen counts.
    """
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
    per_speed = np.maximum(strays * faster_end(bends, body), ERROR_PER_SPEED)
    least = LEAST_SPEED * min(1.0, MUCH_STRAYING / max(strays, 1e-9))
    near = np.maximum((room - ERROR_STANDING) / per_speed, least)
    return np.where(free, speed, np.minimum(speed, near))


def faster_end(bends: FloatArray, body: ChairBody) -> FloatArray:
    """Return (N,) the speed of the body's faster end for each m/s along curvatures (N,) [1/m]."""
    faster: FloatArray = 1.0 + np.abs(bends) * max(body.front, body.rear)
    return faster


@njit(cache=True, nogil=True)
def way_to_slow(v: float, a: float, end: float, most: float, jerk: float) -> float:
    """Return the way [m] from speed v and acceleration a to a lower speed `end` without acceleration.

    The braking grows and falls by the jerk, to at most `most` [m/s^2].
    """
    excess, lost = v - end, a * a / (2 * jerk)
    if excess <= 0.0 and (a <= 0.0 or excess + lost <= 0.0):
        return 0.0
    if a < 0.0 and excess <= lost:  # the braking only has to end
        return max(v, 0.0) * (-a - math.sqrt(a * a - 2 * jerk * excess)) / jerk
    peak = math.sqrt(max(jerk * (excess + lost), 0.0))
    if peak > most:
        peak = most
        held = (excess + lost - most * most / jerk) / most
    else:
        held = 0.0
    grows, falls = (a + peak) / jerk, peak / jerk
    way = v * grows + a * grows**2 / 2 - jerk * grows**3 / 6
    v += (a * a - peak * peak) / (2 * jerk)
    way += v * held - peak * held**2 / 2
    v -= peak * held
    return way + v * falls - peak * falls**2 / 2 + jerk * falls**3 / 6


@njit(cache=True, nogil=True)
def next_acceleration(
    speeds: FloatArray, along: FloatArray, s: float, v: float, a: float, faster: float, slower: float, jerk: float
) -> float:
    """Return the highest acceleration of the next period with which the chair can keep every speed ahead.

    It is at `s` [m] with speed v and acceleration a; both change within the limits, the acceleration by the jerk.
    """
    change = jerk * PERIOD
    planned = RESERVE * jerk
    for k in range(_CHOICES + 1):
        then = min(max(a + change * (1.0 - 2.0 * k / _CHOICES), -slower), faster)
        speed = max(v + then * PERIOD, 0.0)
        here = s + (v + speed) / 2 * PERIOD
        keeps = True
        for i in range(len(speeds)):
            if along[i] < s - _BEHIND and i < len(speeds) - 1:
                continue
            way = along[i] - here
            if way > _AHEAD:
                break
            if way_to_slow(speed, then, speeds[i], RESERVE * slower, planned) > max(way, 0.0):
                keeps = False
                break
        if keeps:
            return then
    return max(a - change, -slower)


_CHOICES = 8
"""Number of steps between the accelerations that are tried."""

_BEHIND, _AHEAD = 0.1, 4.0
"""[m] Stretch of the line whose speeds count."""


def fastest_now(speeds: FloatArray, along: FloatArray, s: float, a: float, jerk: float) -> float:
    """Return the highest speed [m/s] at `s` [m] from which the chair can keep every speed ahead."""
    low, high = 0.0, float(speeds.max())
    for _ in range(12):
        middle = (low + high) / 2
        near = (along >= s - _BEHIND) & (along <= s + _AHEAD)
        needs = (way_to_slow(middle, 0.0, float(end), a, jerk) for end in speeds[near])
        if all(need <= max(way, 0.0) for need, way in zip(needs, (along[near] - s).tolist(), strict=True)):
            low = middle
        else:
            high = middle
    return low


def time_along(poses: FloatArray, rooms: FloatArray, body: ChairBody, limits: DwaSettings, gear: float = 1.0) -> float:
    """Return how long [s] a drive along poses (N, 3) with room (N,) [m] beside them takes, from and to standstill."""
    along, bends = arc_lengths(poses[:, :2]), curvatures(poses)
    speeds = np.minimum(speeds_along(bends, rooms, along, body, limits, gear), _blind_speeds(bends, body, gear))
    return predicted_time(speeds, along, limits)


def _blind_speeds(bends: FloatArray, body: ChairBody, gear: float) -> FloatArray:
    """Return (N,) [m/s] the speeds at which the rear corners move outwards at `BLIND_SPEED`, by the curvature."""
    tight = np.abs(bends)
    backwards = tight * body.width / 2 - gear
    return BLIND_SPEED / np.maximum(np.maximum(backwards, tight * body.rear), 1e-3)


def turn_rate(body: ChairBody, limits: DwaSettings) -> float:
    """Return the highest rate [rad/s] of a turn on the spot, at which the rear corners move at `BLIND_SPEED` at most."""
    return min(limits.max_omega, BLIND_SPEED / max(body.rear, body.width / 2))


def predicted_time(speeds: FloatArray, along: FloatArray, limits: DwaSettings) -> float:
    """Return how long [s] a drive along a line takes, from and to standstill."""
    ended = speeds.copy()
    ended[-1] = 0.0
    return float(_drive_time(ended, along, limits.acceleration, limits.braking, limits.jerk))


@njit(cache=True, nogil=True)
def _drive_time(speeds: FloatArray, along: FloatArray, faster: float, slower: float, jerk: float) -> float:
    s, v, a, t = 0.0, 0.0, 0.0, 0.0
    while s < along[-1] - 0.02 and t < 300.0:
        a = next_acceleration(speeds, along, s, v, a, faster, slower, jerk)
        after = max(v + a * PERIOD, 0.0)
        s += max((v + after) / 2, 0.01) * PERIOD
        v = after
        t += PERIOD
    return t


def turn_time(turn: float, body: ChairBody, limits: DwaSettings) -> float:
    """Return how long [s] a turn on the spot takes from standstill to standstill."""
    turn = abs(turn)
    if turn < 1e-3:
        return 0.0
    rate = turn_rate(body, limits)
    ramp = rate**2 / limits.alpha
    return 0.5 + (2 * math.sqrt(turn / limits.alpha) if turn < ramp else turn / rate + rate / limits.alpha)
