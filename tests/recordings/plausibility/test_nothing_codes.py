"""Codes for "nothing seen" among ranges, against surfaces whose rounded ranges repeat."""

from __future__ import annotations

import math

import numpy as np
import pytest

from waychair.recordings.plausibility.nothing_codes import codes_for_nothing, without_codes
from waychair.types import Float32Array

STEP = math.tau / 360
ANGLES = STEP * np.arange(360)


def corridor(at: float, aside: float = 0.0, length: float = 30.0) -> np.ndarray:
    """Ranges (360,) in a corridor 2.4 m wide, at a place along it and aside of its middle line."""
    c, s = np.cos(ANGLES), np.sin(ANGLES)
    with np.errstate(divide="ignore"):
        along = np.where(c > 0, (length - at) / c, -at / c)
        across = np.where(s > 0, (1.2 - aside) / s, (-1.2 - aside) / s)
    return np.minimum(along, across)


def driven(
    step: float = 0.0, reach: float = math.inf, code: float = math.inf, aside: float = 0.0
) -> list[Float32Array]:
    """Scans along the corridor with 5 mm of noise, rounded, with a code beyond the reach."""
    rng = np.random.default_rng(3)
    scans = []
    for at in np.arange(1.0, 28.0, 0.25):
        ranges = corridor(at, aside) + 0.005 * rng.standard_normal(360)
        ranges = np.round(ranges / step) * step if step else ranges
        scans.append(np.where(ranges > reach, code, ranges).astype(np.float32))
    return scans


@pytest.mark.parametrize("step", [0.0, 0.001, 0.01, 0.05])
@pytest.mark.parametrize(
    ("code", "most"), [(8.0, 8.0), (7.99, 8.0), (8.01, 16.0), (3.0, 16.0), (2.5, 16.0), (29.96, 30.0)]
)
def test_a_constant_in_place_of_far_walls_is_a_code(step: float, code: float, most: float) -> None:
    found = codes_for_nothing(driven(step, 4.0, code), STEP, most)
    assert found == (pytest.approx(code, abs=1e-6),)


@pytest.mark.parametrize("step", [0.0, 0.001, 0.01, 0.05, 0.1])
@pytest.mark.parametrize("aside", [0.0, 0.2, 0.55])
def test_walls_at_a_constant_distance_are_no_codes(step: float, aside: float) -> None:
    assert codes_for_nothing(driven(step, aside=aside), STEP, 40.0) == ()


def test_two_codes_are_found_both() -> None:
    scans = driven(0.0, 6.0, 7.0)
    for scan in scans:
        scan[(scan > 3.0) & (scan < 6.0)] = np.float32(7.01)
    assert {round(code, 3) for code in codes_for_nothing(scans, STEP, 16.0)} == {7.0, 7.01}


def test_lone_beams_without_an_echo_are_found_although_farther_walls_are_measured() -> None:
    rng = np.random.default_rng(5)
    scans = driven(0.001)
    for scan in scans:
        scan[rng.random(360) < 0.08] = np.float32(4.0)
    assert codes_for_nothing(scans, STEP, 40.0) == (4.0,)


def test_the_chairs_own_parts_at_fixed_beams_are_no_code() -> None:
    scans = driven(0.01)
    for scan in scans:
        scan[170:190] = np.float32(0.31)
    assert codes_for_nothing(scans, STEP, 40.0) == ()


def test_a_standing_chair_before_a_box_tells_no_code() -> None:
    box = np.where(np.abs(np.arange(360) - 180) < 20, 1.0, corridor(5.0)).astype(np.float32)
    assert codes_for_nothing([np.round(box, 1)] * 300, STEP, 40.0) == ()
    moved = [np.round(scan, 1) for scan in driven()][:6]
    assert codes_for_nothing([np.round(box, 1)] * 300 + moved, STEP, 40.0) == ()


def test_noiseless_ranges_of_a_simulator_hold_no_code() -> None:
    scans = [corridor(at).astype(np.float32) for at in np.arange(1.0, 28.0, 0.25)]
    assert codes_for_nothing(scans, STEP, 40.0) == ()


def test_codes_become_nothing_seen_and_other_ranges_stay() -> None:
    ranges = np.array([1.0, 5.0, math.nan, 4.99], np.float32)
    np.testing.assert_array_equal(without_codes(ranges, (5.0,)), np.array([1.0, math.inf, math.nan, 4.99], np.float32))
