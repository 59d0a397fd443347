"""Ways between two nodes, unpacked from the border tables, from their end."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from waychair.maps.building.costs import CLOSED_MM
from waychair.maps.building.graph_arrays import GraphArrays, Int32Array
from waychair.planning.building.border_costs import (
    NO_STATE,
    costs_into,
    costs_out,
    entries_of,
    exits_of,
    joined,
    room,
    searched,
)
from waychair.planning.building.border_kernels import (
    StateArray,
    Tables,
    down_cost,
    from_parent,
    outside,
    to_parent,
    up_cost,
)
from waychair.planning.building.overlay import (
    COLUMNS,
    EXITS_AT,
    ROWS,
    STATES,
    Int64Array,
    Layout,
    arc_of_state,
    child_of_state,
    meeting_depth,
)


@njit(cache=True)
def _emit(way: Int32Array, count: int, arc: int) -> int:
    """Append an arc, unless it is the last one, which another overlay has seen, too."""
    if 0 < count <= len(way) and way[count - 1] == arc:
        return count
    if count < len(way):
        way[count] = arc
    return count + 1


class Unpacking(NamedTuple):
    """The few arrays that ways are unpacked with, and memory for sub-maps to go on with, (64, 3)."""

    state_first: Int64Array
    state_arc: Int32Array
    before_first: Int64Array
    before: StateArray
    sizes: Int32Array
    exits_at: Int32Array
    entries_at: Int32Array
    entry_first: Int64Array
    child_first: Int32Array
    child: Int32Array
    waiting: Int64Array


@njit(cache=True)
def unpacking(tables: Tables) -> Unpacking:
    """Return the arrays to unpack ways with."""
    lay, steps = tables.layout, tables.steps
    return Unpacking(
        steps.state_first,
        steps.state_arc,
        steps.first,
        steps.before,
        lay.sizes,
        lay.exits_at,
        lay.entries_at,
        lay.entry_first,
        lay.child_first,
        lay.child,
        np.empty((64, 3), np.int64),
    )


@njit(cache=True)
def _emit_row(un: Unpacking, m: int, row: int, state: int, way: Int32Array, count: int) -> int:
    """Append the arcs from a state back to a row's, within `m`; children are unpacked, too."""
    waiting, depth, room = un.waiting, 0, len(way)
    here, one, at = int(m), int(row), int(state)
    rows, states = int(un.sizes[here, ROWS]), int(un.sizes[here, STATES])
    entries = int(un.entry_first[here + 1] - un.entry_first[here])
    arcs, before_at = un.state_first[here], un.before_first[here] + one * states
    last = way[count - 1] if 0 < count <= room else -1
    while True:
        arc = un.state_arc[arcs + at]
        if arc != last:
            if count < room:
                way[count] = arc
            count += 1
            last = arc
        if at == one:
            if depth == 0:
                break
            depth -= 1
            here, one, at = waiting[depth, 0], waiting[depth, 1], waiting[depth, 2]
        else:
            before = int(un.before[before_at + at])
            if at >= rows or at < entries or before < rows or before >= un.sizes[here, EXITS_AT]:
                at = before
                continue
            low, high = un.child_first[here], un.child_first[here + 1] - 1  # over a child: which one has this exit?
            while low < high:
                middle = (low + high + 1) >> 1
                if un.exits_at[un.child[middle]] <= at:
                    low = middle
                else:
                    high = middle - 1
            c = un.child[low]
            waiting[depth, 0], waiting[depth, 1], waiting[depth, 2] = here, one, before
            depth += 1
            at = int(un.sizes[c, EXITS_AT] + at - un.exits_at[c])
            here, one = int(c), int(before - un.entries_at[c])
        rows, states = int(un.sizes[here, ROWS]), int(un.sizes[here, STATES])
        entries = int(un.entry_first[here + 1] - un.entry_first[here])
        arcs, before_at = un.state_first[here], un.before_first[here] + one * states
    return count


@njit(cache=True)
def is_jump(lay: Layout, m: int, c: int, before: int) -> bool:
    """Return whether a state before an exit of the child `c` is one of its entries."""
    return bool(lay.entries_at[c] <= before < lay.entries_at[c] + entries_of(lay, c) and before >= lay.sizes[m, ROWS])


