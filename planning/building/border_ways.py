"""Ways between two nodes, unpacked from the border tables, from their end."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from waychair.maps.building.costs import CLOSED_MM
from waychair.maps.building.graph_arrays import Int32Array
from waychair.planning.building.border_costs import (
    NO_STATE,
    SEARCHED,
    costs_into,
    costs_out,
    joined,
    searched,
    sums_room,
)
from waychair.planning.building.border_kernels import around_at
from waychair.planning.building.overlay import (
    AFTER,
    ANCESTOR,
    ARCS,
    AROUND,
    BEFORE,
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
    OUT,
    OUT_STATE,
    OWNERS,
    PARENT,
    ROWS,
    STATES,
    UP,
    WITHIN,
    Int64Array,
    Net,
    StateArray,
    Tables,
    is_child_entry,
    meeting_depth,
    wide,
)


class BorderMemory(NamedTuple):
    """Memory of a query: sums of costs (2, count), sub-maps to go on with (levels, 9), and a chain of states."""

    sums: Int32Array
    waiting: Int64Array
    chain: Int32Array


def query_room(tables: Tables) -> BorderMemory:
    """Return memory for queries of these tables."""
    book = tables.book
    levels = (book.shape[1] - ANCESTOR) // LEVEL
    return BorderMemory(
        sums_room(book), np.empty((levels + 2, 9), np.int64), np.empty(int(book[:, STATES].max()) + 1, np.int32)
    )


_AROUND, _LINK = 3, 8
"""First columns of `BorderMemory.waiting` that hold the levels of a way round about, and the exits that a way climbs by."""


@njit(cache=True)
def _emit_row(tables: Tables, waiting: Int64Array, m: int, row: int, state: int, way: Int32Array, count: int) -> int:
    """Append the arcs from a state back to a row's, within `m`; children are unpacked, too.

    An arc that is the last one already is not appended again: two overlays see it.
    """
    book, numbers, steps = tables.book, tables.numbers, tables.steps
    depth, room, at = 0, len(way), state
    last = wide(way[count - 1]) if 0 < count <= room else -1
    arcs, rows, entries = book[m, ARCS], book[m, ROWS], book[m, ENTRIES]
    before_at = book[m, BEFORE] + row * book[m, STATES]
    while True:
        arc = wide(numbers[arcs + at])
        if arc != last:
            if count < room:
                way[count] = arc
            count += 1
            last = arc
        if at == row:
            if depth == 0:
                return count
            depth -= 1
            m, row, at = waiting[depth, 0], waiting[depth, 1], waiting[depth, 2]
        else:
            before = wide(steps[before_at + at])
            if at >= rows or at < entries or not is_child_entry(book, m, before):
                at = before
                continue
            c = wide(numbers[book[m, OWNERS] + at - entries])  # over a child
            waiting[depth, 0], waiting[depth, 1], waiting[depth, 2] = m, row, before
            depth += 1
            m, row, at = c, before - book[c, ENTRIES_IN], book[c, EXITS_AT] + at - book[c, EXITS_IN]
        arcs, rows, entries = book[m, ARCS], book[m, ROWS], book[m, ENTRIES]
        before_at = book[m, BEFORE] + row * book[m, STATES]


@njit(cache=True)
def _emit_around(tables: Tables, waiting: Int64Array, m: int, row: int, state: int, way: Int32Array, count: int) -> int:
    """Append the arcs from a state (an entry of a child of `m`) back to a row (an exit of a child), by any way."""
    book, numbers = tables.book, tables.numbers
    levels, depth = waiting[:, _AROUND:_LINK], 0  # at each level: sub-map, row, state, exit, entry
    levels[0, 0], levels[0, 1], levels[0, 2] = m, row, state
    while True:
        here, one, other = levels[depth, 0], levels[depth, 1], levels[depth, 2]
        columns, rows = book[here, COLUMNS], book[here, ROWS]
        width, start = book[here, EXITS_AT] - rows, book[here, WITHIN]
        least = numbers[book[here, AROUND] + (one - book[here, ENTRIES]) * width + other - rows]
        if numbers[start + one * columns + other - rows] == least:
            break
        for x in range(book[here, EXITS]):
            there = wide(numbers[start + one * columns + width + x])
            if there < least:
                for e in range(book[here, ENTRIES]):
                    back = numbers[start + e * columns + other - rows]
                    if there + numbers[around_at(book, here, x, e)] + back == least:
                        levels[depth, 3], levels[depth, 4] = x, e
        depth += 1
        levels[depth, 0] = book[here, PARENT]
        levels[depth, 1] = book[here, EXITS_IN] + levels[depth - 1, 3]
        levels[depth, 2] = book[here, ENTRIES_IN] + levels[depth - 1, 4]
    for k in range(depth):
        count = _emit_row(tables, waiting, levels[k, 0], levels[k, 4], levels[k, 2], way, count)
    count = _emit_row(tables, waiting, levels[depth, 0], levels[depth, 1], levels[depth, 2], way, count)
    for k in range(depth - 1, -1, -1):
        exit = book[levels[k, 0], EXITS_AT] + levels[k, 3]
        count = _emit_row(tables, waiting, levels[k, 0], levels[k, 1], exit, way, count)
    return count


@njit(cache=True)
def _split(numbers: Int32Array, parts: int, own: int, table: int, count: int, onto: int, cost: int) -> int:
    """Return the x of own parts for which `parts[x] + table[x, onto]` is a cost, the first one."""
    for x in range(own):
        if wide(numbers[parts + x]) + numbers[table + x * count + onto] == cost:
            return x
    return -1


@njit(cache=True)
def _emit_into(
    tables: Tables, waiting: Int64Array, goal: int, m: int, c: int, entry: int, cost: int, way: Int32Array, count: int
) -> int:
    """Append the arcs from a node of `m` back to an entry of `c`, in which it lies, at this cost."""
    book, numbers = tables.book, tables.numbers
    own, d, above = book[m, ENTRIES], book[c, DEPTH], book[c, ENTRIES]
    row = (goal - book[m, NODES]) * own
    here = entry
    if m != c:
        here = _split(numbers, book[m, INTO] + row, own, book[m, DOWN + LEVEL * d], above, entry, cost)
    count = _emit_row(tables, waiting, m, here, wide(tables.steps[book[m, INTO_STATE] + row + here]), way, count)
    while m != c:  # up to the entry of c
        p, next_entry = book[m, PARENT], entry
        if p != c:
            rest = wide(numbers[book[m, DOWN + LEVEL * d] + here * above + entry])
            parts = book[m, DOWN + LEVEL * (book[m, DEPTH] - 1)] + here * book[p, ENTRIES]
            next_entry = _split(numbers, parts, book[p, ENTRIES], book[p, DOWN + LEVEL * d], above, entry, rest)
        count = _emit_row(tables, waiting, p, next_entry, book[m, ENTRIES_IN] + here, way, count)
        here, m = next_entry, p
    return count


@njit(cache=True)
def _emit_out(
    tables: Tables, room: BorderMemory, start: int, m: int, c: int, exit: int, cost: int, way: Int32Array, count: int
) -> int:
    """Append the arcs from an exit of `c` back to a node of `m`, which lies in it, at this cost."""
    book, numbers, waiting = tables.book, tables.numbers, room.waiting
    own, d, above = book[m, EXITS], book[c, DEPTH], book[c, EXITS]
    row = (start - book[m, NODES]) * own
    first, links = exit, 0
    if m != c:
        first = _split(numbers, book[m, OUT] + row, own, book[m, UP + LEVEL * d], above, exit, cost)
        here, q = first, m
        while True:  # find the exits climbed by, then unpack from c downwards
            waiting[links, _LINK] = here
            links += 1
            p = book[q, PARENT]
            if p == c:
                break
            rest = wide(numbers[book[q, UP + LEVEL * d] + here * above + exit])
            parts = book[q, UP + LEVEL * (book[q, DEPTH] - 1)] + here * book[p, EXITS]
            here = _split(numbers, parts, book[p, EXITS], book[p, UP + LEVEL * d], above, exit, rest)
            q = p
        onto = exit
        for k in range(links - 1, -1, -1):
            q = book[m, ANCESTOR + LEVEL * (book[m, DEPTH] - k)]
            p, link = book[q, PARENT], waiting[k, _LINK]
            count = _emit_row(tables, waiting, p, book[q, EXITS_IN] + link, book[p, EXITS_AT] + onto, way, count)
            onto = link
    return _emit_after(tables, room, m, first, wide(tables.steps[book[m, OUT_STATE] + row + first]), way, count)


@njit(cache=True)
def _emit_after(tables: Tables, room: BorderMemory, m: int, exit: int, state: int, way: Int32Array, count: int) -> int:
    """Append the arcs from an exit of `m` back to a state, by the states after it; children are unpacked."""
    book, chain = tables.book, room.chain
    at, goal, length = book[m, AFTER] + exit * book[m, STATES], book[m, EXITS_AT] + exit, 1
    chain[0] = state
    while state != goal:
        state = wide(tables.steps[at + state])
        chain[length] = state
        length += 1
    for k in range(length - 1, -1, -1):
        before = wide(chain[k - 1]) if k > 0 else NO_STATE
        count = _emit_state(tables, room.waiting, m, wide(chain[k]), before, way, count)
    return count


@njit(cache=True)
def _emit_state(
    tables: Tables, waiting: Int64Array, m: int, state: int, before: int, way: Int32Array, count: int
) -> int:
    """Append the arc of a state of `m`, and those of the child that lies between it and the state before, if there is one."""
    book, numbers = tables.book, tables.numbers
    if book[m, ENTRIES] <= state < book[m, ROWS] and is_child_entry(book, m, before):
        c = wide(numbers[book[m, OWNERS] + state - book[m, ENTRIES]])
        exit = book[c, EXITS_AT] + state - book[c, EXITS_IN]
        return _emit_row(tables, waiting, c, before - book[c, ENTRIES_IN], exit, way, count)
    arc = numbers[book[m, ARCS] + state]
    if 0 < count <= len(way) and way[count - 1] == arc:
        return count
    if count < len(way):
        way[count] = arc
    return count + 1


@njit(cache=True)
def _emit_joined(
    tables: Tables,
    room: BorderMemory,
    start: int,
    one: int,
    goal: int,
    other: int,
    left: int,
    right: int,
    way: Int32Array,
) -> tuple[int, int]:
    """Append the arcs of the cheapest way from a node of `one` in `left` to one of `other` in `right`, by the table around
    the parent of these two; return its cost and how many there are."""
    book, numbers, sums, top = tables.book, tables.numbers, room.sums, tables.book[left, PARENT]
    costs_out(book, numbers, start, one, left, sums[0])
    costs_into(book, numbers, goal, other, right, sums[1])
    cost, x, e = joined(book, numbers, top, left, right, sums)
    if x < 0:
        return cost, 0
    count = _emit_into(tables, room.waiting, goal, other, right, e, wide(sums[1, e]), way, wide(0))
    row, state = book[left, EXITS_IN] + x, book[right, ENTRIES_IN] + e
    count = _emit_around(tables, room.waiting, top, row, state, way, count)
    return cost, _emit_out(tables, room, start, one, left, x, wide(sums[0, x]), way, count)


@njit(cache=True)
def _turned(way: Int32Array, count: int) -> None:
    """Turn the order of the first arcs round, if they are all there."""
    if count <= len(way):
        for k in range(count >> 1):
            way[k], way[count - 1 - k] = way[count - 1 - k], way[k]


@njit(cache=True)
def table_way(
    node_submap: Int32Array,
    book: Int64Array,
    numbers: Int32Array,
    steps: StateArray,
    sums: Int32Array,
    waiting: Int64Array,
    chain: Int32Array,
    start: int,
    goal: int,
    way: Int32Array,
) -> tuple[int, int]:
    """As `way_between`, but the cost is `SEARCHED` where no table has it; Python hands on single arrays faster."""
    one, other = wide(node_submap[start]), wide(node_submap[goal])
    d = meeting_depth(book, one, other)
    if book[one, DEPTH] == d or book[other, DEPTH] == d:
        return SEARCHED, 0
    left, right = book[one, ANCESTOR + LEVEL * (d + 1)], book[other, ANCESTOR + LEVEL * (d + 1)]
    tables, room = Tables(book, numbers, steps), BorderMemory(sums, waiting, chain)
    cost, count = _emit_joined(tables, room, start, one, goal, other, left, right, way)
    _turned(way, count)
    return cost, count


@njit(cache=True)
def way_between(
    net: Net, tables: Tables, room: BorderMemory, start: int, goal: int, way: Int32Array
) -> tuple[int, int]:
    """Fill the arcs of the cheapest way into `way`; return its cost and how many arcs there are, also if too many.

    The cost is `CLOSED_MM` if there is none.
    """
    book, sums = tables.book, room.sums
    cost, count = table_way(
        net.node_submap, book, tables.numbers, tables.steps, sums, room.waiting, room.chain, start, goal, way
    )
    if cost != SEARCHED:
        return cost, count
    one, other = wide(net.node_submap[start]), wide(net.node_submap[goal])
    top = book[one, ANCESTOR + LEVEL * meeting_depth(book, one, other)]
    cost, last, before = searched(net, tables, start, goal, sums)
    if last >= 0:
        count = _emit_searched(tables, room, start, one, goal, other, top, last, before, way)
    elif start != goal and cost < CLOSED_MM:
        count = _emit_joined(tables, room, start, one, goal, other, top, top, way)[1]
    _turned(way, count)
    return cost, count


@njit(cache=True)
def _emit_searched(
    tables: Tables,
    room: BorderMemory,
    start: int,
    one: int,
    goal: int,
    other: int,
    m: int,
    last: int,
    before: Int32Array,
    way: Int32Array,
) -> int:
    """Append the arcs of a way found by `searched` in the overlay of `m`."""
    book, numbers, sums = tables.book, tables.numbers, room.sums
    count, s, d = wide(0), last, book[m, DEPTH] + 1
    if other != m:
        c = book[other, ANCESTOR + LEVEL * d]
        costs_into(book, numbers, goal, other, c, sums[1])
        e = last - book[c, ENTRIES_IN]
        count = _emit_into(tables, room.waiting, goal, other, c, e, wide(sums[1, e]), way, count)
    while True:
        b = wide(before[s])
        count = _emit_state(tables, room.waiting, m, s, b, way, count)
        if b < 0:
            break
        s = b
    if b != NO_STATE:
        c, x = book[one, ANCESTOR + LEVEL * d], -1 - b
        costs_out(book, numbers, start, one, c, sums[0])
        count = _emit_out(tables, room, start, one, c, x, wide(sums[0, x]), way, count)
    return count


@njit(cache=True)
def ways_between(
    net: Net, tables: Tables, room: BorderMemory, starts: Int32Array, goals: Int32Array, way: Int32Array
) -> tuple[Int32Array, Int32Array]:
    """Return the costs [mm] and numbers of arcs (Q,) of many ways, each written out into `way` in turn."""
    found, counts = np.empty(len(starts), np.int32), np.empty(len(starts), np.int32)
    for q in range(len(starts)):
        found[q], counts[q] = way_between(net, tables, room, wide(starts[q]), wide(goals[q]), way)
    return found, counts
