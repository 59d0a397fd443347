"""Costs between two nodes, read from the border tables.

A way from one sub-map into another leaves the first by an exit and enters the second by an entry for the last time; in
between, the table around their common sub-map has the cost. Where an end is a node of the common sub-map itself, its
overlay is searched, a few hundred states.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from waychair.maps.building.costs import CLOSED_MM
from waychair.maps.building.graph_arrays import GraphArrays, Int32Array
from waychair.planning.building.border_kernels import (
    Tables,
    down_cost,
    outside,
    up_cost,
)
from waychair.planning.building.overlay import (
    COLUMNS,
    EXITS_AT,
    ROWS,
    STATES,
    Layout,
    arc_of_state,
    meeting_depth,
    overlay,
    state_of_arc,
)
from waychair.planning.building.packed_heap import SHIFT, pop, push

NO_STATE = -(1 << 30)
"""Before a state at which a way begins in the sub-map itself."""


@njit(cache=True)
def exits_of(lay: Layout, m: int) -> int:
    return int(lay.exit_first[m + 1] - lay.exit_first[m])


@njit(cache=True)
def entries_of(lay: Layout, m: int) -> int:
    return int(lay.entry_first[m + 1] - lay.entry_first[m])


@njit(cache=True)
def costs_out(tables: Tables, node: int, m: int, c: int, costs: Int32Array) -> int:
    """Fill the costs from a node of `m` to the exits of `c`, which is `m` or an ancestor; return how many there are."""
    lay, labels = tables.layout, tables.labels
    own, count = exits_of(lay, m), exits_of(lay, c)
    at = labels.out_first[m] + (node - lay.node_first[m]) * own
    if c == m:
        costs[:own] = labels.out[at : at + own]
        return own
    costs[:count] = CLOSED_MM
    d = lay.depth[c]
    for x in range(own):
        part = labels.out[at + x]
        if part < CLOSED_MM:
            for y in range(count):
                costs[y] = min(costs[y], part + up_cost(lay, tables.borders, tables.climbs, m, d, x, y))
    return count


@njit(cache=True)
def costs_into(tables: Tables, node: int, m: int, c: int, costs: Int32Array) -> int:
    """Fill the costs from the entries of `c` to a node of `m`, below or in it; return how many there are."""
    lay, labels = tables.layout, tables.labels
    own, count = entries_of(lay, m), entries_of(lay, c)
    at = labels.into_first[m] + (node - lay.node_first[m]) * own
    if c == m:
        costs[:own] = labels.into[at : at + own]
        return own
    costs[:count] = CLOSED_MM
    d = lay.depth[c]
    for e in range(own):
        part = labels.into[at + e]
        if part < CLOSED_MM:
            for y in range(count):
                costs[y] = min(costs[y], part + down_cost(lay, tables.borders, tables.climbs, m, d, e, y))
    return count


@njit(cache=True)
def joined(tables: Tables, top: int, one: int, other: int, out: Int32Array, into: Int32Array) -> tuple[int, int, int]:
    """Return the least cost over the exits of `one` and the entries of `other`, children of `top`, and these two."""
    lay, borders = tables.layout, tables.borders
    width = lay.sizes[top, EXITS_AT] - lay.sizes[top, ROWS]
    left = lay.entries_at[other] - lay.sizes[top, ROWS]
    least, exit, entry = CLOSED_MM, -1, -1
    at = borders.around_first[top] + (lay.exits_at[one] - entries_of(lay, top)) * width + left
    for x in range(exits_of(lay, one)):
        if out[x] < least:
            for e in range(entries_of(lay, other)):
                cost = np.int64(out[x]) + borders.around[at + e] + into[e]
                if cost < least:
                    least, exit, entry = cost, x, e
        at += width
    return least, exit, entry


@njit(cache=True)
def cost_between(graph: GraphArrays, tables: Tables, start: int, goal: int, out: Int32Array, into: Int32Array) -> int:
    """Return the cost from node to node [mm], `CLOSED_MM` if there is no way. `out`, `into`: room for all exits, entries."""
    if start == goal:
        return 0
    lay = tables.layout
    one, other = graph.node_submap[start], graph.node_submap[goal]
    d = meeting_depth(lay.depth, lay.ancestor, one, other)
    if lay.depth[one] == d or lay.depth[other] == d:
        return searched(graph, tables, start, goal, d, out, into)[0]
    from_map, to_map = lay.ancestor[one, d + 1], lay.ancestor[other, d + 1]
    costs_out(tables, start, one, from_map, out)
    costs_into(tables, goal, other, to_map, into)
    return joined(tables, lay.ancestor[one, d], from_map, to_map, out, into)[0]


@njit(cache=True)
def searched(
    graph: GraphArrays, tables: Tables, start: int, goal: int, d: int, out: Int32Array, into: Int32Array
) -> tuple[int, int, Int32Array]:
    """Search the overlay of the common sub-map at depth d, of which one end is a node: return cost, last state, befores.

    The state before a first state is -1 - exit if the way comes from a child, else `NO_STATE`.
    """
    lay, borders = tables.layout, tables.borders
    one, other = graph.node_submap[start], graph.node_submap[goal]
    m = lay.ancestor[one, d]
    first, to, weight = overlay(graph, lay, borders.first, borders.within, m)
    states, exits_at = lay.sizes[m, STATES], lay.sizes[m, EXITS_AT]
    cost, before = np.full(states, CLOSED_MM, np.int32), np.full(states, NO_STATE, np.int32)
    tail_cost = np.full(states, CLOSED_MM, np.int32)
    p = graph.parent[m]
    heap, size = np.empty(states + len(to) + exits_of(lay, m) * entries_of(lay, m) + 8, np.int64), 0
    if one == m:
        for b in range(graph.first[start], graph.first[start + 1]):
            if graph.cost[b] < CLOSED_MM:
                s = state_of_arc(graph, lay, m, b)
                cost[s] = graph.cost[b]
                size = push(heap, size, int((np.int64(cost[s]) << SHIFT) | s))
    else:
        c = lay.ancestor[one, d + 1]
        for x in range(costs_out(tables, start, one, c, out)):
            if out[x] < CLOSED_MM:
                s = lay.exits_at[c] + x
                cost[s], before[s] = out[x], -1 - x
                size = push(heap, size, int((np.int64(out[x]) << SHIFT) | s))
    if other == m:
        for s in range(states):
            if graph.head[arc_of_state(lay, m, s)] == goal:
                tail_cost[s] = 0
    else:
        c = lay.ancestor[other, d + 1]
        count = costs_into(tables, goal, other, c, into)
        tail_cost[lay.entries_at[c] : lay.entries_at[c] + count] = into[:count]
    least, last = CLOSED_MM, -1
    while size > 0:
        item = heap[0]
        size = pop(heap, size)
        here, s = item >> SHIFT, item & 0xFFFFFFFF
        if here >= least:
            break
        if here > cost[s]:
            continue
        if here + tail_cost[s] < least:
            least, last = here + tail_cost[s], s
        for k in range(first[s], first[s + 1]):
            if here + weight[k] < cost[to[k]]:
                cost[to[k]], before[to[k]] = here + weight[k], s
                size = push(heap, size, int((np.int64(cost[to[k]]) << SHIFT) | to[k]))
        x = s - exits_at
        if p >= 0 and 0 <= x < exits_of(lay, m):
            for e in range(entries_of(lay, m)):
                new = here + outside(lay, borders, p, m, x, e)
                if new < cost[e]:
                    cost[e], before[e] = new, s
                    size = push(heap, size, int((np.int64(new) << SHIFT) | e))
    return least, last, before


@njit(cache=True)
def _least_sums(
    labels: Int32Array,
    at: int,
    own: int,
    table: Int32Array,
    base: int,
    by_own: int,
    by_other: int,
    sums: Int32Array,
    count: int,
) -> None:
    """Fill the least sums of a label and a table's entry: `labels[at + x] + table[base + x * by_own + y * by_other]`."""
    for y in range(count):
        sums[y] = CLOSED_MM
    for x in range(own):
        part, row = np.int64(labels[at + x]), base + x * by_own
        if part < CLOSED_MM:
            for y in range(count):
                new = part + table[row + y * by_other]
                sums[y] = min(sums[y], new)