@njit(cache=True)
def _emit_around(
    graph: GraphArrays, tables: Tables, un: Unpacking, m: int, row: int, state: int, way: Int32Array, count: int
) -> int:
    """Append the arcs from a state (an entry of a child of `m`) back to a row (an exit of a child), by any way."""
    lay, borders = tables.layout, tables.borders
    steps, depth = np.empty((64, 5), np.int64), 0  # at each level: sub-map, row, state, exit, entry
    steps[0, 0], steps[0, 1], steps[0, 2] = m, row, state
    while True:
        here, one, other = steps[depth, 0], steps[depth, 1], steps[depth, 2]
        columns, rows = np.int64(lay.sizes[here, COLUMNS]), lay.sizes[here, ROWS]
        width, start = np.int64(lay.sizes[here, EXITS_AT] - rows), borders.first[here]
        least = borders.around[borders.around_first[here] + (one - entries_of(lay, here)) * width + other - rows]
        if borders.within[start + one * columns + other - rows] == least:
            break
        parent = graph.parent[here]
        for x in range(exits_of(lay, here)):
            there = borders.within[start + one * columns + width + x]
            if there < least:
                for e in range(entries_of(lay, here)):
                    back = borders.within[start + e * columns + other - rows]
                    if there + outside(lay, borders, parent, here, x, e) + back == least:
                        steps[depth, 3], steps[depth, 4] = x, e
        depth += 1
        steps[depth, 0] = parent
        steps[depth, 1] = lay.exits_at[here] + steps[depth - 1, 3]
        steps[depth, 2] = lay.entries_at[here] + steps[depth - 1, 4]
    for k in range(depth):
        count = _emit_row(un, steps[k, 0], steps[k, 4], steps[k, 2], way, count)
    count = _emit_row(un, steps[depth, 0], steps[depth, 1], steps[depth, 2], way, count)
    for k in range(depth - 1, -1, -1):
        exit = lay.sizes[steps[k, 0], EXITS_AT] + steps[k, 3]
        count = _emit_row(un, steps[k, 0], steps[k, 1], exit, way, count)
    return count


@njit(cache=True)
def _emit_into(
    graph: GraphArrays,
    tables: Tables,
    un: Unpacking,
    goal: int,
    m: int,
    c: int,
    entry: int,
    cost: int,
    way: Int32Array,
    count: int,
) -> int:
    """Append the arcs from a node of `m` back to an entry of `c`, in which it lies, at this cost."""
    lay, labels = tables.layout, tables.labels
    borders, climbs, d = tables.borders, tables.climbs, lay.depth[c]
    own = entries_of(lay, m)
    at = labels.into_first[m] + (goal - lay.node_first[m]) * np.int64(own)
    below = entry
    if m != c:
        for e in range(own):
            part = labels.into[at + e]
            if part < CLOSED_MM and part + down_cost(lay, borders, climbs, m, d, e, entry) == cost:
                below = e
    count = _emit_row(un, m, below, int(labels.into_state[at + below]), way, count)
    rest, q = cost - labels.into[at + below], m
    while q != c:  # up to the entry of c
        p = graph.parent[q]
        above = entry
        if p != c:
            for z in range(entries_of(lay, p)):
                part = from_parent(lay, borders, p, q, z, below)
                if part < CLOSED_MM and part + down_cost(lay, borders, climbs, p, d, z, entry) == rest:
                    above = z
            rest -= from_parent(lay, borders, p, q, above, below)
        count = _emit_row(un, p, above, lay.entries_at[q] + below, way, count)
        below, q = above, p
    return count


@njit(cache=True)
def _emit_out(
    graph: GraphArrays,
    tables: Tables,
    un: Unpacking,
    start: int,
    m: int,
    c: int,
    exit: int,
    cost: int,
    way: Int32Array,
    count: int,
) -> int:
    """Append the arcs from an exit of `c` back to a node of `m`, which lies in it, at this cost."""
    lay, labels = tables.layout, tables.labels
    borders, climbs, d = tables.borders, tables.climbs, lay.depth[c]
    own = exits_of(lay, m)
    at = labels.out_first[m] + (start - lay.node_first[m]) * np.int64(own)
    chain, length, bottom = np.empty(64, np.int32), 0, exit
    if m != c:
        for x in range(own):
            if (
                labels.out[at + x] < CLOSED_MM
                and labels.out[at + x] + up_cost(lay, borders, climbs, m, d, x, exit) == cost
            ):
                bottom = x
        rest, here, q = cost - labels.out[at + bottom], bottom, m
        chain[0], length = bottom, 1
        while graph.parent[q] != c:
            p = graph.parent[q]
            for z in range(exits_of(lay, p)):
                part = to_parent(lay, borders, p, q, here, z)
                if part < CLOSED_MM and part + up_cost(lay, borders, climbs, p, d, z, exit) == rest:
                    chain[length] = z
                    length += 1
                    here, rest = z, rest - part
                    break
            q = p
        onto = exit
        for k in range(length - 1, -1, -1):  # from c downwards
            q = lay.ancestor[m, lay.depth[m] - k]
            p = graph.parent[q]
            count = _emit_row(un, p, lay.exits_at[q] + chain[k], lay.sizes[p, EXITS_AT] + onto, way, count)
            onto = chain[k]
    return _emit_after(tables, un, m, bottom, int(labels.out_state[at + bottom]), way, count)


@njit(cache=True)
def _emit_after(tables: Tables, un: Unpacking, m: int, exit: int, state: int, way: Int32Array, count: int) -> int:
    """Append the arcs from an exit of `m` back to a state, by the states after it; children are unpacked."""
    lay, steps = tables.layout, tables.steps
    at = steps.after_first[m] + np.int64(exit) * lay.sizes[m, STATES]
    length, s, goal = 1, state, lay.sizes[m, EXITS_AT] + exit
    while s != goal:
        s = int(steps.after[at + s])
        length += 1
    states = np.empty(length, np.int32)
    states[0] = state
    for k in range(1, length):
        states[k] = steps.after[at + states[k - 1]]
    return _emit_states(tables, un, m, states, way, count)


