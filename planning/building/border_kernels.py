"""The kernels that make border tables: within each sub-map bottom-up, around it top-down, labels of its nodes.

A table's rows are the entries of the sub-map and the exits of its children, its columns the entries of its children and
its own exits (`overlay`). All rows of a table are found together: the states are relaxed in turn, in both directions,
until nothing changes, and each relaxation treats all rows at once (SIMD). Costs are int32 millimetres; two costs of at
most `CLOSED_MM` can be added, and no sum is kept that reaches it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from waychair.maps.building.costs import CLOSED_MM
from waychair.maps.building.graph_arrays import GraphArrays, Int32Array
from waychair.planning.building.overlay import (
    COLUMNS,
    EXITS_AT,
    ROWS,
    STATES,
    Int64Array,
    Layout,
    arc_of_state,
    overlay,
    state_of_arc,
)
from waychair.types import BoolArray

StateArray = NDArray[np.uint16] | NDArray[np.int32]


class Borders(NamedTuple):
    """The tables, one behind the other from `first` (M + 1,) on: `within` each sub-map, and `around`.

    `around` holds only the exits of children (rows) and the entries of children (columns), from `around_first` on, at the
    least cost of any way, also one that leaves the sub-map and returns.
    """

    first: Int64Array
    within: Int32Array
    around_first: Int64Array
    around: Int32Array


class Steps(NamedTuple):
    """The ways behind the tables. `before[first + row * states + state]` is the state before it on the way from a row;
    `after[after_first + exit * states + state]` the state after it on the way to an exit. States count in the overlay;
    `state_arc[state_first[m] + state]` is the arc of each."""

    first: Int64Array
    before: StateArray
    after_first: Int64Array
    after: StateArray
    state_first: Int64Array
    state_arc: Int32Array


class Labels(NamedTuple):
    """Costs [mm] between each node and its own sub-map's exits and entries, and the first or last state of the way.

    `out[out_first[m] + (node - node_first[m]) * exits + exit]`; `into` likewise, by entries.
    """

    out_first: Int64Array
    out: Int32Array
    out_state: StateArray
    into_first: Int64Array
    into: Int32Array
    into_state: StateArray


class Climbs(NamedTuple):
    """Costs [mm] within an ancestor at depth d, from two levels above on: `up[up_first[m, d]]` from the exits of m to the
    ancestor's exits, `down[down_first[m, d]]` from the ancestor's entries to those of m, by (of m, of the ancestor)."""

    up_first: Int64Array
    up: Int32Array
    down_first: Int64Array
    down: Int32Array


class Tables(NamedTuple):
    """All tables of a building."""

    layout: Layout
    borders: Borders
    steps: Steps
    labels: Labels
    climbs: Climbs


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
def solve(graph: GraphArrays, tables: Tables, m: int) -> int:
    """Make the table of `m` within it, its ways and its nodes' labels; return which parts above it have changed.

    The bits of the answer: 1, from entries to exits; 2, from children's exits to its exits or from its entries to
    children's entries; 4, any other.
    """
    lay, borders, steps, labels = tables.layout, tables.borders, tables.steps, tables.labels
    first, to, weight = overlay(graph, lay, borders.first, borders.within, m)
    rows, columns, states = lay.sizes[m, ROWS], lay.sizes[m, COLUMNS], lay.sizes[m, STATES]
    exits_at, exits = lay.sizes[m, EXITS_AT], lay.exit_first[m + 1] - lay.exit_first[m]
    entries = lay.entry_first[m + 1] - lay.entry_first[m]
    cost, came = np.empty((states, rows), np.int32), np.empty((states, rows), np.int32)
    _relaxed(first, to, weight, rows, cost, came)
    changed = 0
    for r in range(rows):
        at = borders.first[m] + r * columns
        for q in range(columns):
            if borders.within[at + q] != cost[rows + q, r]:
                borders.within[at + q] = cost[rows + q, r]
                if r < entries and q >= columns - exits:
                    changed |= 1
                elif r < entries or q >= columns - exits:
                    changed |= 2
                else:
                    changed |= 4
    for r in range(rows):
        at = steps.first[m] + r * states
        for s in range(states):
            steps.before[at + s] = came[s, r]
    back, after = np.empty((states, exits), np.int32), np.empty((states, exits), np.int32)
    _relaxed_back(first, to, weight, exits_at, exits, back, after)
    for x in range(exits):
        at = steps.after_first[m] + x * states
        for s in range(states):
            steps.after[at + s] = after[s, x]
    _label(graph, lay, labels, m, cost, back)
    return changed


@njit(cache=True)
def _label(
    graph: GraphArrays, lay: Layout, labels: Labels, m: int, cost: NDArray[np.int32], back: NDArray[np.int32]
) -> None:
    low, high, states = lay.node_first[m], lay.node_first[m + 1], lay.sizes[m, STATES]
    entries, exits = lay.entry_first[m + 1] - lay.entry_first[m], lay.exit_first[m + 1] - lay.exit_first[m]
    outs, ins = labels.out_first[m], labels.into_first[m]
    labels.out[outs : outs + (high - low) * exits] = CLOSED_MM
    labels.into[ins : ins + (high - low) * entries] = CLOSED_MM
    if exits > 0:
        for node in range(low, high):
            at = outs + (node - low) * exits
            for b in range(graph.first[node], graph.first[node + 1]):
                if graph.cost[b] < CLOSED_MM:
                    s = state_of_arc(graph, lay, m, b)
                    for x in range(exits):
                        if graph.cost[b] + back[s, x] < labels.out[at + x]:
                            labels.out[at + x], labels.out_state[at + x] = graph.cost[b] + back[s, x], s
    if entries > 0:
        for s in range(states):
            node = graph.head[arc_of_state(lay, m, s)]
            if graph.node_submap[node] == m:
                at = ins + (node - low) * entries
                for e in range(entries):
                    if cost[s, e] < labels.into[at + e]:
                        labels.into[at + e], labels.into_state[at + e] = cost[s, e], s


@njit(cache=True)
def outside(lay: Layout, borders: Borders, parent: int, m: int, exit: int, entry: int) -> int:
    """Return the cost of the cheapest way from an exit of `m` to an entry of it, by their positions."""
    p_entries = lay.entry_first[parent + 1] - lay.entry_first[parent]
    row = lay.exits_at[m] - p_entries + exit
    width = lay.sizes[parent, EXITS_AT] - lay.sizes[parent, ROWS]
    return int(
        borders.around[borders.around_first[parent] + row * width + lay.entries_at[m] - lay.sizes[parent, ROWS] + entry]
    )


@njit(cache=True)
def surround(lay: Layout, borders: Borders, parents: Int32Array, m: int, changed: BoolArray) -> bool:
    """Make the table around `m` from that within it and that around its parent; mark children that see a change."""
    rows, columns = lay.sizes[m, ROWS], lay.sizes[m, COLUMNS]
    entries, exits = lay.entry_first[m + 1] - lay.entry_first[m], lay.exit_first[m + 1] - lay.exit_first[m]
    height, width = rows - entries, columns - exits
    if height == 0 or width == 0:
        return False
    made = np.empty((height, width), np.int32)
    start = borders.first[m]
    for r in range(height):
        made[r] = borders.within[start + (entries + r) * columns : start + (entries + r) * columns + width]
    parent = parents[m]
    if parent >= 0 and exits > 0 and entries > 0:
        over = np.empty((exits, entries), np.int32)
        for x in range(exits):
            for e in range(entries):
                over[x, e] = outside(lay, borders, parent, m, x, e)
        for r in range(height):
            row = made[r]
            for e in range(entries):
                least = CLOSED_MM
                for x in range(exits):
                    least = min(least, borders.within[start + (entries + r) * columns + width + x] + over[x, e])
                if least < CLOSED_MM:
                    there = np.int32(least)
                    back = borders.within[start + e * columns : start + e * columns + width]
                    for q in range(width):
                        row[q] = min(row[q], np.int32(back[q] + there))
    at, any_change = borders.around_first[m], False
    for k in range(lay.child_first[m], lay.child_first[m + 1]):
        c = lay.child[k]
        top, left = lay.exits_at[c] - entries, lay.entries_at[c] - rows
        for x in range(lay.exit_first[c + 1] - lay.exit_first[c]):
            for e in range(lay.entry_first[c + 1] - lay.entry_first[c]):
                if borders.around[at + (top + x) * width + left + e] != made[top + x, left + e]:
                    changed[c] = True
    for r in range(height):
        for q in range(width):
            if borders.around[at + r * width + q] != made[r, q]:
                borders.around[at + r * width + q] = made[r, q]
                any_change = True
    return any_change


@njit(cache=True)
def climb(lay: Layout, borders: Borders, climbs: Climbs, parents: Int32Array, m: int) -> None:
    """Make the costs between the borders of `m` and those of its ancestors, given those of its parent."""
    p = parents[m]
    exits, entries = lay.exit_first[m + 1] - lay.exit_first[m], lay.entry_first[m + 1] - lay.entry_first[m]
    for d in range(1, lay.depth[m] - 1):
        a = lay.ancestor[m, d]
        over, under = lay.exit_first[a + 1] - lay.exit_first[a], lay.entry_first[a + 1] - lay.entry_first[a]
        up, down = climbs.up_first[m, d], climbs.down_first[m, d]
        for x in range(exits):
            for y in range(over):
                climbs.up[up + x * over + y] = CLOSED_MM
            for z in range(lay.exit_first[p + 1] - lay.exit_first[p]):
                part = to_parent(lay, borders, p, m, x, z)
                if part < CLOSED_MM:
                    for y in range(over):
                        rest = up_cost(lay, borders, climbs, p, d, z, y)
                        climbs.up[up + x * over + y] = min(climbs.up[up + x * over + y], part + rest)
        for e in range(entries):
            for y in range(under):
                climbs.down[down + e * under + y] = CLOSED_MM
            for z in range(lay.entry_first[p + 1] - lay.entry_first[p]):
                part = from_parent(lay, borders, p, m, z, e)
                if part < CLOSED_MM:
                    for y in range(under):
                        rest = down_cost(lay, borders, climbs, p, d, z, y)
                        climbs.down[down + e * under + y] = min(climbs.down[down + e * under + y], part + rest)


@njit(cache=True, inline="always")
def to_parent(lay: Layout, borders: Borders, p: int, m: int, exit: int, onto: int) -> int:
    """Return the cost within the parent `p` from an exit of its child `m` to an exit of its own."""
    columns = lay.sizes[p, COLUMNS]
    exits_at = lay.sizes[p, EXITS_AT] - lay.sizes[p, ROWS]
    return int(borders.within[borders.first[p] + (lay.exits_at[m] + exit) * columns + exits_at + onto])


@njit(cache=True, inline="always")
def from_parent(lay: Layout, borders: Borders, p: int, m: int, entry: int, onto: int) -> int:
    """Return the cost within the parent `p` from an entry of its own to an entry of its child `m`."""
    columns = lay.sizes[p, COLUMNS]
    return int(borders.within[borders.first[p] + entry * columns + lay.entries_at[m] - lay.sizes[p, ROWS] + onto])


@njit(cache=True, inline="always")
def up_cost(lay: Layout, borders: Borders, climbs: Climbs, m: int, d: int, exit: int, onto: int) -> int:
    """Return the cost from an exit of `m` to an exit of its ancestor at depth d, 1 <= d < its own depth."""
    a = lay.ancestor[m, d]
    if d == lay.depth[m] - 1:
        return to_parent(lay, borders, a, m, exit, onto)
    return int(climbs.up[climbs.up_first[m, d] + exit * (lay.exit_first[a + 1] - lay.exit_first[a]) + onto])


@njit(cache=True, inline="always")
def down_cost(lay: Layout, borders: Borders, climbs: Climbs, m: int, d: int, entry: int, above: int) -> int:
    """Return the cost to an entry of `m` from an entry of its ancestor at depth d, `above`; d as in `up_cost`."""
    a = lay.ancestor[m, d]
    if d == lay.depth[m] - 1:
        return from_parent(lay, borders, a, m, above, entry)
    return int(climbs.down[climbs.down_first[m, d] + entry * (lay.entry_first[a + 1] - lay.entry_first[a]) + above])


@njit(cache=True)
def build(graph: GraphArrays, tables: Tables) -> None:
    """Make all tables: within bottom-up, around and climbs top-down."""
    lay, maps, steps = tables.layout, len(graph.parent), tables.steps
    for m in range(maps - 1, -1, -1):
        for state in range(lay.sizes[m, STATES]):
            steps.state_arc[steps.state_first[m] + state] = arc_of_state(lay, m, state)
        solve(graph, tables, m)
    changed = np.zeros(maps, np.bool_)
    for m in range(maps):
        surround(lay, tables.borders, graph.parent, m, changed)
        if m > 0:
            climb(lay, tables.borders, tables.climbs, graph.parent, m)


@njit(cache=True)
def repair(graph: GraphArrays, tables: Tables, arcs: Int32Array) -> Int32Array:
    """Make the tables anew after the costs of arcs have changed; return how many were made within and around (2,)."""
    lay, maps = tables.layout, len(graph.parent)
    within, around = np.zeros(maps, np.bool_), np.zeros(maps, np.bool_)
    climbing = np.zeros(maps, np.bool_)
    for k in range(len(arcs)):
        within[graph.node_submap[graph.tail[arcs[k]]]] = True
    made = np.zeros(2, np.int32)
    for m in range(maps - 1, -1, -1):
        if within[m]:
            parts = solve(graph, tables, m)
            made[0] += 1
            around[m] = parts != 0
            climbing[m] = parts & 2 != 0
            if parts & 1 and m > 0:
                within[graph.parent[m]] = True
    for m in range(maps):
        if around[m] and surround(lay, tables.borders, graph.parent, m, around):
            made[1] += 1
        if m > 0 and climbing[graph.parent[m]]:
            climb(lay, tables.borders, tables.climbs, graph.parent, m)
            climbing[m] = True  # and its children, too
    return made
