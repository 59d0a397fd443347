"""The proven best ways of a few chairs equal those of a plain joint search, and they meet nowhere."""

from __future__ import annotations

import heapq
from itertools import combinations, product

import pytest

from tests.planning.fleet.small_traffic import SMALL
from waychair.maps.traffic.traffic_graph import TrafficGraph
from waychair.planning.fleet.cbs import Constraint, barred_entries, barred_uses, best_ways
from waychair.planning.fleet.sipp import Stay, earliest, gaps_between
from waychair.planning.fleet.ways import Ways, ways_of

_QUICK, _CLEARING_MS = 1000.0, 1


def plain_best(ways: Ways, starts: tuple[int, ...], goals: tuple[str, ...]) -> int | None:
    """Return the least sum of arrivals [ms], by a search over all spots and times of all chairs; None if there is none.

    A state is the spot of each chair and the time that it has still to pass there, 1 if it can leave in the next
    millisecond.
    """
    begin = tuple((start, 1) for start in starts)
    queue, known = [(0, begin)], {begin: 0}
    while queue:
        price, now = heapq.heappop(queue)
        if all(ways.names[spot] == goal for (spot, _), goal in zip(now, goals, strict=True)):
            return price
        if price > known[now]:
            continue
        used = [int(ways.resource[spot]) for spot, _ in now]
        options = []
        for k, (spot, left) in enumerate(now):
            mine = [(spot, max(left - 1, 0))]
            for other in ways.after[ways.first[spot] : ways.first[spot + 1]].tolist() if left <= 1 else []:
                if not ways.is_barred(goals[k])[other] and int(ways.resource[other]) not in used:
                    mine.append((other, int(ways.passing_ms[other])))
            options.append(mine)
        for then in product(*options):
            resources = [int(ways.resource[spot]) for spot, _ in then]
            if len(set(resources)) < len(resources):
                continue
            step = sum(ways.names[spot] != goal for (spot, _), goal in zip(now, goals, strict=True))
            if price + step < known.get(then, 1 << 30):
                known[then] = price + step
                heapq.heappush(queue, (price + step, then))
    return None


def found_best(ways: Ways, starts: tuple[int, ...], goals: tuple[str, ...], most: int) -> dict[int, tuple[Stay, ...]]:
    def way_of(chair: int, constraints: tuple[Constraint, ...]) -> tuple[Stay, ...]:
        gaps = gaps_between(ways, barred_uses(ways, constraints), 0)
        barred = barred_entries(constraints)
        return earliest(ways, gaps, starts[chair], 1, goals[chair], _CLEARING_MS, barred=barred)

    best = best_ways(ways, dict.fromkeys(range(len(starts)), 1.0), way_of, _CLEARING_MS, most)
    return {} if best is None else dict(best.ways)


@pytest.mark.parametrize("graph", SMALL, ids=lambda graph: graph.name)
def test_proven_ways_of_two_chairs_are_the_best_there_are(graph: TrafficGraph) -> None:
    ways = ways_of(graph, _QUICK)
    names = list(ways.slots)
    proven = 0
    for here, there in product(combinations(names, 2), combinations(names, 2)):
        for goals in (there, there[::-1]):
            starts = tuple(ways.slots[name][0] for name in here)
            best = found_best(ways, starts, goals, 300)
            if not best:
                continue
            proven += 1
            assert sum(way[-1].from_ms for way in best.values()) == plain_best(ways, starts, goals), (here, goals)
            for one, other in product(best[0], best[1]):
                apart = one.until_ms <= other.from_ms or other.until_ms <= one.from_ms
                assert apart or ways.resource[one.spot] != ways.resource[other.spot]
    assert proven >= len(names)