@njit(cache=True)
def costs_between(graph: GraphArrays, tables: Tables, starts: Int32Array, goals: Int32Array) -> Int32Array:
    """Return the costs of many ways (Q,) [mm], `CLOSED_MM` where there is none.

    All in one loop over plain arrays: to hand on the tables costs more than the sums.
    """
    lay, labels, climbs = tables.layout, tables.labels, tables.climbs
    submap, depth, ancestor = graph.node_submap, lay.depth, lay.ancestor
    node_first, exit_first, entry_first, sizes = lay.node_first, lay.exit_first, lay.entry_first, lay.sizes
    exits_at, entries_at, first, within = lay.exits_at, lay.entries_at, tables.borders.first, tables.borders.within
    around_first, around = tables.borders.around_first, tables.borders.around
    out_first, all_out, into_first, all_into = labels.out_first, labels.out, labels.into_first, labels.into
    up_first, up, down_first, down = climbs.up_first, climbs.up, climbs.down_first, climbs.down
    out, into = room(lay)
    found = np.empty(len(starts), np.int32)
    for q in range(len(starts)):
        start, goal = starts[q], goals[q]
        one, other = submap[start], submap[goal]
        d = min(depth[one], depth[other])
        while ancestor[one, d] != ancestor[other, d]:
            d -= 1
        if start == goal or depth[one] == d or depth[other] == d:
            found[q] = cost_between(graph, tables, start, goal, out, into)
            continue
        top, left, right = ancestor[one, d], ancestor[one, d + 1], ancestor[other, d + 1]
        exits, entries = exit_first[left + 1] - exit_first[left], entry_first[right + 1] - entry_first[right]
        own = exit_first[one + 1] - exit_first[one]
        at = out_first[one] + np.int64(start - node_first[one]) * own
        if one == left:
            for x in range(own):
                out[x] = all_out[at + x]
        elif depth[one] == d + 2:
            columns = np.int64(sizes[left, COLUMNS])
            base = first[left] + exits_at[one] * columns + sizes[left, EXITS_AT] - sizes[left, ROWS]
            _least_sums(all_out, at, own, within, base, int(columns), 1, out, exits)
        else:
            _least_sums(all_out, at, own, up, up_first[one, d + 1], exits, 1, out, exits)
        own = entry_first[other + 1] - entry_first[other]
        at = into_first[other] + np.int64(goal - node_first[other]) * own
        if other == right:
            for e in range(own):
                into[e] = all_into[at + e]
        elif depth[other] == d + 2:
            base = first[right] + entries_at[other] - sizes[right, ROWS]
            _least_sums(all_into, at, own, within, base, 1, int(sizes[right, COLUMNS]), into, entries)
        else:
            _least_sums(all_into, at, own, down, down_first[other, d + 1], entries, 1, into, entries)
        width = np.int64(sizes[top, EXITS_AT] - sizes[top, ROWS])
        row = around_first[top] + (exits_at[left] - (entry_first[top + 1] - entry_first[top])) * width
        row += entries_at[right] - sizes[top, ROWS]
        least = np.int64(CLOSED_MM)
        for x in range(exits):
            part = np.int64(out[x])
            if part < least:
                for e in range(entries):
                    least = min(least, part + around[row + e] + into[e])
            row += width
        found[q] = least
    return found


@njit(cache=True)
def room(lay: Layout) -> tuple[Int32Array, Int32Array]:
    """Return arrays with room for the costs of all exits and all entries of any sub-map."""
    exits, entries = 1, 1
    for m in range(len(lay.depth)):
        exits, entries = max(exits, exits_of(lay, m)), max(entries, entries_of(lay, m))
    return np.empty(exits, np.int32), np.empty(entries, np.int32)
