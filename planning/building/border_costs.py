"""Costs between two nodes, read from the border tables.

A way from one sub-map into another leaves the first by an exit and enters the second by an entry for the last time; in
between, the table around their common sub-map has the cost. Where an end is a node of the common sub-map itself, its
overlay is searched, up to the best way that leaves it and returns.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from waychair.maps.building.costs import CLOSED_MM
from waychair.maps.building.graph_arrays import Int32Array
from waychair.planning.building.overlay import (
    ANCESTOR,
    ARCS,
    AROUND,
    DEPTH,
    DOWN,
    ENTRIES,
    ENTRIES_IN,
    EXITS,
    EXITS_AT,
    EXITS_IN,
    INTO,
    LEVEL,
    NODES,
    OUT,
    PARENT,
    ROWS,
    STATES,
    UP,
    Int64Array,
    Net,
    Tables,
    followers,
    meeting_depth,
    most_followers,
    state_of_arc,
    wide,
)
from waychair.planning.building.packed_heap import SHIFT, pop, push

NO_STATE = -(1 << 30)
"""Before a state at which a way begins in the sub-map itself."""

SEARCHED = -1
"""The answer of `table_cost` where the overlay must be searched."""


def sums_room(book: Int64Array) -> Int32Array:
    """Return memory for the costs to all exits and entries of any sub-map, (2, count)."""
    return np.empty((2, max(1, int(book[:, [EXITS, ENTRIES]].max(initial=1)))), np.int32)


(
    _LABEL_OUT,
    _OWN_EXITS,
    _UP,
    _EXITS,
    _LABEL_INTO,
    _OWN_ENTRIES,
    _DOWN,
    _ENTRIES,
    _BETWEEN,
    _WIDTH,
    _TOUCHED,
    _PLAN,
) = range(12)
"""Columns of a plan: where a query finds its numbers, before it reads them; -1 for `_UP` or `_DOWN` if labels suffice."""

_BLOCK = 32
"""So many queries are planned together: their numbers are then fetched at the same time, and memory is not waited for."""


def new_plan() -> Int64Array:
    """Return memory for the plan of one query."""
    return np.empty(_PLAN, np.int64)


@njit(cache=True)
def _least_sums(numbers: Int32Array, label: int, own: int, table: int, count: int, sums: Int32Array) -> None:
    """Fill the least sums of labels (own,) and a table (own, count); the labels themselves if `table` is -1."""
    if table < 0:
        for x in range(own):
            sums[x] = numbers[label + x]
        return
    for y in range(count):
        sums[y] = CLOSED_MM
    for x in range(own):
        part = numbers[label + x]
        for y in range(count):
            sums[y] = min(sums[y], np.int32(part + numbers[table + x * count + y]))


@njit(cache=True)
def costs_out(book: Int64Array, numbers: Int32Array, node: int, m: int, c: int, costs: Int32Array) -> int:
    """Fill the costs from a node of `m` to the exits of `c`, which is `m` or an ancestor; return how many there are."""
    own, count = book[m, EXITS], book[c, EXITS]
    label = book[m, OUT] + (node - book[m, NODES]) * own
    table = book[m, UP + LEVEL * book[c, DEPTH]] if c != m else -1
    _least_sums(numbers, label, own, table, count, costs)
    return int(count)


@njit(cache=True)
def costs_into(book: Int64Array, numbers: Int32Array, node: int, m: int, c: int, costs: Int32Array) -> int:
    """Fill the costs from the entries of `c` to a node of `m`, below or in it; return how many there are."""
    own, count = book[m, ENTRIES], book[c, ENTRIES]
    label = book[m, INTO] + (node - book[m, NODES]) * own
    table = book[m, DOWN + LEVEL * book[c, DEPTH]] if c != m else -1
    _least_sums(numbers, label, own, table, count, costs)
    return int(count)


@njit(cache=True)
def _between_at(book: Int64Array, top: int, one: int, other: int) -> int:
    """Return where the table around `top` has the cost from the first exit of one child to the first entry of another."""
    width = book[top, EXITS_AT] - book[top, ROWS]
    column = book[other, ENTRIES_IN] - book[top, ROWS]
    return int(book[top, AROUND] + (book[one, EXITS_IN] - book[top, ENTRIES]) * width + column)


@njit(cache=True)
def joined(
    book: Int64Array, numbers: Int32Array, top: int, one: int, other: int, sums: Int32Array
) -> tuple[int, int, int]:
    """Return the least cost over the exits of `one` and the entries of `other`, children of `top`, and these two."""
    least, exit, entry = wide(CLOSED_MM), -1, -1
    at, width = _between_at(book, top, one, other), book[top, EXITS_AT] - book[top, ROWS]
    for x in range(book[one, EXITS]):
        part = wide(sums[0, x])
        if part < least:
            for e in range(book[other, ENTRIES]):
                cost = part + numbers[at + e] + sums[1, e]
                if cost < least:
                    least, exit, entry = cost, x, e
        at += width
    return least, exit, entry


@njit(cache=True)
def _planned(book: Int64Array, one: int, other: int, start: int, goal: int, plan: Int64Array) -> bool:
    """Fill the plan of a query from a node of sub-map `one` to a node of `other`; return whether tables answer it."""
    d = meeting_depth(book, one, other)
    if book[one, DEPTH] == d or book[other, DEPTH] == d:
        return False
    top, left = book[one, ANCESTOR + LEVEL * d], book[one, ANCESTOR + LEVEL * (d + 1)]
    right = book[other, ANCESTOR + LEVEL * (d + 1)]
    plan[_OWN_EXITS], plan[_OWN_ENTRIES] = book[one, EXITS], book[other, ENTRIES]
    plan[_LABEL_OUT] = book[one, OUT] + (start - book[one, NODES]) * book[one, EXITS]
    plan[_LABEL_INTO] = book[other, INTO] + (goal - book[other, NODES]) * book[other, ENTRIES]
    plan[_UP] = book[one, UP + LEVEL * (d + 1)] if left != one else -1
    plan[_DOWN] = book[other, DOWN + LEVEL * (d + 1)] if right != other else -1
    plan[_EXITS], plan[_ENTRIES] = book[left, EXITS], book[right, ENTRIES]
    is_empty = plan[_EXITS] == 0 or plan[_ENTRIES] == 0  # a table without entries may end before its begin
    plan[_BETWEEN] = 0 if is_empty else _between_at(book, top, left, right)
    plan[_WIDTH] = book[top, EXITS_AT] - book[top, ROWS]
    return True


@njit(cache=True)
def _read(numbers: Int32Array, plan: Int64Array, sums: Int32Array) -> int:
    """Return the cost that a plan leads to [mm]."""
    exits, entries, at = plan[_EXITS], plan[_ENTRIES], plan[_BETWEEN]
    _least_sums(numbers, plan[_LABEL_OUT], plan[_OWN_EXITS], plan[_UP], exits, sums[0])
    _least_sums(numbers, plan[_LABEL_INTO], plan[_OWN_ENTRIES], plan[_DOWN], entries, sums[1])
    least: int = wide(CLOSED_MM)
    for x in range(exits):
        part, rest = wide(sums[0, x]), np.int32(2 * CLOSED_MM)
        if part < least:
            for e in range(entries):
                rest = min(rest, np.int32(numbers[at + e] + sums[1, e]))
            least = min(least, part + wide(rest))
        at += plan[_WIDTH]
    return least


@njit(cache=True)
def table_cost(
    node_submap: Int32Array,
    book: Int64Array,
    numbers: Int32Array,
    start: int,
    goal: int,
    plan: Int64Array,
    sums: Int32Array,
) -> int:
    """Return the cost from node to node [mm], `CLOSED_MM` if there is no way, `SEARCHED` where no table has it."""
    if not _planned(book, wide(node_submap[start]), wide(node_submap[goal]), start, goal, plan):
        return SEARCHED
    return _read(numbers, plan, sums)


@njit(cache=True)
def searched(net: Net, tables: Tables, start: int, goal: int, sums: Int32Array) -> tuple[int, int, Int32Array]:
    """Search the overlay of the common sub-map, of which one end is a node: return cost, last state, and befores.

    The state before a first state is -1 - exit if the way comes from a child, else `NO_STATE`. The last state is -1 if
    the cheapest way leaves the sub-map and returns.
    """
    book, numbers = tables.book, tables.numbers
    one, other = wide(net.node_submap[start]), wide(net.node_submap[goal])
    d = meeting_depth(book, one, other)
    m, least, last = book[one, ANCESTOR + LEVEL * d], wide(CLOSED_MM), -1
    states = book[m, STATES]
    cost, before = np.full(states, CLOSED_MM, np.int32), np.full(states, NO_STATE, np.int32)
    ending = np.full(states, CLOSED_MM, np.int32)
    if start == goal:
        return 0, -1, before
    if m > 0:  # round about
        costs_out(book, numbers, start, one, m, sums[0])
        costs_into(book, numbers, goal, other, m, sums[1])
        least = joined(book, numbers, book[m, PARENT], m, m, sums)[0]
    most, pushes = 1, states
    for s in range(states):
        followed = most_followers(net, tables, m, s)
        most, pushes = max(most, followed), pushes + followed
    to, weight = np.empty(most, np.int32), np.empty(most, np.int32)
    heap, size = np.empty(pushes + 1, np.int64), wide(0)
    if one == m:
        for b in range(net.first[start], net.first[start + 1]):
            if net.cost[b] < CLOSED_MM:
                s = state_of_arc(net, tables, m, wide(b))
                cost[s] = net.cost[b]
                size = push(heap, size, (wide(cost[s]) << SHIFT) | s)
    else:
        c = book[one, ANCESTOR + LEVEL * (d + 1)]
        for x in range(costs_out(book, numbers, start, one, c, sums[0])):
            if sums[0, x] < CLOSED_MM:
                s = book[c, EXITS_IN] + x
                cost[s], before[s] = sums[0, x], -1 - x
                size = push(heap, size, (wide(cost[s]) << SHIFT) | s)
    if other == m:
        for s in range(states):
            if net.head[numbers[book[m, ARCS] + s]] == goal:
                ending[s] = 0
    else:
        c = book[other, ANCESTOR + LEVEL * (d + 1)]
        for e in range(costs_into(book, numbers, goal, other, c, sums[1])):
            ending[book[c, ENTRIES_IN] + e] = sums[1, e]
    while size > 0:
        item = heap[0]
        size = pop(heap, size)
        here, s = item >> SHIFT, item & 0xFFFFFFFF
        if here >= least:
            break
        if here > cost[s]:
            continue
        if here + ending[s] < least:
            least, last = here + ending[s], s
        count = followers(net, tables, m, s, to, weight, wide(0))
        for k in range(count):
            b = wide(to[k])
            if here + weight[k] < cost[b]:
                cost[b], before[b] = here + weight[k], s
                size = push(heap, size, (wide(cost[b]) << SHIFT) | b)
    return least, last, before


@njit(cache=True)
def costs_between(net: Net, tables: Tables, starts: Int32Array, goals: Int32Array, sums: Int32Array) -> Int32Array:
    """Return the costs of many ways (Q,) [mm], `CLOSED_MM` where there is none."""
    found, plans = np.empty(len(starts), np.int32), np.empty((_BLOCK, _PLAN), np.int64)
    submaps, is_planned = np.empty((_BLOCK, 2), np.int64), np.empty(_BLOCK, np.bool_)
    book, numbers = tables.book, tables.numbers
    for begin in range(0, len(starts), _BLOCK):
        count = min(_BLOCK, len(starts) - begin)
        for k in range(count):
            submaps[k, 0], submaps[k, 1] = net.node_submap[starts[begin + k]], net.node_submap[goals[begin + k]]
        for k in range(count):
            start, goal = wide(starts[begin + k]), wide(goals[begin + k])
            is_planned[k] = _planned(book, submaps[k, 0], submaps[k, 1], start, goal, plans[k])
        for k in range(count):
            if is_planned[k]:
                plan = plans[k]
                plan[_TOUCHED] = numbers[plan[_LABEL_OUT]] + numbers[plan[_LABEL_INTO]] + numbers[plan[_BETWEEN]]
                plan[_TOUCHED] += numbers[plan[_UP]] + numbers[plan[_DOWN]]
        for k in range(count):
            if is_planned[k]:
                found[begin + k] = _read(numbers, plans[k], sums)
            else:
                start, goal = wide(starts[begin + k]), wide(goals[begin + k])
                found[begin + k] = searched(net, tables, start, goal, sums)[0]
    return found
