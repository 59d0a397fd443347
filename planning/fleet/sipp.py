"""The earliest way of one chair to its goal among the times in which others use the resources: safe intervals (SIPP).

A state is a spot with a gap between two uses of its resource; the earliest time of entering it dominates all later
ones, as a chair can wait in its spot. (M. Phillips, M. Likhachev, "SIPP: safe interval path planning for dynamic
environments", ICRA 2011.)
"""

from __future__ import annotations

import heapq
from collections.abc import Iterable
from itertools import chain
from typing import NamedTuple

import numpy as np
from numba import njit

from waychair.planning.fleet.ways import NEVER, Ways
from waychair.types import BoolArray, IntArray

ANY_ENTRY: IntArray = np.zeros((0, 3), np.int64)
"""No entry is barred."""


class Stay(NamedTuple):
    """A chair's use of a spot [ms]: from entering it until its resource is free again; `until_ms` may be `NEVER`."""

    spot: int
    from_ms: int
    until_ms: int


class Gaps(NamedTuple):
    """The times [ms] in which each resource is free: of resource r, gaps[first[r] : first[r + 1]] (G, 2) from, until."""

    first: IntArray
    gaps: IntArray


def gaps_between(ways: Ways, stays: Iterable[Stay], now_ms: int) -> Gaps:
    """Return the times from now on in which the resources are free between the stays of others."""
    table = np.fromiter(chain.from_iterable(stays), np.int64).reshape(-1, 3)
    return Gaps(*_gaps_between(ways.resource[table[:, 0]], table[:, 1], table[:, 2], ways.resources, now_ms))


@njit(cache=True)
def _gaps_between(
    owner: IntArray, from_ms: IntArray, until_ms: IntArray, resources: int, now_ms: int
) -> tuple[IntArray, IntArray]:
    """Return `Gaps` for stays (K,) in resources `owner`."""
    by_start = np.argsort(from_ms)
    begins = np.zeros(resources + 1, np.int64)
    for each in owner:
        begins[each + 1] += 1
    begins = np.cumsum(begins)
    filled = begins[:-1].copy()
    ordered = np.empty(len(owner), np.int64)
    for k in by_start:  # sorted by resource, then by time
        ordered[filled[owner[k]]] = k
        filled[owner[k]] += 1
    first = np.zeros(resources + 1, np.int64)
    gaps = np.empty((len(owner) + resources, 2), np.int64)
    count = 0
    for resource in range(resources):
        free_from = now_ms
        for k in ordered[begins[resource] : begins[resource + 1]]:
            if from_ms[k] > free_from:
                gaps[count, 0], gaps[count, 1] = free_from, from_ms[k]
                count += 1
            free_from = max(free_from, until_ms[k])
        if free_from < NEVER:
            gaps[count, 0], gaps[count, 1] = free_from, NEVER
            count += 1
        first[resource + 1] = count
    return first, gaps[:count]


def earliest(
    ways: Ways,
    gaps: Gaps,
    start: int,
    ready_ms: int,
    goal: str,
    clearing_ms: int,
    latest_ms: int = NEVER,
    barred: IntArray = ANY_ENTRY,
) -> tuple[Stay, ...]:
    """Return the stays of a chair on its earliest way from a spot to a slot of a refuge, where it stays for good.

    The chair is in `start` since now, can leave it at `ready_ms`, and frees a resource `clearing_ms` after it has entered
    the next one. Empty if it cannot be there by `latest_ms`. `barred` (K, 3) are spots that it must not enter from a time until
    a time [ms].
    """
    towards = ways.towards(goal)
    spots, entered = _earliest(
        ways.resource,
        ways.passing_ms,
        ways.first,
        ways.after,
        towards.is_barred,
        towards.is_goal,
        towards.least_ms,
        gaps.first,
        gaps.gaps,
        start,
        ready_ms,
        clearing_ms,
        latest_ms,
        barred,
    )
    times = entered.tolist()
    until = [*(entered[1:] + clearing_ms).tolist(), NEVER]
    return tuple(map(Stay, spots.tolist(), times, until))


@njit(cache=True)
def _earliest(
    resource: IntArray,
    passing_ms: IntArray,
    first: IntArray,
    after: IntArray,
    is_barred: BoolArray,
    is_goal: BoolArray,
    least_ms: IntArray,
    gap_first: IntArray,
    gaps: IntArray,
    start: int,
    ready_ms: int,
    clearing_ms: int,
    latest_ms: int,
    barred: IntArray,
) -> tuple[IntArray, IntArray]:
    """Return the spots (K,) and the times (K,) of entering them, empty if there is no way; see `earliest`."""
    count = len(resource)
    offset = np.empty(count + 1, np.int64)
    offset[0] = 0
    for spot in range(count):
        offset[spot + 1] = offset[spot] + gap_first[resource[spot] + 1] - gap_first[resource[spot]]
    entered = np.full(offset[count], NEVER, np.int64)
    before = np.full(offset[count], -1, np.int64)
    spot_of = np.empty(offset[count], np.int64)
    for spot in range(count):
        spot_of[offset[spot] : offset[spot + 1]] = spot
    queue = [(np.int64(0), np.int64(0))]
    queue.clear()
    if least_ms[start] < NEVER and offset[start + 1] > offset[start]:
        state = offset[start]
        entered[state] = gaps[gap_first[resource[start]], 0]
        heapq.heappush(queue, (np.int64(ready_ms + least_ms[start]), state))
    found = np.int64(-1)
    done = np.zeros(offset[count], np.bool_)
    while len(queue) > 0:
        key, state = heapq.heappop(queue)
        if done[state]:
            continue
        if key > latest_ms:
            break
        done[state] = True
        spot = spot_of[state]
        gap = gap_first[resource[spot]] + state - offset[spot]
        if is_goal[spot] and gaps[gap, 1] >= NEVER:
            found = state
            break
        leave = ready_ms if before[state] < 0 else entered[state] + passing_ms[spot]
        last = gaps[gap, 1] - clearing_ms
        for edge in range(first[spot], first[spot + 1]):
            other = after[edge]
            if is_barred[other] or least_ms[other] >= NEVER:
                continue
            for other_gap in range(gap_first[resource[other]], gap_first[resource[other] + 1]):
                time = max(leave, gaps[other_gap, 0])
                for _ in range(len(barred)):  # in any order: each pass moves the time beyond one more of them
                    for k in range(len(barred)):
                        if barred[k, 0] == other and barred[k, 1] <= time < barred[k, 2]:
                            time = barred[k, 2]
                if time > last:
                    break
                if time + passing_ms[other] + clearing_ms > gaps[other_gap, 1]:
                    continue
                target = offset[other] + other_gap - gap_first[resource[other]]
                if time < entered[target] and not done[target]:
                    entered[target] = time
                    before[target] = state
                    heapq.heappush(queue, (time + least_ms[other], target))
    length = 0
    state = found
    while state >= 0:
        length += 1
        state = before[state]
    spots, times = np.empty(length, np.int64), np.empty(length, np.int64)
    state = found
    for k in range(length - 1, -1, -1):
        spots[k], times[k] = spot_of[state], entered[state]
        state = before[state]
    return spots, times
