"""Stops: the delay and distance of one, the worst case of many, and the speed that they permit."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from waychair.calibration.fits.stopping import (
    UNMEASURED_SPEED,
    MeasuredStop,
    StopSettings,
    StopTable,
    permitted_speed,
    stop_from_motion,
    stop_table,
    stops_to_measure,
)
from waychair.errors import CalibrationError, ThinData
from waychair.types import FloatArray

TABLE = StopTable(speeds=(0.2, 0.6, 1.0), distances=(0.1, 0.4, 1.0), turn_rate=0.6, turn_angle=0.3, delay_s=0.2)


def _braking(v: float, omega: float, delay: float, seconds: float = 2.0) -> tuple[FloatArray, FloatArray]:
    """Speeds that fall evenly to 0 within `seconds`, after a delay."""
    times = np.arange(-0.6, delay + seconds + 0.3, 0.01)
    part = np.clip(1.0 - (times - delay) / seconds, 0.0, 1.0)
    return times, part[:, None] * (v, omega)


@pytest.mark.parametrize(("v", "omega"), [(1.0, 0.0), (-0.6, 0.0), (0.5, 0.4), (0.0, -0.8)])
@pytest.mark.parametrize("delay", [0.0, 0.1, 0.3])
def test_a_stop_has_a_delay_and_a_distance(v: float, omega: float, delay: float) -> None:
    stop = stop_from_motion(*_braking(v, omega, delay))
    assert stop.v == pytest.approx(v)
    assert stop.omega == pytest.approx(omega)
    assert stop.delay_s == pytest.approx(delay + 0.05 * 2.0, abs=0.02)
    assert stop.distance_m == pytest.approx(abs(v) * (delay + 1.0), abs=0.01)
    assert stop.angle_rad == pytest.approx(abs(omega) * (delay + 1.0), abs=0.01)


def test_a_log_that_ends_before_rest_is_refused() -> None:
    times, twists = _braking(1.0, 0.0, 0.1)
    with pytest.raises(ThinData, match="still moving"):
        stop_from_motion(times[times < 1.0], twists[times < 1.0])


def test_a_stop_before_its_speed_was_reached_is_refused() -> None:
    times, twists = _braking(1.0, 0.0, 0.1)
    speeding_up = np.clip(1.0 + times, 0.0, 1.0)[:, None]
    with pytest.raises(ThinData, match=r"still changing its speed, from 0\.\d+ to 0\.\d+ m/s"):
        stop_from_motion(times, twists * speeding_up)


def test_a_stop_needs_samples_before_it() -> None:
    times, twists = _braking(1.0, 0.0, 0.1)
    with pytest.raises(ThinData, match="half a second"):
        stop_from_motion(times[times > 0.1], twists[times > 0.1])


def test_the_table_is_the_worst_of_all_directions_plus_the_margin() -> None:
    stops = [
        MeasuredStop(0.30, 0.0, 0.10, 0.10, 0.0),
        MeasuredStop(-0.31, 0.0, 0.15, 0.14, 0.0),
        MeasuredStop(0.60, 0.0, 0.12, 0.40, 0.0),
        MeasuredStop(0.61, 0.5, 0.20, 0.40, 0.2),
        MeasuredStop(0.0, 0.6, 0.10, 0.0, 0.3),
    ]
    table = stop_table(stops, 0.8)
    assert table.speeds == (0.30, 0.60)
    assert table.distances == pytest.approx((0.14 * 1.2 + 0.03, (0.40 + 0.2 * 0.8) * 1.2 + 0.03))
    assert table.ways == pytest.approx(
        (0.14 * 1.2 + 0.03, 0.40 * 1.2 + 0.03)
    )  # a turn's corner is judged by its own arc
    assert table.way(0.45) == pytest.approx(sum(table.ways) / 2)
    assert TABLE.way(0.6) == TABLE.distance(0.6)  # measured before the two were told apart
    assert table.delay_s == 0.20
    assert (table.turn_rate, table.turn_angle) == pytest.approx((0.6, 0.3 * 1.2 + 0.03 / 0.8))


@pytest.mark.parametrize("ways", [(0.1,), (0.1, 0.5, 0.9), (0.0, 0.4, 0.9), (0.1, 0.4, math.nan)])
def test_ways_that_do_not_belong_to_the_table_are_refused(ways: tuple[float, ...]) -> None:
    with pytest.raises(CalibrationError, match="measure the stops again"):
        replace(TABLE, ways=ways)


def test_stops_from_one_speed_or_without_a_spin_are_refused() -> None:
    fast, slow, spin = (
        MeasuredStop(0.6, 0.0, 0.1, 0.4, 0.0),
        MeasuredStop(0.2, 0.0, 0.1, 0.1, 0.0),
        MeasuredStop(0.0, 0.6, 0.1, 0.0, 0.3),
    )
    stop_table([fast, slow, spin], 0.8)
    for stops in ([fast, spin], [fast, slow], []):
        with pytest.raises(ThinData, match="too few"):
            stop_table(stops, 0.8)


def test_an_unmeasured_chair_may_only_crawl() -> None:
    assert permitted_speed(None) == permitted_speed(None, 0.1) == UNMEASURED_SPEED == 0.3


@pytest.mark.parametrize(
    ("free", "speed"), [(-1.0, 0.0), (0.0, 0.0), (0.05, 0.1), (0.1, 0.2), (0.25, 0.4), (1.0, 1.0), (math.inf, 1.0)]
)
def test_the_permitted_speed_stops_within_the_free_distance(free: float, speed: float) -> None:
    assert permitted_speed(TABLE, free) == pytest.approx(speed)


@given(st.floats(0.0, 2.0))
def test_the_permitted_speed_is_the_inverse_of_the_distance(free: float) -> None:
    speed = permitted_speed(TABLE, free)
    assert TABLE.distance(speed) <= free + 1e-9
    assert TABLE.distance(speed) == pytest.approx(min(free, 1.0))


def test_an_unmeasured_speed_has_no_stopping_distance() -> None:
    assert TABLE.distance(-1.0) == 1.0
    for speed in (1.01, -1.01, math.nan):
        with pytest.raises(CalibrationError, match="at most 1 m/s"):
            TABLE.distance(speed)


@pytest.mark.parametrize(
    ("speeds", "distances"),
    [((), ()), ((0.2,), ()), ((0.2, 0.2), (0.1, 0.2)), ((0.2, 0.4), (0.2, 0.1)), ((0.0, 0.4), (0.1, 0.2)),
     ((0.2, math.nan), (0.1, 0.2))],
)  # fmt: skip
def test_a_table_with_gaps_or_decreasing_distances_is_refused(
    speeds: tuple[float, ...], distances: tuple[float, ...]
) -> None:
    with pytest.raises(CalibrationError, match="table of stops"):
        StopTable(speeds=speeds, distances=distances)


@given(st.floats(0.15, 2.0))
def test_stops_are_planned_in_pairs_up_to_the_top_speed(fastest: float) -> None:
    plan = list(stops_to_measure(StopSettings(repetitions=1), fastest))
    assert max(v for v, _ in plan) == pytest.approx(min(fastest, StopSettings().fastest))
    assert all(a == (-b[0], -b[1]) for a, b in list(pairwise(plan))[::2])
    assert {math.copysign(1.0, omega) for v, omega in plan if v > 0.0 and omega} == {1.0, -1.0}
