from __future__ import annotations

import math

import numpy as np
import pytest

from waychair.control.journey.pressure_climb import PressureClimb
from waychair.control.journey.which_storey import StopEvidence, decided, probabilities
from waychair.simulation.sensors.barometer import Barometer
from waychair.types import PressureSample

SECOND = 1_000_000_000


def heard(climb: PressureClimb, begin_s: float, end_s: float, pascal: float) -> None:
    for k in range(round(begin_s * 10), round(end_s * 10)):
        climb.hear(PressureSample(k * SECOND // 10, pascal))


def ridden(seed: int, height: float) -> tuple[float, float]:
    """A ride of 20 s between two rests, by a simulated barometer."""
    climb, barometer = PressureClimb(), Barometer(10.0, np.random.default_rng(seed))
    for k in range(250):
        climb.hear(barometer.sample(k * SECOND // 10, 0.0 if k < 50 else min((k - 50) / 100, 1.0) * height))
        if k == 49:
            climb.begin(k * SECOND // 10)
    known = climb.climb(249 * SECOND // 10)
    assert known is not None
    return known


def test_a_simulated_barometer_alone_finds_the_storey_of_alike_ones() -> None:
    heights, right, wrong = {"0": 0.0, "1": 3.3, "2": 6.6, "3": 9.9}, 0, 0
    for seed in range(60):
        true = ("1", "2", "3")[seed % 3]
        known = StopEvidence(heights, began="0", asked="2", pressure=ridden(seed, heights[true]))
        found = decided(probabilities(known))
        right, wrong = right + (found == true), wrong + (found not in (None, true))
    assert right >= 57  # the rider is asked for the others
    assert wrong == 0


def test_without_fresh_samples_before_and_after_the_climb_is_unknown() -> None:
    climb = PressureClimb()
    assert climb.climb(SECOND) is None
    heard(climb, 0.0, 2.0, 101_000.0)
    climb.begin(2 * SECOND)
    assert climb.climb(2 * SECOND) == pytest.approx((0.0, 0.3), abs=0.01)
    assert climb.climb(9 * SECOND) is None  # the barometer is silent
    heard(climb, 20.0, 22.0, 101_000.0 - 40.0)
    assert climb.climb(22 * SECOND) == pytest.approx((40.0 / 12.0, 0.34), abs=0.01)
    late = PressureClimb()
    late.begin(0)
    heard(late, 0.1, 3.0, 101_000.0)
    assert late.climb(3 * SECOND) is None


@pytest.mark.parametrize("wrong", [math.nan, math.inf, 0.0, 1013.25])
def test_a_reading_that_is_no_pressure_in_pascal_is_left_out(wrong: float) -> None:
    climb = PressureClimb()
    heard(climb, 0.0, 2.0, wrong)
    climb.begin(2 * SECOND)
    heard(climb, 2.0, 4.0, wrong)
    assert climb.climb(4 * SECOND) is None
