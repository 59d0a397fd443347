"""Message streams and their staleness."""

from __future__ import annotations

import pytest

from waychair.topics import COMMAND, GOAL, SCAN


@pytest.mark.parametrize(
    ("age_ms", "stale"), [(0, False), (499, False), (500, False), (501, True), (-500, False), (-501, True)]
)
def test_f11_a_scan_is_stale_after_half_a_second_and_so_is_one_from_the_future(age_ms: int, stale: bool) -> None:
    now = 10**12
    assert SCAN.is_stale(now - age_ms * 10**6, now) is stale


def test_a_topic_without_a_message_is_stale_unless_it_has_no_rate() -> None:
    assert COMMAND.is_stale(None, 0)
    assert not GOAL.is_stale(None, 0)
    assert COMMAND.max_age_ns() == 150_000_000
