"""Readings of the angles of scans whose fields contradict each other."""

from __future__ import annotations

import math

import numpy as np
import pytest

from waychair.recordings.plausibility.angle_readings import angle_readings
from waychair.recordings.plausibility.told_scans import ToldScan


def told(beams: int, first: float, last: float, step: float) -> ToldScan:
    return ToldScan(0, np.ones(beams, np.float32), first, last, step)


@pytest.mark.parametrize(
    ("first", "last", "step"),
    [
        (-math.pi, math.pi - math.tau / 360, math.tau / 360),
        (-math.pi, math.pi, math.tau / 360),  # the first beam counted twice
        (0.0, 6.28319, 0.0174533),
        (math.pi, -math.pi, -math.tau / 360),  # clockwise
        (math.pi, math.pi - math.tau / 360, math.tau / 360),  # wrapped round
        (0.0, 0.0, math.tau / 360),  # angle_max was never filled in
    ],
)
def test_angles_that_fit_together_are_sound(first: float, last: float, step: float) -> None:
    readings = angle_readings(told(360, first, last, step))
    assert readings.sound
    assert (readings.readings[0].first, readings.readings[0].step) == (first, step)


@pytest.mark.parametrize(
    ("first", "last", "step"),
    [(-120.0, 119.5, 0.5), (-120.0, 119.5, math.radians(0.5)), (math.radians(-120.0), math.radians(119.5), 0.5)],
)
def test_degrees_are_converted_whichever_fields_are_in_degrees(first: float, last: float, step: float) -> None:
    (reading,) = angle_readings(told(480, first, last, step)).readings
    assert (reading.first, reading.step) == (pytest.approx(math.radians(-120.0)), pytest.approx(math.radians(0.5)))
    assert "degrees" in reading.text


@pytest.mark.parametrize("step", [0.0, math.nan, 0.5])
def test_a_step_that_cannot_be_is_that_between_the_ends(step: float) -> None:
    (reading,) = angle_readings(told(241, -2.0, 2.0, step)).readings
    assert (reading.first, reading.step) == (-2.0, pytest.approx(4.0 / 240))


def test_ends_that_are_exchanged_have_three_readings_of_which_two_mirror_or_turn_the_map() -> None:
    readings = angle_readings(told(241, 2.0, -2.0, 4.0 / 240))
    assert readings.mirrored
    assert [(r.first, r.step) for r in readings.readings] == [
        (-2.0, 4.0 / 240),
        (2.0, -4.0 / 240),
        (2.0, 4.0 / 240),
    ]


def test_another_last_angle_leaves_two_readings() -> None:
    readings = angle_readings(told(241, -2.0, 1.0, 4.0 / 240)).readings
    assert [reading.step for reading in readings] == [4.0 / 240, pytest.approx(3.0 / 240)]


@pytest.mark.parametrize(
    "scan",
    [told(241, math.nan, 2.0, 0.1), told(241, 0.0, 0.0, 0.0), told(1, 0.0, 1.0, 0.1), told(241, 0.0, 1e5, math.inf)],
)
def test_angles_that_cannot_be_read_have_no_reading(scan: ToldScan) -> None:
    assert angle_readings(scan).readings == ()
