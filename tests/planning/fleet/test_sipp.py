"""The earliest way among the stays of others equals a plain search, and its own stays meet none of them."""

from __future__ import annotations

import numpy as np

from tests.planning.fleet.small_traffic import SMALL, TEE, plain_earliest
from waychair.planning.fleet.sipp import Stay, earliest, gaps_between
from waychair.planning.fleet.ways import NEVER, Ways, ways_of

_QUICK = 1000.0
"""m/s; a section of 3 m takes 3 ms, so that a plain search can try every millisecond."""

_CLEARING_MS = 2


def random_stays(ways: Ways, rng: np.random.Generator, start: int) -> list[Stay]:
    """Return stays of others in all resources but that of the start, three in each on average."""
    stays = []
    for spot in rng.choice(len(ways.names), 3 * ways.resources).tolist():
        if ways.resource[spot] != ways.resource[start]:
            from_ms = int(rng.integers(0, 40))
            until_ms = NEVER if rng.random() < 0.02 else from_ms + int(rng.integers(1, 6))
            stays.append(Stay(spot, from_ms, until_ms))
    return stays


def test_the_earliest_way_equals_a_plain_search_and_meets_nobody() -> None:
    found_ways = 0
    for number in range(120):
        rng = np.random.default_rng(number)
        ways = ways_of(SMALL[number % len(SMALL)], _QUICK)
        names = list(ways.slots)
        start, goal = ways.slots[names[0]][0], names[1 + number % (len(names) - 1)]
        stays = random_stays(ways, rng, start)
        ready_ms = int(rng.integers(0, 4))
        way = earliest(ways, gaps_between(ways, stays, 0), start, ready_ms, goal, _CLEARING_MS)
        plain = plain_earliest(ways, stays, start, ready_ms, goal, _CLEARING_MS, 80)
        assert (way[-1].from_ms if way else None) == plain
        for own in way:
            for stay in stays:
                same = ways.resource[own.spot] == ways.resource[stay.spot]
                assert not (same and own.from_ms < stay.until_ms and stay.from_ms < own.until_ms)
        found_ways += bool(way)
    assert 30 < found_ways < 120


def test_alone_a_chair_needs_the_least_time_and_a_later_limit_changes_nothing() -> None:
    ways = ways_of(TEE, 1.0)
    start = ways.slots["P"][0]
    for goal in ("Q", "T", "U"):
        way = earliest(ways, gaps_between(ways, [], 0), start, 0, goal, 400)
        assert way[-1].from_ms == ways.least_ms(goal)[start] - ways.passing_ms[start]
        assert not earliest(ways, gaps_between(ways, [], 0), start, 0, goal, 400, way[-1].from_ms - 1)
    assert ways.least_ms("P")[start] == 0
