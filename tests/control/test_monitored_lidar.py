"""A lidar that is not trusted: blind, frozen, too close to something, or with arbitrary data."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.control.safety.test_collision_monitor import BEAMS, MS, NOTHING, VIEW, scan_of
from waychair.calibration.chair_body import CHAIR_A
from waychair.control.safety.collision_monitor import Monitor
from waychair.control.safety.stops import STOPS
from waychair.types import Scan, Twist


@pytest.mark.parametrize(("covered", "blind"), [(0.19, False), (0.21, True), (1.0, True)])
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_f12_a_lidar_of_which_a_fifth_is_covered_is_blind_within_half_a_second(
    covered: float, blind: bool, value: float
) -> None:
    monitor = Monitor(CHAIR_A)
    for k in range(12):
        scan = scan_of(np.empty((0, 2)), stamp_ns=100 * k * MS, seed=k)
        if k >= 6:
            scan.ranges[: round(covered * BEAMS)] = value
        monitor.see(scan)
        found = monitor.judge(Twist(0.1, 0.0), Twist(), scan.stamp_ns).stop
        assert found == ("lidar_blind" if blind and k >= 9 else "")


@pytest.mark.parametrize("value", [math.nan, 0.0, 0.02, -math.inf, 25.1, 65.533])
@pytest.mark.parametrize("grows", [0, 1])
def test_f12_a_lidar_is_blind_for_any_readings_out_of_range_and_any_number_of_beams(value: float, grows: int) -> None:
    monitor = Monitor(CHAIR_A)
    for k in range(12):
        count = BEAMS + grows * (k % 2)
        ranges = np.full(count, 8.0, np.float32) + np.random.default_rng(k).normal(0.0, 0.001, count).astype(np.float32)
        if k >= 6:
            ranges[: round(0.9 * count)] = value
        monitor.see(Scan(100 * k * MS, ranges, -VIEW / 2, VIEW / (count - 1), 0.0, 0.05, 25.0))
        found = monitor.judge(Twist(0.1, 0.0), Twist(), 100 * k * MS).stop
        assert found == ("lidar_blind" if k >= 9 else "")


@pytest.mark.parametrize(
    ("laser_x", "range_min", "stops"), [(CHAIR_A.front, 0.2, True), (CHAIR_A.laser_x, 0.05, False)]
)
def test_a_surface_too_close_to_be_measured_is_not_driven_into(laser_x: float, range_min: float, stops: bool) -> None:
    body = replace(CHAIR_A, laser_x=laser_x)
    scan = replace(scan_of(np.empty((0, 2)), body), range_min=range_min)
    scan.ranges[340:381] = -math.inf  # straight ahead
    monitor = Monitor(body)
    monitor.see(scan)
    assert (monitor.judge(Twist(0.3, 0.0), Twist(), 0).stop == "obstacle") is stops
    assert monitor.judge(Twist(-0.2, 0.0), Twist(), 0).stop == ""


def test_f12_beams_without_a_return_at_intervals_are_not_blind() -> None:
    monitor = Monitor(CHAIR_A)
    for k in range(20):
        scan = scan_of(np.empty((0, 2)), stamp_ns=100 * k * MS, seed=k)
        scan.ranges[k % 3 :: 3] = math.inf
        monitor.see(scan)
        assert monitor.judge(Twist(0.1, 0.0), Twist(), scan.stamp_ns).stop == ""


def test_f12_identical_scans_are_a_frozen_lidar_until_one_differs() -> None:
    monitor = Monitor(CHAIR_A)
    for k in range(8):
        scan = scan_of(np.empty((0, 2)), stamp_ns=100 * k * MS)
        monitor.see(scan)
        assert monitor.judge(Twist(), Twist(), scan.stamp_ns).stop == ("lidar_frozen" if k >= 4 else "")
    monitor.see(scan_of(np.empty((0, 2)), stamp_ns=800 * MS, seed=1))
    assert monitor.judge(Twist(), Twist(), 800 * MS).stop == ""


@given(
    st.integers(0, 40),
    st.sampled_from([math.nan, math.inf, -math.inf, 0.0, -1.0, 1e30]),
    st.floats(-1, 1),
    st.floats(-1, 1),
)
def test_no_scan_raises_an_error(beams: int, value: float, v: float, omega: float) -> None:
    monitor = Monitor(CHAIR_A)
    monitor.see(Scan(0, np.full(beams, value, np.float32), -1.0, 0.05, 1e-3, 0.0, 10.0))
    verdict = monitor.judge(Twist(v, omega), Twist(v, omega), 50 * MS)
    assert 0.0 <= verdict.share <= 1.0
    assert verdict.stop == "" or verdict.stop in STOPS


def test_after_a_scan_without_beams_it_goes_on() -> None:
    monitor = Monitor(CHAIR_A)
    monitor.see(replace(scan_of(NOTHING), ranges=np.zeros(0, np.float32)))
    assert monitor.judge(Twist(0.1, 0.0), Twist(), 0).stop == "lidar_blind"
    monitor.see(scan_of(NOTHING, stamp_ns=100 * MS))
    assert monitor.judge(Twist(0.1, 0.0), Twist(), 100 * MS).stop == ""
