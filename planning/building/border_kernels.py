"""The kernels that make border tables: within each sub-map bottom-up, around it top-down, labels of its nodes.

A table's rows are the entries of the sub-map and the exits of its children, its columns the entries of its children and
its own exits (`overlay`). All rows of a table are found together: the states are relaxed in turn, in both directions,
until nothing changes, and each relaxation treats all rows at once (SIMD). Costs are int32 millimetres; two costs of at
most `CLOSED_MM` can be added, and no sum is kept that reaches it.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from waychair.maps.building.costs import CLOSED_MM
from waychair.maps.building.graph_arrays import Int32Array
from waychair.planning.building.overlay import (
    AFTER,
    ANCESTOR,
    ARCS,
    AROUND,
    BEFORE,
    CHILDREN,
    CHILDREN_END,
    COLUMNS,
    DEPTH,
    DOWN,
    ENTRIES,
    ENTRIES_IN,
    EXITS,
    EXITS_AT,
    EXITS_IN,
    INTO,
    INTO_STATE,
    LEVEL,
    NODES,
    NODES_END,
    OUT,
    OUT_STATE,
    PARENT,
    ROWS,
    STATES,
    UP,
    WITHIN,
    Int64Array,
    Net,
    Tables,
    overlay,
    state_of_arc,
    wide,
)
from waychair.types import BoolArray


@njit(cache=True)
def _relaxed(
    first: Int32Array, to: Int32Array, weight: Int32Array, rows: int, cost: NDArray[np.int32], before: NDArray[np.int32]
) -> None:
    """Fill cost and the state before, (S, R), of the cheapest ways from the first R states to all."""
    states = len(first) - 1
    cost[:] = CLOSED_MM
    before[:] = -1
    waiting = np.zeros(states, np.bool_)
    for r in range(rows):
        cost[r, r] = 0
        waiting[r] = True
    step, busy = 1, rows > 0
    while busy:
        busy = False
        s = 0 if step == 1 else states - 1
        for _ in range(states):
            if waiting[s]:
                waiting[s] = False
                here = cost[s]
                for k in range(first[s], first[s + 1]):
                    w, there, came = weight[k], cost[to[k]], before[to[k]]
                    better = 0
                    for r in range(rows):
                        new, old = np.int32(here[r] + w), there[r]
                        is_less = new < old
                        there[r] = new if is_less else old
                        came[r] = np.int32(s) if is_less else came[r]
                        better |= is_less
                    if better:
                        waiting[to[k]] = True
                        busy = True
            s += step
        step = -step


@njit(cache=True)
def _relaxed_back(
    first: Int32Array,
    to: Int32Array,
    weight: Int32Array,
    exits_at: int,
    exits: int,
    cost: NDArray[np.int32],
    after: NDArray[np.int32],
) -> None:
    """Fill cost and the state after, (S, X), of the cheapest ways from all states to the exits."""
    states = len(first) - 1
    cost[:] = CLOSED_MM
    after[:] = -1
    for x in range(exits):
        cost[exits_at + x, x] = 0
    step, busy = -1, exits > 0
    while busy:
        busy = False
        s = 0 if step == 1 else states - 1
        for _ in range(states):
            for k in range(first[s], first[s + 1]):
                b, w = to[k], weight[k]
                for x in range(exits):
                    new = cost[b, x] + w
                    if new < cost[s, x]:
                        cost[s, x], after[s, x] = new, b
                        busy = True
            s += step
        step = -step


@njit(cache=True)
def solve(net: Net, tables: Tables, m: int) -> int:
    """Make the table of `m` within it, its ways and its nodes' labels; return which parts above it have changed.

    The bits of the answer: 1, from entries to exits; 2, from children's exits to its exits or from its entries to
    children's entries; 4, any other.
    """
    book, numbers, steps = tables.book, tables.numbers, tables.steps
    first, to, weight = overlay(net, tables, m)
    rows, columns, states, exits_at = book[m, ROWS], book[m, COLUMNS], book[m, STATES], book[m, EXITS_AT]
    exits, entries = book[m, EXITS], book[m, ENTRIES]
    cost, came = np.empty((states, rows), np.int32), np.empty((states, rows), np.int32)
    _relaxed(first, to, weight, rows, cost, came)
    changed = 0
    for r in range(rows):
        at = book[m, WITHIN] + r * columns
        for q in range(columns):
            if numbers[at + q] != cost[rows + q, r]:
                numbers[at + q] = cost[rows + q, r]
                if r < entries and q >= columns - exits:
                    changed |= 1
                elif r < entries or q >= columns - exits:
                    changed |= 2
                else:
                    changed |= 4
    for r in range(rows):
        at = book[m, BEFORE] + r * states
        for s in range(states):
            steps[at + s] = came[s, r]
    back, after = np.empty((states, exits), np.int32), np.empty((states, exits), np.int32)
    _relaxed_back(first, to, weight, exits_at, exits, back, after)
    for x in range(exits):
        at = book[m, AFTER] + x * states
        for s in range(states):
            steps[at + s] = after[s, x]
    _label(net, tables, m, cost, back)
    return changed


@njit(cache=True)
def _label(net: Net, tables: Tables, m: int, cost: NDArray[np.int32], back: NDArray[np.int32]) -> None:
    """Fill the costs between the nodes of `m` and its exits and entries, and the first or last states of these ways."""
    book, numbers, steps = tables.book, tables.numbers, tables.steps
    low, count, states = book[m, NODES], book[m, NODES_END] - book[m, NODES], book[m, STATES]
    exits, entries, outs, ins = book[m, EXITS], book[m, ENTRIES], book[m, OUT], book[m, INTO]
    numbers[outs : outs + count * exits] = CLOSED_MM
    numbers[ins : ins + count * entries] = CLOSED_MM
    if exits > 0:
        for node in range(low, low + count):
            row = (node - low) * exits
            for b in range(net.first[node], net.first[node + 1]):
                if net.cost[b] < CLOSED_MM:
                    s = state_of_arc(net, tables, m, wide(b))
                    for x in range(exits):
                        new = net.cost[b] + back[s, x]
                        if new < numbers[outs + row + x]:
                            numbers[outs + row + x], steps[book[m, OUT_STATE] + row + x] = new, s
    if entries > 0:
        for s in range(states):
            node = net.head[numbers[book[m, ARCS] + s]]
            if net.node_submap[node] == m:
                row = (node - low) * entries
                for e in range(entries):
                    if cost[s, e] < numbers[ins + row + e]:
                        numbers[ins + row + e], steps[book[m, INTO_STATE] + row + e] = cost[s, e], s


@njit(cache=True)
def around_at(book: Int64Array, m: int, exit: int, entry: int) -> int:
    """Return where the table around the parent of `m` has the cost from an exit of `m` to an entry of it."""
    p = book[m, PARENT]
    width = book[p, EXITS_AT] - book[p, ROWS]
    row, column = book[m, EXITS_IN] - book[p, ENTRIES] + exit, book[m, ENTRIES_IN] - book[p, ROWS] + entry
    return int(book[p, AROUND] + row * width + column)


@njit(cache=True)
def _surround(tables: Tables, m: int, changed: BoolArray) -> bool:
    """Make the table around `m` from that within it and that around its parent; mark children that see a change."""
    book, numbers = tables.book, tables.numbers
    rows, columns, exits, entries = book[m, ROWS], book[m, COLUMNS], book[m, EXITS], book[m, ENTRIES]
    height, width = rows - entries, columns - exits
    if height == 0 or width == 0:
        return False
    made = np.empty((height, width), np.int32)
    start = book[m, WITHIN]
    for r in range(height):
        for q in range(width):
            made[r, q] = numbers[start + (entries + r) * columns + q]
    if m > 0 and exits > 0 and entries > 0:
        for r in range(height):
            row = made[r]
            for e in range(entries):
                least = wide(CLOSED_MM)
                for x in range(exits):
                    over = numbers[around_at(book, m, x, e)]
                    least = min(least, wide(numbers[start + (entries + r) * columns + width + x]) + over)
                if least < CLOSED_MM:
                    there = np.int32(least)
                    back = numbers[start + e * columns : start + e * columns + width]
                    for q in range(width):
                        row[q] = min(row[q], np.int32(back[q] + there))
    at, any_change = book[m, AROUND], False
    for k in range(book[m, CHILDREN], book[m, CHILDREN_END]):
        c = numbers[k]
        top, left = book[c, EXITS_IN] - entries, book[c, ENTRIES_IN] - rows
        for x in range(book[c, EXITS]):
            for e in range(book[c, ENTRIES]):
                if numbers[at + (top + x) * width + left + e] != made[top + x, left + e]:
                    changed[c] = True
    for r in range(height):
        for q in range(width):
            if numbers[at + r * width + q] != made[r, q]:
                numbers[at + r * width + q] = made[r, q]
                any_change = True
    return any_change


@njit(cache=True)
def _climb(tables: Tables, m: int) -> None:
    """Make the costs between the borders of `m` and those of its ancestors, given those of its parent."""
    book, numbers = tables.book, tables.numbers
    p, depth, exits, entries = book[m, PARENT], book[m, DEPTH], book[m, EXITS], book[m, ENTRIES]
    if depth < 2:
        return
    columns, own = book[p, COLUMNS], book[m, UP + LEVEL * (depth - 1)]
    for x in range(exits):  # within the parent
        at = book[p, WITHIN] + (book[m, EXITS_IN] + x) * columns + columns - book[p, EXITS]
        for z in range(book[p, EXITS]):
            numbers[own + x * book[p, EXITS] + z] = numbers[at + z]
    own_down = book[m, DOWN + LEVEL * (depth - 1)]
    for e in range(entries):
        at = book[p, WITHIN] + book[m, ENTRIES_IN] - book[p, ROWS] + e
        for z in range(book[p, ENTRIES]):
            numbers[own_down + e * book[p, ENTRIES] + z] = numbers[at + z * columns]
    for d in range(1, depth - 1):
        a = book[m, ANCESTOR + LEVEL * d]
        for x in range(exits):
            _add_up(numbers, own + x * book[p, EXITS], book[p, EXITS], book[p, UP + LEVEL * d], book[a, EXITS],
                    book[m, UP + LEVEL * d] + x * book[a, EXITS])  # fmt: skip
        for e in range(entries):
            _add_up(numbers, own_down + e * book[p, ENTRIES], book[p, ENTRIES], book[p, DOWN + LEVEL * d],
                    book[a, ENTRIES], book[m, DOWN + LEVEL * d] + e * book[a, ENTRIES])  # fmt: skip


@njit(cache=True)
def _add_up(numbers: Int32Array, parts: int, own: int, table: int, count: int, sums: int) -> None:
    """Fill the least sums of parts (own,) and a table (own, count)."""
    for y in range(count):
        numbers[sums + y] = CLOSED_MM
    for x in range(own):
        part = numbers[parts + x]
        for y in range(count):
            numbers[sums + y] = min(numbers[sums + y], np.int32(part + numbers[table + x * count + y]))


@njit(cache=True)
def make(net: Net, tables: Tables, within: BoolArray, afresh: bool) -> Int32Array:
    """Make the tables within the marked sub-maps (M,), bottom-up, then those around, top-down; return how many (2,).

    All of them if `afresh`, else only those that change by the former, and by the change of others.
    """
    maps = len(tables.book)
    around, climbing = np.full(maps, afresh), np.full(maps, afresh)
    made = np.zeros(2, np.int32)
    made[0] = make_within(net, tables, within, around, climbing, 0, maps)
    made[1] = make_around(tables, around, climbing, 0, maps)
    return made


@njit(cache=True)
def make_within(
    net: Net, tables: Tables, within: BoolArray, around: BoolArray, climbing: BoolArray, begin: int, end: int
) -> int:
    """Make the tables within the marked sub-maps from `end` - 1 down to `begin`; mark what changes by them, and return how many.

    `within`, `around` and `climbing` (M,) mark the sub-maps whose tables within, around and up the tree are to be made.
    """
    made = 0
    for m in range(end - 1, begin - 1, -1):
        if within[m]:
            parts = solve(net, tables, m)
            made += 1
            around[m] |= parts != 0
            climbing[m] |= parts & 2 != 0
            if parts & 1 and m > 0:
                within[tables.book[m, PARENT]] = True
    return made


@njit(cache=True)
def make_around(tables: Tables, around: BoolArray, climbing: BoolArray, begin: int, end: int) -> int:
    """Make the tables around the marked sub-maps from `begin` to `end` - 1, those within all being made; return how many."""
    made = 0
    for m in range(begin, end):
        if around[m] and _surround(tables, m, around):
            made += 1
        if m > 0 and climbing[tables.book[m, PARENT]]:
            _climb(tables, m)
            climbing[m] = True  # and its children, too
    return made