@njit(cache=True)
def _emit_states(tables: Tables, un: Unpacking, m: int, states: Int32Array, way: Int32Array, count: int) -> int:
    """Append the arcs of states of `m`, given in the order of driving, from the last one back."""
    lay = tables.layout
    for k in range(len(states) - 1, -1, -1):
        count = _emit(way, count, arc_of_state(lay, m, states[k]))
        if k > 0:
            c = child_of_state(lay, m, states[k])
            if c >= 0 and states[k] < lay.sizes[m, ROWS] and is_jump(lay, m, c, states[k - 1]):
                exit = lay.sizes[c, EXITS_AT] + states[k] - lay.exits_at[c]
                count = _emit_row(un, c, states[k - 1] - lay.entries_at[c], exit, way, count)
    return count


@njit(cache=True)
def way_between(
    graph: GraphArrays,
    tables: Tables,
    un: Unpacking,
    start: int,
    goal: int,
    out: Int32Array,
    into: Int32Array,
    way: Int32Array,
) -> tuple[int, int]:
    """Fill the arcs of the cheapest way into `way`; return its cost and how many arcs there are, also if too many.

    The cost is `CLOSED_MM` if there is none.
    """
    if start == goal:
        return 0, 0
    lay = tables.layout
    one, other = graph.node_submap[start], graph.node_submap[goal]
    d = meeting_depth(lay.depth, lay.ancestor, one, other)
    count = 0
    if lay.depth[one] == d or lay.depth[other] == d:
        cost, last, before = searched(graph, tables, start, goal, d, out, into)
        if cost < CLOSED_MM:
            count = _emit_searched(graph, tables, un, start, goal, d, last, before, out, into, way)
    else:
        from_map, to_map, top = lay.ancestor[one, d + 1], lay.ancestor[other, d + 1], lay.ancestor[one, d]
        costs_out(tables, start, one, from_map, out)
        costs_into(tables, goal, other, to_map, into)
        cost, x, e = joined(tables, top, from_map, to_map, out, into)
        if cost < CLOSED_MM:
            count = _emit_into(graph, tables, un, goal, other, to_map, e, into[e], way, 0)
            count = _emit_around(
                graph, tables, un, top, lay.exits_at[from_map] + x, lay.entries_at[to_map] + e, way, count
            )
            count = _emit_out(graph, tables, un, start, one, from_map, x, out[x], way, count)
    if count <= len(way):
        for k in range(count >> 1):
            way[k], way[count - 1 - k] = way[count - 1 - k], way[k]
    return cost, count


@njit(cache=True)
def _emit_searched(
    graph: GraphArrays,
    tables: Tables,
    un: Unpacking,
    start: int,
    goal: int,
    d: int,
    last: int,
    before: Int32Array,
    out: Int32Array,
    into: Int32Array,
    way: Int32Array,
) -> int:
    lay = tables.layout
    one, other = graph.node_submap[start], graph.node_submap[goal]
    m, count, s = lay.ancestor[one, d], 0, last
    exits_at = lay.sizes[m, EXITS_AT]
    if other != m:
        c = lay.ancestor[other, d + 1]
        e = last - lay.entries_at[c]
        count = _emit_into(graph, tables, un, goal, other, c, e, into[e], way, count)
    while True:
        count = _emit(way, count, arc_of_state(lay, m, s))
        b = before[s]
        if b == NO_STATE:
            return count
        if b < 0:
            x = -1 - b
            return _emit_out(graph, tables, un, start, one, lay.ancestor[one, d + 1], x, out[x], way, count)
        if s < entries_of(lay, m) and exits_at <= b < exits_at + exits_of(lay, m):
            p = graph.parent[m]
            count = _emit_around(
                graph, tables, un, p, lay.exits_at[m] + b - exits_at, lay.entries_at[m] + s, way, count
            )
        c = child_of_state(lay, m, s)
        if c >= 0 and s < lay.sizes[m, ROWS] and is_jump(lay, m, c, b):
            exit = lay.sizes[c, EXITS_AT] + s - lay.exits_at[c]
            count = _emit_row(un, c, b - lay.entries_at[c], exit, way, count)
        s = b


@njit(cache=True)
def ways_between(
    graph: GraphArrays, tables: Tables, starts: Int32Array, goals: Int32Array, way: Int32Array
) -> tuple[Int32Array, Int32Array]:
    """Return the costs [mm] and numbers of arcs (Q,) of many ways, each written out into `way` in turn."""
    out, into = room(tables.layout)
    un = unpacking(tables)
    found, counts = np.empty(len(starts), np.int32), np.empty(len(starts), np.int32)
    for q in range(len(starts)):
        found[q], counts[q] = way_between(graph, tables, un, starts[q], goals[q], out, into, way)
    return found, counts
