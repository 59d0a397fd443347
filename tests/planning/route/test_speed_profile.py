"""The speed along a line: slower in bends and beside things, and low enough everywhere to slow down in time."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from waychair.calibration.chair_body import CHAIR_A, CHAIR_A_FRONT, CHAIR_A_MID
from waychair.planning.body.footprint import along_arc
from waychair.planning.route.speed_profile import (
    fastest_now,
    next_acceleration,
    predicted_time,
    speeds_along,
    turn_time,
    way_to_slow,
)
from waychair.planning.window.motion_limits import PERIOD, DwaSettings
from waychair.types import FloatArray

LIMITS = DwaSettings()


def plain_way(v: float, a: float, end: float, most: float, jerk: float) -> float:
    """The way to slow down, by the best switch from growing to falling braking, in small steps."""
    best = math.inf
    for peak in np.linspace(0.0, most, 100):
        way, speed, rate, dt = 0.0, v, a, 0.005
        while rate > -peak:
            rate = max(rate - jerk * dt, -peak)
            way, speed = way + speed * dt, speed + rate * dt
        while speed - rate * rate / (2 * jerk) > end:
            way, speed = way + speed * dt, speed + rate * dt
            if peak == 0.0:
                break
        while rate < 0.0:
            rate = min(rate + jerk * dt, 0.0)
            way, speed = way + speed * dt, speed + rate * dt
        if abs(speed - end) < 0.008:
            best = min(best, way)
    return best


@pytest.mark.parametrize(("v", "a", "end"), [(0.8, 0.0, 0.0), (0.8, 0.4, 0.3), (0.5, -0.2, 0.1), (0.3, 0.2, 0.0)])
def test_the_way_to_slow_down_is_that_of_a_plain_search(v: float, a: float, end: float) -> None:
    assert way_to_slow(v, a, end, 0.6, 0.7) == pytest.approx(plain_way(v, a, end, 0.6, 0.7), abs=0.02)


def test_a_chair_below_the_speed_needs_no_way() -> None:
    assert way_to_slow(0.3, 0.0, 0.5, 0.6, 0.7) == 0.0
    assert way_to_slow(0.3, 0.1, 0.5, 0.6, 0.7) == 0.0
    assert way_to_slow(0.49, 0.4, 0.5, 0.6, 0.7) > 0.0, "it would still gain speed"


@given(st.lists(st.floats(0.05, 0.8), min_size=8, max_size=8), st.floats(1.0, 6.0))
def test_no_speed_ahead_is_exceeded_and_the_jerk_is_kept(stations: list[float], length: float) -> None:
    along = np.linspace(0.0, length, 60)
    speeds = np.interp(along, np.linspace(0.0, length, 8), stations)
    speeds = np.minimum(speeds, 0.8)
    speeds[-1] = 0.0
    s, v, a = 0.0, 0.0, 0.0
    for _ in range(1200):
        then = next_acceleration(speeds, along, s, v, a, LIMITS.acceleration, LIMITS.braking, LIMITS.jerk)
        assert abs(then - a) <= LIMITS.jerk * PERIOD + 1e-9
        a, before = then, v
        v = max(v + a * PERIOD, 0.0)
        s += (before + v) / 2 * PERIOD
        if s >= length - 0.02 or v == 0.0:
            break
        k = int(np.searchsorted(along, s))
        assert v <= max(speeds[k - 1], speeds[k]) + 0.03
    assert v < 0.15


def speeds_of(line: FloatArray, room: float, backwards: bool = False, strays: float = 0.0) -> FloatArray:
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line[:, :2], axis=0).T))])
    bends = np.gradient(np.unwrap(line[:, 2]), along)
    rooms = np.full(len(line), room)
    return speeds_along(bends, rooms, along, CHAIR_A, LIMITS, -1.0 if backwards else 1.0, strays)


def arc(radius: float) -> FloatArray:
    return np.array([along_arc(0.0, 0.0, 0.0, s, s / radius, 1.0) for s in np.linspace(0.0, 3.0, 40)])


def test_bends_limit_the_speed_by_comfort_and_by_turning() -> None:
    straight, wide, tight = (speeds_of(arc(radius), 0.16)[20] for radius in (1e6, 1.0, 0.4))
    assert straight == LIMITS.max_speed
    assert wide <= math.sqrt(LIMITS.max_lateral * 1.0) + 1e-6
    assert tight / 0.4 <= LIMITS.max_omega
    assert straight > wide > tight


def test_beside_things_the_chair_is_slower_the_less_room_there_is() -> None:
    speeds = [speeds_of(arc(1e6), room)[20] for room in (0.16, 0.04, 0.02, 0.0)]
    assert speeds == sorted(speeds, reverse=True)
    assert speeds[-1] == pytest.approx(0.15)
    assert speeds_of(arc(1e6), 0.16, backwards=True)[20] == LIMITS.max_reverse


def test_a_chair_that_strays_is_slower_beside_things_and_below_the_least_speed_of_one_as_its_file_says() -> None:
    speeds = [speeds_of(arc(1e6), 0.06, strays=strays)[20] for strays in (0.1, 0.2, 0.4, 0.8)]
    assert speeds == sorted(speeds, reverse=True)
    assert speeds[1] >= 0.15 > speeds[2] > speeds[3] > 0.03
    assert speeds_of(arc(1e6), 0.16, strays=0.8)[20] == LIMITS.max_speed


def test_the_predicted_time_of_a_straight_drive_is_that_of_its_profile() -> None:
    along = np.linspace(0.0, 8.0, 101)
    seconds = predicted_time(np.full(101, 0.8), along, LIMITS)
    assert 8.0 / 0.8 + 1.0 < seconds < 8.0 / 0.8 + 4.5


def test_a_turn_takes_longer_the_farther_it_goes() -> None:
    times = [turn_time(turn, CHAIR_A, LIMITS) for turn in (0.0, 0.1, 1.0, -3.0)]
    assert times[0] == 0.0
    assert times == sorted(times)


def test_a_turn_takes_longer_the_farther_the_rear_corners_are_from_the_drive_wheels() -> None:
    rear, middle, front = (turn_time(math.pi, body, LIMITS) for body in (CHAIR_A, CHAIR_A_MID, CHAIR_A_FRONT))
    assert rear < middle < front
    assert front == pytest.approx(0.5 + math.pi / 0.2 + 0.2 / LIMITS.alpha)  # corners 0.75 m behind at 0.15 m/s


def test_the_highest_speed_now_lets_the_chair_keep_the_speeds_ahead() -> None:
    along = np.linspace(0.0, 3.0, 61)
    speeds = np.where(along < 2.0, 0.8, 0.2)
    near, far = (fastest_now(speeds, along, s, 0.6, 0.7) for s in (1.9, 0.2))
    assert near < 0.45
    assert far == pytest.approx(0.8, abs=0.01)
