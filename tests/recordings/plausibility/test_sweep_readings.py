"""The duration of a sweep from `time_increment`, and the times of a cloud's points."""

from __future__ import annotations

import numpy as np
import pytest

from waychair.recordings.plausibility.point_times import point_times
from waychair.recordings.plausibility.sweep_readings import scan_interval, sweep_readings

INTERVAL = 0.1
STAMP = 1_700_000_000_250_000_000


@pytest.mark.parametrize(
    ("increment", "duration"),
    [
        (0.0997 / 359, 0.0997),  # as it should be
        (0.0997e9 / 359, 0.0997),
        (0.0997e6 / 359, 0.0997),
        (0.0997e3 / 359, 0.0997),
        (0.1, 0.1),  # the time of the whole scan
    ],
)
def test_one_unit_fits_between_two_scans(increment: float, duration: float) -> None:
    (reading,) = sweep_readings(increment, 359, INTERVAL, 1.0)
    assert reading.duration == pytest.approx(duration)
    assert bool(reading.text) == (increment > 0.01)


def test_scans_that_were_left_out_of_the_recording_do_not_change_the_unit() -> None:
    (reading,) = sweep_readings(0.1e9 / 359, 359, 1.0, 1.0)  # one scan in ten was kept
    assert reading.duration == pytest.approx(0.1)


def test_a_time_that_fits_no_unit_is_left_to_the_motion() -> None:
    readings = sweep_readings(3 * 0.0997 / 359, 359, INTERVAL, 1.0)
    assert [reading.duration for reading in readings] == [0.0, pytest.approx(INTERVAL)]
    assert all(reading.text for reading in readings)
    negative = sweep_readings(-0.0997 / 359, 359, INTERVAL, 1.0)
    assert {round(reading.duration, 4) for reading in negative} == {0.0, 0.0997, -0.0997}


def test_without_a_time_the_lidars_turn_is_offered_and_nothing_is_wrong() -> None:
    told, turning, backwards = sweep_readings(0.0, 359, INTERVAL, 0.75)
    assert told.duration == 0.0
    assert not told.text
    assert (turning.duration, backwards.duration) == (pytest.approx(0.075), pytest.approx(-0.075))


def test_the_interval_is_the_median_and_ignores_stamps_that_step_back() -> None:
    assert scan_interval([0, 100_000_000, 200_000_000, 150_000_000, 900_000_000, 1_000_000_000]) == pytest.approx(0.1)
    assert scan_interval([5]) == 0.0


LATER = np.linspace(0.0, 0.0997, 50)


@pytest.mark.parametrize(
    ("told", "shift"),
    [
        (LATER, 0.0),
        (LATER - 0.0997, -0.0997),  # before the stamp of the last point
        (1e3 * LATER, 0.0),
        (1e6 * LATER, 0.0),
        (1e9 * LATER, 0.0),
        (STAMP * 1e-9 + LATER, 0.0),
        (STAMP + 1e9 * LATER, 0.0),
        (1e9 * (4321.0 + LATER), 0.0),  # since the sensor was switched on
    ],
)
def test_times_of_points_are_read_in_their_unit_and_from_their_origin(told: np.ndarray, shift: float) -> None:
    reading = point_times([(STAMP, told)], INTERVAL)
    assert reading is not None
    np.testing.assert_allclose(reading.seconds(told, STAMP), LATER + shift, atol=1e-6)
    assert reading.text()


def test_times_that_fit_no_unit_are_not_read() -> None:
    assert point_times([(STAMP, np.zeros(20))], INTERVAL) is None
    assert point_times([(STAMP, 7.0 * np.arange(20.0))], INTERVAL) is None
    assert point_times([], INTERVAL) is None
