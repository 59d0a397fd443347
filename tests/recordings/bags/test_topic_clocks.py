"""Stamps of topics are compared with each other and with the times of recording."""

from __future__ import annotations

import numpy as np

from waychair.recordings.bags.topic_clocks import TopicTimes, plausible_stamps
from waychair.types import BoolArray, IntArray

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND


def times(
    topic: str,
    stamps: IntArray,
    logs: IntArray | None = None,
    unstamped: BoolArray | None = None,
    waits_ns: int = 0,
) -> TopicTimes:
    """Return a topic that is recorded 10 ms after its messages are whole."""
    logs = stamps + waits_ns + SECOND // 100 if logs is None else logs
    return TopicTimes(
        topic, stamps, logs, np.zeros(len(stamps), np.bool_) if unstamped is None else unstamped, waits_ns
    )


def ticks(count: int, period_s: float) -> IntArray:
    """Return stamps of a steady topic."""
    return START + np.rint(np.arange(count) * period_s * SECOND).astype(np.int64)


ODOM, IMU = times("/odom", ticks(200, 0.05)), times("/imu", ticks(500, 0.02))


def test_sound_stamps_stay_as_they_are() -> None:
    scan = times("/scan", ticks(50, 0.2), waits_ns=SECOND // 5)
    stamps, findings = plausible_stamps([scan, ODOM, IMU])
    assert findings == []
    assert all(np.array_equal(mended, own.stamps) for mended, own in zip(stamps, [scan, ODOM, IMU], strict=True))


def test_a_topic_with_a_clock_of_its_own_is_moved_to_that_of_the_others_less_its_sweep() -> None:
    true = ticks(50, 0.2)
    scan = times("/scan", true - 3600 * SECOND, true + SECOND // 5 + SECOND // 100, waits_ns=SECOND // 5)
    (mended, *_), (found,) = plausible_stamps([scan, ODOM, IMU])
    assert np.abs(mended - true).max() <= SECOND // 1000
    assert found.topic == "/scan"
    assert "3600.0 s before those of the other topics" in found.text


def test_a_stamp_that_lies_seconds_beside_its_neighbours_is_set_between_them() -> None:
    true = ticks(50, 0.2)
    told = true.copy()
    told[20] += 86_400 * SECOND
    told[31] -= SECOND
    (mended, _), (found,) = plausible_stamps([times("/scan", told, true + SECOND // 100), ODOM])
    assert np.abs(mended - true).max() <= SECOND // 1000
    assert found.count == 2


def test_a_message_that_is_recorded_late_keeps_its_stamp() -> None:
    true = ticks(50, 0.2)
    logs = true + SECOND // 100
    logs[10:20] = logs[20]  # the disk was busy
    (mended, _), findings = plausible_stamps([times("/scan", true, logs), ODOM])
    assert findings == []
    assert np.array_equal(mended, true)


def test_stamps_that_repeat_or_are_cut_to_seconds_are_replaced_by_the_times_of_recording() -> None:
    true = ticks(50, 0.2)
    for told in (true[np.arange(50) // 5 * 5], true // SECOND * SECOND):
        (mended, _), (found,) = plausible_stamps([times("/scan", told, true + SECOND // 100), ODOM])
        assert np.abs(mended - true).max() <= SECOND // 20
        assert "stamp of the one before" in found.text


def test_a_topic_without_stamps_takes_the_times_of_recording_less_its_sweep() -> None:
    true = ticks(50, 0.2)
    logs = true + SECOND // 5 + SECOND // 100
    scan = times("/scan", logs, logs, np.ones(50, np.bool_), SECOND // 5)
    (mended, _), (found,) = plausible_stamps([scan, ODOM])
    assert np.abs(mended - true).max() <= SECOND // 1000
    assert found.count == 50


def test_without_times_of_recording_nothing_is_changed() -> None:
    scan = times("/scan", ticks(50, 0.2), np.zeros(50, np.int64))
    (mended, _), findings = plausible_stamps([scan, ODOM])
    assert np.array_equal(mended, scan.stamps)
    assert findings == []


def test_a_clock_that_stands_still_gives_way_to_the_times_of_recording_less_the_sweep() -> None:
    true = ticks(50, 0.2)
    scan = times("/scan", np.full(50, START), true + SECOND // 5 + SECOND // 100, waits_ns=SECOND // 5)
    stamps, findings = plausible_stamps([scan, ODOM, IMU])
    assert [(found.topic, found.count) for found in findings] == [("/scan", 49)]
    assert np.abs(stamps[0] - true).max() <= 1000
