"""Encoder counts over a restart of their counter."""

from __future__ import annotations

from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st

from waychair.calibration.chair_body import CHAIR_A
from waychair.slam.odometry.wheel_counts import WheelCounts
from waychair.types import WheelTicks

TURN, SECOND = 4096, 1_000_000_000
BODY = replace(CHAIR_A, ticks_per_turn=TURN)
COUNT = st.integers(-(2**31), 2**31 - 1)


def test_counts_that_restart_after_a_silence_continue_from_their_last_value() -> None:
    counts = WheelCounts(BODY)
    assert counts.update(WheelTicks(0, 90_000, 80_000)) == WheelTicks(0, 90_000, 80_000)
    assert counts.update(WheelTicks(2 * SECOND, 0, 0)) == WheelTicks(2 * SECOND, 90_000, 80_000)
    assert counts.update(WheelTicks(2 * SECOND + 1, 12, -7)) == WheelTicks(2 * SECOND + 1, 90_012, 79_993)
    assert counts.update(WheelTicks(4 * SECOND, 5, 5)) == WheelTicks(4 * SECOND, 90_005, 80_005)


def test_counts_and_clock_that_restart_together_continue_as_well() -> None:
    counts = WheelCounts(BODY)
    counts.update(WheelTicks(3_000 * SECOND, 90_000, 80_000))
    assert counts.update(WheelTicks(0, 3, 0)) == WheelTicks(0, 90_000, 80_000)


@given(st.lists(st.tuples(COUNT, COUNT), min_size=1, max_size=20))
def test_without_a_silence_nothing_is_added(readings: list[tuple[int, int]]) -> None:
    counts = WheelCounts(BODY)
    for k, (left, right) in enumerate(readings):
        reading = WheelTicks(k * 100_000_000, left, right)
        assert counts.update(reading) == reading


@given(COUNT, st.integers(-TURN, TURN))
def test_a_motion_during_a_silence_is_kept(before: int, moved: int) -> None:
    """Except for one that ends at the start of the counters, which looks like a restart."""
    counts = WheelCounts(BODY)
    counts.update(WheelTicks(0, before, before))
    after = (before + moved + 2**31) % 2**32 - 2**31
    seen = counts.update(WheelTicks(SECOND, after, after))
    assert seen.left == after or abs(after) < TURN // 4


def test_a_second_restart_adds_up_and_wraps() -> None:
    counts = WheelCounts(BODY)
    for second, left in ((0, 2**31 - 10), (2, 0), (3, 3000), (5, 0)):
        seen = counts.update(WheelTicks(second * SECOND, left, left))
    assert seen.left == (2**31 - 10 + 3000 + 2**31) % 2**32 - 2**31
