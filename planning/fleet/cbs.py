"""The best ways of a few chairs together, by conflict-based search (CBS) in continuous time.

Each chair takes its earliest way under its own constraints. Where two use one resource at a time, either the first must not
enter it before the second one's use would be over, or the other way round. Where they come towards each other in a run, the
constraint is on the whole run at once, as else every spot in it would be a conflict of its own. (G. Sharon et al.,
Artificial Intelligence 219, 2015; A. Andreychuk et al., "Multi-agent pathfinding with continuous time", IJCAI 2019; J. Li et
al., "Pairwise symmetry reasoning for multi-agent path finding search", Artificial Intelligence 301, 2021.)
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from waychair.planning.fleet.sipp import Stay
from waychair.planning.fleet.ways import NEVER, NOBODYS, Ways
from waychair.types import IntArray

Way = tuple[Stay, ...]


class Entry(NamedTuple):
    """A chair must not enter a spot from a time until a time [ms]."""

    chair: int
    spot: int
    from_ms: int
    until_ms: int


class Use(NamedTuple):
    """A chair must not be in a resource from a time until a time [ms]."""

    chair: int
    resource: int
    from_ms: int
    until_ms: int


Constraint = Entry | Use


@dataclass(frozen=True, slots=True)
class Best:
    """The ways found, and their weighted sum of arrivals; no smaller sum is possible."""

    ways: Mapping[int, Way]
    price: float


def best_ways(
    ways: Ways,
    chairs: Mapping[int, float],
    way_of: Callable[[int, tuple[Constraint, ...]], Way],
    clearing_ms: int,
    most: int,
) -> Best | None:
    """Return the ways of chairs with the least weighted sum of arrivals; None if the search is not done in `most` steps.

    `chairs` are their weights; `way_of` gives a chair's earliest way under constraints, empty if there is none.
    """
    first = {chair: way_of(chair, ()) for chair in chairs}
    if not all(first.values()):
        return None
    count = 0
    queue: list[tuple[float, int, int, dict[int, Way], tuple[Constraint, ...]]] = []

    def push(found: dict[int, Way], constraints: tuple[Constraint, ...]) -> None:
        nonlocal count
        count += 1
        price = sum(weight * found[chair][-1].from_ms for chair, weight in chairs.items())
        heapq.heappush(queue, (price, -len(constraints), count, found, constraints))

    push(first, ())
    for _ in range(most):
        if not queue:
            return None
        price, _, _, found, constraints = heapq.heappop(queue)
        split = _first_conflict(ways, found, clearing_ms)
        if split is None:
            return Best(found, price)
        for constraint in split:
            chair = constraint.chair
            own = tuple(each for each in (*constraints, constraint) if each.chair == chair)
            way = way_of(chair, own)
            if way:
                push({**found, chair: way}, (*constraints, constraint))
    return None


def barred_entries(constraints: tuple[Constraint, ...]) -> IntArray:
    """Return the entries (K, 3) that constraints forbid, as `sipp.earliest` takes them."""
    rows = [(each.spot, each.from_ms, each.until_ms) for each in constraints if isinstance(each, Entry)]
    return np.array(rows, np.int64).reshape(-1, 3)


def barred_uses(ways: Ways, constraints: tuple[Constraint, ...]) -> list[Stay]:
    """Return the uses that constraints forbid, as stays of others."""
    resource = ways.resource.tolist()
    return [
        Stay(resource.index(each.resource), each.from_ms, each.until_ms)
        for each in constraints
        if isinstance(each, Use)
    ]


def _first_conflict(ways: Ways, found: Mapping[int, Way], clearing_ms: int) -> tuple[Constraint, Constraint] | None:
    """Return the two constraints of which each solution keeps one, for the earliest conflict; None if there is none."""
    uses: list[tuple[int, int, int, int, int]] = []
    resource = ways.resource.tolist()
    for chair, way in found.items():
        uses += [(resource[stay.spot], stay.from_ms, stay.until_ms, chair, k) for k, stay in enumerate(way)]
    uses.sort()
    first: tuple[int, tuple[int, int], tuple[int, int]] | None = None
    last: tuple[int, int, int, int, int] | None = None
    for use in uses:
        if last is not None and last[0] == use[0] and use[1] < last[2]:
            if last[3] != use[3] and (first is None or use[1] < first[0]):
                first = (use[1], (last[3], last[4]), (use[3], use[4]))
            if use[2] < last[2]:
                continue
        last = use
    if first is None:
        return None
    _, one, other = first
    return _split_run(ways, found, one, other, clearing_ms) or _split(ways, found, one, other, clearing_ms)


def _split(
    ways: Ways, found: Mapping[int, Way], one: tuple[int, int], other: tuple[int, int], clearing_ms: int
) -> tuple[Constraint, Constraint]:
    """Return the constraints for one resource, which `one` enters first; a place in a way is a chair and an index."""
    a, b = found[one[0]][one[1]], found[other[0]][other[1]]
    resource = int(ways.resource[a.spot])
    least_a, least_b = (_least_ms(ways, found[chair], k, clearing_ms) for chair, k in (one, other))
    until_a = min(a.from_ms + least_a, NEVER)
    if one[1] > 0 and other[1] > 0 and until_a > b.from_ms:
        until_b = min(b.from_ms + least_b, NEVER)
        return Entry(one[0], a.spot, a.from_ms, until_b), Entry(other[0], b.spot, b.from_ms, until_a)
    # one of them waits there, or began there: it must not be there at the last moment of both
    moment = min(a.until_ms, b.until_ms, b.from_ms + least_b) - 1
    return Use(one[0], resource, moment, moment + 1), Use(other[0], resource, moment, moment + 1)


def _least_ms(ways: Ways, way: Way, k: int, clearing_ms: int) -> int:
    """Return the least time for which a chair uses the k-th spot of its way; for ever at its end."""
    return NEVER if k == len(way) - 1 else int(ways.passing_ms[way[k].spot]) + clearing_ms


def _split_run(
    ways: Ways, found: Mapping[int, Way], one: tuple[int, int], other: tuple[int, int], clearing_ms: int
) -> tuple[Constraint, Constraint] | None:
    """Return the constraints for two chairs that come towards each other where neither can turn off; None elsewhere."""
    (a, i), (b, j) = one, other
    way_a, way_b = found[a], found[b]
    resource = ways.resource

    def same(k: int, m: int) -> bool:
        return bool(resource[way_a[k].spot] == resource[way_b[m].spot])

    begin_a, end_b = i, j
    while begin_a > 1 and end_b < len(way_b) - 2 and same(begin_a - 1, end_b + 1) and _only_on(ways, way_a, begin_a):
        begin_a, end_b = begin_a - 1, end_b + 1
    end_a, begin_b = i, j
    while begin_b > 1 and end_a < len(way_a) - 2 and same(end_a + 1, begin_b - 1) and _only_on(ways, way_a, end_a):
        end_a, begin_b = end_a + 1, begin_b - 1
    if not _has_direction(ways, way_a[begin_a]):
        begin_a, end_b = begin_a + 1, end_b - 1
    if not _has_direction(ways, way_b[begin_b]):
        begin_b, end_a = begin_b + 1, end_a - 1
    if begin_a > end_a or begin_a < 1 or begin_b < 1:
        return None
    through_a = sum(int(ways.passing_ms[way_a[k].spot]) for k in range(begin_a, end_a + 1)) + clearing_ms
    through_b = sum(int(ways.passing_ms[way_b[k].spot]) for k in range(begin_b, end_b + 1)) + clearing_ms
    enter_a, enter_b = way_a[begin_a].from_ms, way_b[begin_b].from_ms
    if not (enter_a < enter_b + through_b and enter_b < enter_a + through_a):
        return None
    return (
        Entry(a, way_a[begin_a].spot, enter_a, enter_b + through_b),
        Entry(b, way_b[begin_b].spot, enter_b, enter_a + through_a),
    )


def _has_direction(ways: Ways, stay: Stay) -> bool:
    """Return whether a spot tells the direction of driving: a section does, a node does not."""
    return bool(ways.passing_ms[stay.spot] > 1)


def _only_on(ways: Ways, way: Way, k: int) -> bool:
    """Return whether a chair in the k-th spot of a way can only go on or back, or turn into a place that is its goal."""
    spot = way[k].spot
    after = ways.after[ways.first[spot] : ways.first[spot + 1]]
    beside = set(ways.resource[after[ways.reserved[after] == NOBODYS]].tolist())
    return beside <= {int(ways.resource[way[other].spot]) for other in (k - 1, k, k + 1)}
