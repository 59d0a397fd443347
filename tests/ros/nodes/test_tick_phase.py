"""Ticks that follow regular messages: how soon, how far from their period, and how late after the message."""

from __future__ import annotations

import random
from itertools import pairwise

import pytest

from waychair.ros.nodes.parts.tick_phase import TickPhase

MS = 1_000_000
PERIOD = 50 * MS
BEHIND = 6 * MS


def ticks_and_waits(first_news_ns: int, jitter_ns: int, count: int = 400) -> tuple[list[int], list[int]]:
    """Run a timer of 50 ms, shifted by messages every 100 ms; return its ticks, and the wait of each message for the
    next one."""
    phase, rng = TickPhase(PERIOD, BEHIND), random.Random(first_news_ns)
    news = [first_news_ns + k * 2 * PERIOD + rng.randint(0, jitter_ns) for k in range(count)]
    ticks, waits, due_ns, period_ns = [], [], 0, PERIOD
    waiting: list[int] = []
    while news:
        if news[0] <= due_ns:
            waiting.append(news.pop(0))
            period_ns = phase.message_arrived(waiting[-1])
            continue
        phase.ticked(due_ns)
        ticks.append(due_ns)
        waits += [due_ns - came_ns for came_ns in waiting]
        waiting.clear()
        due_ns, period_ns = due_ns + period_ns, PERIOD  # a period that is set holds from the next tick to the one after
    return ticks, waits


@pytest.mark.parametrize("first_ms", range(0, 100, 7))
def test_from_any_phase_ticks_come_just_after_the_messages_within_two_seconds(first_ms: int) -> None:
    _, waits = ticks_and_waits(first_ms * MS + 1, 0)
    assert all(abs(wait - BEHIND) <= MS for wait in waits[40:])


@pytest.mark.parametrize("first_ms", range(0, 100, 7))
def test_no_period_is_changed_by_more_than_two_milliseconds(first_ms: int) -> None:
    ticks, _ = ticks_and_waits(first_ms * MS + 1, 10 * MS)
    assert all(abs(after - before - PERIOD) <= 2 * MS for before, after in pairwise(ticks))


def test_messages_late_by_some_milliseconds_are_rarely_missed() -> None:
    _, waits = ticks_and_waits(30 * MS, 8 * MS)
    assert sum(wait > 15 * MS for wait in waits[40:]) <= 0.02 * len(waits)


def test_before_the_first_tick_the_period_is_unchanged() -> None:
    assert TickPhase(PERIOD, BEHIND).message_arrived(123 * MS) == PERIOD
