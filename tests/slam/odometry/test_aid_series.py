"""The aids of a drive over the intervals between scans, whether these were compared or not."""

from __future__ import annotations

import numpy as np
import pytest

from waychair.slam.odometry.aid_series import ScanSeries


def series() -> ScanSeries:
    """Two runs of compared scans, with gaps before, between and after them; the last interval was not measured."""
    intervals = np.array([[1.0, 1.5], [1.5, 2.0], [6.0, 6.5]])
    known = np.array([True, True, False])
    return ScanSeries(intervals, np.array([[0.2, 0.0, 0.1]] * 3), known, known, np.ones(3, np.bool_))


def test_all_intervals_between_scans_follow_each_other() -> None:
    # the scan at 1.2 s was too near the one before
    times = np.array([0.0, 1.0, 1.2, 1.5, 2.0, 2.0, 4.0, 6.0, 6.5, 9.0])
    every = series().with_all(times)
    assert every.intervals[:, 0].tolist() == [0.0, 1.0, 1.5, 2.0, 4.0, 6.0, 6.5]
    assert (every.intervals[1:, 0] == every.intervals[:-1, 1]).all()
    assert every.compared.tolist() == [False, True, True, False, False, True, False]
    assert every.turn_known.tolist() == [False, True, True, False, False, False, False]
    assert every.motions[every.compared] == pytest.approx(series().motions)


def test_a_chair_stands_where_nothing_tells_its_motion() -> None:
    every = series().with_all(np.array([1.0, 1.5, 2.0, 6.0, 6.5]))
    assert every.filled() == pytest.approx(
        np.array([[0.2, 0.0, 0.1], [0.2, 0.0, 0.1], [0.0, 0.0, 0.0], [0.2, 0.0, 0.1]])
    )


def test_a_series_without_compared_scans_has_all_intervals() -> None:
    none = np.zeros(0, np.bool_)
    every = ScanSeries(np.zeros((0, 2)), np.zeros((0, 3)), none, none, none).with_all(np.array([0.0, 3.0, 6.0]))
    assert every.intervals.tolist() == [[0.0, 3.0], [3.0, 6.0]]
    assert not every.compared.any()
