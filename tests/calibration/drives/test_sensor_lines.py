"""Sensors as lines of text: printed lines are read back, in any pieces, and invalid lines are counted."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from waychair.calibration.drives.sensor_lines import LONGEST_LINE, SensorLines, message_from_text, text_from_message
from waychair.types import ImuSample, Scan, WheelTicks

counts = st.integers(-(2**31), 2**31 - 1)


@given(st.integers(0, 2**62), counts, counts)
def test_wheel_counts_survive_printing_and_reading(stamp_ns: int, left: int, right: int) -> None:
    ticks = WheelTicks(stamp_ns, left, right)
    assert message_from_text(text_from_message(ticks), 0) == ticks


def test_scans_and_readings_survive_with_their_missing_values() -> None:
    scan = Scan(7, np.array([1.5, math.inf, -math.inf, math.nan], np.float32), -1.0, 0.01, 1e-4, 0.1, 20.0)
    again = message_from_text(text_from_message(scan), 0)
    assert isinstance(again, Scan)
    assert np.array_equal(again.ranges, scan.ranges, equal_nan=True)
    assert again.angles() == pytest.approx(scan.angles())
    assert (again.stamp_ns, again.time_step, again.range_min, again.range_max) == (7, 1e-4, 0.1, 20.0)
    reading = message_from_text(text_from_message(ImuSample(8, np.array([0.1, 0.2, 9.8]), np.array([1e-4, 0, 2]))), 0)
    assert isinstance(reading, ImuSample)
    assert [*reading.accel, *reading.gyro] == pytest.approx([0.1, 0.2, 9.8, 1e-4, 0, 2])


def test_a_line_without_a_stamp_gets_the_time_of_its_arrival() -> None:
    assert message_from_text("wheels - 3 -4", 123) == WheelTicks(123, 3, -4)


@given(st.lists(st.integers(1, 9), min_size=1, max_size=20))
def test_lines_are_found_however_the_bytes_are_split(sizes: list[int]) -> None:
    data = b"f a line\nwheels 1 2 3\r\nwheels 4 5 6\n\nwheels 7 8"
    lines, found = SensorLines(), []
    for size in [*sizes, len(data)]:
        part, data = data[:size], data[size:]
        found += lines.feed(part, 0)
    assert found == [WheelTicks(1, 2, 3), WheelTicks(4, 5, 6)]
    assert lines.bad == 0


@pytest.mark.parametrize(
    "line",
    ["speed 1 2 3", "wheels", "wheels 1 2", "wheels 1 2 3 4", "wheels x 2 3", "imu 1 2 3", "imu 1 1 1 nan 1 1 1",
     "scan 1 0 0.1 0 0 20", "scan 1 nan 0.1 0 0 20 1 1", "\\xff\\xfe"],
)  # fmt: skip
def test_an_invalid_line_is_counted_and_shown(line: str) -> None:
    lines = SensorLines()
    assert lines.feed(b"\n" + line.encode() + b"\nwheels 1 2 3\n", 0) == [WheelTicks(1, 2, 3)]
    assert (lines.bad, lines.last_bad) == (1, line)


@given(st.binary(max_size=400))
def test_no_bytes_raise_an_error(data: bytes) -> None:
    lines = SensorLines()
    lines.feed(data, 0)
    assert lines.feed(b"\nwheels 1 2 3\n", 0)[-1:] == [WheelTicks(1, 2, 3)]


def test_an_endless_line_does_not_fill_the_memory() -> None:
    lines = SensorLines()
    for _ in range(4):
        lines.feed(b"9" * LONGEST_LINE, 0)
    assert len(lines._pending) == LONGEST_LINE
